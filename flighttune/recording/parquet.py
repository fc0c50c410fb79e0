"""One Parquet file a run: the record, exact to the bit."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.errors import RecordingError
from flighttune.recording.check import brief
from flighttune.recording.description import FORMAT, described_run, description, signal_table
from flighttune.simulate.run import SIGNAL_UNITS, Run
from flighttune.whole_file import whole_file

METADATA_KEY = b"flighttune.run"


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
        metadata = json.dumps(description(run), ensure_ascii=False, sort_keys=False)
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
        found = json.loads(raw)
        if found["format"] > FORMAT:
            raise RecordingError(
                f"{path}: layout must be {FORMAT} or older, got {found['format']}; "
                "read it with a newer flighttune."
            )
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        return described_run(found, signal_table(columns.pop("t"), columns))
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
        raise RecordingError(
            f"{path}: must be a sound Parquet file, got: {brief(error)}."
        ) from error


def _what_is(path: Path) -> str:
    return "a folder" if path.is_dir() else "no such file"
