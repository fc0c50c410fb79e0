"""The set of all errors that the flights of a scenario can have."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InfeasibleError
from flighttune.base.words import number
from flighttune.claims.residual import Residual
from flighttune.claims.tubes import exact, interval, proof, sample
from flighttune.claims.tubes.enclosure import LEFT, Flown, Settings, Tube, bounds_of
from flighttune.claims.tubes.problem import QUANTITIES, TubeProblem, enclosed_plant, tube_problem
from flighttune.claims.tubes.search import Search, coordinates, settled_set
from flighttune.control.gains import PIGains
from flighttune.flight import fly, load
from flighttune.flight.loop.loop import simulate
from flighttune.flight.scenario.schema import Scenario

# Maximum doubling time of the width of a set that is about to be lost, s
DOUBLING = 0.2

# Number of flights of an aircraft from random starts against its boxes
RANDOM_STARTS = 8

# Trial disturbances, rad/s: all numbers of two digits
DISTURBANCES = [float(f"{digits}e{power}") for power in range(-6, 0) for digits in range(10, 100)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedDisturbances(Answering):
    """The tubes of a problem for several disturbances."""

    tried: Mapping[float, Tube]  # tubes by bound on the disturbance, rad/s

    @property
    def largest(self) -> float | None:
        """The largest disturbance with a bounded tube, rad/s; None without any."""
        bounded = (size for size, tube in self.tried.items() if tube.status == "bounded")
        return max(bounded, default=None)


def largest_disturbance(
    problem: TubeProblem, progress: Callable[[float], None] | None = None
) -> TriedDisturbances:
    """Seek the largest disturbance, to two digits, with a bounded tube.

    The largest bounded disturbance is known to two digits if the next larger one was also tried. If
    the first of `DISTURBANCES`, or the scenario's own disturbance, is not bounded, no tube is.
    """
    tried: dict[float, Tube] = {}

    def lost(size: float) -> bool:
        tried[size] = tube_of(replace(problem, disturbance=size), for_ever=False, progress=progress)
        return tried[size].status == "unbounded"

    scenario_size = float(problem.disturbances[1].max())
    larger = [size for size in DISTURBANCES if size > scenario_size]
    bisect_left([scenario_size, *larger] if scenario_size else larger, True, key=lost)
    return TriedDisturbances(tried=dict(sorted(tried.items())))


def enclosed(problem: TubeProblem, progress: Callable[[float], None] | None = None) -> Tube:
    """The tube of a problem; flights that contradict it or its boxes make it unbounded."""
    enclosure = tube_of(problem, progress=progress)
    flown = flights_against(enclosure)
    enclosure = replace(enclosure, flown=flown)
    reason = LEFT if flown.leave else boxes_refuted(enclosure, flown)
    return replace(enclosure, status="unbounded", reason=reason) if reason else enclosure


def boxes_refuted(enclosure: Tube, flown: Flown) -> str:
    """Why the boxes of an aircraft do not hold in its flights; empty if they may.

    A flight outside its boxes is no flight of the tube and does not contradict it. But a count
    claims how rare such flights are.
    """
    counted, left = enclosure.probability, flown.drawn_outside_boxes
    if counted is not None and counted.of == "flight":
        chance = binom.sf(left - 1, flown.drawn, counted.at_most)
        if chance < 1.0 - counted.confidence:
            return (
                f"{left} of {flown.drawn} flights from random starts leave the boxes, which a "
                f"flight leaves with probability at most {number(counted.at_most)} by their count: "
                "the boxes are wrong and no file is written"
            )
    if flown.outside_boxes == flown.flights:
        who = "the scenario's flight leaves its"
        if flown.flights > 1:
            who = f"all {flown.flights} flights from its starts leave their"
        return f"{who} boxes, so the tube covers none that was flown and no file is written"
    return ""


def stated_problem(
    source: Scenario | str | Path,
    wanted: PIGains | str | None = None,
    changes: Mapping[str, Any] | None = None,
    *,
    plant: str | None = None,
    band: Residual | None = None,
    **flights: Any,
) -> TubeProblem:
    """The flights to enclose; `flights` are further arguments of `tube_problem`.

    The default plant is an aircraft if a band is given, and the first suitable law flies gains that
    are numbers.
    """
    entry = load.chosen_entry(source, wanted, changes)
    scenario, law = entry.scenario, entry.law
    if isinstance(wanted, PIGains):
        law = scenario.law_for(wanted)
    if not law.by_gains:
        raise InfeasibleError(
            f"{scenario.title}: gains {entry.name}: a tube must be of a law that it knows, got "
            f"{law.name}."
        )
    table = enclosed_plant(scenario, plant, aircraft=band is not None)
    return tube_problem(replace(entry, law=law, plant=table), band=band, **flights)


def tube_of(
    problem: TubeProblem,
    *,
    attempts: Sequence[Settings] = (),
    for_ever: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Tube:
    """Enclose all flights of a problem: the controller as it flies, with all its limits.

    `attempts`: settings to try in order until the set is bounded; by default first few pieces, then
    many. `for_ever`: also seek an invariant set for the time after the scenario. `progress`: called
    with the enclosed share of the time, 0 to 1.
    """
    if not attempts:
        disturbed = not np.array_equal(*problem.disturbances)
        sides = 1 if problem.start == 0.0 else 4 if disturbed else 8
        symbols = 660 if disturbed else 200
        # Every piece costs time, so a box of starts, already in pieces, is split further only if
        # needed.
        few, many = (1 if sides > 1 else 60), sides * sides + 100
        attempts = [Settings(sides, symbols, 0.5, few), Settings(sides, symbols, 0.2, many)]
    tried = []
    for settings in attempts:
        tried.append(_attempt(problem, settings, progress, for_ever=for_ever))
        if tried[-1].status == "bounded":
            return tried[-1]
    return max(tried, key=lambda tube: len(tube.bounds.t))


def _why_lost(stop: str, t: FloatArray, ranges: Sequence[FloatArray]) -> str:
    """Time when the set is lost, and growth of its width."""
    lost = len(ranges)
    reason = f"{stop} from t = {t[lost]:.2f} s on"
    span = round(DOUBLING / (t[1] - t[0]))
    if not 0 < span < lost:  # a slow loop has no two samples within `DOUBLING`
        return reason
    widths = np.ptp([errors[:2] for errors in ranges], axis=2)
    steady = (widths[span:] < 2.0 * widths[:-span]).all(axis=1)
    first = int(np.flatnonzero(steady)[-1]) + 1 if steady.any() else 0
    if first < len(steady):
        reason += f"; from {t[first]:.2f} s on the width doubles within {DOUBLING} s"
    return reason


def _attempt(
    problem: TubeProblem,
    settings: Settings,
    progress: Callable[[float], None] | None,
    *,
    for_ever: bool,
) -> Tube:
    loop, t = problem.loop, problem.t
    rows, still, hulls = coordinates(loop) if for_ever else None, proof.settled_from(loop), {}
    if rows is not None and still < len(t):
        loop = proof.continued(loop, rows[1])
    search = Search(loop, tolerance=settings.tolerance, most=settings.most)
    starts = sample.start_set(loop, problem.start, settings.sides, settings.symbols)
    enclosure = exact.enclosure_of(loop, starts, search)
    ranges, limits_at, reason, chosen = [], [], "", None
    for k in range(len(loop.reference)):
        if k == len(t):
            chosen = search.choices
        try:
            errors, limited = enclosure.sample(k)
        except interval.Unbounded as stop:
            if k >= len(t):
                rows = None
            else:
                reason = _why_lost(str(stop), t, ranges)
            break
        ranges.append(errors)
        limits_at.append(limited)
        if rows is not None and still <= k < len(t):
            hulls[k + 1] = proof.hull(enclosure.pieces, rows[0])
        if progress is not None and k % 50 == 0:
            progress(k / len(loop.reference))
    ever = None
    if rows is not None and hulls and not reason:
        ever = settled_set(problem.loop, *rows, hulls, np.array(ranges[len(t) :]))
    ranges, limits_at = ranges[: len(t)], limits_at[: len(t)]
    return Tube(
        problem=problem,
        status="unbounded" if reason else "bounded",
        reason=reason,
        bounds=bounds_of(t[: len(ranges)], np.reshape(ranges, (-1, len(QUANTITIES), 2))),
        can_limit=np.array(limits_at, dtype=bool).reshape(-1, 2),
        settings=settings,
        # Choices after the end belong to the invariant set.
        chosen=search.choices if ever or chosen is None else chosen,
        hand_over=ever,
    )


def flights_against(enclosure: Tube) -> Flown:
    """Fly the scenario's own flight, the corners of the starts and some starts at random."""
    problem = enclosure.problem
    corners = sorted({(0.0, 0.0), *product((-problem.start, problem.start), repeat=2)})
    counted = problem.boxes is not None and problem.start > 0.0
    rng = np.random.default_rng(problem.scenario.seed)
    drawn = rng.uniform(-problem.start, problem.start, (RANDOM_STARTS * counted, 2)).tolist()
    flown = [_against(enclosure, *start) for start in (*corners, *drawn)]
    return Flown(
        flights=len(flown),
        drawn=len(drawn),
        outside_boxes=sum(not in_boxes for in_boxes, _ in flown),
        drawn_outside_boxes=sum(not in_boxes for in_boxes, _ in flown[len(corners) :]),
        # An unbounded tube is compared as far as it extends.
        leave=sum(in_boxes and not inside for in_boxes, inside in flown),
    )


def _against(enclosure: Tube, chi: float, gamma: float) -> tuple[bool, bool]:
    """Whether a flight from a start stays in its boxes, and inside the tube."""
    problem, entry = enclosure.problem, enclosure.problem.entry
    start = entry.condition
    start = replace(start, chi=start.chi + chi, gamma=start.gamma + gamma)
    signals, _ = simulate(
        fly.plant_of(entry.plant, entry.scenario),
        problem.controller(),
        entry.reference,
        condition=start,
        duration=entry.scenario.flight.duration_s,
        lead=entry.lead,
    )
    return not problem.outside_boxes(signals, start), enclosure.bounds.contain(signals)
