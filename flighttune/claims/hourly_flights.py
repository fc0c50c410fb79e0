"""The flights of a claim per flight hour: their plans, and how they are flown until they end."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field

from flighttune.base.errors import InputError
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.schema import Choice, Uniform
from flighttune.campaigns.statistics.per_hour import Count
from flighttune.claims.counted_flights import rebuilt
from flighttune.claims.leaving import AT_ITS_START, NEVER, Alarms, Leaving, Left, Volume
from flighttune.claims.rates_keys import MANOEUVRES, FaultRateTable, HowEnded, RatesTable
from flighttune.flight.route import planned_route
from flighttune.flight.scenario.load import scenario_from

# Keys of a drawn fault, and of the ending of one flight.
OF_AIRFRAME, OF_RECEIVER = "plant.airframe.fault.from_s", "navigation.fault.from_s"
ENDED_S, ENDED_AT_M = "plant.airframe.fault.ended_s", "route.ending.at_m"

# Time of ending that no flight reaches, s.
NOT_ENDED_S = 1e6

# Longest flight, relative to its time in still air: the bound has this time for flights that last
# longer than all that were counted.
LONGEST = 3.0

# Sides to which a flight turns when it is ended: left and right.
SIDES = -1, 1

# Time allowed for the manoeuvre of an ending, relative to that in still air.
MANOEUVRE = 2.0

Time: TypeAlias = Annotated[float, Field(ge=0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownTerm:
    """The flights of one term: when each left the volume, was ended, and when its record ends."""

    fault: int | None  # place in the file of rates; None without a fault
    ended_s: float | None  # time from fault to ending
    left_s: tuple[float, ...]  # -1: it stayed inside
    end_s: tuple[Time, ...]
    ended_at_s: tuple[float, ...]  # -1: it was not ended

    def __post_init__(self) -> None:
        if not len(self.left_s) == len(self.end_s) == len(self.ended_at_s):
            raise InputError("`terms` must have three times of each flight.")
        times = zip(self.left_s, self.end_s, self.ended_at_s, strict=True)
        for run, (left, end, ended_at) in enumerate(times):
            if not all(x == NEVER or 0.0 <= x <= end for x in (left, ended_at)):
                raise InputError(
                    f"`terms` must have times of leaving and of ending that are {NEVER:g} or in a "
                    f"flight of {end:g} s, got {left:g} and {ended_at:g} of flight {run}."
                )

    def __len__(self) -> int:
        return len(self.left_s)

    def with_flights(self, flown: Iterable[Left]) -> "FlownTerm":
        """The term with further flights."""
        left, end, ended_at, _ = zip(*flown, strict=True)
        return replace(
            self,
            left_s=(*self.left_s, *left),
            end_s=(*self.end_s, *end),
            ended_at_s=(*self.ended_at_s, *ended_at),
        )

    @property
    def count(self) -> Count:
        """Flights that left, of all."""
        return Count(outside=sum(left >= 0.0 for left in self.left_s), flights=len(self))

    @property
    def ended(self) -> int:
        """Number of flights that were ended."""
        return sum(at >= 0.0 for at in self.ended_at_s)


def hourly_plan(plan: Plan) -> Plan:
    """The flights without a fault, which end after a multiple of their time in still air."""
    tables = plan.scenario.as_dict()
    longest = math.ceil(LONGEST * planned_route(plan.campaign.central).time)
    tables["flight"]["duration_s"] = min(float(longest), tables["flight"]["duration_s"])
    # Other draws than those that the volume may follow from.
    campaign = plan.campaign.model_copy(update={"seed": plan.campaign.seed + 1})
    nominal = scenario_from(tables)
    return replace(plan, campaign=rebuilt(campaign, campaign.disperse, nominal))


# Attempts to fly a flight.
ATTEMPTS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Ends:
    """Which flights of a claim are ended, when and how, and the volume that they may leave."""

    plan: Plan  # of the flights without a fault
    rates: RatesTable
    volume: Volume
    alarms: Alarms | None

    def term(self, fault: int | None, after_s: float | None, window_s: float) -> "TermFlights":
        """The flights of a term, ended a time after the fault."""
        how = self.rates.ending_of(fault)
        ends = after_s is not None or self.alarms is not None
        (group,) = self.plan.groups
        return TermFlights(
            plan=_plan_of(self, fault, how if ends else None, window_s),
            leaving=Leaving(
                volume=self.volume,
                ending=self.rates.ending,
                how=how,
                after_s=after_s,
                alarms=self.alarms,
                lead_s=max(self.plan.entry(group).lead),
            ),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TermFlights:
    """The flights of one term."""

    plan: Plan
    leaving: Leaving

    def check_times(self, term: FlownTerm) -> None:
        """Refuse times that cannot be those of the flights of this plan, without flying any."""
        end, stated = np.array(term.end_s), np.array(term.ended_at_s)
        if (late := end > self.plan.scenario.flight.duration_s).any():
            raise InputError(
                f"`end_s` must be at most {self.plan.scenario.flight.duration_s:g} s, got "
                f"{end[late][0]:g} of flight {int(late.argmax())}."
            )
        after, planned = self.leaving.after_s, np.full(len(term), np.inf)
        if after is not None:
            planned = self.plan.with_runs(len(term)).parameters()[self._from_s] + after
        # An alarm ends a flight before that time, or one that nothing else ends.
        alarmed = self.leaving.alarms is not None and stated != NEVER
        planned = np.where(alarmed & (stated < planned), stated, planned)
        if (wrong := stated != np.where(planned > end, NEVER, planned)).any():
            raise InputError(
                f"`ended_at_s` must be the declared time after the fault that is drawn, got "
                f"{stated[wrong][0]:g} s of flight {int(wrong.argmax())}."
            )

    @property
    def _from_s(self) -> str:
        """Key of the time of the fault."""
        return OF_RECEIVER if OF_RECEIVER in self.plan.keys else OF_AIRFRAME

    def flown(
        self, pool: WorkerPool, runs: Sequence[int], doing: str, *, again: bool = False
    ) -> list[Left]:
        """What some runs did, each flown until it is ended and then as it ends.

        `again`: JSBSim repeats each compiled flight.
        """
        if not runs:
            return []
        plan = self.plan.with_runs(max(runs) + 1)
        if self._known_before:
            after = self.leaving.after_s
            assert after is not None  # no alarm ends these flights
            values = [plan.values_of(run) for run in range(plan.runs)]
            values = [{**x, ENDED_S: x[self._from_s] + after} for x in values]
            return [*self._flown(pool, plan, runs, doing, values, again=again).values()]
        flown = self._flown(pool, plan, runs, doing, again=again)
        if to_end := self._to_end(flown):
            values = [plan.values_of(run) for run in range(plan.runs)]
            pool.progress.budget += len(to_end) * bool(pool.progress.budget)
            for run in to_end:
                values[run] |= self._ending(flown[run])
            ends = f"{doing}: their ends"
            flown |= self._flown(pool, plan, to_end, ends, values, again=again)
        return [*flown.values()]

    @property
    def _known_before(self) -> bool:
        """Whether the time of ending follows from the draw, and nothing else does."""
        leaving = self.leaving
        return leaving.how == "cut" and leaving.alarms is None and leaving.after_s is not None

    def _to_end(self, flown: Mapping[int, Left]) -> list[int]:
        """Runs that are still inside when they are ended; they fly again as they end."""
        if self.leaving.how == "parachute":
            return []  # its descent follows from the state
        return [
            run
            for run, x in flown.items()
            if x.ended_s != NEVER and not NEVER < x.left_s < x.ended_s
        ]

    def _ending(self, flown: Left) -> dict[str, float]:
        """Values with which a flight is ended at the time and place that were found."""
        values = {}
        if self.leaving.how in ("cut", "glide"):
            values[ENDED_S] = flown.ended_s
        if self.leaving.how in MANOEUVRES:
            values[ENDED_AT_M] = flown.at_m
        return values

    def _flown(
        self,
        pool: WorkerPool,
        plan: Plan,
        runs: Sequence[int],
        doing: str,
        draws: list[dict[str, Any]] | None = None,
        *,
        again: bool,
    ) -> dict[int, Left]:
        """What runs did, in their order; a flight without samples left at its start."""
        flown: dict[int, Left] = {}
        # On a busy machine a flight may run out of time: it is flown once more.
        for _ in range(ATTEMPTS):
            missing = [run for run in runs if run not in flown]
            rows = pool.rows(
                plan, missing, doing=doing, probes={"left": self.leaving}, draws=draws, again=again
            )
            # Only these numbers of a row are kept: a count may have 10^6 flights.
            flown |= {row["run"]: Left(*row["left"]) for row in rows if "left" in row}
        return {run: flown.get(run, AT_ITS_START) for run in runs}


def _plan_of(ends: Ends, fault: int | None, how: HowEnded | None, window_s: float) -> Plan:
    """Flights with a fault at a time uniform over a window, which can end as they are to."""
    plan, rates = ends.plan, ends.rates
    if fault is None and how is None:
        return plan
    tables, drawn = plan.scenario.as_dict(), list(plan.campaign.disperse)
    in_air: dict[str, Any] = {}  # [plant.airframe.fault]
    if fault is not None:
        kind, sizes = rates.fault[fault].of_kind, _range_of(plan, rates.fault[fault])
        own: dict[str, Any] = {"from_s": 0.0}
        if kind.key:
            own[kind.key] = kind.fixed if sizes is None else sizes[0]
        if kind.receiver:
            tables["navigation"] = {**(tables.get("navigation") or {}), "fault": own}
            drawn.append(Uniform(key="navigation.fault.course_deg", lower=-180.0, upper=180.0))
        else:
            in_air = own
        from_s = OF_RECEIVER if kind.receiver else OF_AIRFRAME
        drawn.append(Uniform(key=from_s, lower=0.0, upper=window_s))
        if sizes is not None:
            key = from_s.replace("from_s", kind.key)
            drawn.append(Uniform(key=key, lower=sizes[0], upper=sizes[1]))
    if how in ("cut", "glide"):
        by = "cut" if how == "cut" else "thrust"
        in_air = {"from_s": 0.0, **in_air, "ended_s": NOT_ENDED_S, "ended_by": by}
        drawn.append(Choice(key=ENDED_S, values=[NOT_ENDED_S]))
    for plant in tables["plant"]:
        if in_air and plant["kind"] == "jsbsim":
            plant["airframe"] = {**(plant.get("airframe") or {}), "fault": in_air}
    if how is not None and how in MANOEUVRES:
        tables["route"]["ending"] = {"kind": MANOEUVRES[how]}
        tables["flight"]["duration_s"] += _longest(plan, tables)
        drawn.append(Choice(key="route.ending.side", values=[*SIDES]))
    seed = plan.campaign.seed + (0 if fault is None else 1 + fault)
    campaign = plan.campaign.model_copy(update={"success": [], "seed": seed})
    return replace(plan, campaign=rebuilt(campaign, drawn, scenario_from(tables)))


def _longest(plan: Plan, tables: dict[str, Any]) -> float:
    """Time for the manoeuvre that ends a flight, s, from where it is longest."""
    path, lengths = planned_route(plan.campaign.central).reference.path, []
    flown = path.s <= path.length
    far = np.hypot(path.north - path.north[0], path.east - path.east[0])
    # The way down is longest from the highest place, the way home from the farthest; turning onto
    # either may be longest at the start, and to one side.
    places = {0.0, *(float(path.s[x[flown].argmax()]) for x in (path.up, far))}
    for at_m, side in product(places, SIDES):
        ending = {**tables["route"]["ending"], "at_m": at_m, "side": side}
        ended = scenario_from({**tables, "route": {**tables["route"], "ending": ending}})
        lengths.append(planned_route(ended).reference.path.length - at_m)
    return MANOEUVRE * math.ceil(max(lengths) / min(plan.campaign.central.airspeeds))


def _range_of(plan: Plan, fault: FaultRateTable) -> tuple[float, float] | None:
    """Range of a fault's size; None without a range."""
    kind = fault.of_kind
    stated = getattr(fault, kind.range_key) if kind.range_key else None
    if stated is not None or not kind.surface:
        return stated
    (table,) = (x for x in plan.scenario.plant if x.label == plan.groups[0].plant)
    surface = getattr(table.config.surfaces, kind.surface)
    low, high = np.rad2deg(surface.travel).tolist()
    return low, high


