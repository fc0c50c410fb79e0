"""A tube over time as a Parquet file."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.tube.result import QUANTITIES, Tube
from flighttune.whole_file import whole_file

UNITS = {"chi_err": "rad", "gamma_err": "rad", "phi_cmd": "rad", "n_z_cmd": "1"}


def write_signals(tube: Tube, path: Path) -> None:
    """Write the bounds: ``t`` in s, and every quantity with ``_low`` and ``_high``.

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
    with whole_file(path) as part:
        pq.write_table(pa.table(columns, schema=pa.schema(fields)), part, compression="zstd")
