"""What can be compared: run folders, files of runs, and gains of a scenario, flown now."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from flighttune.errors import InputError, RecordingError
from flighttune.flight import fly
from flighttune.recording.parquet import read_run
from flighttune.scenario.load import load_gains, load_scenario
from flighttune.scenario.schema import GainsTable
from flighttune.simulate.run import SIGNAL_UNITS, Run

GAINS_FILES = (".json", ".toml")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """Runs that belong together, under the name the user gave.

    Attributes
    ----------
    name : str
        As given: a path, or ``scenario@gains``.
    runs : tuple of Run
        In the order of the scenario where it is known.
    units : mapping of str to str
        Units that a file states for its signals, where they are not those of `SIGNAL_UNITS`.
    """

    name: str
    runs: tuple[Run, ...]
    units: Mapping[str, str] = field(default_factory=dict)


def load_source(name: str | Path) -> Source:
    """Find the runs of a name.

    Parameters
    ----------
    name : str or path-like
        A run folder of ``flighttune fly``, a Parquet file of one run, a recording (.rrd) with its
        runs beside it, or a scenario, which is flown. Behind an ``@`` a gain set, a plant or the
        label of a run chooses among its runs; of a scenario also a file of gains, or a set it does
        not list.

    Returns
    -------
    Source
        With at least one run.

    Raises
    ------
    RecordingError
        If a file or folder holds no runs, or none of that choice.
    ScenarioError
        If there is no such scenario or gains file.
    """
    name = str(name)
    place, _, choice = name.partition("@") if not Path(name).exists() else (name, "", "")
    path = Path(place)
    if path.is_dir():
        return _chosen(name, _in_folder(path), choice)
    if path.suffix == ".parquet":
        return _chosen(name, [path], choice)
    if path.suffix == ".rrd" and path.is_file():
        return _chosen(name, _in_folder(path.parent), choice)
    return Source(name=name, runs=_flown(place, choice))


def _in_folder(folder: Path) -> list[Path]:
    files = sorted(folder.glob("*.parquet"))
    if not files:
        raise RecordingError(f"{folder}: the folder must hold runs (*.parquet), got none.")
    return files


def _chosen(name: str, files: Sequence[Path], choice: str) -> Source:
    found = _of_runs(name, [read_run(file) for file in files], choice)
    units: dict[str, str] = {}
    for file in files:
        units |= _foreign_units(file)
    return Source(name=name, runs=found.runs, units=units)


def _of_runs(name: str, runs: Sequence[Run], choice: str) -> Source:
    names = [(run.provenance.gains_name, run.provenance.plant, run.label) for run in runs]
    kept = [run for run, known in zip(runs, names, strict=True) if not choice or choice in known]
    if not kept:
        known = ", ".join(dict.fromkeys(run.label for run in runs)) or "no runs"
        raise RecordingError(
            f"{name}: {choice or 'it'!r} must be a gain set, a plant or a run, got {known}."
        )
    order = {run.label: place for place, run in enumerate(_in_order(kept))}
    return Source(name=name, runs=tuple(sorted(kept, key=lambda run: order[run.label])))


def _in_order(runs: Sequence[Run]) -> list[Run]:
    """Runs plant by plant, gain set by gain set, as their scenario lists them."""

    def place(run: Run) -> tuple[int, int]:
        scenario, made = run.provenance.scenario, run.provenance
        plants = [
            f"{p['kind']}:{p['aircraft']}" if p.get("aircraft") else p.get("kind")
            for p in scenario.get("plant", ())
        ]
        gains = [g if isinstance(g, str) else g.get("name") for g in scenario.get("gains", ())]
        return (
            plants.index(made.plant) if made.plant in plants else len(plants),
            gains.index(made.gains_name) if made.gains_name in gains else len(gains),
        )

    return sorted(runs, key=place)


def _foreign_units(file: Path) -> dict[str, str]:
    fields: list[pa.Field] = list(pq.read_schema(file))
    stated = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in fields}
    return {
        name: unit for name, unit in stated.items() if unit and unit != SIGNAL_UNITS.get(name, unit)
    }


def _flown(place: str, choice: str) -> tuple[Run, ...]:
    scenario = load_scenario(place)
    if choice:
        file = Path(choice)
        entry: str | GainsTable = choice
        if file.suffix.lower() in GAINS_FILES:
            gains = load_gains(file)
            entry = GainsTable(name=file.stem, K_P=gains.K_P.tolist(), K_I=gains.K_I.tolist())
        else:
            given = [g for g in scenario.gains if isinstance(g, GainsTable) and g.name == choice]
            entry = given[0] if given else choice
        scenario = scenario.model_copy(update={"gains": [entry]})
    try:
        return fly(scenario).runs
    except InputError as error:
        raise InputError(f"{place}@{choice}: {error}") from error
