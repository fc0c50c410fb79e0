"""One Parquet file per run: the record, exact to the bit."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.errors import RecordingError
from flighttune.present.names import distinct
from flighttune.recording.run_record import RunRecord, first_line, naming
from flighttune.seal import BLANK, seal, sealed_bytes
from flighttune.simulate.run import Run
from flighttune.whole_file import whole_file

PARQUET_FILE = "Parquet file"

DESCRIPTION, RUN_SHA256, PLACE, SEAL = (
    b"flighttune.run",
    b"flighttune.run.sha256",
    b"flighttune.recording",
    b"flighttune.file",
)
"""Keys in the metadata of the schema, in the order of the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """The recording that a Parquet file was written with, and the run of it that it holds.

    Attributes
    ----------
    sha256 : str
        What `seal_of` says of the recording.
    run, runs : int
        Number of the run, from 0, and of all runs in the recording.
    """

    sha256: str
    run: int
    runs: int


def signal_files(runs: Sequence[Run], folder: Path) -> list[Path]:
    """Where the Parquet files of the runs of one recording are: ``PLANT-GAINS.parquet``."""
    names = (f"{run.provenance.plant}-{run.provenance.gains_name}" for run in runs)
    stems = distinct(re.sub(r"[^A-Za-z0-9.+-]+", "_", name) for name in names)
    return [folder / f"{stem}.parquet" for stem in stems]


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
    OutputError
        If the file cannot be written.
    RecordingError
        If the scenario holds what JSON cannot.
    """
    path = Path(path)
    with naming(path):
        data = parquet_bytes(run)
    with whole_file(path) as part:
        part.write_bytes(data)


def parquet_bytes(run: Run, place: Place | None = None) -> bytes:
    """The file that `write_run` writes, next to a recording with its `place` there.

    Raises
    ------
    RecordingError
        If the scenario holds what JSON cannot.
    """
    record = RunRecord.of(run)
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None)
            for name, unit in record.columns.items()
        ],
        metadata={
            DESCRIPTION: record.description,
            RUN_SHA256: record.sha256,
            **({PLACE: json.dumps(asdict(place))} if place else {}),
            SEAL: BLANK,
        },
    )
    values = [pa.array(column) for column in np.ascontiguousarray(record.rows.T)]
    sink = pa.BufferOutputStream()
    pq.write_table(
        pa.table(values, schema=schema),
        sink,
        compression="zstd",
        use_dictionary=False,  # signals hardly repeat a value: a dictionary only costs
    )
    return seal(sink.getvalue().to_pybytes())


def read_run(path: str | Path) -> Run:
    """Return the run that `write_run` wrote to `path`, equal to the bit.

    Parameters
    ----------
    path : str or Path
        A Parquet file of one run.

    Raises
    ------
    RecordingError
        If there is no such file, it is not as flighttune wrote it (damaged, edited, of another
        program or of flighttune 0.1.0), or it has a newer layout.
    """
    path = Path(path)
    record = read_record(path)
    with naming(path):
        return record.run()


def read_record(path: Path) -> RunRecord:
    """The record in a Parquet file; see `read_run`."""
    data = sealed_bytes(path, PARQUET_FILE)
    with _arrow_errors(path):
        table = pq.ParquetFile(pa.BufferReader(data)).read()
        stated = table.schema.metadata
        return RunRecord(
            description=stated[DESCRIPTION].decode(),
            rows=np.column_stack([column.to_numpy() for column in table.columns]),
            sha256=stated[RUN_SHA256].decode(),
        )


def recorded_sha256(path: Path) -> str:
    """The SHA-256 of the record in a Parquet file, without its signals; errors as `read_run`."""
    metadata = _metadata(path)
    with _arrow_errors(path):
        return metadata[RUN_SHA256].decode()


def recorded_place(path: Path) -> Place | None:
    """Where the run of a Parquet file is recorded too, if anywhere; errors as `read_run`."""
    place = _metadata(path).get(PLACE)
    with _arrow_errors(path):
        return None if place is None else Place(**json.loads(place))


def _metadata(path: Path) -> dict[bytes, bytes]:
    data = sealed_bytes(path, PARQUET_FILE)
    with _arrow_errors(path):
        return pq.read_schema(pa.BufferReader(data)).metadata or {}


@contextmanager
def _arrow_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError, TypeError, ValueError, KeyError) as error:
        got = first_line(error)
        raise RecordingError(f"{path}: must be a {PARQUET_FILE} of a run, got: {got}.") from error
