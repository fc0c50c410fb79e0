"""One Parquet file per run: the record, exact to the bit."""

import hashlib
import json
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.present.names import distinct
from flighttune.seal import BLANK, seal, sealed_bytes
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run
from flighttune.whole_file import whole_file

FORMAT = 2  # version of the layout; a file with a higher one is from a newer flighttune
PARQUET_FILE = "Parquet file"
LONGEST_REASON = 160  # characters of a library's error message that are repeated

# Keys in the metadata of the schema, in the order of the file: the seal must be the last one.
DESCRIPTION = b"flighttune.run"
RUN_SHA256 = b"flighttune.run.sha256"
FLIGHT = b"flighttune.flight"  # JSON: the SHA-256 of all runs flown with this one, in order
SEAL = b"flighttune.file"

# A run as its file holds it: a description (JSON: format, status, reason, provenance, name and unit
# of each column), time in s and signals as the columns of an array, and the SHA-256 of both.
Parts: TypeAlias = tuple[str, FloatArray, str]


def signal_files(runs: Sequence[Run], folder: Path) -> list[Path]:
    """Paths of the Parquet files of the runs of one recording: ``PLANT-GAINS.parquet``."""
    names = (f"{run.provenance.plant}-{run.provenance.gains_name}" for run in runs)
    stems = distinct(re.sub(r"[^A-Za-z0-9.+-]+", "_", name) for name in names)
    return [folder / f"{stem}.parquet" for stem in stems]


def write_run(run: Run, path: str | Path) -> None:
    """Write `run` to one Parquet file: signals as float64 columns, the rest as JSON in the schema.

    The signals may be empty. An existing file is replaced, and parent folders are made.
    """
    path = Path(path)
    with naming(path):
        data = parquet_bytes(run)
    with whole_file(path) as part:
        part.write_bytes(data)


def parquet_bytes(run: Run) -> bytes:
    """The file that `write_run` writes."""
    return record_bytes(parts_of(run))


def parts_of(run: Run) -> Parts:
    """Parts of the file of a run; RecordingError if JSON cannot hold its scenario."""
    units = {**run.units, **SIGNAL_UNITS}
    description = {
        "format": FORMAT,
        "status": run.status,
        "reason": run.reason,
        "provenance": asdict(run.provenance),
        "columns": {"t": "s", **{str(name): units.get(str(name)) for name in run.signals}},
    }
    text = json.dumps(description, ensure_ascii=False, default=_listed)
    rows = np.column_stack([run.signals.index, run.signals]).astype(float)
    return text, rows, signals_sha256(text, rows)


def _listed(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise RecordingError(f"the scenario must hold plain values, got {value!r}.")


def signals_sha256(description: str, rows: FloatArray) -> str:
    """SHA-256 over a description in UTF-8 and then the rows as little-endian float64."""
    digest = hashlib.sha256(description.encode())
    digest.update(np.ascontiguousarray(rows, dtype="<f8").tobytes())
    return digest.hexdigest()


def record_bytes(parts: Parts, flight: Sequence[str] = ()) -> bytes:
    """The file of a run; `flight` has the SHA-256 of all runs that belong together."""
    description, rows, sha256 = parts
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None)
            for name, unit in json.loads(description)["columns"].items()
        ],
        metadata={
            DESCRIPTION: description,
            RUN_SHA256: sha256,
            FLIGHT: json.dumps(list(flight)),
            SEAL: BLANK,
        },
    )
    values = [pa.array(column) for column in np.ascontiguousarray(rows.T)]
    sink = pa.BufferOutputStream()
    # Without a dictionary: signals hardly repeat a value.
    table = pa.table(values, schema=schema)
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    return seal(sink.getvalue().to_pybytes())


def read_run(path: str | Path) -> Run:
    """Return the run that `write_run` wrote to `path`, equal to the bit.

    A RecordingError says in one line if there is no such file, it is not as flighttune wrote it
    (damaged, edited, of another program or of flighttune 0.1.0), or it has a newer layout.
    """
    path = Path(path)
    data = sealed_bytes(path, PARQUET_FILE)
    with _arrow_errors(path):
        table = pq.ParquetFile(pa.BufferReader(data)).read()
        stated = table.schema.metadata
        rows = np.column_stack([column.to_numpy() for column in table.columns])
        parts = stated[DESCRIPTION].decode(), rows, stated[RUN_SHA256].decode()
    with naming(path):
        return run_of(parts)


def run_of(parts: Parts) -> Run:
    """The run, with signals equal to the bit, if its SHA-256 is that of the other parts."""
    description, rows, sha256 = parts
    if sha256 != signals_sha256(description, rows):
        raise RecordingError(
            "description and signals must have the SHA-256 that was recorded, got another one; "
            "fly it again."
        )
    try:
        entry = json.loads(description)
        if entry["format"] > FORMAT:
            raise RecordingError(
                f"layout must be {FORMAT} or older, got {entry['format']}; "
                "read it with a newer flighttune."
            )
        columns, provenance = entry["columns"], entry["provenance"]
        for name, unit in columns.items():
            if unit != SIGNAL_UNITS.get(name, unit):
                raise RecordingError(f"`{name}` must be in {SIGNAL_UNITS[name]}, got {unit}.")
        gains = provenance.pop("gains")
        if gains is not None:
            gains |= {key: tuple(gains[key]) for key in ("inputs", "errors")}
            gains = PIGains(**gains)
        _, *names = columns
        index = pd.Index(rows[:, 0], name="t", dtype=np.float64)
        own = set(names) - set(SIGNAL_UNITS)
        return Run(
            signals=pd.DataFrame(dict(zip(names, rows[:, 1:].T, strict=True)), index=index),
            status=entry["status"],
            reason=entry["reason"],
            provenance=Provenance(**provenance, gains=gains),
            units={name: columns[name] for name in names if name in own and columns[name]},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, RecordingError):
            raise
        got = f"{type(error).__name__}: {first_line(error)}"
        raise RecordingError(f"must describe a complete run, got {got}.") from error


def recorded_flight(path: Path) -> tuple[str, tuple[str, ...]]:
    """The SHA-256 of the run in a Parquet file, and those of all runs of its flight.

    The latter are empty if the file was written on its own. Errors are those of `read_run`.
    """
    data = sealed_bytes(path, PARQUET_FILE)
    with _arrow_errors(path):
        stated = pq.read_schema(pa.BufferReader(data)).metadata
        return stated[RUN_SHA256].decode(), tuple(json.loads(stated.get(FLIGHT, b"[]")))


@contextmanager
def _arrow_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError, TypeError, ValueError, KeyError) as error:
        got = first_line(error)
        raise RecordingError(f"{path}: must be a {PARQUET_FILE} of a run, got: {got}.") from error


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of the file before the message of a RecordingError in the block."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def first_line(text: object) -> str:
    """The first line of a library's message, cut to a readable length."""
    line = next(iter(str(text).splitlines()), "no reason")
    return textwrap.shorten(line, LONGEST_REASON, placeholder=" ...").rstrip(".")
