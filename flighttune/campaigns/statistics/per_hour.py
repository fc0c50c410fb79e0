"""Rate per flight hour from declared rates of faults and counted flights: docs/per_hour.md."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from flighttune.base.arrays import check_between
from flighttune.base.errors import InputError
from flighttune.campaigns.statistics.count import supported_epsilon

SECONDS = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Count:
    """Flights that left a volume, of all that were flown."""

    outside: int
    flights: int

    def share(self, confidence: float) -> float:
        """Upper bound of the probability to leave, by Clopper and Pearson."""
        return supported_epsilon(self.outside, self.flights, confidence)


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """Duration of flights, counted on flights without a fault."""

    shortest_s: float  # shortest duration of the counted flights, apart from `shorter`
    window_s: float  # longest duration of the counted flights: faults are drawn from this time
    cap_s: float  # time at which every flight without a fault ends
    flights: int
    shorter: int = 0  # number, fixed beforehand, of flights that may be shorter than `shortest_s`
    beyond_s: float = 0.0  # time beyond `cap_s` that the ending of a flight with a fault may take

    def hours(self, confidence: float, per_hour: float = 0.0) -> float:
        """Lower bound of the mean duration, h, with faults at a rate `per_hour` in total.

        Few flights without a fault are shorter than `shortest_s`; a flight with faults lasts at
        least until the first of them, an exponential time.
        """
        short = supported_epsilon(self.shorter, self.flights, confidence)
        until = self.shortest_s / SECONDS
        if per_hour > 0.0:
            until = -math.expm1(-per_hour * until) / per_hour
        return (1.0 - short) * until

    def odd(self, confidence: float) -> float:
        """Upper bound of the share of flights longer than all counted ones."""
        return supported_epsilon(0, self.flights, confidence)


@dataclass(frozen=True, slots=True, kw_only=True)
class HourlyBound:
    """Upper bounds per flight hour, which hold together."""

    total: float
    healthy: float
    faults: tuple[float, ...]  # in the order of the faults
    several: float  # flights with two faults or more
    each: float  # confidence of each count
    hours: float  # lower bound of the mean duration, h


def hourly_bound(
    healthy: Count,
    faults: Sequence[tuple[float, Count]],
    exposure: Exposure,
    *,
    confidence: float,
    more: int = 0,
) -> HourlyBound:
    """Bound the exits per flight hour at a confidence that all counts share.

    `faults` has the declared rate per hour of each fault, and the count of flights with this fault
    at a time that is uniform in the exposure's window. `more` counts share the confidence too.
    """
    check_between(0.0, 1.0, confidence=confidence)
    if not 0.0 < exposure.shortest_s <= exposure.window_s <= exposure.cap_s:
        raise InputError(
            f"`shortest_s` must be positive and at most {exposure.window_s:g} s, got "
            f"{exposure.shortest_s:g}."
        )
    # Counts: healthy flights, the shortest and the longest of them, and the flights of each fault.
    each = 1.0 - (1.0 - confidence) / (3 + len(faults) + more)
    rates = sum(rate for rate, _ in faults)
    hours, odd = exposure.hours(each, rates), exposure.odd(each)
    window, cap = exposure.window_s / SECONDS, exposure.cap_s / SECONDS
    last = cap + exposure.beyond_s / SECONDS
    terms = [rate * (window * count.share(each) + odd * cap) / hours for rate, count in faults]
    # The first fault of a flight lies before the end of one without a fault, the second before
    # `last`: the flight after a fault may be longer.
    pairs = window * (last - 0.5 * window) + odd * cap * (last - 0.5 * cap)
    several = rates**2 * pairs / hours
    alone = healthy.share(each) / hours
    total = alone + sum(terms) + several
    return HourlyBound(
        total=total, healthy=alone, faults=tuple(terms), several=several, each=each, hours=hours
    )
