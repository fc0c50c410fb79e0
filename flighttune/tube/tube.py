"""The set of all errors that the flights of a scenario can have."""

from collections.abc import Callable, Sequence

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.conformance import Conformance
from flighttune.control.gains import PIGains
from flighttune.control.law import Law
from flighttune.scenario.schema import Scenario
from flighttune.tube.exact import enclosure_of
from flighttune.tube.hand_over import hull, settled_from
from flighttune.tube.problem import TubeProblem, tube_problem
from flighttune.tube.result import QUANTITIES, Settings, Tube, first_set, within_counted
from flighttune.tube.sample import Bounds, Unbounded
from flighttune.tube.search import Search
from flighttune.tube.settling import coordinates, hand_over

DOUBLING = 0.2
"""Time, s, within which the width of a set that is about to be lost doubles."""

LEAST_DISTURBANCE, MOST_DISTURBANCE = 1e-5, 10.0
"""Range in which the largest disturbance is looked for, rad/s."""

UNKNOWN_START = "in wind the path over ground begins elsewhere, and the scenario states no wind"


def tube(
    scenario: Scenario,
    gains: PIGains,
    *,
    plant: str | None = None,
    start: float = 0.0,
    disturbance: float | None = None,
    conformance: Conformance | None = None,
    law: Law | None = None,
    progress: Callable[[float], None] | None = None,
) -> Tube:
    """Enclose all flights of a scenario: the controller as it flies, with all its limits.

    `plant`: label of a plant; by default the first aircraft with a conformance, else the first
    plant that is none. `start` (rad): course and flight-path angle start within this of the
    scenario's. `disturbance` (rad/s): the disturbance of each rate is within this of zero, in any
    shape; by default within the amplitudes of the scenario's sinusoid, or zero. `conformance`: that
    of an aircraft: its model flies, under every disturbance in its boxes. Where the set of these
    flights is lost, the errors are within the boxes that were counted for them. `law`: law that
    flies the gains; by default the first of the scenario that takes them. `progress`: called with
    the share of time that is enclosed, 0 to 1. Raises InputError if a value cannot be used, or the
    tube does not know the law.
    """
    problem = tube_problem(
        scenario,
        gains,
        plant=plant,
        start=start,
        disturbance=disturbance,
        conformance=conformance,
        law=law,
    )
    result = enclosed(problem, progress=progress)
    lost = result.status == "unbounded" and problem.counted is not None
    return within_counted(result) if lost else result


def largest_disturbance(
    scenario: Scenario,
    gains: PIGains,
    *,
    plant: str | None = None,
    start: float = 0.0,
    law: Law | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Tube]:
    """Look for the largest disturbance, to two digits, for which the set is bounded.

    Parameters are those of `tube`. Returns all tubes that were tried, by disturbance. The largest
    bounded one is known to two digits if one that is larger follows it; the list ends with a
    bounded one at `MOST_DISTURBANCE`, and has none at all if none down to `LEAST_DISTURBANCE`, or
    to the scenario's own, is bounded.
    """
    tried: dict[float, Tube] = {}
    least = max(np.abs(tube_problem(scenario, gains, plant=plant, law=law).d_high).max(), 0.0)

    def bounded(size: float) -> bool:
        problem = tube_problem(scenario, gains, plant=plant, start=start, disturbance=size, law=law)
        tried[size] = enclosed(problem, for_ever=False, progress=progress)
        return tried[size].status == "bounded"

    low, high = _bracket(bounded, max(0.01, float(least)), max(LEAST_DISTURBANCE, float(least)))
    while low and high:
        middle = float(f"{np.sqrt(low * high):.2g}")
        if not low < middle < high:
            break
        low, high = (middle, high) if bounded(middle) else (low, middle)
    return [tried[size] for size in sorted(tried)]


