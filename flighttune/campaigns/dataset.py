"""A campaign on disk: ``campaign.json``, one Parquet file per chunk of runs, and saved signals.

Any reader of Parquet can read ``runs/`` at any time, because every file in it is complete. Hashes
reveal damage: ``campaign.json`` holds its own, and a file of rows has its hash in its name.
"""

import hashlib
import json
import os
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from flighttune.base.errors import InputError, OutputError, RecordingError
from flighttune.base.files import owned, parquet
from flighttune.base.files.budget import PARQUET, file_bytes
from flighttune.base.files.load import CAMPAIGN
from flighttune.base.files.table import hash_of
from flighttune.base.files.whole import allowed, reason_of, remove_unfinished, whole_file
from flighttune.campaigns.flying.columns import NOT_REPRODUCIBLE, Row, table_of
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights, compiled_in
from flighttune.campaigns.planning.plan import FORMAT, Plan, recorded_plan

LOCK = "campaign.lock"
RUNS, SIGNALS = "runs", "signals"

# Folder of unfinished files: not in ``runs``, where a reader's ``*.parquet`` would find them.
WRITING = ".writing"

# Rows are written after another twentieth of the elapsed time, at least 0.25 s and at most 10 s
# apart: a killed campaign loses little, and a long campaign has few files.
KEEP_S, KEEP_SHARE, KEEP_MAX_S = 0.25, 0.05, 10.0

# Statuses of runs without a time history.
NO_SIGNALS = ("crashed", "timed_out", "invalid", "no_gains", "no_trim")

_PART = re.compile(r"part-(\d+)-(\d+)-([0-9a-f]{16})\.parquet")
_SIGNALS = re.compile(r"run-(\d+)\.parquet")


class Part(NamedTuple):
    """A file of rows, as its name describes it."""

    runs: range
    digest: str  # first quarter of the SHA-256 of the file, hexadecimal

    @property
    def path(self) -> str:
        """Path of the file in the folder of the campaign."""
        return f"{RUNS}/part-{self.runs.start:010d}-{self.runs.stop:010d}-{self.digest}.parquet"

    @classmethod
    def holding(cls, runs: range, data: bytes) -> "Part":
        """The part of consecutive runs whose file has these bytes."""
        return cls(runs, hashlib.sha256(data).hexdigest()[:16])


