"""Shares and percentiles with their intervals, and gain sets compared on the same draws.

SciPy's intervals of a proportion need whole counts. Clustered draws have effective counts, which
are not whole.
"""

import math
from itertools import combinations
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
import scipy

from flighttune.base.arrays import FloatArray, check_between
from flighttune.campaigns.statistics.count import log_evidence

Method: TypeAlias = Literal["wilson", "clopper-pearson", "any-time"]

CONFIDENCE = 0.95

# Halvings of the range of a probability, down to rounding.
BISECTIONS = 50

# Values of a measure within this relative difference count as equal.
TIED = 1e-9


def rate_interval(
    successes: npt.ArrayLike,
    n: npt.ArrayLike,
    confidence: float = CONFIDENCE,
    *,
    method: Method = "wilson",
) -> tuple[FloatArray, FloatArray]:
    """Interval of the probability behind a count of successes; 0 to 1 without trials.

    Trials are independent; `successes` and `n`, shape (...), may be effective numbers, which are
    not whole. Wilson's score interval is ``(p + z^2/2n ± z sqrt(p (1-p)/n + z^2/4n^2)) / (1 +
    z^2/n)`` with ``p = successes / n`` and ``z`` the normal quantile of ``(1 + confidence) / 2``:
    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. Am.
    Stat. Assoc. 22 (1927) 209-212. The interval of Clopper and Pearson, by quantiles of beta
    distributions, never covers less often than it claims: "The use of confidence or fiducial limits
    illustrated in the case of the binomial", Biometrika 26 (1934) 404-413. The any-time interval
    keeps this property even if earlier trials decide whether another follows: it contains the
    probabilities that `log_evidence` does not reject.
    """
    k, trials = np.broadcast_arrays(np.asarray(successes, dtype=float), np.asarray(n, dtype=float))
    check_between(0.0, 1.0, confidence=confidence)
    tail = 0.5 - 0.5 * confidence
    if method == "wilson":
        z2 = float(scipy.special.ndtri(0.5 + 0.5 * confidence)) ** 2
        m = np.maximum(trials, 1.0)
        middle = (k + 0.5 * z2) / (m + z2)
        half = np.sqrt(z2) / (m + z2) * np.sqrt(k * (m - k) / m + 0.25 * z2)
        lo, hi = middle - half, middle + half
    elif method == "any-time":
        lo, hi = _not_refused(k, trials, tail)
    else:
        lo = scipy.special.betaincinv(np.maximum(k, 0.5), trials - k + 1.0, tail)
        hi = scipy.special.betaincinv(k + 1.0, np.maximum(trials - k, 0.5), 1.0 - tail)
    return np.where(k == 0.0, 0.0, lo), np.where(k == trials, 1.0, hi)


def _not_refused(k: FloatArray, n: FloatArray, tail: float) -> tuple[FloatArray, FloatArray]:
    """Range of the probabilities of success that neither evidence about failures rejects."""
    ends = []
    for side in (0, 1):  # evidence for rarer, then for more frequent failures
        low, high = np.zeros(k.shape), np.ones(k.shape)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            refused = log_evidence(n - k, n, middle)[side] > -math.log(tail)
            higher = refused if side else ~refused
            low, high = np.where(higher, middle, low), np.where(higher, high, middle)
        ends.append(1.0 - (low if side else high))
    return ends[0], ends[1]


def quantile_interval(
    values: npt.ArrayLike,
    q: float,
    confidence: float = CONFIDENCE,
    *,
    effective: float | None = None,
) -> tuple[float, float]:
    """Interval of a quantile of `values` (no NaN) by order statistics, for any distribution.

    The number of values below the quantile is binomial: ``lo`` is the largest order statistic that
    is above the quantile with a probability of at most ``(1 - confidence) / 2``, ``hi`` the
    smallest that is below it; a side with too few values is infinite. The interval therefore covers
    at least as often as it claims. `effective`: the effective number of values (`effective_size`),
    by default all.
    """
    check_between(0.0, 1.0, q=q, confidence=confidence)
    tail = 0.5 - 0.5 * confidence
    ordered = np.sort(np.asarray(values, dtype=float))
    n = len(ordered)
    if not n:
        return -np.inf, np.inf
    m = n if effective is None else max(1, min(n, math.floor(effective)))
    at_most = scipy.special.bdtr(np.arange(m), m, q)
    below = math.floor(np.sum(at_most <= tail) * n / m)
    above = math.ceil((np.sum(at_most < 1.0 - tail) + 1) * n / m)
    lo = float(ordered[below - 1]) if below else -np.inf
    hi = float(ordered[above - 1]) if above <= n else np.inf
    return lo, hi


