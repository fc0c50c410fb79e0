"""Which parameters matter to a measure: rank correlation, and the share of variance by ranks."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import chdtrc, ndtri, stdtr
from scipy.stats import rankdata

from flighttune.arrays import FloatArray
from flighttune.campaign.intervals import CONFIDENCE

Test: TypeAlias = tuple[float, float]
"""A statistic and its p-value, both NaN where there is none."""

CLASSES = 10
"""Classes of equal size that a number with many values is cut into."""

LEAST_IN_CLASS = 5
"""Flights in a class on average: the test by ranks needs them."""

LEAST_FLIGHTS = 10
COLLINEAR = 1e10
"""Condition number of the correlations of ranks from which on they tell no partial ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Influence:
    """What one parameter does to one measure.

    Attributes
    ----------
    parameter : str
    n : int
        Flights looked at.
    rho, lo, hi : float, 1
        Spearman's rank correlation with its interval; NaN where the parameter is no number.
    partial : float, 1
        The same with the ranks of all other parameters held; NaN where they are collinear.
    share : float, 1
        Share of the variance of the measure's ranks that the parameter explains by itself, whatever
        the shape; 0 is what chance would explain.
    p_rho, p_share : float, 1
        Probability of a `rho` and a `share` as large without any influence, corrected for the
        number of tests.
    apart : bool
        Whether chance is refused as the explanation of either of them.
    """

    parameter: str
    n: int
    rho: float
    lo: float
    hi: float
    partial: float
    share: float
    p_rho: float
    p_share: float
    apart: bool

    @property
    def strength(self) -> float:
        """What influences are ordered by, 0 to 1: `share` or the square of `rho`, the larger."""
        known = [one for one in (self.share, self.rho**2) if math.isfinite(one)]
        return max(known, default=0.0)


def influences(
    parameters: pd.DataFrame, measure: npt.ArrayLike, *, confidence: float = CONFIDENCE
) -> tuple[Influence, ...]:
    """Influence of every parameter on a measure, the strongest first.

    Parameters
    ----------
    parameters : DataFrame
        A row a flight; columns of numbers, or of anything else as categories.
    measure : array_like, shape (flights,)
        Flights without a value, or without one of a parameter, are left out; infinite ones count
        by their rank.
    confidence : float, 1
        Of intervals and of `Influence.apart`.

    Returns
    -------
    tuple of Influence
        None of parameters that do not vary. Empty where there are fewer than 10 flights or the
        measure does not vary.

    Notes
    -----
    The interval of `rho` is that of [1]_. `share` is epsilon squared of the Kruskal-Wallis test
    [2]_ over the values of the parameter, or over ten classes of equal size where it has more than
    ten, less what chance explains: ``(H - k + 1) / (n - k)`` for k classes. P-values are corrected
    together by Holm's method [3]_.

    References
    ----------
    .. [1] D. G. Bonett, T. A. Wright, "Sample size requirements for estimating Pearson, Kendall and
       Spearman correlations", Psychometrika 65 (2000) 23-28.
    .. [2] W. H. Kruskal, W. A. Wallis, "Use of ranks in one-criterion variance analysis", J. Am.
       Stat. Assoc. 47 (1952) 583-621.
    .. [3] S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6
       (1979) 65-70.
    """
    values = np.asarray(measure, dtype=float)
    kept = ~np.isnan(values) & parameters.notna().all(axis=1).to_numpy()
    ranks = rankdata(values[kept])
    table = {str(name): pd.Series(column[kept]) for name, column in parameters.items()}
    table = {name: column for name, column in table.items() if column.nunique() > 1}
    n = len(ranks)
    if n < LEAST_FLIGHTS or ranks.min() == ranks.max() or not table:
        return ()
    correlations = [_spearman(column, ranks) for column in table.values()]
    shares = [_share(column, ranks) for column in table.values()]
    partial = _partial(table, ranks)
    p = holm([p for _, p in (*correlations, *shares)])
    found = []
    for i, name in enumerate(table):
        p_rho, p_share = p[i], p[len(table) + i]
        rho = correlations[i][0]
        lo, hi = _interval(rho, n, confidence)
        found.append(
            Influence(
                parameter=name, n=n, rho=rho, lo=lo, hi=hi, partial=partial[name],
                share=shares[i][0], p_rho=p_rho, p_share=p_share,
                apart=min(p_rho, p_share) < 1.0 - confidence,
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda one: -one.strength))


