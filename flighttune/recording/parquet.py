"""One Parquet file per run: the record, exact to the bit."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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

# Keys in the metadata of the schema, in the order of the file: the seal must be the last one.
DESCRIPTION = b"flighttune.run"
RUN_SHA256 = b"flighttune.run.sha256"
FLIGHT = b"flighttune.flight"  # JSON: the SHA-256 of all runs flown with this one, in order
SEAL = b"flighttune.file"


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
    return record_bytes(RunRecord.of(run))


def record_bytes(record: RunRecord, flight: Sequence[str] = ()) -> bytes:
    """The Parquet file of a record; `flight` has the SHA-256 of all runs that belong together."""
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None)
            for name, unit in record.columns.items()
        ],
        metadata={
            DESCRIPTION: record.description,
            RUN_SHA256: record.sha256,
            FLIGHT: json.dumps(list(flight)),
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

    A RecordingError says in one line if there is no such file, it is not as flighttune wrote it
    (damaged, edited, of another program or of flighttune 0.1.0), or it has a newer layout.
    """
    path = Path(path)
    data = sealed_bytes(path, PARQUET_FILE)
    with _arrow_errors(path):
        table = pq.ParquetFile(pa.BufferReader(data)).read()
        stated = table.schema.metadata
        record = RunRecord(
            description=stated[DESCRIPTION].decode(),
            rows=np.column_stack([column.to_numpy() for column in table.columns]),
            sha256=stated[RUN_SHA256].decode(),
        )
    with naming(path):
        return record.run()


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
