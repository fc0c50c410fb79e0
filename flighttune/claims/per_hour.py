"""Exits from a volume per flight hour: declared rates of faults times counted flights."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arrays import check_positive
from flighttune.base.errors import InputError, ScenarioError, keeping, naming
from flighttune.base.files import code
from flighttune.base.files.claim import read, write
from flighttune.base.files.table import STRICT, hash_of, validated
from flighttune.base.words import at_most, confidence_text, listed, quoted
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.plan import Plan, aircraft_hashes
from flighttune.campaigns.statistics.count import (
    chance_missed,
    flights_again,
    flights_needed,
    forged_and_again,
)
from flighttune.campaigns.statistics.per_hour import Count, Exposure, HourlyBound, hourly_bound
from flighttune.claims.about import Probability
from flighttune.claims.band import KEPT
from flighttune.claims.counted import flights_sentence
from flighttune.claims.counted_flights import distribution_of, plan_in
from flighttune.claims.distribution import Distribution
from flighttune.claims.hourly_flights import Ends, FlownTerm, TermFlights, check_rates, hourly_plan
from flighttune.claims.leaving import Alarms, Around, GeoJSON, Volume
from flighttune.claims.rates_keys import MANOEUVRES, RatesTable
from flighttune.claims.unfinished import written_at
from flighttune.claims.unfinished_hours import KeptTerms
from flighttune.control.theory.exact import Verification
from flighttune.flight.route import planned_route
from flighttune.routes.fence import read_fence

# Times since a fault at which flights are ended to find the latest, s, in rising order.
LATER_S = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 60.0)

# Share of the healthy flights that may be shorter than the duration with which the exposure is
# bounded: in a strong tail wind or lost at the start, and where false alarms end flights early.
SHORTER, SHORTER_BY_ALARMS = 0.01, 0.05

# Least number of flights of a term that a check repeats, as of a band at 5 %.
AGAIN = flights_again(0.05)

# Flights of each term that left the volume and that JSBSim flies again while they are counted.
EXITS_AGAIN = 10


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
    alarms : Alarms or None
        The monitor whose alarms end flights.
    terms : tuple of FlownTerm
        The flights without a fault, then those with each fault.
    later : tuple of FlownTerm
        Flights with the fault of the largest term, ended at other times, in rising order.
    fence : dict or None
        The fence whose inside is the volume, as GeoJSON.
    around : Around or None
        Without a fence: the contingency volume of the mission, which is the volume.
    """

    rates: dict[str, Any]
    confidence: Probability
    plan: dict[str, Any]
    volume: Volume
    terms: tuple[FlownTerm, ...]
    alarms: Alarms | None = None
    later: tuple[FlownTerm, ...] = ()
    fence: GeoJSON | None = None
    around: Around | None = None

    kind: ClassVar[str] = "counted"
    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune flight hours 2"
    UNSEALED: ClassVar[str] = ""  # a file of flighttune 0.5.0 does not say what it is about
    UNITS: ClassVar[Mapping[str, str]] = {"volume": "m"}

    def __post_init__(self) -> None:
        table, numbers = self.table, [len(term) for term in self.terms]
        stated = [table.flights, *(fault.flights for fault in table.fault)]
        faults = [term.fault for term in self.terms]
        ends = [(None, *(x.ended_s for x in table.fault)), tuple(x.ended_s for x in self.terms)]
        fit = numbers == stated and faults == [None, *range(len(table.fault))]
        if not fit or ends[0] != ends[1]:
            raise InputError("`terms` must be the flights that `rates` states.")
        tried = [(term.fault, len(term)) for term in self.later]
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
        end = sorted(self.terms[0].end_s)
        shorter = int((SHORTER if self.alarms is None else SHORTER_BY_ALARMS) * len(end))
        return Exposure(
            shortest_s=end[shorter],
            window_s=end[-1],
            cap_s=float(self.plan["nominal"]["flight"]["duration_s"]),
            flights=len(end),
            shorter=shorter,
            beyond_s=self._beyond_s,
        )

    @property
    def _beyond_s(self) -> float:
        """Largest time that a manoeuvre which ends flights may add to their longest, s."""
        ends = self.alarms is not None or any(x.ended_s is not None for x in self.table.fault)
        faults = range(len(self.table.fault))
        if not (ends and {self.table.ending_of(i) for i in faults} & {*MANOEUVRES}):
            return 0.0
        cap_s = self.plan["nominal"]["flight"]["duration_s"]
        return -cap_s + max(
            self.ends.term(term.fault, term.ended_s, 1.0).plan.scenario.flight.duration_s
            for term in self.terms
        )

    @cached_property
    def flights(self) -> Plan:
        """The plan of the flights without a fault."""
        return plan_in(self.plan)

    @cached_property
    def distribution(self) -> Distribution:
        """The distribution of the flights."""
        (group,) = self.flights.groups
        return distribution_of(self.flights.campaign, group.plant)

    @property
    def ends(self) -> Ends:
        """Which flights are ended, when and how."""
        return Ends(plan=self.flights, rates=self.table, volume=self.volume, alarms=self.alarms)

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
    def too_few(self) -> bool:
        """Whether the healthy flights are too few for the target, though all stayed inside."""
        target, healthy = self.table.target_per_hour, self.terms[0].count
        return target is not None and not healthy.outside and self.bound.healthy > target

    @property
    def largest(self) -> int | None:
        """Place of the fault with the largest term; None if that of healthy flight is larger."""
        i = int(np.argmax(self.bound.faults))
        return i if self.bound.faults[i] > self.bound.healthy else None

    @property
    def sentence(self) -> str:
        """The claim, with all that is declared."""
        return f"{self.rate}, with the rates of faults as declared: {listed(self.declared)}"

    @property
    def rate(self) -> str:
        """The claim without what is declared."""
        return (
            f"At most {at_most(self.bound.total, 3)} flights per flight hour leave the volume of "
            f"{self.volume.words}, at a confidence of {confidence_text(self.confidence)}"
        )

    @property
    def declared(self) -> list[str]:
        """What is declared of each fault, of the endings, and the target, in words."""
        tables = self.table.model_dump(mode="json", exclude_none=True)
        faults = [
            f"{fault.pop('kind').replace('_', ' ')} {fault.pop('per_hour'):g} per hour by "
            f"{quoted(fault.pop('source'))} ({_stated(fault)})"
            for fault in tables["fault"]
        ]
        target = tables.get("target_per_hour")
        aim = [] if target is None else [f"a target of {target:g} per hour"]
        return [*faults, f"endings ({_stated(tables['ending'])})", *aim]

    @property
    def about(self) -> list[str]:
        """What the claim is about, in sentences: volume, flights and declarations."""
        plan = self.flights
        (group,), (_, (lat, lon), height) = plan.groups, planned_route(plan.campaign.central).where
        what = "a fence" if self.fence is not None else "the contingency volume of its mission"
        flown = flights_sentence(self.distribution, plan.scenario, *group)
        alarms = "" if self.alarms is None else f"; alarms {hash_of(asdict(self.alarms))[:12]}"
        return [
            f"The volume is {what}: {self.volume.words}, which is at {lat:.6f}, {lon:.6f} deg and "
            f"{height:.0f} m above sea level.",
            f"The flights are those of {flown}.",
            f"Declared, and not checked: {listed(self.declared)}{alarms}.",
        ]

    def save(self, path: str | Path) -> None:
        """Write the claim with its counts and its SHA-256 (.json)."""
        write(self, path)

    def check_volume(self) -> None:
        """Refuse a volume that does not follow from the fence, or from the room and the route."""
        again = volume_of(self.flights, self.fence, self.around)
        if self.volume.differs(again):
            raise InputError(
                f"`volume` must be that of the fence or the room around the route, {again.words}, "
                f"got {self.volume.words}."
            )

    def flights_of(self, term: FlownTerm) -> TermFlights:
        """The flights of a term; InputError if the files of the aircraft have changed."""
        if self.flights.aircraft != aircraft_hashes(self.flights.scenario):
            raise InputError("the files of the aircraft must be those that were flown.")
        return self.ends.term(term.fault, term.ended_s, self.exposure.window_s)

    def verify(self, count: int | None, fliers: Fliers) -> Verification:
        """Repeat `count` random flights of each term with JSBSim, and compare all their numbers.

        By default at least `AGAIN`, and so many that a forgery which doubles the bound of a term is
        missed with a chance of at most `MISSED`. Before, the volume is derived again, and the times
        of all flights are checked.
        """
        rng, notes = np.random.default_rng(), []
        terms = (*self.terms, *self.later)
        try:
            check_rates(self.flights, self.table)
            self.check_volume()
            for term in terms:
                self.flights_of(term).check_times(term)
        except InputError as error:
            return Verification(valid=False, reason=str(error))
        for number, term in enumerate(terms, start=1):
            flights = len(term)
            forged, again = forged_and_again(term.count.outside, flights, self.bound.each)
            again = min(flights, max(again, AGAIN))
            if count is not None:
                again = min(flights, count)
            runs = np.sort(rng.choice(flights, again, replace=False)).tolist()
            try:
                of_term = self.flights_of(term)
                stage = fliers.at_stage(number, len(terms))
                with code.in_jsbsim(), WorkerPool(stage) as pool:
                    flown = of_term.flown(pool, runs, "counting again")
            except InputError as error:
                return Verification(valid=False, reason=str(error))
            for run, x in zip(runs, flown, strict=True):
                stated = term.left_s[run], term.end_s[run], term.ended_at_s[run]
                if stated != (x.left_s, x.end_s, x.ended_s):
                    name = self.table.name_of(term.fault, term.ended_s)
                    reason = f"flight {run} of {name} must be as JSBSim flies it again, it is not"
                    return Verification(valid=False, reason=reason)
            missed = chance_missed(forged, flights, again)
            every = forged == flights - term.count.outside
            what = "all that stayed inside" if every else "which would double its share"
            name = self.table.name_of(term.fault, term.ended_s).capitalize()
            notes.append(
                f"{name}: {again} of {flights} flights, chosen at random, were flown again by "
                f"JSBSim and are equal. A forgery of {forged}, {what}, would be missed with "
                f"probability {missed:.2g}."
            )
        notes.append("The declared rates are the applicant's and are not checked.")
        return Verification(valid=True, reason="", notes=tuple(notes))


