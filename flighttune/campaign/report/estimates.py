"""Shares and percentiles of the flights of a group, each with its interval."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.campaign.intervals import (
    CONFIDENCE,
    clopper_pearson,
    effective_size,
    quantile_interval,
    wilson,
)

Method: TypeAlias = Literal["wilson", "clopper-pearson"]
INTERVALS = {"wilson": wilson, "clopper-pearson": clopper_pearson}


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its interval.

    Attributes
    ----------
    value, lo, hi : float
        NaN where there is no value.
    n : int
        Flights that it is of.
    """

    value: float
    lo: float
    hi: float
    n: int


def share(
    flags: npt.NDArray[np.bool_],
    clusters: npt.ArrayLike,
    *,
    method: Method = "wilson",
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Share of flights of which something is true.

    Parameters
    ----------
    flags : ndarray of bool, shape (n,)
    clusters : array_like, shape (n,)
        Cycle of the design of each flight.
    method : "wilson" or "clopper-pearson"
    confidence : float, 1
    """
    n = len(flags)
    if not n:
        return Estimate(value=np.nan, lo=0.0, hi=1.0, n=0)
    rate, size = float(np.mean(flags)), effective_size(flags, clusters)
    count = float(np.sum(flags)) if size == n else rate * size
    lo, hi = INTERVALS[method](count, size, confidence)
    return Estimate(value=rate, lo=float(lo), hi=float(hi), n=n)


def percentile(
    values: FloatArray, q: float, clusters: npt.ArrayLike, *, confidence: float = CONFIDENCE
) -> Estimate:
    """Quantile of a measure.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Without NaN.
    q : float, 1
        Between 0 and 1.
    clusters : array_like, shape (n,)
        Cycle of the design of each flight.
    confidence : float, 1
    """
    if not len(values):
        return Estimate(value=np.nan, lo=np.nan, hi=np.nan, n=0)
    value = float(np.quantile(values, q))
    size = effective_size(values <= value, clusters)
    lo, hi = quantile_interval(values, q, confidence, effective=size)
    return Estimate(value=value, lo=lo, hi=hi, n=len(values))
