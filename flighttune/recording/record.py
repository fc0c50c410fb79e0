"""Writing a flown scenario to a folder: one recording, and one Parquet file per run."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from flighttune.flight.fly import FlownScenario
from flighttune.recording.page import scenario_page
from flighttune.recording.parquet import Place, parquet_bytes, signal_files
from flighttune.recording.rrd import recording_bytes
from flighttune.recording.run_record import naming
from flighttune.seal import seal_of
from flighttune.whole_file import whole_file


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFiles:
    """What was written.

    Attributes
    ----------
    recording : Path
        The Rerun recording of all runs.
    signals : mapping of str to Path
        Parquet file of each run that flew, by run label.
    """

    recording: Path
    signals: Mapping[str, Path]


def record(flown: FlownScenario, folder: str | Path, *, name: str = "flight") -> RecordedFiles:
    """Write a flown scenario to `folder`: ``NAME.rrd`` and ``PLANT-GAINS.parquet`` for each run.

    Parameters
    ----------
    flown : FlownScenario
        What `flighttune.fly` returns.
    folder : path-like
        Made if need be; files of the same name are replaced, after all have been written.
    name : str
        Stem of the recording's name.

    Returns
    -------
    RecordedFiles
        Where everything is.

    Raises
    ------
    OutputError
        If a file cannot be written; what stood in the folder still does.
    RecordingError
        If the scenario holds what JSON cannot.
    """
    folder = Path(folder)
    recording = folder / f"{name}.rrd"
    having = [run for run in flown.runs if len(run.signals)]
    signals = dict(zip((run.label for run in having), signal_files(having, folder), strict=True))
    with naming(recording):
        data = recording_bytes(flown.runs, page=page_of(flown), title=flown.scenario.title)
    # Nothing gets its name before all is written, and then the recording first: it is complete in
    # itself, and tells Parquet files of an earlier flight from its own.
    with ExitStack() as files, naming(recording):
        for number, run in enumerate(flown.runs):
            if run.label in signals:
                place = Place(sha256=seal_of(data), run=number, runs=len(flown.runs))
                part = files.enter_context(whole_file(signals[run.label]))
                part.write_bytes(parquet_bytes(run, place))
        part = files.enter_context(whole_file(recording))
        part.write_bytes(data)
    return RecordedFiles(recording=recording, signals=signals)


def page_of(flown: FlownScenario) -> str:
    """The page of text in the recording of a flown scenario, as Markdown."""
    return scenario_page(
        flown.runs,
        scenario=flown.scenario.as_dict(),
        indicators={name: (found.R_K, found.I_K) for name, found in flown.indicators.items()},
        metrics=flown.metrics,
        flight=flown.flight,
    )
