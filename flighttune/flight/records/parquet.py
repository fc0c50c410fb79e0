"""One Parquet file per run, exact to the bit, and the runs of a folder."""

import hashlib
import json
import os
import re
import warnings
from base64 import b64decode, b64encode
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import RecordingError
from flighttune.base.files import parquet
from flighttune.base.files.load import BLANK, RERUN, file_bytes, seal, sealed_bytes
from flighttune.base.files.table import first_line, json_object
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.base.words import distinct, pick
from flighttune.control.gains import PIGains
from flighttune.flight.loop.run import Alarm, Bounds, Provenance, Run, RunClaim

PARQUET, RECORDING = ".parquet", ".rrd"
PARQUET_FILE, RECORDING_FILE = "Parquet file", "recording (.rrd)"
FORMAT = 3  # version of the layout; other versions are refused

# Keys in the metadata of the schema, in file order; the seal must be last.
DESCRIPTION = b"flighttune.run"
FLIGHT = b"flighttune.flight"  # JSON: the SHA-256 of all runs of the same flight, in order
SEAL = b"flighttune.file"

# Errors from a damaged file or from another program's file.
UNREADABLE = (pa.ArrowException, OSError, LookupError, TypeError, ValueError, AttributeError)

HASHED = 2**16  # number of rows that are reordered at once for the hash

ORIGIN = "record"  # property of a recording with the runs that it shows

# Content of a run's file: a description (JSON: format, status, reason, provenance, name and unit of
# each column), time in s and signals as the columns of an array, and the SHA-256 of both.
Parts: TypeAlias = tuple[str, FloatArray, str]


def signal_files(runs: Sequence[Run], folder: Path) -> list[Path]:
    """Paths of the Parquet files of the runs of one recording: ``PLANT-GAINS.parquet``."""
    names = (f"{run.provenance.plant}-{run.provenance.gains_name}" for run in runs)
    stems = distinct(re.sub(r"[^A-Za-z0-9.+-]+", "_", name) for name in names)
    return [folder / f"{stem}.parquet" for stem in stems]


def parquet_bytes(run: Run) -> bytes:
    """The Parquet file of a run: signals as float64 columns, the rest as JSON in the schema."""
    return record_bytes(parts_of(run))


def parts_of(run: Run) -> Parts:
    """Parts of the file of a run; RecordingError if JSON cannot hold its scenario."""
    units, provenance = {**run.units, **SIGNAL_UNITS}, asdict(run.provenance)
    if (gains := run.provenance.gains) is not None and not gains.feeds_back:
        del provenance["gains"]["feedback"]  # such files keep their earlier format
    description = {
        "format": FORMAT,
        "status": run.status,
        "reason": run.reason,
        "provenance": provenance,
        "columns": {"t": "s", **{str(name): units.get(str(name)) for name in run.signals}},
        **({"claims": [*map(_described, run.claims)]} if run.claims else {}),
    }
    text = json.dumps(description, ensure_ascii=False, default=_listed)
    rows = np.column_stack([run.signals.index, run.signals]).astype(float)
    return text, rows, signals_sha256(text, rows)


def _described(claim: RunClaim) -> dict[str, Any]:
    """A claim as JSON, with its bounds as text of their bytes."""
    ends = b64encode(np.ascontiguousarray(claim.bounds.pairs, dtype="<f8").tobytes()).decode()
    described = {**pick(claim, "kind title sentence"), "units": dict(claim.units), "bounds": ends}
    if claim.no_claim:
        described["no_claim"] = claim.no_claim
    return described | ({"alarm": claim.alarm} if claim.alarm else {})


def _claim_of(described: dict[str, Any], t: FloatArray) -> RunClaim:
    """The claim of a description by `_described`, for a flight with samples at `t` (s)."""
    names = tuple(described["units"])
    values = np.frombuffer(b64decode(described.pop("bounds"), validate=True), dtype="<f8")
    low, high = np.moveaxis(values.reshape(len(t), len(names), 2), -1, 0)
    if "alarm" in described:
        described["alarm"] = Alarm(*described["alarm"])
    return RunClaim(**described, bounds=Bounds(t, low, high, names))


