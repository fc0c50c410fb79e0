"""Bands on a route: the corridor that they claim, and the count of flights inside a fence."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flighttune.campaign.band import plan_of
from flighttune.campaign.planning.plan import Plan
from flighttune.claims.band import Band
from flighttune.claims.count import supported_epsilon
from flighttune.errors import InputError
from flighttune.flight.conditions import reference_of
from flighttune.flight.route import PlannedRoute, planned_route
from flighttune.metrics import OFF_ROUTE
from flighttune.present.answer import Answer, pick
from flighttune.present.tables import Column, Table, number, printable
from flighttune.references.fence import DISTANCE_SIGNS, Fence, read_fence, room_along
from flighttune.references.follow import RouteReference
from flighttune.references.maps import Corridor, Where
from flighttune.scenario.schema import Scenario

# GeoJSON as it is read.
Tables: TypeAlias = dict[str, Any]

# Stands for the file of a fence that is kept with its band.
KEPT = Path("fence")

# Distance in samples, at the airspeed, by which positions may lie beyond the edges of a window.
OVERLAP_SAMPLES = 2.0


class FenceCount(NamedTuple):
    """The flights of a band that are not certainly inside a fence."""

    heights: str  # floor and ceiling of the fence in words
    outside: int
    epsilon: float  # probability of leaving the fence that the count supports
    supported: bool  # whether it is at most that of the band
    nearest: list[dict[str, Any]]  # of the completed flights, and of the band if it has a corridor


NEAREST_COLUMNS = [
    Column("what", "nearest to the fence"),
    Column("margin_m", "margin", "m", "z.2f"),
    Column("side", "side"),
    Column("edge", "edge"),
    Column("along_m", "along", "m", ".0f"),
    Column("stretch", "stretch"),
]


def route_of(band: Band) -> PlannedRoute:
    """The planned route of the flights of a band."""
    return planned_route(plan_of(band).campaign.central)


def where_of(scenario: Scenario) -> Where:
    """Path, start and height of a scenario with a route."""
    route = reference_of(scenario)
    if scenario.route is None or not isinstance(route, RouteReference):
        raise InputError("`route` must be given for a corridor, got a reference over time.")
    return route.path, scenario.route.origin, scenario.flight.h_m


def fence_of(plan: Plan, tables: Tables, file: Path = KEPT, *signals: str) -> Fence:
    """The fence in the tables of a file about the flights of a plan; a band bounds `signals`."""
    _, origin, _ = where_of(plan.campaign.central)
    check_off_route(signals or OFF_ROUTE)
    return read_fence(file, origin, tables)


def corridor_of(band: Band, where: Where | None = None) -> Corridor:
    """The corridor that a band claims, in any wind, about the route `where`."""
    about = band.about
    if about.predicted_from or not band.claims:
        claim = "one around a prediction from the wind" if about.predicted_from else "no claim"
        raise InputError(f"the band must claim one corridor for all flights, got {claim}.")
    if where and where != where_of(plan_of(band).campaign.central):  # a path is planned once
        raise InputError("the band must be of this route and start, got one of another.")
    edges, columns = band.flights.edges, _columns(band)
    bounds, windows = band.bounds(edges[:-1]), np.column_stack([edges[:-1], edges[1:]])
    low, high = bounds.low[:, columns], bounds.high[:, columns]
    return Corridor(windows, low, high, printable(band.sentence))


def count_inside(band: Band, tables: Tables, file: Path = KEPT) -> FenceCount:
    """Count the flights of a band that are not certainly inside a fence."""
    about, plan = band.about, plan_of(band)
    central, columns = plan.campaign.central, _columns(band)
    fence, where = fence_of(plan, tables, file), where_of(central)
    for run in band.draws.tolist():
        if where_of(plan.scenario_of(run))[:2] != where[:2]:  # the same path is planned once
            raise InputError(f"a fence must have one path and start for all, got draw {run}.")
    away, completed = DISTANCE_SIGNS * band.extremes[:, :, columns], np.isfinite(band.scores)
    reaches = {"completed flights": away[completed].max(axis=0)} if completed.any() else {}
    if band.claims and not about.predicted_from:
        corridor = corridor_of(band)
        reaches["band"] = DISTANCE_SIGNS * np.stack([corridor.low, corridor.high], axis=-1)
    widest = max([0.0, *(float(reach[:, 0].max()) for reach in reaches.values())])
    overlap = OVERLAP_SAMPLES * central.flight.V_a_mps / central.controller.rate_hz
    room = room_along(fence, where[0], band.flights.edges, widest=widest, overlap=overlap)
    # The limits to the sides are finite: flights that were not completed are outside.
    outside = int(np.sum(~(away <= room.limits).all(axis=(1, 2, 3))))
    epsilon = supported_epsilon(outside, len(away), about.confidence)
    nearest = [{"what": what, **room.nearest(reach)} for what, reach in reaches.items()]
    return FenceCount(fence.heights, outside, epsilon, epsilon <= about.epsilon, nearest)


def inside_sentence(band: Band, count: FenceCount) -> str:
    """The result of a count of flights inside a fence, in words."""
    flights = len(band.scores)
    return (
        f"of {flights} fresh flights {flights - count.outside} are certainly inside the fence: a "
        f"new flight leaves it with probability at most {number(count.epsilon)}, confidence "
        f"{band.confidence:.10g}{band.shared}"
    )


def fence_answer(counted: Band, answer: Answer) -> Answer:
    """The answer of a band and of its last fence; a failure if flights may leave it."""
    count = count_inside(counted, counted.about.fences[-1])
    said = [
        f"The band itself is {'inside' if nearest['margin_m'] >= 0.0 else 'not inside'} the fence."
        for nearest in count.nearest
        if nearest["what"] == "band"
    ]
    said.append(f"The fence has {count.heights}.")
    if counted.not_completed:
        said.append(f"Of the flights {counted.lost}: they count as outside.")
    sentence = inside_sentence(counted, count)
    return replace(
        answer,
        values={**answer.values, "fence": count._asdict()},
        tables=[*answer.tables, Table(NEAREST_COLUMNS, count.nearest, "fence")],
        notes=[*answer.notes, answer.verdict or answer.failure, *said],
        verdict=sentence if count.supported else "",
        failure="" if count.supported else f"{sentence}; {counted.about.epsilon:g} was asked for",
    )


def mission_answer(counted: Band, answer: Answer) -> Answer:
    """The answer of a mission's band with the length, the time and the fate of its items."""
    planned = route_of(counted)
    plan = planned.answer()
    mission = {**pick(planned, "conditions time"), "length_m": planned.length}
    flyable = f"Flyable: {plan.verdict}; {planned.conditions}."
    return replace(
        answer,
        values={**answer.values, "mission": mission},
        notes=[flyable, *plan.notes, *answer.notes],
    )


def check_off_route(signals: Iterable[str], over: str = "along") -> None:
    """Refuse a band without the distances from a route."""
    if over != "along" or not {*OFF_ROUTE} <= {*signals}:
        raise InputError(
            f"the band must be of {' and '.join(OFF_ROUTE)} along a route, got one of "
            f"{', '.join(signals)} over {'time' if over == 'time' else 'the distance along it'}."
        )


def _columns(band: Band) -> list[int]:
    """Where the distances from a route are among the signals of a band."""
    check_off_route(band.about.signals, band.flights.over)
    return [list(band.about.signals).index(name) for name in OFF_ROUTE]