def holm(p: Sequence[float]) -> list[float]:
    """P-values corrected together; those that are NaN take no part and become 1."""
    values = np.array(p, dtype=float)
    known = np.flatnonzero(~np.isnan(values))
    order = known[np.argsort(values[known], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    corrected = np.ones(len(values))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors))
    return corrected.tolist()


def is_number(column: pd.Series) -> bool:
    """Whether the values of a parameter have an order that correlation can use."""
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def classes_of(column: pd.Series, most: int = CLASSES) -> npt.NDArray[np.intp]:
    """Class of each flight by its value of a parameter.

    Parameters
    ----------
    column : Series
        Values; a number with more than `most` of them, or with fewer than five flights of each, is
        cut into classes of equal size.
    most : int

    Returns
    -------
    ndarray of int, shape (flights,)
        From 0 on, rising with a number.
    """
    codes, found = pd.factorize(column, sort=True)
    few = len(found) <= most and LEAST_IN_CLASS * len(found) <= len(column)
    if few or not is_number(column):
        return np.asarray(codes)
    count = max(2, min(most, len(column) // LEAST_IN_CLASS))
    places = (rankdata(column) - 0.5) / len(column)
    return pd.factorize(np.floor(places * count), sort=True)[0]


def _spearman(column: pd.Series, ranks: FloatArray) -> Test:
    if not is_number(column):
        return math.nan, math.nan
    rho = float(np.clip(np.corrcoef(rankdata(column), ranks)[0, 1], -1.0, 1.0))
    freedom = len(ranks) - 2
    t = abs(rho) * math.sqrt(freedom / max(1.0 - rho**2, np.finfo(float).eps))
    return rho, 2.0 * float(stdtr(freedom, -t))


def _share(column: pd.Series, ranks: FloatArray) -> Test:
    """Epsilon squared less what chance explains, and the p-value of Kruskal and Wallis."""
    codes = classes_of(column)
    sizes = np.bincount(codes)
    n, k = len(ranks), len(sizes)
    if not 1 < k < n:
        return math.nan, math.nan
    means = np.bincount(codes, weights=ranks) / sizes
    between = float(sizes @ (means - ranks.mean()) ** 2)
    H = (n - 1) * between / float(np.sum((ranks - ranks.mean()) ** 2))
    return (H - k + 1) / (n - k), float(chdtrc(k - 1, H))


def _partial(table: Mapping[str, pd.Series], ranks: FloatArray) -> dict[str, float]:
    """Partial rank correlation of every number, categories held by a column each but one."""
    numbers = [name for name, column in table.items() if is_number(column)]
    held = [rankdata(table[name]) for name in numbers]
    for name, column in table.items():
        if name not in numbers:
            codes = pd.factorize(column)[0]
            held += [(codes == one).astype(float) for one in range(1, codes.max() + 1)]
    found = dict.fromkeys(table, math.nan)
    correlations = np.corrcoef([*held, ranks])
    if len(ranks) > len(held) + 2 and np.linalg.cond(correlations) < COLLINEAR:
        inverse = np.linalg.inv(correlations)
        scale = np.sqrt(np.diag(inverse))
        partial = -inverse[-1] / (scale[-1] * scale)
        found.update(zip(numbers, partial.tolist(), strict=False))
    return found


def _interval(rho: float, n: int, confidence: float) -> tuple[float, float]:
    """Of a rank correlation, by the normal distribution of its area tangent."""
    if math.isnan(rho):
        return math.nan, math.nan
    if abs(rho) >= 1.0:
        return rho, rho
    half = float(ndtri(0.5 + 0.5 * confidence)) * math.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    middle = math.atanh(rho)
    return math.tanh(middle - half), math.tanh(middle + half)
