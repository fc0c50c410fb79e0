"""Reading runs from a run folder or a Parquet file."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.recording.parquet import first_line, read_run, recorded_flight
from flighttune.seal import file_bytes
from flighttune.simulate.run import Run

PARQUET, RECORDING = ".parquet", ".rrd"
RECORDING_FILE = "recording (.rrd)"
ORIGIN = "record"  # the property of a recording that says which runs it shows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Runs read back, and the parts of their folder that were not read.

    Attributes
    ----------
    path : Path
        The file or folder.
    runs : tuple of Run
        In the order in which they were recorded. Signals are equal to the bit to those written.
    missing : tuple of str
        Runs of the flight whose files are not there, and files of other flights in the folder.
    """

    path: Path
    runs: tuple[Run, ...]
    missing: tuple[str, ...] = ()

    def __getitem__(self, label: str) -> Run:
        """The run of that label, ``plant / gains``; the message of a KeyError lists the labels."""
        for run in self.runs:
            if run.label == label:
                return run
        raise KeyError(f"{label!r} is not one of {', '.join(run.label for run in self.runs)}")


def load_recording(path: str | Path) -> Recording:
    """Read the runs of a run folder or of a Parquet file.

    Parameters
    ----------
    path : path-like
        Output of ``flighttune fly`` or `record`: a folder, or one of its ``.parquet`` files. A
        ``.rrd`` file stands for the Parquet files beside it from which it was drawn.

    Returns
    -------
    Recording
        For a folder the runs of one flight: if there are files of several, those of a complete
        one, and of complete ones those of the newest. Files that were written on their own belong
        together. Files whose names begin with a dot are left over from a killed command and not
        read.

    Raises
    ------
    RecordingError
        If there is nothing to read, a ``.rrd`` file is without its Parquet files, or a file is
        not as flighttune wrote it: cut off, damaged, edited, of another program or of flighttune
        0.1.0.

    Examples
    --------
    >>> recording = load_recording("runs/paper")  # doctest: +SKIP
    >>> recording["kinematic / paper"].signals["chi"]  # doctest: +SKIP
    """
    path = Path(path)
    if path.is_dir():
        return _in_folder(path)
    if path.suffix.lower() == PARQUET:
        return Recording(path=path, runs=(read_run(path),))
    return _drawn_in(path)


def recording_in(folder: Path) -> Path | None:
    """The recording (.rrd) in a run folder, if there is one; several are an error."""
    recordings = _files(folder, RECORDING)
    if len(recordings) > 1:
        names = ", ".join(path.name for path in recordings)
        raise RecordingError(f"{folder}: the folder must hold one recording, got {names}.")
    return recordings[0] if recordings else None


def _files(folder: Path, ending: str) -> list[Path]:
    # A name with a dot in front is that of a file which was not finished.
    return sorted(folder.glob(f"[!.]*{ending}"))


def _by_flight(files: Iterable[Path]) -> dict[tuple[str, ...], dict[str, Path]]:
    """Parquet files by the SHA-256 of their run, for each flight in the folder."""
    flights: dict[tuple[str, ...], dict[str, Path]] = {}
    for file in files:
        sha256, flight = recorded_flight(file)
        flights.setdefault(flight, {})[sha256] = file
    return flights


def _in_folder(folder: Path) -> Recording:
    files = _files(folder, PARQUET)
    if not files:
        raise RecordingError(f"{folder}: the folder must hold Parquet files of runs, got none.")
    flights = _by_flight(files)

    def rank(flight: tuple[str, ...]) -> tuple[bool, float]:
        there = flights[flight]
        newest = max(file.stat().st_mtime for file in there.values())
        return set(flight) <= set(there), newest

    flight = max(flights, key=rank)
    there = flights[flight]
    lost = [sha256 for sha256 in flight if sha256 not in there]
    missing = [f"{folder}: {len(lost)} of the {len(flight)} runs are not there"] if lost else []
    missing += [f"{file}: of another flight" for file in files if file not in there.values()]
    order = [sha256 for sha256 in flight or there if sha256 in there]
    runs = tuple(read_run(there[sha256]) for sha256 in order)
    return Recording(path=folder, runs=runs, missing=tuple(missing))


def _drawn_in(path: Path) -> Recording:
    """The runs that a ``.rrd`` file was drawn from, if their Parquet files are beside it."""
    check_recording(path)
    origin = _origin(path)
    if origin is None:
        raise RecordingError(
            f"{path}: the runs must be loaded from Parquet files, got a recording (.rrd) that was "
            "written without any, which only shows the runs."
        )
    folder, flight = origin
    there = _by_flight(_files(path.parent, PARQUET)).get(flight, {})
    if not set(flight) <= set(there):
        raise RecordingError(
            f"{path}: the runs must be loaded from the Parquet files of the folder {folder}, got a "
            "recording (.rrd) alone, which only shows the runs."
        )
    return Recording(path=path, runs=tuple(read_run(there[sha256]) for sha256 in flight))


def check_recording(path: str | Path) -> None:
    """Refuse a file that is no Rerun recording; the viewer reports faults inside one."""
    if not file_bytes(Path(path), RECORDING_FILE).startswith(b"RRF"):
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got another file.")


def _origin(path: Path) -> tuple[str, tuple[str, ...]] | None:
    """Folder and SHA-256 of the runs in a recording; None if they were not recorded with it."""
    import pyarrow as pa
    from rerun.chunk import RrdReader

    try:
        reader = RrdReader(path)
        store = reader.store(store=reader.recordings()[0])
        for chunk in store.stream().filter(content=f"/__properties/{ORIGIN}").to_chunks():
            stated = chunk.to_record_batch()
            (folder,), sha256 = (stated.column(key)[0].as_py() for key in ("folder", "sha256"))
            return folder, tuple(sha256)
    except (RuntimeError, ValueError, KeyError, IndexError, pa.ArrowException) as error:
        got = first_line(error)
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got: {got}.") from error
    return None
