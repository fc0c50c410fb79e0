"""Claims from counted flights by order statistics, for any distribution of the flights.

S. S. Wilks, "Determination of sample sizes for setting tolerance limits", Annals of Mathematical
Statistics 12 (1941).
"""

import math
from bisect import bisect_left, bisect_right
from functools import partial
from typing import Literal

import numpy as np
import scipy

from flighttune.base.arrays import FloatArray, Floats, check_between
from flighttune.base.errors import InputError
from flighttune.base.words import confidence_text

# Default number of flights that may lie outside, so that the scale depends less on one flight.
OUTSIDE = 5

# Largest probability, relative to epsilon, in the evidence for a no.
WIDEST = 20.0

# An any-time count is checked after each of this number of flights.
LOOK = 12

# Default chance that repeated flights miss a forgery.
MISSED = 0.05


def chance(outside: Floats, flights: int, epsilon: Floats, early: int = 0) -> FloatArray:
    """Chance that at most `outside` of `flights` are outside, each with probability `epsilon`.

    With `early` it is the chance that none of the first `early` flights, or at most `outside` of
    all, are outside. A count that may end at either number is wrong with at most this chance, for
    any rule of ending.
    """
    if not early:
        return scipy.special.bdtr(outside, flights, epsilon)
    later = flights - early
    others = 1.0 - scipy.special.bdtr(np.minimum(outside, later), later, epsilon)
    return (
        scipy.special.bdtr(outside, flights, epsilon)
        + scipy.special.bdtr(0, early, epsilon) * others
    )


def allowed_outside(flights: int, epsilon: float, confidence: float, early: int = 0) -> int:
    """Largest number r of independent flights that may lie outside; -1 if `flights` are too few.

    If a flight leaves the bounds with probability above `epsilon`, then at most r of `flights`
    leave them with probability ``P(Bin(flights, epsilon) <= r) <= 1 - confidence``. If the count
    could end after `early` flights, this is the `chance` of both ends, and none may be outside at
    the first end.
    """
    check_between(0.0, 1.0, epsilon=epsilon, confidence=confidence)
    numbers = range(1 if flights == early else math.ceil(epsilon * flights) + 1)
    chances = partial(chance, flights=flights, epsilon=epsilon, early=early)
    return bisect_right(numbers, 1.0 - confidence, key=chances) - 1


def supported_epsilon(outside: int, flights: int, confidence: float, early: int = 0) -> float:
    """Smallest epsilon that `outside` supports: the bound of Clopper and Pearson."""
    if outside == flights:
        return 1.0
    if not early:
        return float(scipy.special.bdtri(outside, flights, 1.0 - confidence))
    return scipy.optimize.brentq(
        lambda x: chance(outside, flights, x, early) - 1.0 + confidence, 0.0, 1.0
    )


def flights_needed(epsilon: float, confidence: float, outside: int = 0, early: int = 0) -> int:
    """Smallest number of flights of which `outside` may lie outside, see `allowed_outside`."""
    allowed = partial(allowed_outside, epsilon=epsilon, confidence=confidence, early=early)
    least = max(early, outside) + 1
    most = least
    while allowed(most) < outside:
        most *= 2
    return bisect_left(range(most), outside, lo=least, key=allowed)


def check_enough(flights: int, epsilon: float, confidence: float) -> None:
    """Refuse a number of flights that supports no claim even if none of them is outside."""
    if allowed_outside(flights, epsilon, confidence) < 0:
        raise InputError(
            f"`flights` must be at least {flights_needed(epsilon, confidence)} for `epsilon` "
            f"{epsilon:g} and `confidence` {confidence_text(confidence)}, got {flights}."
        )


def counted_scale(
    scores: FloatArray, epsilon: float, confidence: float, early: int = 0
) -> tuple[float, int]:
    """Scale that a new score exceeds with probability at most `epsilon`, and number of excesses.

    `scores`, shape (N,): scores of independent flights that did not affect the scoring; infinite
    for a flight that was not completed. The scale is the (r + 1)-th largest score, with r from
    `allowed_outside`; it is infinite if more than r flights were not completed. Raises InputError
    if there are too few scores.
    """
    flights = len(scores)
    check_enough(flights, epsilon, confidence)
    if (r := allowed_outside(flights, epsilon, confidence, early)) < 0:
        raise InputError(f"`early` must be enough flights if none is outside, got {early}.")
    scale = float(np.partition(scores, -r - 1)[-r - 1])
    return scale, int(np.sum(scores > scale))