def load_per_hour(path: str | Path) -> PerHour:
    """Read a claim per flight hour; its bound is computed again from its counts."""
    hourly = read(path, PerHour)
    with naming(path, ScenarioError):
        hourly.distribution  # noqa: B018 - this refuses a wrong plan
        if (hourly.alarms is None) != (hourly.table.ending.monitor is None):
            raise InputError("`alarms` must be given with a `monitor` in `rates`, and only then.")
        check_positive(bound=hourly.bound.total)  # or its times are refused
    return hourly


def volume_of(plan: Plan, fence: GeoJSON | None, around: Around | None) -> Volume:
    """The volume of a mission: the inside of a fence, else the room around its route."""
    central = plan.campaign.central
    where = planned_route(central).where
    if fence is not None:
        return Volume.of(read_fence(KEPT, where[1], fence))
    if around is None:
        raise InputError("`fence` or `around` must say what the volume is.")
    return Volume.around(where, central.flight.ground_m, around)


def _stated(table: Mapping[str, Any]) -> str:
    """Declared keys with their values."""
    return ", ".join(f"{key} {_value(value)}" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, list):
        return " to ".join(map(_value, value))
    return quoted(value) if isinstance(value, str) else f"{value:.12g}"


def count_per_hour(
    plan: Plan,
    rates: RatesTable,
    *,
    fence: GeoJSON | None = None,
    around: Around | None = None,
    alarms: Alarms | None = None,
    confidence: float,
    unfinished: Path | None = None,
    fliers: Fliers,
) -> PerHour:
    """Fly the flights of all terms of a file of rates, and bound the exits per flight hour.

    The volume is the inside of a `fence` (GeoJSON), or the room `around` the route. A count that
    was killed goes on with those in the file `unfinished`.
    """
    check_rates(plan, rates)
    plan = hourly_plan(plan)
    volume = volume_of(plan, fence, around)
    ends = Ends(plan=plan, rates=rates, volume=volume, alarms=alarms)
    with WorkerPool(fliers) as pool, keeping(unfinished):
        flying = _Flying(pool, ends, KeptTerms(ends, unfinished, pool.observer))
        kept = flying.kept.flights  # perhaps compiled
        stated = [(None, None), *((i, fault.ended_s) for i, fault in enumerate(rates.fault))]
        pool.progress.budget = sum(flying.missing(*term) for term in stated)
        healthy = flying.term(None, None, 0.0)
        # The flights without a fault say how long a flight lasts.
        window_s = max(healthy.end_s)
        faults = [flying.term(i, fault.ended_s, window_s) for i, fault in enumerate(rates.fault)]
        counted = PerHour(
            rates=rates.model_dump(mode="json", exclude_none=True),
            confidence=confidence,
            plan=plan.as_dict(),
            volume=volume,
            fence=fence,
            around=around,
            alarms=alarms,
            terms=(healthy, *faults),
        )
        counted = replace(counted, later=tuple(flying.later(counted)))
        if kept or pool.progress.compiled.flights:
            flying.check_compiled(counted)
        flying.kept.remove()
        return counted


