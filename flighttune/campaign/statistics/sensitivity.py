"""Influence of parameters on a metric: rank statistics."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import ndtri

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.flights import is_number
from flighttune.campaign.statistics.intervals import CONFIDENCE

# A statistic and its p-value, both NaN if it is undefined.
Test: TypeAlias = tuple[float, float]

# Classes of equal size that a number with many values is cut into.
CLASSES = 10

# Flights in a class on average: the test by ranks needs them.
MIN_IN_CLASS = 5

MIN_FLIGHTS = 10

# Condition number of the correlations of ranks from which on they tell no partial ones.
COLLINEAR = 1e10


def influences(
    parameters: pd.DataFrame, measure: npt.ArrayLike, *, confidence: float = CONFIDENCE
) -> list[dict[str, Any]]:
    """Influence of every parameter on a measure, the strongest first.

    Parameters
    ----------
    parameters : DataFrame
        A row a flight; columns of numbers, or of anything else as categories.
    measure : array_like, shape (flights,)
        Flights without a value, or without one of a parameter, are left out; infinite ones count
        by their rank.
    confidence : float, 1
        Confidence of intervals, and of what is `apart` from chance.

    Returns
    -------
    list of dict
        Empty where there are fewer than 10 flights or the measure does not vary. Parameters that do
        not vary are left out. Of every other `parameter`: number `n` of flights; Spearman's rank
        correlation `rho` from `lo` to `hi`, NaN where the parameter is no number; `partial`, the
        same with the ranks of all other parameters fixed, NaN if they are collinear; `share` of the
        variance of the measure's ranks explained, 0 by chance; `p_rho` and `p_share`, corrected
        probabilities of such values without any influence; and whether it is `apart`: chance is
        refused as the explanation of one of them.

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
    from scipy.stats import rankdata

    values = np.asarray(measure, dtype=float)
    kept = ~np.isnan(values) & parameters.notna().all(axis=1).to_numpy()
    ranks = rankdata(values[kept])
    table, n = parameters[kept], len(ranks)
    table = table.loc[:, table.nunique() > 1]
    if n < MIN_FLIGHTS or ranks.min() == ranks.max() or table.empty:
        return []
    columns = [column for _, column in table.items()]
    rho, p_rho = np.array([_spearman(column, ranks) for column in columns]).T
    share, p_share = np.array([_share(column, ranks) for column in columns]).T
    p_rho, p_share = holm([*p_rho, *p_share]).reshape(2, -1)
    lo, hi = _interval(rho, n, confidence)
    tested = pd.DataFrame(
        {
            "parameter": table.columns,
            "n": n,
            "rho": rho,
            "lo": lo,
            "hi": hi,
            "partial": _partial(table, ranks),
            "share": share,
            "p_rho": p_rho,
            "p_share": p_share,
            "apart": np.minimum(p_rho, p_share) < 1.0 - confidence,
        }
    )
    return sorted(tested.to_dict("records"), key=strength, reverse=True)


def strength(influence: Mapping[str, Any]) -> float:
    """The larger of `share` and the square of `rho`, to nine digits; it orders influences."""
    strengths = [influence["share"], influence["rho"] ** 2]
    # Two parameters that are drawn together have the same share but for rounding, and then stay in
    # the order of the campaign.
    return round(max((each for each in strengths if math.isfinite(each)), default=0.0), 9)


def holm(p: npt.ArrayLike) -> FloatArray:
    """P-values corrected together; those that are NaN take no part and become 1."""
    values = np.asarray(p, dtype=float)
    tests = np.flatnonzero(~np.isnan(values))
    order = tests[np.argsort(values[tests], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    corrected = np.ones(len(values))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors))
    return corrected


def classes_of(column: pd.Series, most: int = CLASSES) -> npt.NDArray[np.intp]:
    """Class of each flight by its value of a parameter, from 0 on, rising with a number."""
    from scipy.stats import rankdata

    codes, distinct = pd.factorize(column, sort=True)
    few = len(distinct) <= most and MIN_IN_CLASS * len(distinct) <= len(column)
    if few or not is_number(column):
        return np.asarray(codes)
    count = max(2, min(most, len(column) // MIN_IN_CLASS))
    places = (rankdata(column) - 0.5) / len(column)
    return pd.factorize(np.floor(places * count), sort=True)[0]


def _spearman(column: pd.Series, ranks: FloatArray) -> Test:
    from scipy.stats import spearmanr

    if not is_number(column):
        return math.nan, math.nan
    correlation: Any = spearmanr(column, ranks)
    return float(correlation.statistic), float(correlation.pvalue)


def _share(column: pd.Series, ranks: FloatArray) -> Test:
    """Epsilon squared less what chance explains, and the p-value of Kruskal and Wallis."""
    from scipy.stats import kruskal

    codes = classes_of(column)
    n, k = len(ranks), int(codes.max()) + 1
    if not 1 < k < n:
        return math.nan, math.nan
    H, p = kruskal(*(ranks[codes == label] for label in range(k)))
    return (float(H) - k + 1) / (n - k), float(p)


def _partial(table: pd.DataFrame, ranks: FloatArray) -> FloatArray:
    """Partial rank correlation of every number; k categories are k - 1 indicator columns."""
    numeric = np.array([is_number(column) for _, column in table.items()])
    # numbers come first, in their order, then the indicators
    columns = pd.get_dummies(table, columns=table.columns[~numeric], drop_first=True, dtype=float)
    columns = columns.rank()
    correlations = np.corrcoef(columns.to_numpy().T, ranks)
    partials = np.full(len(numeric), np.nan)
    if len(ranks) > columns.shape[1] + 2 and np.linalg.cond(correlations) < COLLINEAR:
        inverse = np.linalg.inv(correlations)
        scale = np.sqrt(np.diag(inverse))
        partials[numeric] = (-inverse[-1] / (scale[-1] * scale))[: numeric.sum()]
    return partials


def _interval(rho: FloatArray, n: int, confidence: float) -> tuple[FloatArray, FloatArray]:
    """Intervals of rank correlations, by the normal distribution of their area tangents."""
    half = ndtri(0.5 + 0.5 * confidence) * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    with np.errstate(divide="ignore"):
        middle = np.arctanh(rho)  # infinite where |rho| = 1, which then is both ends
    return np.tanh(middle - half), np.tanh(middle + half)
