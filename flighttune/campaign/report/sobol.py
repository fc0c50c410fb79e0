"""Sobol indices: how much of the variance each parameter makes, alone and with the others."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.intervals import CONFIDENCE
from flighttune.errors import ShapeError

RESAMPLES = 1000
LEAST_BLOCKS = 8
AT_ONCE = 4_000_000
"""Weights of blocks that are held at a time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SobolIndices:
    """Indices of d parameters, with percentile intervals.

    Attributes
    ----------
    n : int
        Blocks of flights they come from.
    first, first_lo, first_hi : ndarray, shape (d,), 1
        Share of the variance that a parameter makes by itself.
    total, total_lo, total_hi : ndarray, shape (d,), 1
        Share that would go if the parameter were known, its interactions included.
    """

    n: int
    first: FloatArray
    first_lo: FloatArray
    first_hi: FloatArray
    total: FloatArray
    total_lo: FloatArray
    total_hi: FloatArray


def sobol_indices(
    f_A: FloatArray,
    f_B: FloatArray,
    f_AB: FloatArray,
    *,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> SobolIndices | None:
    r"""First and total indices of a measure flown on Saltelli's design.

    Parameters
    ----------
    f_A, f_B : ndarray, shape (n,)
        The measure at n points A, and at n independent points B.
    f_AB : ndarray, shape (d, n)
        At the points A with the i-th parameter of B.
    confidence : float, 1
        Of the intervals.
    resamples : int
        Of the blocks (A, B and all A_B of one row together), with replacement.
    seed : int
        Of the resampling.

    Returns
    -------
    SobolIndices or None
        From the blocks in which every flight has a value; None where those are fewer than 8, or
        their measure does not vary.

    Raises
    ------
    ShapeError
        If the shapes do not fit.

    Notes
    -----
    ``S_i = mean(f_B (f_AB_i - f_A)) / V`` and ``S_Ti = mean((f_A - f_AB_i)^2) / 2V`` with V the
    variance over A and B, eqs. (b) and (f) of table 2 in [1]_; the mean is taken off `f` first.

    References
    ----------
    .. [1] A. Saltelli et al., "Variance based sensitivity analysis of model output. Design and
       estimator for the total sensitivity index", Comput. Phys. Commun. 181 (2010) 259-270.
    """
    if f_A.shape != f_B.shape or f_AB.ndim != 2 or f_AB.shape[1:] != f_A.shape:
        raise ShapeError(
            f"`f_A`, `f_B` and `f_AB` must have shapes (n,), (n,) and (d, n), got {f_A.shape}, "
            f"{f_B.shape} and {f_AB.shape}."
        )
    whole = np.isfinite(f_A) & np.isfinite(f_B) & np.isfinite(f_AB).all(axis=0)
    f_A, f_B, f_AB = f_A[whole], f_B[whole], f_AB[:, whole]
    n, d = len(f_A), len(f_AB)
    if n < LEAST_BLOCKS or np.ptp([f_A, f_B]) == 0.0:
        return None
    mean = 0.5 * (f_A.mean() + f_B.mean())
    a, b, ab = f_A - mean, f_B - mean, f_AB - mean
    terms = np.vstack([b * (ab - a), 0.5 * (a - ab) ** 2, 0.5 * (a + b), 0.5 * (a**2 + b**2)])
    found = _indices(terms.mean(axis=1)[None], d)[0]
    tail = 0.5 - 0.5 * confidence
    resampled = np.vstack(list(_resampled(terms, resamples, seed)))
    lo, hi = np.nanquantile(_indices(resampled, d), [tail, 1.0 - tail], axis=0)
    return SobolIndices(
        n=n, first=found[:d], first_lo=lo[:d], first_hi=hi[:d],
        total=found[d:], total_lo=lo[d:], total_hi=hi[d:],
    )  # fmt: skip


def _resampled(terms: FloatArray, resamples: int, seed: int) -> Iterator[FloatArray]:
    """Means of the terms over blocks drawn with replacement, some resamples at a time."""
    n = terms.shape[1]
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    some = max(1, AT_ONCE // n)
    for first in range(0, resamples, some):
        size = min(some, resamples - first)
        yield rng.multinomial(n, np.full(n, 1.0 / n), size=size) @ terms.T / n


def _indices(means: FloatArray, d: int) -> FloatArray:
    """First, then total indices, shape (resamples, 2 d), from the means of the terms."""
    variance = means[:, -1] - means[:, -2] ** 2
    variance[variance <= 0.0] = np.nan
    return means[:, : 2 * d] / variance[:, None]
