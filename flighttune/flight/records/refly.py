"""Repeat recorded runs from their provenance, and find the first difference."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.bits import same_bits
from flighttune.base.errors import RecordingError
from flighttune.control.gains import PIGains
from flighttune.flight.apart import Progress
from flighttune.flight.flown import FlownScenario
from flighttune.flight.fly import fly, library_versions
from flighttune.flight.loop.run import SCORE, Run
from flighttune.flight.own import LawMaker, PlantMaker
from flighttune.flight.scenario.load import as_recorded, scenario_from

EQUAL = "equal to the bit"


class Difference(NamedTuple):
    """The first difference of a repeated run."""

    # A signal, an entry of the gains such as ``K_P[0][1]``, ``status``, ``samples`` or ``signals``
    # (their names), or a column of a campaign's rows
    what: str
    t: float | None  # s: Time of the difference in a signal
    # Both values, SI and rad
    recorded: float | int | str | None
    reflown: float | int | str | None

    @property
    def sentence(self) -> str:
        """The difference in words: the signal, its time and both values."""
        when = "" if self.t is None else f" at t = {self.t:g} s"
        recorded, reflown = (
            value if isinstance(value, str) else repr(value)
            for value in (self.recorded, self.reflown)
        )
        return f"{self.what} differs{when}: {recorded} recorded, {reflown} flown again"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedRun:
    """A repeated run."""

    name: str  # label in a recording; else also the number
    status: str  # recorded status
    differences: tuple[Difference, ...]  # the first difference of a recording, or all of a row
    drawn: Mapping[str, Any] = field(default_factory=dict)  # drawn values of its campaign

    @property
    def record(self) -> dict[str, Any]:
        """The run as ``--json`` has it."""
        first = next(iter(self.differences), None)
        return {
            "run": self.name,
            "status": self.status,
            "equal": first is None,
            "result": first.sentence if first else EQUAL,
            "differences": [difference._asdict() for difference in self.differences],
            "drawn": dict(self.drawn),
        }


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reflown(Answering):
    """Repeated runs, and whether they are equal to the bit.

    Attributes
    ----------
    source : str
        Name of the recording, campaign or band.
    runs : tuple of CheckedRun
    versions : mapping of str to (str, str)
        Libraries with another version than recorded: then and now.
    missing : tuple of str
        Recorded runs that cannot be read.
    flown : FlownScenario or None
        The flight of the run that was requested by number.

    Examples
    --------
    >>> again = ft.refly(ft.fly("paper_as_printed").runs)
    >>> again.equal, again.runs[0].name
    (True, 'kinematic / paper')
    """

    source: str
    runs: tuple[CheckedRun, ...]
    versions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    flown: FlownScenario | None = None

    @property
    def equal(self) -> bool:
        """Whether no run differs in any bit."""
        return not any(run.differences for run in self.runs)


def reflights(
    runs: Sequence[Run],
    *,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
) -> tuple[CheckedRun, ...]:
    """Repeat runs of one scenario from the scenario and seed in their provenance, and compare."""
    scenarios = [dict(run.provenance.scenario) for run in runs]
    if not runs or any(other != scenarios[0] for other in scenarios[1:]):
        raise RecordingError(f"the runs must be of one scenario, got {len(runs)} of several.")
    scenario = scenario_from(as_recorded(scenarios[0]))
    labels = [f"{plant.label} / {name}" for plant in scenario.plant for name in scenario.gain_names]
    for run in runs:
        if run.label not in labels:
            raise RecordingError(
                f"{run.label}: the run must be one of its scenario ({', '.join(labels)}) "
                "to be flown again."
            )
    again = fly(scenario, laws=laws, plants=plants, progress=progress)
    return tuple(
        CheckedRun(
            name=run.label,
            status=run.status,
            differences=tuple(islice(differences(run, again[run.label]), 1)),
        )
        for run in runs
    )


def changed_versions(then: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Libraries whose version differs from `then`: the version then and now."""
    now = library_versions()
    pairs = {name: (version, now.get(name, "none")) for name, version in then.items()}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def other_versions(then: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """As `changed_versions`, also of libraries that `then` does not name."""
    return changed_versions(dict.fromkeys(library_versions(), "absent") | dict(then))


def other_libraries(then: Mapping[str, str]) -> str:
    """What differs from `then` of libraries and machine, in words; empty if nothing does."""
    pairs = other_versions(then).items()
    return "; ".join(f"{name}: was {was}, is {now}" for name, (was, now) in pairs)


def differences(recorded: Run, reflown: Run) -> Iterator[Difference]:
    """Differences to the bit: gains, then signals in order of time, then the outcome."""
    yield from _in_gains(recorded.provenance.gains, reflown.provenance.gains)
    yield from _in_signals(recorded, reflown)
    for what, then, now in (
        ("samples", len(recorded.signals), len(reflown.signals)),
        ("status", recorded.status, reflown.status),
        ("reason", recorded.reason, reflown.reason),
    ):
        if then != now:
            yield Difference(what, None, then, now)


def _in_gains(recorded: PIGains | None, reflown: PIGains | None) -> Iterator[Difference]:
    if recorded is None or reflown is None:
        if recorded is not reflown:
            then, now = ("none" if gains is None else "found" for gains in (recorded, reflown))
            yield Difference("gains", None, then, now)
        return
    for name in ("K_P", "K_I", "feedback"):
        then, now = (np.asarray(getattr(gains, name)) for gains in (recorded, reflown))
        for place in np.argwhere(then != now).tolist():
            values = (gains[tuple(place)].item() for gains in (then, now))
            yield Difference(name + "".join(f"[{i}]" for i in place), None, *values)


def _in_signals(recorded: Run, reflown: Run) -> Iterator[Difference]:
    if not (n := min(len(recorded.signals), len(reflown.signals))):
        return
    # A monitor adds its score to a flight, which is not repeated.
    columns = [[str(x) for x in run.signals if x != SCORE] for run in (recorded, reflown)]
    if columns[0] != columns[1]:
        odd = [", ".join(sorted(set(a) - set(b))) or "others" for a, b in (columns, columns[::-1])]
        yield Difference("signals", None, *odd)
        return
    then, now = (
        run.signals[names].reset_index().to_numpy(dtype=float)[:n]
        for run, names in zip((recorded, reflown), columns, strict=True)
    )
    if "libc" not in recorded.provenance.versions:
        # Up to 0.5, a compiled flight may have a zero of the other sign than JSBSim.
        then, now = then + 0.0, now + 0.0
    differ = ~same_bits(then, now)
    for row, column in np.argwhere(differ)[:1].tolist():
        what = ["t", *columns[0]][column]
        entry = (row, column)
        yield Difference(what, float(then[row, 0]), float(then[entry]), float(now[entry]))
