"""A tube over time as a Parquet file."""

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.tube.flight_hash import ABOUT, flight_sha256
from flighttune.tube.result import QUANTITIES, Tube
from flighttune.whole_file import whole_file

UNITS = {"chi_err": "rad", "gamma_err": "rad", "phi_cmd": "rad", "n_z_cmd": "1"}


def write_signals(tube: Tube, path: Path) -> None:
    """Write the bounds: ``t`` in s, and every quantity with ``_low`` and ``_high``.

    The metadata have the hash of the flight, by which `flighttune.tube.of_run` finds its tube.

    Parameters
    ----------
    tube : Tube
    path : Path
        File to write or replace.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    columns, fields = [pa.array(tube.t)], [pa.field("t", pa.float64(), metadata={"unit": "s"})]
    for i, name in enumerate(QUANTITIES):
        for j, end in enumerate(("low", "high")):
            columns.append(pa.array(tube.bounds[:, i, j]))
            unit = {"unit": UNITS[name]}
            fields.append(pa.field(f"{name}_{end}", pa.float64(), metadata=unit))
    problem = tube.problem
    about = {
        "run": flight_sha256(problem.scenario.as_dict(), problem.plant, problem.gains),
        "status": tube.status,
        "reason": tube.reason,
        "model": tube.model,
        "handed_over_s": tube.handed_over,
        "counted_from_s": tube.counted_from,
    }
    schema = pa.schema(fields, metadata={ABOUT: json.dumps(about).encode()})
    with whole_file(path) as part:
        pq.write_table(pa.table(columns, schema=schema), part, compression="zstd")