def _listed(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise RecordingError(f"the scenario must hold plain values, got {value!r}.")


def signals_sha256(description: str, rows: FloatArray) -> str:
    """SHA-256 over a description in UTF-8 and then the rows as little-endian float64."""
    digest = hashlib.sha256(description.encode())
    for k in range(0, len(rows), HASHED):
        digest.update(np.ascontiguousarray(rows[k : k + HASHED], dtype="<f8").tobytes())
    return digest.hexdigest()


def record_bytes(parts: Parts, flight: Sequence[str] = ()) -> bytes:
    """The file of a run; `flight`: the SHA-256 of all runs of the flight."""
    description, rows, _ = parts
    parquet.check_size(*rows.shape)  # the content must be readable again
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None)
            for name, unit in json.loads(description)["columns"].items()
        ],
        metadata={DESCRIPTION: description, FLIGHT: json.dumps(list(flight)), SEAL: BLANK},
    )
    values = [pa.array(column) for column in np.ascontiguousarray(rows.T)]
    sink = pa.BufferOutputStream()
    # Without a dictionary, because signals hardly repeat values.
    pq.write_table(pa.table(values, schema=schema), sink, compression="zstd", use_dictionary=False)
    return seal(sink.getvalue().to_pybytes())


def _read(path: Path) -> tuple[Run, str, tuple[str, ...]]:
    """The run in a Parquet file, its SHA-256, and those of all runs recorded with it."""
    data = sealed_bytes(path, PARQUET_FILE)
    try:
        file = parquet.opened(data)
        stated = file.schema_arrow.metadata
        # column by column, so that only one copy is in memory
        rows = np.empty((file.metadata.num_rows, file.metadata.num_columns), order="F")
        for i in range(file.metadata.num_columns):
            rows[:, i] = file.reader.read_column(i).to_numpy()
        description = stated[DESCRIPTION].decode()
        flight = tuple(
            json_object(f'{{"of": {stated.get(FLIGHT, b"[]").decode()}}}', "its flight")["of"]
        )
        return _run_of(description, rows), signals_sha256(description, rows), flight
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except UNREADABLE as error:
        got = f"{type(error).__name__}: {first_line(error)}"
        raise RecordingError(f"{path}: must be a {PARQUET_FILE} of a run, got {got}.") from error