def log_evidence(
    outside: Floats, flights: Floats, epsilon: Floats
) -> tuple[FloatArray, FloatArray]:
    """Any-time evidence that a probability is below `epsilon`, and that it is above.

    Returns, shape (...), the natural logarithms of two mixtures of likelihood ratios against
    `epsilon`. The first covers probabilities below it, with half of the weight on 0 and half
    uniform; the second is uniform from `epsilon` to 20 times `epsilon`, at most 1. With ``k`` of
    ``n`` independent flights outside, a mixture over ``q`` is the integral of ``(q / epsilon)^k ((1
    - q) / (1 - epsilon))^(n - k)``. If the probability is at least `epsilon`, ``below`` is a
    supermartingale (``above`` if it is at most `epsilon`), and it ever exceeds 1/alpha with a
    probability of at most alpha: Ville's inequality, eq. (2) of S. R. Howard, A. Ramdas, J.
    McAuliffe and J. Sekhon, "Time-uniform Chernoff bounds via nonnegative supermartingales",
    Probability Surveys 17 (2020).
    """
    k, n = np.asarray(outside, dtype=float), np.asarray(flights, dtype=float)
    epsilon, top = np.asarray(epsilon), np.minimum(1.0, WIDEST * np.asarray(epsilon))
    log_epsilon = scipy.special.xlogy(k, epsilon) + scipy.special.xlog1py(n - k, -epsilon)
    shares = [scipy.special.betainc(k + 1.0, n - k + 1.0, q) for q in (epsilon, top)]
    with np.errstate(divide="ignore"):
        below, above = np.log([shares[0] / epsilon, (shares[1] - shares[0]) / (top - epsilon)])
    uniform = scipy.special.betaln(k + 1.0, n - k + 1.0) - log_epsilon
    never = np.where(k == 0.0, -log_epsilon, -np.inf)
    return np.logaddexp(never, below + uniform) - math.log(2.0), above + uniform


def sure(outside: int, flights: int, epsilon: float, confidence: float) -> Literal["yes", "no", ""]:
    """Whether flights are outside with a probability of at most `epsilon`; empty if it is not sure.

    It may be called after every flight: over all times each answer is false with a probability of
    at most half of ``1 - confidence`` (`log_evidence`).
    """
    check_between(0.0, 1.0, epsilon=epsilon, confidence=confidence)
    below, above = (
        evidence > math.log(2.0 / (1.0 - confidence))
        for evidence in log_evidence(outside, flights, epsilon)
    )
    return "yes" if below else "no" if above else ""


def looks(draws: int) -> list[int]:
    """Numbers of draws, ending with `draws`, after which the answer is checked.

    Workers wait for the last flight before each check, so later checks are an eighth apart.
    """
    numbers = [LOOK]
    while numbers[-1] < draws:
        numbers.append(numbers[-1] + max(LOOK, numbers[-1] // 8))
    return [*numbers[:-1], draws]


def flights_again(epsilon: float) -> int:
    """Number of flights to repeat, so that forgeries that double epsilon are missed by `MISSED`."""
    return math.ceil(math.log(MISSED) / math.log1p(-epsilon))


def forged_and_again(outside: int, flights: int, confidence: float) -> tuple[int, int]:
    """Forged flights that would double the bound of a count, and flights to repeat to find them.

    A forger who claims `outside` of `flights` has said of that many flights that they stayed
    inside. The repeated flights, chosen at random, miss all of them with a chance of at most
    `MISSED`.
    """
    inside, doubled = flights - outside, 2.0 * supported_epsilon(outside, flights, confidence)
    if not inside:
        return flights, 1

    def with_forged(forged: int) -> float:
        return supported_epsilon(outside + forged, flights, confidence)

    # Where no forgery doubles the bound, all that are inside may be forged.
    forged = bisect_left(range(1, inside), doubled, key=with_forged) + 1
    found = partial(chance_missed, forged, flights)
    return forged, bisect_left(range(flights), -MISSED, key=lambda again: -found(again))


def chance_missed(forged: int, flights: int, again: int) -> float:
    """Chance that `again` of `flights`, chosen at random, include none of the `forged`."""
    return math.prod(max(flights - forged - i, 0) / (flights - i) for i in range(again))
