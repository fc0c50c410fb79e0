"""Writing a flown scenario to a folder: one Parquet file per run, and one recording of all."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from flighttune.flight.fly import FlownScenario
from flighttune.recording.page import scenario_page
from flighttune.recording.parquet import naming, parts_of, record_bytes, signal_files
from flighttune.recording.rrd import recording_bytes
from flighttune.whole_file import whole_file


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFiles:
    """Paths of the files of a flight."""

    recording: Path  # Rerun recording of all runs
    signals: Mapping[str, Path]  # Parquet file of each run, by its label


def record(flown: FlownScenario, folder: str | Path, *, name: str = "flight") -> RecordedFiles:
    """Write a flown scenario to `folder`: ``PLANT-GAINS.parquet`` for each run, and ``NAME.rrd``.

    Parameters
    ----------
    flown : FlownScenario
        Result of `flighttune.fly`.
    folder : path-like
        Made if need be; files of the same name are replaced, after all have been written.
    name : str
        Stem of the recording's name.

    Returns
    -------
    RecordedFiles
        Paths of all files.

    Raises
    ------
    OutputError
        If a file cannot be written; what stood in the folder still does.
    RecordingError
        If the scenario holds what JSON cannot.
    """
    folder = Path(folder)
    recording = folder / f"{name}.rrd"
    paths = signal_files(flown.runs, folder)
    with naming(recording):
        runs = [parts_of(run) for run in flown.runs]
    flight = [sha256 for _, _, sha256 in runs]
    drawn = recording_bytes(
        flown.runs,
        page=page_of(flown),
        title=flown.scenario.title,
        # Without the private part of the path.
        origin={"folder": folder.name if folder.is_absolute() else str(folder), "sha256": flight},
    )
    # Nothing gets its name before all is written; the last one entered is renamed first.
    with ExitStack() as files:
        for path, parts in zip(paths, runs, strict=True):
            files.enter_context(whole_file(path)).write_bytes(record_bytes(parts, flight))
        files.enter_context(whole_file(recording)).write_bytes(drawn)
    labels = (run.label for run in flown.runs)
    return RecordedFiles(recording=recording, signals=dict(zip(labels, paths, strict=True)))


def page_of(flown: FlownScenario) -> str:
    """The page of text in the recording of a flown scenario, as Markdown."""
    return scenario_page(
        flown.runs,
        scenario=flown.scenario.as_dict(),
        indicators={name: (values.R_K, values.I_K) for name, values in flown.indicators.items()},
    )
