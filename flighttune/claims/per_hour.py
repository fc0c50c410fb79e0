"""Exits from a volume per flight hour: declared rates of faults times counted flights."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import shapely
from pydantic import Field

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files import code
from flighttune.base.files.table import STRICT, read, validated, write
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.plan import Plan, aircraft_hashes, plan_from
from flighttune.campaigns.planning.schema import Uniform
from flighttune.campaigns.statistics.count import chance_missed, flights_again, flights_needed
from flighttune.campaigns.statistics.per_hour import Count, Exposure, HourlyBound, hourly_bound
from flighttune.claims.about import Probability
from flighttune.claims.counted_flights import rebuilt
from flighttune.claims.rates_keys import EndingTable, FaultRateTable, RatesTable
from flighttune.control.theory.exact import Verification
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.load import scenario_from
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.fence import Fence

# Time between the samples at which a flight is looked at, s.
LOOKED_AT_S = 0.1

# Times since a fault at which flights are ended to find the latest, s, in rising order.
LATER_S = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 60.0)

# Keys of a drawn fault.
OF_AIRFRAME, OF_RECEIVER = "plant.airframe.fault.from_s", "navigation.fault.from_s"

# Share of the confidence's complement, and epsilon, of flights that a check repeats.
AGAIN = 0.05

Time: TypeAlias = Annotated[float, Field(ge=0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Volume:
    """A volume not to leave by its sides or its top, and by its floor, in m from the start."""

    rings: tuple[tuple[tuple[float, float], ...], ...]  # north, east
    outside: tuple[bool, ...]  # whether flights must stay outside each ring
    low: float | None  # None: the ground
    high: float | None

    @classmethod
    def of(cls, fence: Fence) -> "Volume":
        """The volume of a fence."""
        rings = tuple(tuple((n, e) for n, e in ring.tolist()) for ring in fence.rings)
        low, high = (float(x) if math.isfinite(x) else None for x in (fence.low, fence.high))
        return cls(rings=rings, outside=tuple(map(bool, fence.outside)), low=low, high=high)

    def margins(self, places: FloatArray) -> FloatArray:
        """Distances inside the sides, the top and the floor, shape (places, 3), m; negative out."""
        points = np.asarray(shapely.points(places[:, :2]))
        beside = np.full(len(places), np.inf)
        for ring, outside in zip(self.rings, self.outside, strict=True):
            area = shapely.Polygon(ring)
            shapely.prepare(area)
            sign = np.where(shapely.contains(area, points) == outside, -1.0, 1.0)
            beside = np.minimum(beside, sign * shapely.distance(area.exterior, points))
        top = np.full(len(places), np.inf) if self.high is None else self.high - places[:, 2]
        floor = np.full(len(places), np.inf) if self.low is None else places[:, 2] - self.low
        return np.column_stack([beside, top, floor])


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaving:
    """Probe of a flight: the time at which it leaves a volume, -1 if it does not, and its end."""

    volume: Volume
    ending: EndingTable
    ended_s: float | None = None  # time from fault to ending

    any_end: ClassVar[bool] = True  # also asked of flights that did not complete

    def __call__(self, run: Run, scenario: Scenario) -> list[float]:
        """The time of leaving and the time of the end, s."""
        if not len(run.signals):
            return [0.0, 0.0]
        t = np.asarray(run.t, dtype=float)
        every = max(round(LOOKED_AT_S * scenario.controller.rate_hz), 1)
        looked = np.unique(np.append(np.arange(0, len(t), every), len(t) - 1))
        ended_at = self._ended_at(scenario)
        parachute = self.ending.kind == "parachute" and ended_at <= t[-1]
        if parachute:
            last = int(np.searchsorted(t, ended_at))
            looked = np.unique(np.append(looked[looked < last], last))
        signals = run.signals.iloc[looked]
        h = signals["h"].to_numpy()
        up = h - float(run.signals["h"].iloc[0])
        places = np.column_stack([signals["north"], signals["east"], up])
        margins = self.volume.margins(places)
        # An ended flight comes down to the ground inside the sides, which is no exit.
        margins[t[looked] >= ended_at, 2] = np.inf
        out = (margins < 0.0).any(axis=1)
        if out.any():
            return [float(t[looked][out.argmax()]), float(t[-1])]
        whole = run.status in ("completed", "ground_contact") and not parachute
        end = signals.iloc[-1]
        if whole or self._falls_inside(end, margins[-1], scenario, ended_at <= t[-1]):
            return [-1.0, float(t[-1])]
        return [float(t[-1]), float(t[-1])]

    def _ended_at(self, scenario: Scenario) -> float:
        """Time at which the flight is ended, s; infinite for none."""
        if self.ended_s is None:
            return math.inf
        return _fault_time(scenario) + self.ended_s

    def _falls_inside(
        self, end: Mapping[str, Any], margins: FloatArray, scenario: Scenario, ended: bool
    ) -> bool:
        """Whether an ended flight reaches the ground inside, from its last flown state."""
        if not ended:
            return False  # the autopilot flies on, and the model no longer holds
        height = float(end["h"]) - scenario.flight.ground_m
        rise = 0.5 * float(end["V_a"]) ** 2 / scenario.flight.g_mps2
        if self.ending.kind == "parachute":
            sink, opens = self.ending.sink_mps, self.ending.opens_s
            assert sink is not None
            assert opens is not None  # its table has both
            drift = math.hypot(float(end["wind_north"]), float(end["wind_east"]))
            reach = float(end["V_g"]) * opens + drift * height / sink
        elif self.ending.fall_per_height is None:
            return False
        else:
            reach = self.ending.fall_per_height * (height + rise)
        return bool(margins[0] >= reach and margins[1] >= rise)


def _fault_time(scenario: Scenario) -> float:
    """Time of a flight's fault, s."""
    for table in scenario.plant:
        if table.airframe is not None and table.airframe.fault is not None:
            return table.airframe.fault.from_s
    assert scenario.navigation is not None
    assert scenario.navigation.fault is not None  # no fault is in the airframe
    return scenario.navigation.fault.from_s


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownTerm:
    """The flights of one term: when each left the volume, and when it ended."""

    fault: int | None  # place in the file of rates; None without a fault
    ended_s: float | None  # time from fault to ending
    left_s: tuple[float, ...]  # -1: it stayed inside
    end_s: tuple[Time, ...]

    @property
    def count(self) -> Count:
        """Flights that left, of all."""
        return Count(outside=sum(left >= 0.0 for left in self.left_s), flights=len(self.left_s))


