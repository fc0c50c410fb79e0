"""One Parquet file a run: the record, exact to the bit."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.recording.whole_file import whole_file
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run

METADATA_KEY = b"flighttune.run"
FORMAT = 1
"""Version of the layout; a file with a higher one is from a newer flighttune."""


def write_run(run: Run, path: str | Path) -> None:
    """Write `run` to one Parquet file: signals as float64 columns, the rest as JSON in the schema.

    Parameters
    ----------
    run : Run
        A flight; its signals may be empty.
    path : str or Path
        File to write or replace; parent folders are made.

    Raises
    ------
    RecordingError
        If the file cannot be written, or the scenario holds what JSON cannot.
    """
    path = Path(path)
    try:
        metadata = json.dumps(_description(run), ensure_ascii=False, sort_keys=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"{path}: the scenario must hold plain values, got {error}."
        ) from error
    columns = {"t": run.signals.index, **{str(name): run.signals[name] for name in run.signals}}
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": "s" if name == "t" else SIGNAL_UNITS[name]})
        if name == "t" or name in SIGNAL_UNITS
        else pa.field(name, pa.float64())
        for name in columns
    ]
    table = pa.table(
        [pa.array(np.asarray(values, dtype=np.float64)) for values in columns.values()],
        schema=pa.schema(fields, metadata={METADATA_KEY: metadata}),
    )
    with whole_file(path) as part:
        pq.write_table(
            table, part, compression="zstd", use_dictionary=False, write_page_checksum=True
        )


def read_run(path: str | Path) -> Run:
    """Return the run that `write_run` wrote to `path`, equal to the bit.

    Parameters
    ----------
    path : str or Path
        A Parquet file of one run.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty, damaged, not Parquet, not a run of flighttune, or
        written by a newer layout.
    """
    path = Path(path)
    table = _read_table(path)
    raw = (table.schema.metadata or {}).get(METADATA_KEY)
    if raw is None:
        raise RecordingError(
            f"{path}: must be a run written by flighttune, got a Parquet file without "
            f"`{METADATA_KEY.decode()}` in its schema."
        )
    try:
        description = json.loads(raw)
        if description["format"] > FORMAT:
            raise RecordingError(
                f"{path}: layout must be {FORMAT} or older, got {description['format']}; "
                "read it with a newer flighttune."
            )
        return _run(description, table)
    except RecordingError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RecordingError(
            f"{path}: must describe a complete run, got {type(error).__name__}: {error}."
        ) from error


def _read_table(path: Path) -> pa.Table:
    if not path.is_file():
        raise RecordingError(f"{path}: must be a Parquet file, got {_what_is(path)}.")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: must be a Parquet file, got an empty file.")
    try:
        return pq.ParquetFile(path, page_checksum_verification=True).read()
    except (pa.ArrowException, OSError) as error:
        line = str(error).splitlines()[0].rstrip(".")
        raise RecordingError(f"{path}: must be a sound Parquet file, got: {line}.") from error


def _what_is(path: Path) -> str:
    return "a folder" if path.is_dir() else "no such file"


def _description(run: Run) -> dict[str, Any]:
    made = run.provenance
    gains = made.gains
    return {
        "format": FORMAT,
        "status": run.status,
        "reason": run.reason,
        "provenance": {
            "scenario": _plain(made.scenario),
            "plant": made.plant,
            "gains_name": made.gains_name,
            "gains": None
            if gains is None
            else {
                "K_P": gains.K_P.tolist(),
                "K_I": gains.K_I.tolist(),
                "inputs": list(gains.inputs),
                "errors": list(gains.errors),
            },
            "seed": made.seed,
            "versions": dict(made.versions),
            "wall_s": made.wall_s,
        },
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return value


def _run(description: dict[str, Any], table: pa.Table) -> Run:
    made = dict(description["provenance"])
    if made["gains"] is not None:
        gains = made["gains"]
        for names in ("inputs", "errors"):
            gains[names] = tuple(gains[names])
        made["gains"] = PIGains(**gains)
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    index = pd.Index(columns.pop("t"), name="t", dtype=np.float64)
    return Run(
        signals=pd.DataFrame(columns, index=index, dtype=np.float64),
        status=description["status"],
        reason=description["reason"],
        provenance=Provenance(**made),
    )
