"""Fly recorded runs again from what they say made them, and look for the first difference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.flight import fly
from flighttune.one_flight import Progress, library_versions
from flighttune.scenario import scenario_from
from flighttune.simulate.run import Run

STOPPED_FROM_OUTSIDE = ("cut_off", "interrupted")
"""What does not come again: a recording that was cut off, a flight stopped by hand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Where a run that was flown again first differs.

    Attributes
    ----------
    what : str
        A signal, an entry of the gains such as ``K_P[0][1]``, ``status``, ``samples`` or
        ``signals`` (their names).
    t : float or None, s
        When, where it is a signal.
    recorded, reflown : float, int or str
        Both values, SI and rad.
    """

    what: str
    t: float | None
    recorded: float | int | str
    reflown: float | int | str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reflight:
    """A recorded run and the same flight flown again.

    Attributes
    ----------
    recorded, reflown : Run
    difference : Difference or None
        The first one; None where gains, outcome and every sample are equal to the bit. Of a run
        that was cut off or stopped by hand only the samples it has are looked at.
    versions : mapping of str to (str, str)
        Libraries whose version is not the recorded one: then and now.
    """

    recorded: Run
    reflown: Run
    difference: Difference | None
    versions: Mapping[str, tuple[str, str]]


def refly(runs: Sequence[Run], *, progress: Progress | None = None) -> tuple[Reflight, ...]:
    """Fly runs again from the scenario and seed in their provenance.

    Parameters
    ----------
    runs : sequence of Run
        Runs of one scenario, as `load_recording` returns them.
    progress : callable, optional
        Told how far each run is.

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
    """
    scenarios = [dict(run.provenance.scenario) for run in runs]
    if not runs or any(other != scenarios[0] for other in scenarios[1:]):
        raise RecordingError(f"the runs must be of one scenario, got {len(runs)} of several.")
    scenario = scenario_from(scenarios[0])
    names = [entry if isinstance(entry, str) else entry.name for entry in scenario.gains]
    known = [f"{plant.label} / {name}" for plant in scenario.plant for name in names]
    for run in runs:
        if run.label not in known:
            raise RecordingError(
                f"{run.label}: the run must be one of its scenario ({', '.join(known)}) "
                "to be flown again."
            )
    again = {run.label: run for run in fly(scenario, progress=progress).runs}
    now = library_versions()
    return tuple(
        Reflight(
            recorded=run,
            reflown=again[run.label],
            difference=first_difference(run, again[run.label]),
            versions={
                name: (then, now.get(name, "none"))
                for name, then in run.provenance.versions.items()
                if now.get(name) != then
            },
        )
        for run in runs
    )


def first_difference(recorded: Run, reflown: Run) -> Difference | None:
    """The first difference of two runs to the bit: gains, then signals in time, then outcome.

    Parameters
    ----------
    recorded : Run
        With the status ``cut_off`` or ``interrupted`` only its samples are looked at.
    reflown : Run
    """
    found = _in_gains(recorded.provenance.gains, reflown.provenance.gains)
    found = found or _in_signals(recorded, reflown)
    if found or recorded.status in STOPPED_FROM_OUTSIDE:
        return found
    for what, a, b in (
        ("samples", len(recorded.signals), len(reflown.signals)),
        ("status", recorded.status, reflown.status),
        ("reason", recorded.reason, reflown.reason),
    ):
        if a != b:
            return Difference(what=what, t=None, recorded=a, reflown=b)
    return None


def _in_gains(recorded: PIGains | None, reflown: PIGains | None) -> Difference | None:
    if recorded is None or reflown is None:
        if recorded is reflown:
            return None
        words = ["none" if gains is None else "found" for gains in (recorded, reflown)]
        return Difference(what="gains", t=None, recorded=words[0], reflown=words[1])
    for name in ("K_P", "K_I"):
        a, b = getattr(recorded, name), getattr(reflown, name)
        for i, j in np.argwhere(a != b).tolist():
            return Difference(
                what=f"{name}[{i}][{j}]", t=None, recorded=float(a[i, j]), reflown=float(b[i, j])
            )
    return None


def _in_signals(recorded: Run, reflown: Run) -> Difference | None:
    columns = [list(map(str, run.signals)) for run in (recorded, reflown)]
    n = min(len(recorded.signals), len(reflown.signals))
    if not n:
        return None
    if columns[0] != columns[1]:
        odd = [", ".join(sorted(set(a) - set(b))) or "others" for a, b in (columns, columns[::-1])]
        return Difference(what="signals", t=None, recorded=odd[0], reflown=odd[1])
    tables = [
        np.column_stack([run.signals.index.to_numpy(dtype=float), run.signals.to_numpy()])[:n]
        for run in (recorded, reflown)
    ]
    bits = [np.ascontiguousarray(table).view(np.uint64) for table in tables]
    unequal = np.argwhere(bits[0] != bits[1])
    if not len(unequal):
        return None
    row, column = unequal[0].tolist()
    return Difference(
        what=["t", *columns[0]][column],
        t=float(tables[0][row, 0]),
        recorded=float(tables[0][row, column]),
        reflown=float(tables[1][row, column]),
    )