@dataclass(frozen=True, kw_only=True, eq=False)
class PerHour(Answering):
    """Exits from the operational volume per flight hour, and the flights that were counted.

    Attributes
    ----------
    rates : dict
        The file of declared rates.
    confidence : float
        Confidence of all that is claimed together.
    plan : dict
        Plan of the flights without a fault.
    volume : Volume
        The operational volume.
    terms : tuple of FlownTerm
        The flights without a fault, then those with each fault.
    later : tuple of FlownTerm
        Flights with the fault of the largest term, ended at other times, in rising order.
    """

    rates: dict[str, Any]
    confidence: Probability
    plan: dict[str, Any]
    volume: Volume
    terms: tuple[FlownTerm, ...]
    later: tuple[FlownTerm, ...] = ()

    kind: ClassVar[str] = "counted"
    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune flight hours 1"
    UNITS: ClassVar[Mapping[str, str]] = {"volume": "m"}

    def __post_init__(self) -> None:
        numbers = [len(term.left_s) for term in self.terms]
        table = self.table
        stated = [table.flights, *(fault.flights for fault in table.fault)]
        faults = [term.fault for term in self.terms]
        ends = [(None, *(x.ended_s for x in table.fault)), tuple(x.ended_s for x in self.terms)]
        lengths = [len(term.end_s) for term in self.terms]
        fit = numbers == stated == lengths and faults == [None, *range(len(table.fault))]
        if not fit or ends[0] != ends[1]:
            raise InputError("`terms` must be the flights that `rates` states.")
        tried = [(term.fault, len(term.left_s)) for term in self.later]
        largest = {
            (i, table.fault[i].flights) for i in (x.fault for x in self.later) if i is not None
        }
        if len({*tried}) > 1 or {*tried} != largest:
            raise InputError("`later` must be flights of one fault.")

    @cached_property
    def table(self) -> RatesTable:
        """The declared rates."""
        return validated(RatesTable, self.rates, "`rates`")

    @cached_property
    def exposure(self) -> Exposure:
        """Durations of the flights without a fault."""
        end = self.terms[0].end_s
        cap = float(self.plan["nominal"]["flight"]["duration_s"])
        return Exposure(shortest_s=min(end), window_s=max(end), cap_s=cap, flights=len(end))

    @cached_property
    def bound(self) -> HourlyBound:
        """The bound and its terms."""
        return self._with({})

    def total_with(self, term: FlownTerm) -> float:
        """The bound with the flights of `term` in place of those with the same fault."""
        assert term.fault is not None  # only faults are ended at other times
        return self._with({term.fault: term.count}).total

    def _with(self, counts: Mapping[int, Count]) -> HourlyBound:
        """The bound with other counts of some faults."""
        faults = [
            (fault.per_hour, counts.get(i, self.terms[i + 1].count))
            for i, fault in enumerate(self.table.fault)
        ]
        return hourly_bound(
            self.terms[0].count,
            faults,
            self.exposure,
            confidence=self.confidence,
            # The fault with the largest term is chosen after the count: each has another share.
            more=len(faults) if self.table.target_per_hour is not None else 0,
        )

    @property
    def met(self) -> bool | None:
        """Whether the target holds; None without a target."""
        target = self.table.target_per_hour
        return None if target is None else self.bound.total <= target

    @property
    def latest(self) -> tuple[str, float] | None:
        """Fault and latest time of ending, s, with which the target holds; None without one."""
        held = None
        for term in self.later:  # in rising order: the first failure ends the sequence
            assert term.fault is not None
            assert term.ended_s is not None
            if self.total_with(term) > (self.table.target_per_hour or 0.0):
                break
            held = self.table.fault[term.fault].kind, term.ended_s
        return held

    @property
    def largest(self) -> int | None:
        """Place of the fault with the largest term; None if that of healthy flight is larger."""
        i = int(np.argmax(self.bound.faults))
        return i if self.bound.faults[i] > self.bound.healthy else None

    @property
    def sentence(self) -> str:
        """The claim."""
        return (
            f"At most {self.bound.total:.3g} flights per flight hour leave the operational volume, "
            f"at a confidence of {self.confidence:g}, with the rates of faults as declared"
        )

    def save(self, path: str | Path) -> None:
        """Write the claim with its counts (.json)."""
        write(self, path)

    def plan_of(self, term: FlownTerm) -> Plan:
        """The plan of a term's flights; InputError if the files of the aircraft have changed."""
        plan = plan_from(self.plan, "`plan`")
        if plan.aircraft != aircraft_hashes(plan.scenario):
            raise InputError("the files of the aircraft must be those that were flown.")
        return _plan_of(plan, self.table, term.fault, term.ended_s, self.exposure.window_s)

    def probe(self, term: FlownTerm) -> Leaving:
        """The probe of a term's flights."""
        return Leaving(volume=self.volume, ending=self.table.ending, ended_s=term.ended_s)

    def verify(self, count: int | None, fliers: Fliers) -> Verification:
        """Repeat `count` random flights of each term with JSBSim, and compare all their numbers."""
        rng, notes = np.random.default_rng(), []
        for term in (*self.terms, *self.later):
            flights = len(term.left_s)
            again = min(flights, flights_again(AGAIN) if count is None else count)
            runs = np.sort(rng.choice(flights, again, replace=False)).tolist()
            try:
                plan = self.plan_of(term).with_runs(flights)
                with code.in_jsbsim(), WorkerPool(fliers) as pool:
                    rows = _flown(pool, plan, self.probe(term), runs)
            except InputError as error:
                return Verification(valid=False, reason=str(error))
            for run, numbers in zip(runs, rows, strict=True):
                if numbers != (term.left_s[run], term.end_s[run]):
                    name = _name(self.table, term)
                    reason = f"flight {run} of {name} must be as JSBSim flies it again, it is not"
                    return Verification(valid=False, reason=reason)
            forged = math.ceil(AGAIN * flights)
            missed = chance_missed(forged, flights, again)
            notes.append(
                f"{_name(self.table, term).capitalize()}: {again} of {flights} flights, chosen at "
                f"random, were flown again by JSBSim and are equal; {forged} forged ones would be "
                f"missed with probability {missed:.2g}."
            )
        notes.append("The declared rates are the applicant's and are not checked.")
        return Verification(valid=True, reason="", notes=tuple(notes))


