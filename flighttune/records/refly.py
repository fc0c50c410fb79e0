"""Fly recorded runs again from their provenance, and look for the first difference."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.flight.fly import Progress, fly, library_versions
from flighttune.flight.own import LawMaker, PlantMaker
from flighttune.scenario.load import as_recorded, scenario_from
from flighttune.simulate.run import Run


@dataclass(frozen=True, slots=True)
class Difference:
    """Where a run that was flown again first differs."""

    # A signal, an entry of the gains such as ``K_P[0][1]``, ``status``, ``samples`` or
    # ``signals`` (their names); a column of a campaign's rows
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


@dataclass(frozen=True, slots=True, eq=False)
class Reflight:
    """A recorded run and the same flight flown again."""

    recorded: Run
    reflown: Run

    @property
    def difference(self) -> Difference | None:
        """The first one; None where gains, outcome and every sample are equal to the bit."""
        return next(_differences(self.recorded, self.reflown), None)

    @property
    def versions(self) -> Mapping[str, tuple[str, str]]:
        """Libraries whose version is not the recorded one: then and now."""
        return changed_versions(self.recorded.provenance.versions)


def refly(
    runs: Sequence[Run],
    *,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
) -> tuple[Reflight, ...]:
    """Fly runs again from the scenario and seed in their provenance.

    Parameters
    ----------
    runs : sequence of Run
        Runs of one scenario, as `load_recording` returns them.
    laws, plants : mapping of str to callable, optional
        As of `fly`, where the runs were flown with them.
    progress : callable, optional
        Called with how far each run is.

    Returns
    -------
    tuple of Reflight
        One a run, in order.

    Raises
    ------
    RecordingError
        If the runs are not of one scenario, or not flown as their scenario says (a rung of a
        ladder, a figure of the paper).
    ScenarioError
        If the scenario cannot be read, being from another version.

    Examples
    --------
    >>> flown = ft.fly(ft.load_scenario("paper_as_printed"))
    >>> [flight.difference for flight in ft.refly(flown.runs)]
    [None]
    """
    scenarios = [dict(run.provenance.scenario) for run in runs]
    if not runs or any(other != scenarios[0] for other in scenarios[1:]):
        raise RecordingError(f"the runs must be of one scenario, got {len(runs)} of several.")
    scenario = scenario_from(as_recorded(scenarios[0]))
    names = scenario.gain_names
    labels = [f"{plant.label} / {name}" for plant in scenario.plant for name in names]
    for run in runs:
        if run.label not in labels:
            raise RecordingError(
                f"{run.label}: the run must be one of its scenario ({', '.join(labels)}) "
                "to be flown again."
            )
    again = fly(scenario, laws=laws, plants=plants, progress=progress)
    return tuple(Reflight(run, again[run.label]) for run in runs)


def changed_versions(then: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Libraries whose version is not that of `then`: the version then, and now."""
    now = library_versions()
    return {
        name: (version, now.get(name, "none"))
        for name, version in then.items()
        if now.get(name) != version
    }


def _differences(recorded: Run, reflown: Run) -> Iterator[Difference]:
    """Differences to the bit: of gains, then of signals in time, then of the outcome."""
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
    for name in ("K_P", "K_I"):
        then, now = getattr(recorded, name), getattr(reflown, name)
        for i, j in np.argwhere(then != now).tolist():
            yield Difference(f"{name}[{i}][{j}]", None, float(then[i, j]), float(now[i, j]))


def _in_signals(recorded: Run, reflown: Run) -> Iterator[Difference]:
    n = min(len(recorded.signals), len(reflown.signals))
    if not n:
        return
    columns = [[*map(str, run.signals)] for run in (recorded, reflown)]
    if columns[0] != columns[1]:
        odd = [", ".join(sorted(set(a) - set(b))) or "others" for a, b in (columns, columns[::-1])]
        yield Difference("signals", None, *odd)
        return
    then, now = (
        run.signals[names].reset_index().to_numpy(dtype=float)[:n]
        for run, names in zip((recorded, reflown), columns, strict=True)
    )
    # Bits, not values: a NaN equals itself, and zeros of either sign are two numbers.
    bits = [np.ascontiguousarray(table).view(np.uint64) for table in (then, now)]
    for row, column in np.argwhere(bits[0] != bits[1])[:1].tolist():
        what = ["t", *columns[0]][column]
        at = (row, column)
        yield Difference(what, float(then[row, 0]), float(then[at]), float(now[at]))
