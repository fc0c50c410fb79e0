"""Reading runs from a recording, a folder with one, or a Parquet file."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.plants.label import label_of
from flighttune.recording.parquet import read_run, recorded_place, recorded_sha256, signal_files
from flighttune.recording.run_record import RunRecord, naming
from flighttune.seal import RECORDING_FILE, seal_of, sealed_bytes
from flighttune.simulate.run import Run

PARQUET, RECORDING = ".parquet", ".rrd"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Runs read back, and what could not be read.

    Attributes
    ----------
    path : Path
        The file or folder.
    runs : tuple of Run
        In the order of the scenario. Signals are equal to the bit to those written.
    missing : tuple of str
        What of a folder was not read, and why: its recording, or Parquet files of other flights.
    """

    path: Path
    runs: tuple[Run, ...]
    missing: tuple[str, ...] = ()

    def __getitem__(self, label: str) -> Run:
        """The run of that label, ``plant / gains``.

        Raises
        ------
        KeyError
            If there is no such run; the message lists the labels.
        """
        for run in self.runs:
            if run.label == label:
                return run
        raise KeyError(f"{label!r} is not one of {', '.join(run.label for run in self.runs)}")


def load_recording(path: str | Path) -> Recording:
    """Read the runs of a recording, of a run folder, or of a Parquet file.

    Parameters
    ----------
    path : path-like
        What ``flighttune fly`` or `record` wrote: a ``.rrd`` file, the folder of one, or one of its
        ``.parquet`` files.

    Returns
    -------
    Recording
        For a folder, the runs of its recording, read from the Parquet files where all of them are
        there. If it is missing or damaged, those of its Parquet files, which do not include the
        runs that never flew. Files whose names begin with a dot are
        what a killed command left behind, and not looked at.

    Raises
    ------
    RecordingError
        If there is nothing to read, or it is not as flighttune wrote it: cut off, damaged, edited,
        of another program or of flighttune 0.1.0.

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
    return Recording(path=path, runs=_runs(_in_recording(path)))


def recording_in(folder: Path) -> Path | None:
    """The recording in a run folder, if there is one.

    Raises
    ------
    RecordingError
        If there are several.
    """
    recordings = _files(folder, RECORDING)
    if len(recordings) > 1:
        names = ", ".join(path.name for path in recordings)
        raise RecordingError(f"{folder}: the folder must hold one recording, got {names}.")
    return recordings[0] if recordings else None


def _files(folder: Path, ending: str) -> list[Path]:
    # A name with a dot in front is that of a file which was not finished.
    return sorted(folder.glob(f"[!.]*{ending}"))


def _in_recording(path: Path) -> list[tuple[Run, RunRecord]]:
    from flighttune.recording.run_columns import recorded_runs

    records = recorded_runs(path)
    with naming(path):
        return [(record.run(), record) for record in records]


def _in_folder(folder: Path) -> Recording:
    recording, files = recording_in(folder), _files(folder, PARQUET)
    if not (recording or files):
        raise RecordingError(f"{folder}: the folder must hold a recording, got none.")
    why = f"{folder}: there is no recording; only runs with a Parquet file are there"
    if recording:
        try:
            whole = _beside(recording, files)
            if whole:
                return Recording(path=folder, runs=whole)
            pairs = _in_recording(recording)
        except RecordingError as error:
            if not files:
                raise
            why = str(error)
        else:
            return Recording(
                path=folder, runs=_runs(pairs), missing=_of_other_flights(recording, pairs)
            )
    runs = sorted((read_run(file) for file in files), key=_place)
    return Recording(path=folder, runs=tuple(runs), missing=(why,))


def _beside(recording: Path, files: Iterable[Path]) -> tuple[Run, ...] | None:
    """The runs of the Parquet files beside a recording, if all that it holds are among them.

    They are the same to the bit, and read without Rerun, which takes longer to import than they
    take to read.

    Raises
    ------
    RecordingError
        If the recording is not as it was written.
    """
    sha256 = seal_of(sealed_bytes(recording, RECORDING_FILE))
    try:
        places = [(recorded_place(file), file) for file in files]
        found = {place: file for place, file in places if place and place.sha256 == sha256}
        if not found or len(found) < max(place.runs for place in found):
            return None
        return tuple(read_run(found[place]) for place in sorted(found, key=lambda one: one.run))
    except RecordingError:
        return None


def _runs(pairs: Iterable[tuple[Run, RunRecord]]) -> tuple[Run, ...]:
    return tuple(run for run, _ in pairs)


def _of_other_flights(recording: Path, pairs: Iterable[tuple[Run, RunRecord]]) -> tuple[str, ...]:
    """Parquet files beside a recording that are not of its flights: a command was killed."""
    flown = [(run, record) for run, record in pairs if len(run.signals)]
    files = signal_files([run for run, _ in flown], recording.parent)
    lines = []
    for file, (_, record) in zip(files, flown, strict=True):
        try:
            if file.exists() and recorded_sha256(file) != record.sha256:
                lines.append(f"{file}: of another flight than {recording.name}, which was read")
        except RecordingError as error:
            lines.append(str(error))
    return tuple(lines)


def _place(run: Run) -> tuple[int, int, str]:
    """Position of a run in its scenario: by plant, then by gain set."""
    scenario = run.provenance.scenario
    plants = [label_of(plant) for plant in scenario.get("plant", [])]
    sets = scenario.get("gains", [])
    gains = [entry if isinstance(entry, str) else entry["name"] for entry in sets]
    places = []
    for name, known in ((run.provenance.plant, plants), (run.provenance.gains_name, gains)):
        places.append(known.index(name) if name in known else len(known))
    return places[0], places[1], run.label