def _name(table: RatesTable, term: FlownTerm) -> str:
    """A term in words."""
    if term.fault is None:
        return "healthy flight"
    name = table.fault[term.fault].kind.replace("_", " ")
    return name if term.ended_s is None else f"{name}, ended after {term.ended_s:g} s"


def load_per_hour(path: str | Path) -> PerHour:
    """Read a claim per flight hour; its bound is computed again from its counts."""
    return read(path, PerHour)


def count_per_hour(
    plan: Plan, rates: RatesTable, volume: Volume, *, confidence: float, fliers: Fliers
) -> PerHour:
    """Fly the flights of all terms of a file of rates, and bound the exits per flight hour."""
    # Other draws than those that the volume may follow from.
    plan = replace(plan, campaign=plan.campaign.model_copy(update={"seed": plan.campaign.seed + 1}))
    check_rates(plan, rates)
    with WorkerPool(fliers) as pool:
        flying = _Flying(pool, plan, rates, volume)
        healthy = flying.term(None, None, 0.0)
        # The flights without a fault say how long a flight lasts.
        window_s = max(healthy.end_s)
        faults = [flying.term(i, fault.ended_s, window_s) for i, fault in enumerate(rates.fault)]
        counted = PerHour(
            rates=rates.model_dump(mode="json", exclude_none=True),
            confidence=confidence,
            plan=plan.as_dict(),
            volume=volume,
            terms=(healthy, *faults),
        )
        return replace(counted, later=tuple(flying.later(counted)))


