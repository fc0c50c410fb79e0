"""Sources of a comparison: run folders, files of runs, and gains of a scenario, flown now."""

from dataclasses import dataclass
from pathlib import Path

from flighttune.control.law import split_name
from flighttune.errors import InputError, RecordingError
from flighttune.flight.fly import fly
from flighttune.recording.parquet import load_recording
from flighttune.scenario.load import load_gains, load_scenario
from flighttune.scenario.schema import GainsTable
from flighttune.simulate.run import Run

RECORDED = (".parquet", ".rrd")
GAINS_FILES = (".json", ".toml")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """Runs that belong together, under the name the user gave."""

    name: str  # the name that the user gave: a path, or ``scenario@gains``
    runs: tuple[Run, ...]  # in the order of the scenario if it is known
    missing: tuple[str, ...] = ()  # runs that were recorded and cannot be read
    # Whether the gains were chosen; False for a scenario flown without an ``@``
    chosen: bool = True

    @property
    def gain_sets(self) -> tuple[str, ...]:
        """Names of the gains flown, each once."""
        return tuple(dict.fromkeys(run.provenance.gains_name for run in self.runs))


def load_source(name: str | Path) -> Source:
    """Find the runs of a name.

    `name`: a run folder of ``flighttune fly``, a Parquet file of one run, a recording (.rrd), or a
    scenario, which is flown. Behind an ``@`` a gain set, a plant or the label of a run chooses
    among its runs; of a scenario also a file of gains, or a set it does not list. The source has at
    least one run. Raises RecordingError if a file or folder holds no runs, or none of that choice.
    Raises ScenarioError if there is no such scenario or gains file.
    """
    name = str(name)
    place, _, choice = name.partition("@") if not Path(name).exists() else (name, "", "")
    path = Path(place)
    if not (path.is_dir() or path.suffix.lower() in RECORDED):
        return Source(name=name, runs=_flown(place, choice), chosen=bool(choice))
    recording = load_recording(path)
    runs = tuple(
        run
        for run in recording.runs
        if choice in ("", run.provenance.gains_name, run.provenance.plant, run.label)
    )
    if not runs:
        labels = ", ".join(dict.fromkeys(run.label for run in recording.runs)) or "no runs"
        raise RecordingError(
            f"{name}: {choice or 'it'!r} must be a gain set, a plant or a run, got {labels}."
        )
    return Source(name=name, runs=runs, missing=recording.missing)


def _flown(place: str, choice: str) -> tuple[Run, ...]:
    scenario = load_scenario(place)
    if choice:
        file = Path(choice)
        entry: str | GainsTable = choice
        if file.suffix.lower() in GAINS_FILES:
            gains = load_gains(file)
            entry = GainsTable(name=file.stem, **gains.as_lists())
            law = scenario.law_table(f"{gains.law}:")
        else:
            law, own = scenario.law_table(choice), split_name(choice)[1]
            tables = [g for g in scenario.gains if isinstance(g, GainsTable) and g.name == own]
            entry = tables[0] if tables else own
        own = entry if isinstance(entry, str) else entry.name
        expected = [
            table for table in scenario.expect if table.gains in (None, *law.law().names_of([own]))
        ]
        scenario = scenario.model_copy(update={"law": [law], "gains": [entry], "expect": expected})
    try:
        return fly(scenario).runs
    except InputError as error:
        raise InputError(f"{place}@{choice}: {error}") from error