class Dataset:
    """The folder of a campaign, its plan and the versions of libraries that affect its rows."""

    def __init__(self, folder: str | Path, plan: Plan, versions: Mapping[str, str]) -> None:
        self.folder, self.plan, self.versions = Path(folder), plan, dict(versions)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The existing files of rows, in order of runs."""
        names = self._matches(RUNS, _PART)
        all_parts = (Part(range(int(name[1]), int(name[2])), name[3]) for name in names)
        parts = sorted(all_parts, key=lambda part: part.path)
        for part, other in pairwise(parts):
            if other.runs.start < part.runs.stop:
                raise RecordingError(
                    f"{self.folder}: a run must be in one file, got run {other.runs.start} in "
                    f"{part.path} and {other.path}."
                )
        return tuple(parts)

    @property
    def missing(self) -> list[int]:
        """The runs of the plan that no file has."""
        absent = np.ones(self.plan.runs, dtype=bool)
        for part in self.parts:
            absent[part.runs.start : part.runs.stop] = False
        return np.flatnonzero(absent).tolist()

    @property
    def kept(self) -> tuple[int, ...]:
        """The runs with saved signals, in order."""
        return tuple(sorted(int(name[1]) for name in self._matches(SIGNALS, _SIGNALS)))

    def write_plan(self) -> None:
        """Write ``campaign.json``; OutputError on failure, as in the other methods that write."""
        tables = {"format": FORMAT, "versions": self.versions, "plan": self.plan.as_dict()}
        text = json.dumps({**tables, "sha256": hash_of(tables)}, indent=1)
        self._write(CAMPAIGN, f"{text}\n".encode())

    def write_rows(self, fly: Callable[[Plan, Sequence[int]], Iterable[Row]], end: int) -> None:
        """Write rows of missing runs below `end` as they are flown, consecutive ones together."""
        waiting: dict[int, Row] = {}
        missing = [run for run in self.missing if run < end]
        runs = iter(missing)
        following = next(runs, None)
        began = written = time.perf_counter()
        try:
            for row in fly(self.plan, missing):
                waiting[row["run"]] = row
                now = time.perf_counter()
                if now < written + min(max(KEEP_S, KEEP_SHARE * (now - began)), KEEP_MAX_S):
                    continue
                ready = []
                while following in waiting:
                    ready.append(following)
                    following = next(runs, None)
                self._write_waiting(waiting, ready)
                written = now
        finally:
            # After a stop or an error, rows may still wait behind a run that never returned.
            self._write_waiting(waiting, sorted(waiting))

    def _write_waiting(self, waiting: dict[int, Row], runs: Sequence[int]) -> None:
        """Write the rows of these runs, and remove them from the waiting rows."""
        # consecutive runs have the same difference from their index in the list
        for _, span in groupby(enumerate(runs), key=lambda place: place[1] - place[0]):
            rows = [waiting.pop(run) for _, run in span]
            self.write_part(_counting(table_of(self.plan, rows), compiled_in(rows)))

    def write_part(self, rows: pa.Table) -> None:
        """Write the rows of consecutive runs, in order of `run`."""
        first, data = rows.column("run")[0].as_py(), parquet_bytes(rows)
        self._write(Part.holding(range(first, first + len(rows)), data).path, data)

    def read_part(self, part: Part, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of one file; RecordingError if the file was damaged or changed."""
        path = self.folder / part.path
        wanted = None if columns is None else [*dict.fromkeys(["run", *columns])]
        data = file_bytes(path, PARQUET)
        if Part.holding(part.runs, data) != part:
            raise RecordingError(
                f"{path}: is damaged or was changed: it must have the hash in its name; "
                "`campaign --resume` flies its runs again."
            )
        try:
            file = parquet.opened(data)
            if file.metadata.num_rows != len(part.runs):
                raise RecordingError(
                    f"it must have the {len(part.runs)} runs of its name, got "
                    f"{file.metadata.num_rows}."
                )
            # an Arrow thread that releases these bytes while Python exits would crash the process
            return file.read(wanted, use_threads=False)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from error
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise RecordingError(f"{path}: must hold rows of a campaign, got {error}.") from error

    def rows(self, columns: Sequence[str] | None = None) -> pa.Table:
        """All existing rows, in order of `run`, with the count of `compiled_of`."""
        if not (tables := [self.read_part(part, columns) for part in self.parts]):
            raise RecordingError(f"{self.folder}: no run has been flown yet.")
        compiled = sum((compiled_of(table) for table in tables), CompiledFlights())
        try:
            return _counting(pa.concat_tables(tables), compiled)
        except pa.ArrowException as error:
            raise RecordingError(
                f"{self.folder}: files of runs must have the same columns, got {error}."
            ) from error

    def keep_signals(
        self, fly: Callable[[Plan, Sequence[int]], Iterable[tuple[int, bytes]]]
    ) -> None:
        """Fly the selected runs again, save their recordings, and remove all other recordings."""
        campaign, keep = self.plan.campaign, self.plan.campaign.keep
        rows = self.rows(["success", "status", keep.worst_by]).to_pandas()
        rows = rows.loc[~rows["status"].isin(NO_SIGNALS)]
        # The selection: the first failures, the worst by a measure, and a random sample.
        failures = rows.loc[~rows["success"], "run"].head(keep.failures)
        measured = rows.dropna(subset=keep.worst_by)
        worst = measured.sort_values(keep.worst_by, ascending=False, kind="stable")["run"]
        random = np.random.default_rng(np.random.SeedSequence((campaign.seed, len(rows))))
        sample = random.choice(rows["run"].to_numpy(), min(keep.sample, len(rows)), replace=False)
        wanted = {*failures.tolist(), *worst.head(keep.worst).tolist(), *sample.tolist()}
        for run in {*self.kept} - wanted:
            self.remove(_signals_of(run))
        for run, data in fly(self.plan, sorted(wanted.difference(self.kept))):
            self._write(_signals_of(run), data)

    def remove(self, name: str) -> None:
        """Remove a file, named by its path in the folder; OutputError if it cannot be."""
        path = self.folder / name
        owned.check_inside(path, self.folder)
        with allowed(path, "removable", OutputError):
            path.unlink(missing_ok=True)

    def remove_compiled(self) -> int:
        """Remove the rows and recordings of compiled flights; returns how many runs these are."""
        removed = 0
        for part in self.parts:
            try:
                compiled = compiled_of(self.read_part(part, ["run"])).flights
            except RecordingError:  # damaged: its runs are flown again too
                compiled = len(part.runs)
            if compiled:
                self.remove(part.path)
                for run in {*part.runs} & {*self.kept}:
                    self.remove(_signals_of(run))
                removed += len(part.runs)
        return removed

    def remove_all(self) -> None:
        """Remove the campaign, and its folders if nothing else is in them."""
        parts, signals = (part.path for part in self.parts), map(_signals_of, self.kept)
        for name in (*parts, *signals, CAMPAIGN, LOCK):
            self.remove(name)
        for folder in (RUNS, SIGNALS, WRITING, ""):
            with suppress(OSError):  # something else is in it
                (self.folder / folder).rmdir()

    def clean(self) -> None:
        """Remove the unfinished files of a campaign that was killed."""
        remove_unfinished(self.folder / WRITING, older_s=0.0)
        with suppress(OSError):
            (self.folder / WRITING).rmdir()

    def _matches(self, folder: str, name: re.Pattern[str]) -> Iterator[re.Match[str]]:
        with suppress(FileNotFoundError):
            for path in (self.folder / folder).iterdir():
                if match := name.fullmatch(path.name):
                    yield match

    def _write(self, name: str, data: bytes) -> None:
        """Write a file completely or not at all: it gets its final name when it is finished."""
        for path in (self.folder / name, self.folder / WRITING / name):
            owned.check_inside(path, self.folder)
        with whole_file(self.folder / name, self.folder / WRITING) as unfinished:
            unfinished.write_bytes(data)