@dataclass(frozen=True, slots=True)
class _Flying:
    """The flights of the terms of a claim."""

    pool: WorkerPool
    plan: Plan
    rates: RatesTable
    volume: Volume

    def term(self, fault: int | None, ended_s: float | None, window_s: float) -> FlownTerm:
        """The flights of a term."""
        number = self.rates.flights if fault is None else self.rates.fault[fault].flights
        plan = _plan_of(self.plan, self.rates, fault, ended_s, window_s).with_runs(number)
        term = FlownTerm(fault=fault, ended_s=ended_s, left_s=(), end_s=())
        probe = Leaving(volume=self.volume, ending=self.rates.ending, ended_s=ended_s)
        doing = f"counting {_name(self.rates, term)}"
        rows = _flown(self.pool, plan, probe, range(number), doing)
        left, end = zip(*rows, strict=True)
        return replace(term, left_s=left, end_s=end)

    def later(self, counted: PerHour) -> Iterator[FlownTerm]:
        """Flights with the fault of the largest term, ended later while the target holds."""
        # The times were fixed before, and the first failure ends the sequence: docs/per_hour.md.
        bound, target = counted.bound, self.rates.target_per_hour
        fault = int(np.argmax(bound.faults))
        table = self.rates.fault[fault]
        if target is None or table.ended_s is None:
            return
        if bound.total - bound.faults[fault] >= target:
            return  # no time of ending is early enough
        for ended_s in (x for x in LATER_S if x >= (table.detected_s or 0.0)):
            term = self.term(fault, ended_s, counted.exposure.window_s)
            yield term
            if counted.total_with(term) > target:
                return