def _run_of(description: str, rows: FloatArray) -> Run:
    """The run of a description and rows, with signals equal to the bit."""
    entry = json_object(description, "its description")
    if entry["format"] != FORMAT:
        got = f"{entry['format']} of another flighttune: fly again"
        raise RecordingError(f"layout must be {FORMAT}, got {got}.")
    columns, provenance = entry["columns"], entry["provenance"]
    for name, unit in columns.items():
        if unit != SIGNAL_UNITS.get(name, unit):
            raise RecordingError(f"`{name}` must be in {SIGNAL_UNITS[name]}, got {unit}.")
    if (gains := provenance.pop("gains")) is not None:
        gains |= {key: tuple(gains[key]) for key in ("inputs", "errors")}
        gains = PIGains(**gains)
    _, *names = columns
    index = pd.Index(rows[:, 0], name="t", dtype=np.float64)
    return Run(
        signals=pd.DataFrame(rows[:, 1:], columns=names or None, index=index, copy=False),
        status=entry["status"],
        reason=entry["reason"],
        provenance=Provenance(**provenance, gains=gains),
        units={name: columns[name] for name in names if name not in SIGNAL_UNITS and columns[name]},
        claims=tuple(_claim_of(claim, rows[:, 0]) for claim in entry.get("claims", ())),
    )


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Runs read from files, and the unread parts of their folder.

    Attributes
    ----------
    path : Path
        The file or folder.
    runs : tuple of Run
        In recorded order. Signals are equal to the written signals to the bit.
    missing : tuple of str
        Runs of the flight without files, and files of other flights in the folder.
    lacks : str
        A sentence about runs of the flight without files; empty if complete.

    Examples
    --------
    >>> files = ft.record(ft.fly(ft.load_scenario("paper_as_printed")), "runs/mine")
    >>> ft.load("runs/mine").missing
    ()
    """

    path: Path
    runs: tuple[Run, ...]
    missing: tuple[str, ...] = ()
    lacks: str = ""

    def __getitem__(self, label: str) -> Run:
        """The run with this label, ``plant / gains``; a KeyError lists the labels."""
        for run in self.runs:
            if run.label == label:
                return run
        raise KeyError(f"{label!r} is not one of {', '.join(run.label for run in self.runs)}")


def load_recording(path: str | Path) -> Recording:
    """Read the runs of a folder, of a Parquet file, or of the files beside a ``.rrd`` file."""
    path = Path(path)
    # If a folder has files of several flights, the newest complete flight counts. Separately
    # written files belong together. Files whose names begin with a dot are remains of a killed
    # command and are not read.
    if os.path.isdir(path):
        return _in_folder(path)
    kind = PARQUET_FILE if path.suffix.lower() == PARQUET else RECORDING_FILE
    head = file_bytes(path, kind, len(RERUN) + 1)
    if head == b"PAR1" or (kind == PARQUET_FILE and not head.startswith(RERUN)):
        return Recording(path=path, runs=(_read(path)[0],))
    return _drawn_in(path)


def recording_in(folder: Path) -> Path | None:
    """The recording (.rrd) in a run folder, if any; several are an error."""
    recordings = _files(folder, RECORDING)
    if len(recordings) > 1:
        names = ", ".join(path.name for path in recordings)
        raise RecordingError(f"{folder}: the folder must hold one recording, got {names}.")
    return recordings[0] if recordings else None


def _files(folder: Path, ending: str) -> list[Path]:
    # A name with a leading dot belongs to an unfinished file.
    return sorted(folder.glob(f"[!.]*{ending}"))


def _by_flight(files: Iterable[Path]) -> dict[tuple[str, ...], dict[str, tuple[Path, Run]]]:
    """For each flight: files and their runs by the SHA-256 of the run."""
    flights: dict[tuple[str, ...], dict[str, tuple[Path, Run]]] = {}
    for file in files:
        run, sha256, flight = _read(file)
        flights.setdefault(flight, {})[sha256] = file, run
    return flights


def _in_folder(folder: Path) -> Recording:
    if not (files := _files(folder, PARQUET)):
        raise RecordingError(f"{folder}: the folder must hold Parquet files of runs, got none.")

    def rank(flight: tuple[tuple[str, ...], dict[str, tuple[Path, Run]]]) -> tuple[bool, float]:
        order, by_hash = flight
        return {*order} <= by_hash.keys(), max(file.stat().st_mtime for file, _ in by_hash.values())

    order, by_hash = max(_by_flight(files).items(), key=rank)
    order = order or tuple(by_hash)
    runs = tuple(by_hash[sha256][1] for sha256 in order if sha256 in by_hash)
    lost, taken = len(order) - len(runs), [file for file, _ in by_hash.values()]
    is_ = "is" if lost == 1 else "are"
    lacks = f"{lost} of {len(order)} runs {is_} missing" if lost else ""
    missing = [f"{folder}: {lacks}"] if lost else []
    missing += [f"{file}: of another flight" for file in files if file not in taken]
    return Recording(path=folder, runs=runs, missing=tuple(missing), lacks=lacks)


def _drawn_in(path: Path) -> Recording:
    """The runs shown in a ``.rrd`` file, if their Parquet files are beside it."""
    check_recording(path)
    if (origin := _origin(path)) is None:
        raise RecordingError(
            f"{path}: the runs must be loaded from Parquet files, got a recording (.rrd) that was "
            "written without any, which only shows the runs."
        )
    folder, flight = origin
    there = _by_flight(_files(path.parent, PARQUET)).get(flight, {})
    if not {*flight} <= there.keys():
        raise RecordingError(
            f"{path}: the runs must be loaded from the Parquet files of the folder {folder}, got a "
            "recording (.rrd) alone, which only shows the runs."
        )
    return Recording(path=path, runs=tuple(there[sha256][1] for sha256 in flight))


def files_shown(recording: Path) -> list[Path]:
    """The Parquet files behind a recording (.rrd), beside it; empty if the recording is damaged."""
    shown = []
    with suppress(RecordingError):
        check_recording(recording)
        _, flight = _origin(recording) or ("", ())
        for file in _files(recording.parent, PARQUET):
            with suppress(RecordingError):
                if flight and _read(file)[2] == flight:
                    shown.append(file)
    return shown


def check_recording(path: str | Path) -> None:
    """Refuse a file that is not a Rerun recording; the viewer reports faults inside a recording."""
    if not file_bytes(Path(path), RECORDING_FILE, len(RERUN)).startswith(RERUN):
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got another file.")


def _origin(path: Path) -> tuple[str, tuple[str, ...]] | None:
    """Folder and SHA-256 of the runs in a recording; None if it lacks them."""
    from rerun.chunk import RrdReader

    try:
        with warnings.catch_warnings(action="ignore"):  # the next error tells the reason
            reader = RrdReader(path)
        store = reader.store(store=reader.recordings()[0])
        for chunk in store.stream().filter(content=f"/__properties/{ORIGIN}").to_chunks():
            stated = chunk.to_record_batch()
            (folder,), sha256 = (stated.column(key)[0].as_py() for key in ("folder", "sha256"))
            return folder, tuple(sha256)
    except Exception as error:  # Rerun and Arrow raise a dozen kinds of errors on a damaged file
        got = first_line(error)
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got: {got}.") from error
    return None
