"""Claims from counted flights: order statistics, whatever the distribution of the flights.

S. S. Wilks, "Determination of sample sizes for setting tolerance limits", Annals of Mathematical
Statistics 12 (1941).
"""

import math

import numpy as np
from scipy.special import bdtr, bdtri

from flighttune.arrays import FloatArray, check_between
from flighttune.errors import InputError

# Flights that may lie outside by default: the scale depends less on a single one of them.
OUTSIDE = 5

# Largest chance of missing a forgery among flights that are flown again by default.
MISSED = 0.05


def allowed_outside(flights: int, epsilon: float, confidence: float) -> int:
    """Largest number r of independent flights that may lie outside; -1 if `flights` are too few.

    Bounds that a flight leaves with probability above `epsilon` are left by at most r of `flights`
    with probability ``P(Bin(flights, epsilon) <= r) <= 1 - confidence``.
    """
    check_between(0.0, 1.0, epsilon=epsilon, confidence=confidence)
    r = np.arange(math.ceil(epsilon * flights) + 1)
    return int(np.sum(bdtr(r, flights, epsilon) <= 1.0 - confidence)) - 1


def supported_epsilon(outside: int, flights: int, confidence: float) -> float:
    """Smallest epsilon that so many of `flights` outside support: the bound of Clopper and Pearson.

    `allowed_outside` is `outside` for an epsilon just above it. It is 1 if all flights are outside.
    """
    return 1.0 if outside == flights else float(bdtri(outside, flights, 1.0 - confidence))


def flights_needed(epsilon: float, confidence: float, outside: int = 0) -> int:
    """Fewest flights of which `outside` may lie outside, see `allowed_outside`."""
    low, high = outside, outside + 1
    while allowed_outside(high, epsilon, confidence) < outside:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        if allowed_outside(middle, epsilon, confidence) < outside:
            low = middle
        else:
            high = middle
    return high


def fresh_flights(flights: int | None, epsilon: float, confidence: float) -> int:
    """Number of flights to count, by default the fewest of which `OUTSIDE` may lie outside.

    Raises InputError if `flights` are too few.
    """
    if flights is None:
        return flights_needed(epsilon, confidence, OUTSIDE)
    if allowed_outside(flights, epsilon, confidence) < 0:
        raise InputError(
            f"`flights` must be at least {flights_needed(epsilon, confidence)} for `epsilon` "
            f"{epsilon:g} and `confidence` {confidence:.10g}, got {flights}."
        )
    return flights


def counted_scale(scores: FloatArray, epsilon: float, confidence: float) -> tuple[float, int]:
    """Scale that a new score exceeds with probability at most `epsilon`, and how many exceed it.

    `scores`, shape (N,): of independent flights that played no part in how they are scored; a
    flight that was not completed has an infinite one. The scale is the (r + 1)-th largest score,
    with r of `allowed_outside`: it is infinite if more than r flights were not completed. Raises
    InputError if there are too few scores.
    """
    r = allowed_outside(fresh_flights(len(scores), epsilon, confidence), epsilon, confidence)
    scale = float(np.partition(scores, -r - 1)[-r - 1])
    return scale, int(np.sum(scores > scale))


def flights_again(epsilon: float) -> int:
    """Flights to fly again so that as many forged ones as double epsilon are missed by `MISSED`."""
    return math.ceil(math.log(MISSED) / math.log1p(-epsilon))


def chance_missed(forged: int, flights: int, again: int) -> float:
    """Chance that `again` of `flights`, chosen at random, have none of those `forged`."""
    return math.prod(max(flights - forged - i, 0) / (flights - i) for i in range(again))
