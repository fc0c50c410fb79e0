"""Claims from counted flights: order statistics, whatever the distribution of the flights.

S. S. Wilks, "Determination of sample sizes for setting tolerance limits", Annals of Mathematical
Statistics 12 (1941).
"""

import math
from bisect import bisect_left, bisect_right
from functools import partial
from typing import Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import bdtr, bdtri, betainc, betaln, xlog1py, xlogy

from flighttune.base.arrays import FloatArray, Floats, check_between
from flighttune.base.errors import InputError

# Flights that may lie outside by default: the scale depends less on a single one of them.
OUTSIDE = 5

# Ratio of the largest probability to epsilon that evidence of a no counts.
WIDEST = 20.0

# Flights of a count in two steps, at most, over those of a count in one.
LONGER = 1.15

# A count that may end at any number of flights is looked at each time after so many.
LOOK = 12

# Largest chance of missing a forgery among flights that are flown again by default.
MISSED = 0.05


def chance(outside: Floats, flights: int, epsilon: Floats, early: int = 0) -> FloatArray:
    """Chance that at most so many of `flights` are outside, if each is so with `epsilon`.

    With `early` it is the chance that none of the first `early` flights, or at most `outside` of
    all, are outside. A count that ends at either of both numbers is wrong with at most this chance,
    whatever decides where it ends.
    """
    if not early:
        return bdtr(outside, flights, epsilon)
    later = flights - early
    others = 1.0 - bdtr(np.minimum(outside, later), later, epsilon)
    return bdtr(outside, flights, epsilon) + bdtr(0, early, epsilon) * others


def allowed_outside(flights: int, epsilon: float, confidence: float, early: int = 0) -> int:
    """Largest number r of independent flights that may lie outside; -1 if `flights` are too few.

    Bounds that a flight leaves with probability above `epsilon` are left by at most r of `flights`
    with probability ``P(Bin(flights, epsilon) <= r) <= 1 - confidence``. If the count could end
    after `early` flights, that is the `chance` of both ends, and none may be outside at the first.
    """
    check_between(0.0, 1.0, epsilon=epsilon, confidence=confidence)
    numbers = range(1 if flights == early else math.ceil(epsilon * flights) + 1)
    chances = partial(chance, flights=flights, epsilon=epsilon, early=early)
    return bisect_right(numbers, 1.0 - confidence, key=chances) - 1


def supported_epsilon(outside: int, flights: int, confidence: float, early: int = 0) -> float:
    """Smallest epsilon that so many `outside` support: the bound of Clopper and Pearson."""
    if outside == flights:
        return 1.0
    if not early:
        return float(bdtri(outside, flights, 1.0 - confidence))
    return brentq(lambda x: chance(outside, flights, x, early) - 1.0 + confidence, 0.0, 1.0)


def flights_needed(epsilon: float, confidence: float, outside: int = 0, early: int = 0) -> int:
    """Fewest flights of which `outside` may lie outside, see `allowed_outside`."""
    allowed = partial(allowed_outside, epsilon=epsilon, confidence=confidence, early=early)
    least = max(early, outside) + 1
    most = least
    while allowed(most) < outside:
        most *= 2
    return bisect_left(range(most), outside, lo=least, key=allowed)


def flights_in_two_steps(epsilon: float, confidence: float) -> tuple[int, int]:
    """Flights after which a count ends if none is outside, and those of which one may be.

    The first number is the smallest for which the second is at most `LONGER` times the flights of a
    count in one step. Where one of 1000 flights is outside, both say yes about as often.
    """
    most = int(LONGER * flights_needed(epsilon, confidence, 1))
    first = range(flights_needed(epsilon, confidence), most)
    early = next(n for n in first if allowed_outside(most, epsilon, confidence, n) >= 1)
    return early, flights_needed(epsilon, confidence, 1, early)


def fresh_flights(flights: int | None, epsilon: float, confidence: float) -> int:
    """Number of flights to count, by default the fewest of which `OUTSIDE` may lie outside."""
    if flights is None:
        return flights_needed(epsilon, confidence, OUTSIDE)
    if allowed_outside(flights, epsilon, confidence) < 0:
        raise InputError(
            f"`flights` must be at least {flights_needed(epsilon, confidence)} for `epsilon` "
            f"{epsilon:g} and `confidence` {confidence:.10g}, got {flights}."
        )
    return flights