def effective_size(values: npt.ArrayLike, clusters: npt.ArrayLike) -> float:
    """Effective sample size of clustered values, finite or booleans, of independent clusters.

    n divided by the design effect of L. Kish, *Survey Sampling*, Wiley 1965, sections 6.4 and 8.2.
    The design effect is the variance of the mean, as a ratio of totals over clusters, relative to n
    independent values. The size is n if every cluster has one value or there is only one cluster,
    and the number of clusters if all values are equal. c clusters of equal size, each with equal
    members, count as c - 1.
    """
    x = np.asarray(values, dtype=float)
    place = np.unique(np.asarray(clusters), return_inverse=True)[1]
    n, count = len(x), int(place.max(initial=-1)) + 1
    if count in (n, 1):
        return float(n)
    apart = float(np.sum((x - x.mean()) ** 2)) / n
    if apart == 0.0:
        return float(count)
    off = np.bincount(place, weights=x - x.mean())
    of_mean = count / (count - 1) * float(off @ off) / n**2
    return float(np.clip(apart / of_mean if of_mean else n, 1.0, n))


class Estimate(NamedTuple):
    """A number with its interval; all NaN without a value."""

    value: float
    lo: float
    hi: float
    n: int  # number of flights


def share(
    flags: npt.NDArray[np.bool_],
    clusters: npt.ArrayLike,
    *,
    method: Method = "wilson",
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Share of flights with a flag set, with its interval; `clusters` are cycles of the design."""
    n = len(flags)
    if not n:
        return Estimate(value=np.nan, lo=0.0, hi=1.0, n=0)
    rate, size = float(np.mean(flags)), effective_size(flags, clusters)
    count = float(np.sum(flags)) if size == n else rate * size
    lo, hi = rate_interval(count, size, confidence, method=method)
    return Estimate(value=rate, lo=float(lo), hi=float(hi), n=n)


def percentile(
    values: FloatArray, q: float, clusters: npt.ArrayLike, *, confidence: float = CONFIDENCE
) -> Estimate:
    """Quantile of a measure without NaN, with its interval; `clusters` are cycles of the design."""
    if not len(values):
        return Estimate(value=np.nan, lo=np.nan, hi=np.nan, n=0)
    value = float(np.quantile(values, q))
    # Flights from one start have the same largest error up to the last bits, and these bits must
    # not decide the width of an interval.
    size = effective_size(values <= value + TIED * abs(value), clusters)
    lo, hi = quantile_interval(values, q, confidence, effective=size)
    return Estimate(value=value, lo=lo, hi=hi, n=len(values))


def paired(
    rows: pd.DataFrame, measure: str, *, confidence: float = CONFIDENCE
) -> list[dict[str, Any]]:
    """Compare every two gain sets on every plant, draw by draw, by a measure to be minimised."""
    pairs = []
    for plant, on_plant in rows.assign(score=scores(rows, measure)).groupby("plant", sort=False):
        flown = on_plant.pivot(index="draw", columns="gains", values=["score", "success"])
        for a, b in combinations(on_plant["gains"].unique(), 2):
            both = flown.loc[:, pd.IndexSlice[:, [a, b]]].dropna()
            if both.empty:
                continue
            x, y = (both["score", name].to_numpy(dtype=float) for name in (a, b))
            ok_a, ok_b = (both["success", name].to_numpy(dtype=bool) for name in (a, b))
            wins_a, wins_b = int(np.sum(x < y)), int(np.sum(y < x))
            lo, hi = rate_interval(wins_a, wins_a + wins_b, confidence)
            # Two lost flights are tied: infinity minus infinity would be NaN.
            apart = np.subtract(x, y, out=np.zeros(len(x)), where=x != y)
            median_lo, median_hi = quantile_interval(apart, 0.5, confidence)
            only_a, only_b = int(np.sum(ok_a & ~ok_b)), int(np.sum(ok_b & ~ok_a))
            # exact two-sided McNemar test
            p = 2.0 * float(scipy.special.bdtr(min(only_a, only_b), only_a + only_b, 0.5))
            won = wins_a / (wins_a + wins_b) if wins_a + wins_b else 0.5
            # an order statistic: infinite values need no mean
            median = float(np.quantile(apart, 0.5, method="inverted_cdf"))
            pair: dict[str, Any] = {"plant": str(plant), "a": a, "b": b, "measure": measure}
            pair |= {"n": len(x), "wins_a": wins_a, "wins_b": wins_b, "win_rate": won}
            pair |= {"lo": float(lo), "hi": float(hi)}
            pair |= {"median": median, "median_lo": median_lo, "median_hi": median_hi}
            pair |= {"only_a": only_a, "only_b": only_b, "p_success": min(1.0, p)}
            pairs.append(pair)
    return pairs


def scores(rows: pd.DataFrame, measure: str) -> FloatArray:
    """The measure of every flight, infinite if it was not completed or has no value."""
    values = rows[measure].to_numpy(dtype=float)
    return np.where((rows["status"] == "completed").to_numpy() & ~np.isnan(values), values, np.inf)
