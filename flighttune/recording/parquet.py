"""One Parquet file a run: the record, exact to the bit."""

import json
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run
from flighttune.whole_file import whole_file

FORMAT = 1
"""Version of the layout; a file with a higher one is from a newer flighttune."""

METADATA_KEY = b"flighttune.run"

LONGEST_REASON = 160
"""Characters of a library's error message that are repeated."""


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
    with errors_of_description(path):
        metadata = json.dumps(description(run), ensure_ascii=False)
    units = {"t": "s", **SIGNAL_UNITS}
    columns = {"t": run.signals.index, **{str(name): run.signals[name] for name in run.signals}}
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": units[name]} if name in units else None)
            for name in columns
        ],
        metadata={METADATA_KEY: metadata},
    )
    values = [pa.array(np.asarray(column, dtype=np.float64)) for column in columns.values()]
    with whole_file(path) as part:
        pq.write_table(
            pa.table(values, schema=schema),
            part,
            compression="zstd",
            use_dictionary=False,  # signals hardly repeat a value: a dictionary only costs
            write_page_checksum=True,
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
    with errors_of_description(path):
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        return described_run(json.loads(raw), signal_table(columns.pop("t"), columns))


def check_file(path: Path, kind: str) -> None:
    """Raise a RecordingError where `path` is not a file of that kind, or an empty one."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise RecordingError(f"{path}: must be a {kind}, got {got}.")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: must be a {kind}, got an empty file.")


@contextmanager
def errors_of_description(path: Path) -> Iterator[None]:
    """Name the file in what is raised by `described_run` and by reading its entry."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        got = f"{type(error).__name__}: {first_line(error)}"
        raise RecordingError(f"{path}: must describe a complete run, got {got}.") from error


def _read_table(path: Path) -> pa.Table:
    check_file(path, "Parquet file")
    try:
        return pq.ParquetFile(path, page_checksum_verification=True).read()
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(
            f"{path}: must be a sound Parquet file, got: {first_line(error)}."
        ) from error


def description(run: Run) -> dict[str, Any]:
    """Status and provenance of a run as plain values for JSON.

    Raises
    ------
    RecordingError
        If the scenario holds what JSON cannot.
    """
    return {
        "format": FORMAT,
        "status": run.status,
        "reason": run.reason,
        "provenance": _plain(run.provenance),
    }


def described_run(entry: Mapping[str, Any], signals: pd.DataFrame) -> Run:
    """The run that `description` describes, with its signals.

    Raises
    ------
    RecordingError
        If a newer flighttune wrote it.
    KeyError, TypeError, ValueError, AttributeError
        If `entry` is not such a description.
    """
    if entry["format"] > FORMAT:
        raise RecordingError(
            f"layout must be {FORMAT} or older, got {entry['format']}; "
            "read it with a newer flighttune."
        )
    provenance = dict(entry["provenance"])
    if provenance["gains"] is not None:
        names = {key: tuple(provenance["gains"][key]) for key in ("inputs", "errors")}
        provenance["gains"] = PIGains(**{**provenance["gains"], **names})
    return Run(
        signals=signals,
        status=entry["status"],
        reason=entry["reason"],
        provenance=Provenance(**provenance),
    )


def signal_table(t: np.ndarray, columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Signals as a run holds them: float64 columns over `t` in s."""
    index = pd.Index(t, name="t", dtype=np.float64)
    return pd.DataFrame(dict(columns), index=index, dtype=np.float64)


def first_line(text: object) -> str:
    """The first line of a library's message, cut to what a reader takes in."""
    line = next(iter(str(text).splitlines()), "no reason")
    return textwrap.shorten(line, LONGEST_REASON, placeholder=" ...").rstrip(".")


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise RecordingError(f"the scenario must hold plain values, got {value!r}.")