def parquet_bytes(rows: pa.Table) -> bytes:
    """The bytes of a Parquet file of rows."""
    sink = pa.BufferOutputStream()
    pq.write_table(rows, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue().to_pybytes()


def compiled_of(rows: pa.Table) -> CompiledFlights:
    """How many flights of aircraft in rows of a campaign were compiled, by their metadata."""
    return CompiledFlights.stated((rows.schema.metadata or {}).get(COMPILED.encode()))


def _counting(rows: pa.Table, compiled: CompiledFlights) -> pa.Table:
    """The rows with this count in their metadata, if there are flights of aircraft."""
    if compiled == CompiledFlights():
        return rows
    return rows.replace_schema_metadata({COMPILED: compiled.text})


def open_dataset(folder: str | Path) -> Dataset:
    """The campaign in a folder; RecordingError without a campaign or if its plan was changed."""
    return Dataset(folder, *recorded_plan(folder))


def dataset_hash(folder: str | Path) -> str:
    """Digest of the rows in order of `run`, in all columns but ``wall_s``."""
    rows = open_dataset(folder).rows()
    digest = hashlib.sha256()
    for field in rows.schema:
        if field.name in NOT_REPRODUCIBLE:
            continue
        digest.update(f"{field.name}:{field.type};".encode())
        for block in _bits(rows.column(field.name)):
            digest.update(block)
    return digest.hexdigest()


def _bits(column: pa.ChunkedArray) -> Iterator[bytes]:
    """The mask of missing values, then the values themselves."""
    yield np.packbits(column.is_null().to_numpy()).tobytes()
    if not pa.types.is_primitive(column.type):
        for text in column.cast(pa.large_string()).fill_null("").to_pylist():
            # the length distinguishes "ab", "c" from "a", "bc"
            yield f"{len(text)}:{text}".encode()
        return
    # Arrow does not define the bits of a missing value
    zero = False if pa.types.is_boolean(column.type) else 0
    yield column.fill_null(pa.scalar(zero, column.type)).to_numpy().tobytes()


def _signals_of(run: int) -> str:
    """Path of the recording of a run in the folder of its campaign."""
    return f"{SIGNALS}/run-{run:010d}.parquet"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder for the block; the system releases the lock of a killed process."""
    path, owner = folder / LOCK, ""
    lock = FileLock(path, timeout=0.0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        with suppress(OSError), owned.opened(path) as file:
            owner = os.read(file, 200).decode(errors="replace")
        raise InputError(f"{folder}: a campaign is being flown into it{owner}.") from error
    except OSError as error:
        got = reason_of(error)
        raise OutputError(f"{path}: must be writable and locked, got {got}.") from error
    with suppress(OSError), owned.opened(path, flags=os.O_WRONLY | os.O_TRUNC) as file:
        # the owner is only for the message; the lock works without it
        os.write(file, f" by process {os.getpid()} on {socket.gethostname()}".encode())
    try:
        yield
    finally:
        lock.release()