def _bracket(
    bounded: Callable[[float], bool], size: float, least: float
) -> tuple[float | None, float | None]:
    """A disturbance that is bounded and twice as much, or less, that is not; None without one."""
    if bounded(size):
        while size < MOST_DISTURBANCE:
            size, low = 2.0 * size, size
            if not bounded(size):
                return low, size
        return size, None
    while size > least:
        size, high = max(0.5 * size, least), size
        if bounded(size):
            return size, high
    return None, size


def enclosed(
    problem: TubeProblem,
    *,
    attempts: Sequence[Settings] = (),
    for_ever: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Tube:
    """The tube of a problem: with few pieces where that is enough, else with many.

    `attempts`: tried one after the other until the set is bounded; by default two. `for_ever`: look
    for a set that holds the flights after the time of the scenario too. `progress`: see `tube`.
    """
    best: Tube | None = None
    for settings in attempts or _attempts(problem):
        result = _attempt(problem, settings, progress, for_ever=for_ever)
        if result.status == "bounded":
            return result
        if best is None or len(result.t) > len(best.t):
            best = result
    assert best is not None
    return best


def _why_lost(
    stop: str, t: FloatArray, bounds: Sequence[Bounds], limits: dict[str, tuple[str, int]]
) -> str:
    """Time at which the set is lost, limits that could act before, and growth of its width."""
    lost = len(bounds)
    reason = f"{stop} from t = {t[lost]:.2f} s on"
    acting = [f"the {limit} of {side} from {t[k]:.2f} s on" for side, (limit, k) in limits.items()]
    if acting:
        reason += f"; commands can be held by {', '.join(acting)}"
    span = round(DOUBLING / (t[1] - t[0]))
    if lost <= span:
        return reason
    widths = np.ptp([sample.ranges[:2] for sample in bounds], axis=2)
    steady = (widths[span:] < 2.0 * widths[:-span]).all(axis=1)
    first = int(np.flatnonzero(steady)[-1]) + 1 if steady.any() else 0
    if first < len(steady):
        reason += f"; from {t[first]:.2f} s on the width doubles within {DOUBLING} s"
    return reason


def _attempts(problem: TubeProblem) -> list[Settings]:
    disturbed = bool((problem.d_low < problem.d_high).any())
    sides = 1 if problem.start == 0.0 else 4 if disturbed else 8
    symbols = 660 if disturbed else 200
    # Splitting costs time for every piece: of a box of starts only where it must be.
    few, many = (1 if sides > 1 else 60), sides * sides + 100
    return [
        Settings(sides, symbols, tolerance, most) for tolerance, most in ((0.5, few), (0.2, many))
    ]


def _attempt(
    problem: TubeProblem,
    settings: Settings,
    progress: Callable[[float], None] | None,
    *,
    for_ever: bool,
) -> Tube:
    loop, t = problem.loop, problem.t
    rows, still, hulls = coordinates(loop) if for_ever else None, settled_from(loop), {}
    search = Search(loop, tolerance=settings.tolerance, most=settings.most)
    enclosure = enclosure_of(loop, first_set(problem, settings), search)
    bounds, reason = [], "" if problem.start_known else UNKNOWN_START
    for k in range(len(t) if problem.start_known else 0):
        try:
            bounds.append(enclosure.sample(k))
        except Unbounded as stop:
            reason = _why_lost(str(stop), t, bounds, enclosure.limits)
            break
        if rows is not None and k >= still:
            hulls[k + 1] = hull(enclosure.pieces, rows[0])
        if progress is not None and k % 50 == 0:
            progress(k / len(t))
    return Tube(
        problem=problem,
        status="unbounded" if reason else "bounded",
        reason=reason,
        t=t[: len(bounds)],
        bounds=np.array([sample.ranges for sample in bounds]).reshape(-1, len(QUANTITIES), 2),
        held=np.array([sample.limited for sample in bounds], dtype=bool).reshape(-1, 2),
        settings=settings,
        chosen=search.choices,
        hand_over=None if reason or rows is None else hand_over(loop, *rows, hulls),
    )
