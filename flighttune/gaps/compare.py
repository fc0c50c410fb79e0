"""The comparison: pairs of runs with their metrics, differences and distances."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError, RecordingError, naming
from flighttune.base.files import code
from flighttune.base.files.load import READERS, load_one, written
from flighttune.base.words import listed
from flighttune.flight import flown, load
from flighttune.flight.fly import fly
from flighttune.flight.loop.run import Claim, Run, renamed, with_claims
from flighttune.flight.metrics import FLIGHT_METRICS, METRICS, measures, unit_of
from flighttune.flight.records.parquet import Recording
from flighttune.flight.scenario.load import gains_notes, leaves
from flighttune.logs.log import Columns

RUNS = "recording, its folder, the Parquet file of a run, or the log of a flight"

# Better direction of each metric. A time that is never reached is worst.
BETTER_IF = {
    **dict.fromkeys((*METRICS, *FLIGHT_METRICS), "low"),
    **dict.fromkeys(("PT_s", "n_z_min", "n_z_max"), "neither"),
    "MS_rad": "near zero",
}

# Metrics whose missing value means that it was never reached.
NEVER = ("rise_s", "settling_s")

# Metrics within this relative difference count as equal.
EQUAL = 1e-12

# Keys of ``[flight]`` that belong to the manoeuvre, as does all of ``[reference]``.
MANOEUVRE = ("V_a_mps", "h_m", "chi_deg", "gamma_deg", "phi_deg", "n_z", "duration_s")

# Keys with text, or compared elsewhere.
DESCRIPTION = ("title", "verifies", "source", "gains", "plant", "reference", "route")

COLUMNS = ("pair", "run_a", "run_b", "channel", "name", "unit", "a", "b", "diff", "better")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """Runs of one source, with the name that the user gave."""

    name: str  # the name that the user gave: a path, or ``scenario@gains``
    runs: tuple[Run, ...]  # in the order of the scenario, if known
    missing: tuple[str, ...] = ()  # recorded runs that cannot be read
    lacks: str = ""  # as in a `Recording`
    # Whether the user chose the gains; False for a scenario flown without an ``@``
    chosen: bool = True

    @property
    def gain_sets(self) -> tuple[str, ...]:
        """Names of the flown gains, each once."""
        return tuple(dict.fromkeys(run.provenance.gains_name for run in self.runs))

    def within(self, *claims: Claim) -> "Source":
        """The runs with a claim about them; InputError if the claim covers none of them."""
        return replace(self, runs=with_claims(self.runs, claims))


Runs: TypeAlias = Run | flown.FlownScenario | Source


class Pair(NamedTuple):
    """Two runs of one manoeuvre, compared."""

    # `a` and `b`: cut to the time that both flew
    a: Run
    b: Run
    # Names of the sources of `a` and `b`
    source_a: str
    source_b: str
    max_distance: float  # m: largest distance of the two at the same time after the start
    t_max_distance: float  # s: time of the largest distance
    # Different settings of the two scenarios, by dotted key
    differs: dict[str, tuple[Any, Any]]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison(Answering):
    """Runs side by side.

    Attributes
    ----------
    reason : str
        Why the sources cannot be compared: another manoeuvre, another aircraft; empty otherwise.
    pairs : tuple of Pair
        Every run of the first source with its partner in each other source.
    metrics : DataFrame
        A row for each pair, channel and metric; columns ``pair`` (its index in `pairs`), ``run_a``,
        ``run_b``, ``channel``, ``name``, ``unit``, ``a``, ``b``, ``diff`` (b minus a), ``better``
        (a, b, same, or empty).
    unpaired : tuple of str
        Runs without a partner, as ``source: label``.
    missing : tuple of str
        Recorded runs that cannot be read.

    Examples
    --------
    >>> comparison = ft.compare("paper_as_printed@paper", "paper_as_printed@K1")
    >>> comparison.comparable, round(comparison.max_distance, 1)
    (True, 10.4)
    """

    reason: str = ""
    pairs: tuple[Pair, ...] = ()
    metrics: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(COLUMNS)))
    unpaired: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def comparable(self) -> bool:
        """Whether the flights can be compared."""
        return not self.reason

    @property
    def max_distance(self) -> float:
        """Largest distance of any pair, m; nan without pairs."""
        return max((pair.max_distance for pair in self.pairs), default=math.nan)

    @property
    def gains_notes(self) -> list[str]:
        """A sentence for gains that were tuned for other aircraft than a run flew."""
        return gains_notes(run for pair in self.pairs for run in (pair.a, pair.b))


def load_source(
    name: str | Path, *, changes: Mapping[str, Any] | None = None, columns: Columns = ()
) -> Source:
    """Find the runs of a source: a folder, Parquet file, recording or log, or a scenario to fly."""
    name = str(name)
    # After an ``@`` a gain set, a plant or a label selects runs. A scenario also takes a file of
    # gains or a gain set that it does not list. A log takes ``START:END``, a part of it in s.
    place, _, choice = name.partition("@") if not os.path.exists(name) else (name, "", "")
    if (recording := written(name, *READERS, columns=columns)) is None:
        scenario = load.load_scenario(place, changes=changes, gains=[choice] if choice else ())
        # Each of these flights decides what is said, so that none is compiled.
        with naming(f"{place}@{choice}"), code.in_jsbsim():
            return Source(name=name, runs=fly(scenario).runs, chosen=bool(choice))
    if changes:
        raise InputError(f"{name}: `--set` must be absent where runs are read, not flown.")
    if isinstance(recording, Run):
        lacking = recording.provenance.log or {}
        missing = *lacking["missing"], *lacking["gaps"]
        return Source(name=name, runs=(recording,), missing=missing)
    if not isinstance(recording, Recording):
        load_one(name, RUNS)  # this refuses it
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
    return Source(name=name, runs=runs, missing=recording.missing, lacks=recording.lacks)


def compare_runs(sources: Iterable[str | Path | Runs], columns: Columns) -> Comparison:
    """Compare runs with the runs of the first source, as `ft.compare` does."""
    stated = [_source(runs_of, place, columns) for place, runs_of in enumerate(sources)]
    compared = stated if len(stated) > 1 else _each_run(*stated)
    first, *rest = compared
    pairs: list[Pair] = []
    unpaired: dict[str, None] = {}
    for other in rest:
        matched = _paired(first.runs, other.runs)
        if reason := _why_not(first, other, matched):
            return Comparison(reason=reason)
        pairs += [_pair(first.name, other.name, *two) for two in matched]
        used = {id(run) for two in matched for run in two}
        for source in (first, other):
            alone = [run.label for run in source.runs if id(run) not in used]
            unpaired |= dict.fromkeys(f"{source.name}: {label}" for label in alone)
    rows = [
        {"pair": place, "run_a": pair.a.label, "run_b": pair.b.label, **row}
        for place, pair in enumerate(pairs)
        for row in _metric_rows(pair)
    ]
    return Comparison(
        pairs=tuple(pairs),
        metrics=pd.DataFrame(rows, columns=list(COLUMNS)),
        unpaired=tuple(unpaired),
        missing=tuple(
            f"{listed([source.name for source in compared if line in source.missing])}: {line}"
            for line in dict.fromkeys(line for source in compared for line in source.missing)
        ),
    )


def better(name: str, a: float, b: float) -> str:
    """Better of two values of a metric: ``a``, ``b``, ``same``, or empty without a direction."""
    if name in NEVER:
        a, b = (math.inf if math.isnan(value) else value for value in (a, b))
    if BETTER_IF[name] == "neither" or math.isnan(a) or math.isnan(b):
        return ""
    if BETTER_IF[name] == "near zero":
        a, b = abs(a), abs(b)
    if math.isclose(a, b, rel_tol=EQUAL):
        return "same"
    return "a" if a < b else "b"


def largest_distance(a: Run, b: Run) -> tuple[float, float]:
    """Largest distance of two runs at equal time after the start, m, and this time, s."""
    t = np.union1d(a.t, b.t)
    t = t[t <= min(a.duration, b.duration)]

    def path(run: Run) -> list[Any]:
        places = run.signals.reindex(columns=["north", "east", "down"])  # a log may lack positions
        places = places.interpolate("index", limit_direction="both")
        return [np.interp(t, places.index, places[axis]) for axis in places]

    distance = np.linalg.norm(np.subtract(path(b), path(a)), axis=0)
    farthest = int(np.argmax(distance))
    at = t[farthest] if distance[farthest] >= 0.0 else math.nan  # NaN without positions
    return float(distance[farthest]), float(at)


def _source(runs_of: str | Path | Runs, place: int, columns: Columns) -> Source:
    letter = chr(ord("A") + place)
    if isinstance(runs_of, Source):
        return runs_of
    if isinstance(runs_of, Run):
        return Source(name=f"{letter}: {runs_of.label}", runs=(runs_of,))
    if isinstance(runs_of, flown.FlownScenario):
        return Source(name=f"{letter}: {runs_of.scenario.title}", runs=runs_of.runs)
    return load_source(runs_of, columns=columns)


def _each_run(source: Source) -> list[Source]:
    """Each run of a source as a source; the first also has the missing runs and runs not flown."""
    runs = [run for run in source.runs if len(run.signals) > 1]
    if len(runs) < 2:
        labels = ", ".join(run.label for run in runs) or "none"
        raise InputError(f"{source.name}: at least two runs must have flown, got {labels}.")
    still = (f"{run.label}: {run.outcome}" for run in source.runs if run not in runs)
    first, *others = (Source(name=source.name, runs=(run,)) for run in runs)
    return [replace(first, missing=(*source.missing, *still)), *others]


def _paired(a: Sequence[Run], b: Sequence[Run]) -> list[tuple[Run, Run]]:
    """Pair a log with every run, and two single runs; else runs of equal label, plant or gains."""
    if len(a) == len(b) == 1 or any(len(side) == 1 and _is_log(side[0]) for side in (a, b)):
        return [*product(a, b)]

    def by(*keys: str) -> list[tuple[Run, Run]]:
        name = attrgetter(*(f"provenance.{key}" for key in keys))
        partners = {name(run): run for run in b}
        return [(run, partners[name(run)]) for run in a if name(run) in partners]

    def are_one(key: str) -> bool:
        return all(len({getattr(x.provenance, key) for x in side}) < 2 for side in (a, b))

    pairs = by("plant", "gains_name")
    if not pairs and are_one("gains_name"):
        pairs = by("plant")
    if not pairs and are_one("plant"):
        pairs = by("gains_name")
    return pairs


def _why_not(a: Source, b: Source, pairs: Sequence[tuple[Run, Run]]) -> str:
    """Why two sources cannot be compared, in one sentence; empty if they can."""
    between = f"{a.name} and {b.name}"
    for source, other in ((a, b), (b, a)):
        several = not source.chosen and len(source.gain_sets) > 1
        if several and set(source.gain_sets) != set(other.gain_sets):
            choices = ", ".join(f"{source.name}@{gains}" for gains in source.gain_sets)
            return f"{between}: {source.name} has several gain sets, name one of {choices}."
    if not pairs:
        labels = " | ".join(", ".join(run.label for run in side.runs) for side in (a, b))
        return (
            f"{between}: no run of one has the plant and gains of one of the other, got {labels}; "
            "choose with SOURCE@GAINS."
        )
    for pair in pairs:
        for source, run in zip((a, b), pair, strict=True):
            if len(run.signals) < 2:
                return f"{source.name}: {run.label} must have flown, got {run.status}: {run.reason}"
        if any(map(_is_log, pair)):
            continue  # a log does not tell the intended manoeuvre
        aircraft = [run.provenance.aircraft for run in pair]
        if all(aircraft) and aircraft[0] != aircraft[1]:
            return f"{between}: the aircraft must be the same, got {aircraft[0]} and {aircraft[1]}."
        for key, (value, got) in _changes(*map(_manoeuvre, pair)).items():
            return f"{between}: the manoeuvre must be the same, `{key}` is {value} and {got}."
    return ""


def _manoeuvre(run: Run) -> dict[str, Any]:
    """Start, duration and reference of a run, which must agree for a comparison."""
    scenario = run.provenance.scenario
    flight = {key: value for key, value in scenario["flight"].items() if key in MANOEUVRE}
    followed = {key: scenario[key] for key in ("reference", "route") if key in scenario}
    return {"flight": flight, **followed}


def _settings(run: Run) -> dict[str, Any]:
    return {k: value for k, value in run.provenance.scenario.items() if k not in DESCRIPTION}


def _changes(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Keys of two tables with different values, and both values."""
    a, b = dict(leaves(a)), dict(leaves(b))
    return {key: (a.get(key), b.get(key)) for key in sorted({*a, *b}) if a.get(key) != b.get(key)}


