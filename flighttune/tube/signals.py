"""A tube over time as a Parquet file."""

import math
from pathlib import Path

import pyarrow as pa

from flighttune.tube.flight_hash import flight_sha256
from flighttune.tube.result import QUANTITIES, Tube
from flighttune.tube.sealed import AboutTube, write_sealed

UNITS = {"chi_err": "rad", "gamma_err": "rad", "phi_cmd": "rad", "n_z_cmd": "1"}


def write_signals(tube: Tube, path: Path) -> None:
    """Write the bounds: ``t`` in s, and every quantity with ``_low`` and ``_high``.

    The metadata have the hash of the flight, by which `flighttune.tube.of_run` finds its tube.

    Raises OutputError if the file cannot be written.
    """
    columns, fields = [pa.array(tube.t)], [pa.field("t", pa.float64(), metadata={"unit": "s"})]
    for i, name in enumerate(QUANTITIES):
        for j, end in enumerate(("low", "high")):
            columns.append(pa.array(tube.bounds[:, i, j]))
            unit = {"unit": UNITS[name]}
            fields.append(pa.field(f"{name}_{end}", pa.float64(), metadata=unit))
    problem = tube.problem
    about = AboutTube(
        run=flight_sha256(problem.scenario.as_dict(), problem.plant, problem.gains),
        status=tube.status,
        reason=tube.reason,
        model=tube.model,
        start_deg=math.degrees(problem.start),
        handed_over_s=tube.handed_over,
        counted_from_s=tube.counted_from,
        probability=tube.probability,
    )
    write_sealed(pa.table(columns, schema=pa.schema(fields)), about, path)