def check_rates(plan: Plan, rates: RatesTable) -> None:
    """Refuse faults and endings that the aircraft cannot have, before any flight."""
    (table,) = (x for x in plan.scenario.plant if x.label == plan.groups[0].plant)
    if table.aircraft is None:
        raise InputError(f"`rates` must be for an aircraft (jsbsim), got {table.label}.")
    if table.airframe is not None and table.airframe.fault is not None:
        raise InputError("`rates` must be for flights without a fault of their own.")
    config, endings = table.config, {rates.ending_of(i) for i in range(len(rates.fault))}
    if "glide" in {*endings, rates.ending.kind} and not plan.scenario.speed_priority:
        raise InputError(
            "`kind` of [ending] must be without a glide for a law that does not hold the airspeed: "
            "[controller] `speed_priority` must be true."
        )
    for fault in rates.fault:
        kind, travel = fault.of_kind, None
        if kind.surface:
            surface = getattr(config.surfaces, kind.surface)
            if surface is None:
                raise InputError(
                    f"`kind` must be a fault that {table.aircraft} can have, got {fault.kind}: it "
                    f"has no {kind.surface}."
                )
            travel = np.rad2deg(surface.travel)
        if fault.kind == "engine" and config.engines.count == 0:
            raise InputError(
                f"`kind` must be a fault that {table.aircraft} can have, got engine: it has none."
            )
        if kind.receiver and plan.scenario.navigation is None:
            raise InputError(
                f"`kind` must be a fault of what is flown, got {fault.kind} with exact navigation."
            )
        stated = fault.stuck_deg
        if (
            travel is not None
            and stated
            and not travel[0] - 1e-9 <= stated[0] <= stated[1] <= travel[1] + 1e-9
        ):
            raise InputError(
                f"`stuck_deg` of {fault.kind} must lie in the travel of {table.aircraft}, "
                f"{travel[0]:g} to {travel[1]:g}, got {stated[0]:g} to {stated[1]:g}."
            )