def _is_log(run: Run) -> bool:
    return run.provenance.log is not None


def _pair(source_a: str, source_b: str, a: Run, b: Run) -> Pair:
    end = min(a.duration, b.duration)
    distance, t_farthest = largest_distance(a, b)
    a, b = (
        run if run.duration <= end else replace(run, signals=run.signals.loc[:end])
        for run in (a, b)
    )
    return Pair(
        a=a,
        b=b,
        source_a=source_a,
        source_b=source_b,
        max_distance=distance,
        t_max_distance=t_farthest,
        differs={} if _is_log(a) or _is_log(b) else _changes(_settings(a), _settings(b)),
    )


def _metric_rows(pair: Pair) -> Iterator[dict[str, Any]]:
    """Metrics that both runs have, side by side."""
    first, second = measures(pair.a), measures(pair.b)
    for channel, values in first.items():
        for name in (x for x in values if x in BETTER_IF and x in second.get(channel, ())):
            a, b = values[name], second[channel][name]
            row = {"channel": channel, "name": name, "unit": unit_of(channel, name)}
            yield {**row, "a": a, "b": b, "diff": b - a, "better": better(name, a, b)}


def sources_of(comparison: Comparison) -> list[str]:
    """Names of the sources, starting with the first source."""
    firsts = [pair.source_a for pair in comparison.pairs]
    return list(dict.fromkeys([*firsts, *(pair.source_b for pair in comparison.pairs)]))


def overlaid(comparison: Comparison) -> list[Run]:
    """Every run of a comparison once; equal labels get the letter of their source, A, B, ..."""
    letters = {name: chr(ord("A") + i) for i, name in enumerate(sources_of(comparison))}
    runs: dict[tuple[str, str], Run] = {}
    for pair in comparison.pairs:
        for source, run in ((pair.source_a, pair.a), (pair.source_b, pair.b)):
            earlier = runs.get((source, run.label))
            if earlier is None or earlier.duration < run.duration:
                runs[source, run.label] = run
    labels = [label for _, label in runs]
    for (source, label), run in runs.items():
        if labels.count(label) > 1:
            name = f"{run.provenance.gains_name} ({letters[source]})"
            runs[source, label] = renamed(run, name)
    return list(runs.values())