def _flown(
    pool: WorkerPool, plan: Plan, probe: Leaving, runs: Sequence[int], doing: str = "counting again"
) -> list[tuple[float, float]]:
    """Times of leaving and end of some runs; a flight without samples left at its start."""
    rows = pool.in_order(plan, runs, doing=doing, probes={"left": probe}, draws=_draws(plan))
    return [tuple(row.get("left", (0.0, 0.0))) for row in rows]


def _draws(plan: Plan) -> list[dict[str, Any]] | None:
    """Draws in which the receiver fails at the time from which the ending counts; else None."""
    navigation = plan.scenario.navigation
    if OF_AIRFRAME not in plan.keys or navigation is None or navigation.fault is None:
        return None
    drawn = map(plan.values_of, range(plan.draws))
    return [{**values, OF_RECEIVER: values[OF_AIRFRAME]} for values in drawn]


def _plan_of(
    plan: Plan, rates: RatesTable, fault: int | None, ended_s: float | None, window_s: float
) -> Plan:
    """Flights with a fault at a time uniform over a window."""
    if fault is None:
        return plan
    table = rates.fault[fault]
    kind, sizes = table.of_kind, _range_of(plan, table)
    cut = ended_s is not None and rates.ending.kind == "cut"
    own: dict[str, Any] = {"from_s": 0.0}
    if kind.key:
        own[kind.key] = kind.fixed if sizes is None else sizes[0]
    tables, drawn = plan.scenario.as_dict(), list(plan.campaign.disperse)
    if kind.receiver:
        tables["navigation"] = {**(tables.get("navigation") or {}), "fault": own}
        drawn.append(Uniform(key="navigation.fault.course_deg", lower=-180.0, upper=180.0))
        own = {"from_s": 0.0}
    if not kind.receiver or cut:
        own |= {"ended_after_s": ended_s} if cut else {}
        for plant in tables["plant"]:
            if plant["kind"] == "jsbsim":
                plant["airframe"] = {**(plant.get("airframe") or {}), "fault": own}
    from_s = OF_AIRFRAME if not kind.receiver or cut else OF_RECEIVER
    drawn.append(Uniform(key=from_s, lower=0.0, upper=window_s))
    if sizes is not None:
        place = "navigation.fault" if kind.receiver else "plant.airframe.fault"
        drawn.append(Uniform(key=f"{place}.{kind.key}", lower=sizes[0], upper=sizes[1]))
    seed = plan.campaign.seed + 1 + fault
    campaign = plan.campaign.model_copy(update={"success": [], "seed": seed})
    return replace(plan, campaign=rebuilt(campaign, drawn, scenario_from(tables)))


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
    """Refuse faults that the aircraft cannot have, before any flight."""
    (table,) = (x for x in plan.scenario.plant if x.label == plan.groups[0].plant)
    if table.aircraft is None:
        raise InputError(f"`rates` must be for an aircraft (jsbsim), got {table.label}.")
    if table.airframe is not None and table.airframe.fault is not None:
        raise InputError("`rates` must be for flights without a fault of their own.")
    config = table.config
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


def healthy_flights_for(hourly: PerHour) -> int | None:
    """Healthy flights to count, none outside, so that their term is half of the target."""
    target = hourly.table.target_per_hour
    if target is None:
        return None
    epsilon = 0.5 * target * hourly.exposure.hours(hourly.bound.each)
    return flights_needed(min(epsilon, 0.5), hourly.bound.each)
