"""Reading runs from a recording, a folder with one, or a Parquet file."""

from dataclasses import dataclass
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.plants.label import label_of
from flighttune.recording.parquet import read_run
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
        Why only the Parquet files of a folder were read; empty if its recording was.
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
        For a folder, the runs of its recording. If that is missing or damaged, those of its Parquet
        files, which do not include the runs that never flew.

    Raises
    ------
    RecordingError
        If there is nothing to read, or it is empty, damaged, or not written by flighttune.

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
    return _in_recording(path)


def _in_recording(path: Path) -> Recording:
    from flighttune.recording.run_columns import recorded_runs

    return Recording(path=path, runs=recorded_runs(path))


def _in_folder(folder: Path) -> Recording:
    recordings = sorted(folder.glob(f"*{RECORDING}"))
    if len(recordings) > 1:
        names = ", ".join(path.name for path in recordings)
        raise RecordingError(f"{folder}: the folder must hold one recording, got {names}.")
    files = sorted(folder.glob(f"*{PARQUET}"))
    if not (recordings or files):
        raise RecordingError(f"{folder}: the folder must hold a recording, got none.")
    why = f"{folder}: there is no recording; only runs with a Parquet file are there"
    if recordings:
        try:
            return _in_recording(recordings[0])
        except RecordingError as error:
            if not files:
                raise
            why = str(error)
    runs = sorted((read_run(file) for file in files), key=_place)
    return Recording(path=folder, runs=tuple(runs), missing=(why,))


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
