"""A flown scenario to a folder: one recording, and one Parquet file a run."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flighttune.flight.fly import FlownScenario
from flighttune.recording.entities import distinct
from flighttune.recording.page import scenario_page
from flighttune.recording.parquet import write_run
from flighttune.recording.rrd import write_recording
from flighttune.simulate.run import Run


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
        Made if need be; files of the same name are replaced, each whole or not at all.
    name : str
        Stem of the recording's name.

    Returns
    -------
    RecordedFiles
        Where everything is.

    Raises
    ------
    RecordingError
        If a file cannot be written.
    """
    folder = Path(folder)
    signals: dict[str, Path] = {}
    having = [run for run in flown.runs if len(run.signals)]
    for run, stem in zip(having, distinct(_stem(run) for run in having), strict=True):
        signals[run.label] = folder / f"{stem}.parquet"
        write_run(run, signals[run.label])
    page = scenario_page(
        flown.runs,
        scenario=flown.scenario.as_dict(),
        indicators={name: (found.R_K, found.I_K) for name, found in flown.indicators.items()},
        metrics=flown.metrics,
        flight=flown.flight,
    )
    recording = folder / f"{name}.rrd"
    write_recording(flown.runs, recording, page=page, title=flown.scenario.title)
    return RecordedFiles(recording=recording, signals=signals)


def _stem(run: Run) -> str:
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", f"{run.provenance.plant}-{run.provenance.gains_name}")