def counted_scale(
    scores: FloatArray, epsilon: float, confidence: float, early: int = 0
) -> tuple[float, int]:
    """Scale that a new score exceeds with probability at most `epsilon`, and how many exceed it.

    `scores`, shape (N,): of independent flights that played no part in how they are scored; a
    flight that was not completed has an infinite one. The scale is the (r + 1)-th largest score,
    with r of `allowed_outside`: it is infinite if more than r flights were not completed. Raises
    InputError if there are too few scores.
    """
    flights = fresh_flights(len(scores), epsilon, confidence)
    if (r := allowed_outside(flights, epsilon, confidence, early)) < 0:
        raise InputError(f"`early` must be enough flights if none is outside, got {early}.")
    scale = float(np.partition(scores, -r - 1)[-r - 1])
    return scale, int(np.sum(scores > scale))


def log_evidence(
    outside: Floats, flights: Floats, epsilon: Floats
) -> tuple[FloatArray, FloatArray]:
    """Evidence that a probability is below, and that it is above, `epsilon`, at any time.

    Returns, shape (...), the natural logarithms of two mixtures of likelihood ratios against
    `epsilon`: of probabilities below it, half of the weight on 0 and half uniform, and of uniform
    ones from it to 20 times as much, at most 1. With ``k`` of ``n`` independent flights outside, a
    mixture over ``q`` is the integral of ``(q / epsilon)^k ((1 - q) / (1 - epsilon))^(n - k)``.
    Where the probability is at least `epsilon`, ``below`` is a supermartingale (``above`` where it
    is at most `epsilon`), and exceeds 1/alpha at any of all times with a probability of at most
    alpha: Ville's inequality, eq. (2) of S. R. Howard, A. Ramdas, J. McAuliffe and J. Sekhon,
    "Time-uniform Chernoff bounds via nonnegative supermartingales", Probability Surveys 17 (2020).
    """
    k, n = np.asarray(outside, dtype=float), np.asarray(flights, dtype=float)
    epsilon, top = np.asarray(epsilon), np.minimum(1.0, WIDEST * np.asarray(epsilon))
    log_epsilon = xlogy(k, epsilon) + xlog1py(n - k, -epsilon)
    shares = [betainc(k + 1.0, n - k + 1.0, q) for q in (epsilon, top)]
    with np.errstate(divide="ignore"):
        below, above = np.log([shares[0] / epsilon, (shares[1] - shares[0]) / (top - epsilon)])
    uniform = betaln(k + 1.0, n - k + 1.0) - log_epsilon
    never = np.where(k == 0.0, -log_epsilon, -np.inf)
    return np.logaddexp(never, below + uniform) - math.log(2.0), above + uniform


def sure(outside: int, flights: int, epsilon: float, confidence: float) -> Literal["yes", "no", ""]:
    """Whether flights are outside with a probability of at most `epsilon`; empty if it is not sure.

    It may be asked after every flight: over all times each answer is false with a probability of at
    most half of ``1 - confidence`` (`log_evidence`).
    """
    check_between(0.0, 1.0, epsilon=epsilon, confidence=confidence)
    below, above = (
        evidence > math.log(2.0 / (1.0 - confidence))
        for evidence in log_evidence(outside, flights, epsilon)
    )
    return "yes" if below else "no" if above else ""


def looks(draws: int) -> list[int]:
    """Numbers of draws, the last one `draws`, after which it is asked whether an answer is sure.

    Workers wait for the last flight before each, so that later ones are an eighth apart.
    """
    numbers = [LOOK]
    while numbers[-1] < draws:
        numbers.append(numbers[-1] + max(LOOK, numbers[-1] // 8))
    return [*numbers[:-1], draws]


def flights_again(epsilon: float) -> int:
    """Flights to fly again so that as many forged ones as double epsilon are missed by `MISSED`."""
    return math.ceil(math.log(MISSED) / math.log1p(-epsilon))


def chance_missed(forged: int, flights: int, again: int) -> float:
    """Chance that `again` of `flights`, chosen at random, have none of those `forged`."""
    return math.prod(max(flights - forged - i, 0) / (flights - i) for i in range(again))