@dataclass(frozen=True, slots=True)
class _Flying:
    """The flights of the terms of a claim."""

    pool: WorkerPool
    ends: Ends
    kept: KeptTerms

    def missing(self, fault: int | None, ended_s: float | None) -> int:
        """Number of flights of a term that are still to be flown."""
        return self.ends.rates.flights_of(fault) - len(self.kept.begun(fault, ended_s))

    def term(self, fault: int | None, ended_s: float | None, window_s: float) -> FlownTerm:
        """The flights of a term, after those that are kept of it."""
        rates, number = self.ends.rates, self.ends.rates.flights_of(fault)
        flights = self.ends.term(fault, ended_s, window_s)
        term = self.kept.begun(fault, ended_s)
        stops = [n for n in (*written_at(number), number) if n > len(term)]
        for begin, end in pairwise([len(term), *stops]):
            doing = f"counting {rates.name_of(fault, ended_s)}"
            term = term.with_flights(flights.flown(self.pool, range(begin, end), doing))
            self.kept.keep(term)
        return term

    def check_compiled(self, counted: PerHour) -> None:
        """Repeat in JSBSim the first flights of each term that left the volume.

        DifferenceError names the first signal that differs.
        """
        for term in (*counted.terms, *counted.later):
            runs = [run for run, left in enumerate(term.left_s) if left >= 0.0][:EXITS_AGAIN]
            flights = self.ends.term(term.fault, term.ended_s, counted.exposure.window_s)
            with self.pool.checking():
                flights.flown(self.pool, runs, "repeating exits", again=True)

    def later(self, counted: PerHour) -> Iterator[FlownTerm]:
        """Flights with the fault of the largest term, ended later while the target holds."""
        # The times were fixed before, and the first failure ends the sequence: docs/per_hour.md.
        bound, target = counted.bound, self.ends.rates.target_per_hour
        fault = int(np.argmax(bound.faults))
        table = self.ends.rates.fault[fault]
        if target is None or table.ended_s is None:
            return
        if bound.total - bound.faults[fault] >= target:
            return  # no time of ending is early enough
        for ended_s in (x for x in LATER_S if x >= (table.detected_s or 0.0)):
            self.pool.progress.budget += self.missing(fault, ended_s)
            term = self.term(fault, ended_s, counted.exposure.window_s)
            yield term
            if counted.total_with(term) > target:
                return


def healthy_flights_for(hourly: PerHour) -> int | None:
    """Healthy flights to count, none outside, so that their term is half of the target."""
    target = hourly.table.target_per_hour
    if target is None:
        return None
    epsilon = 0.5 * target * hourly.bound.hours
    return flights_needed(min(epsilon, 0.5), hourly.bound.each)
