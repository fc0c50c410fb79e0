"""The free gains of a problem, and the polytope that the input limits make of them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.tuning.problem import TuningProblem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchSpace:
    """Free gains k, their bounds, and the rows ``G k + offset <= bound`` of the input limits.

    Attributes
    ----------
    base : ndarray, shape (m, 2 p)
        Fixed gains in their places, 0 in the free ones.
    free : ndarray of bool, shape (m, 2 p)
        Where a gain is free; k holds these row by row.
    k_min, k_max : ndarray, shape (f,)
        Bounds of the f free gains.
    names : tuple of str, length r
        Of the rows: ``<input>_max``, ``_min``, ``_rate_max``, ``_rate_min``.
    G, offset, bound : ndarray, shapes (r, f), (r,), (r,)
        The finite input limits; `offset` comes from the fixed gains.
    """

    base: FloatArray
    free: npt.NDArray[np.bool_]
    k_min: FloatArray
    k_max: FloatArray
    names: tuple[str, ...]
    G: FloatArray
    offset: FloatArray
    bound: FloatArray

    def K(self, k: FloatArray) -> FloatArray:
        """Stacked gains, shape (..., m, 2 p), of free gains of shape (..., f)."""
        K = np.broadcast_to(self.base, (*k.shape[:-1], *self.base.shape)).copy()
        K[..., self.free] = k
        return K

    def slack(self, k: FloatArray) -> FloatArray:
        """What the input limits leave, shape (..., r); negative where one is broken."""
        return self.bound - self.offset - k @ self.G.T


def search_space(problem: TuningProblem) -> SearchSpace:
    """The free gains and limit rows of a problem."""
    lower, upper = problem.gain_bounds
    free = lower < upper
    names, rows, bounds = _limit_rows(problem)
    base = np.where(free, 0.0, lower)
    return SearchSpace(
        base=base,
        free=free,
        k_min=lower[free],
        k_max=upper[free],
        names=names,
        G=rows[:, free],
        offset=(rows * base).sum(axis=(1, 2)),
        bound=bounds,
    )


def _limit_rows(problem: TuningProblem) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names, coefficients of shape (r, m, 2 p) and bounds of the finite limits."""
    _, m, p = problem.model.shape
    limits, x_0 = problem.limits, problem.x_0
    if limits is None or x_0 is None:
        return (), np.empty((0, m, 2 * p)), np.empty(0)
    at_start = np.concatenate([x_0, x_0 * problem.dt])
    rate_at_start = np.concatenate([np.zeros(p), x_0])
    names, rows, bounds = [], [], []
    for i, channel in enumerate(problem.model.inputs):
        for name, direction, bound in (
            (f"{channel}_max", at_start, limits.upper[i]),
            (f"{channel}_min", -at_start, -limits.lower[i]),
            (f"{channel}_rate_max", rate_at_start, limits.rate_upper[i]),
            (f"{channel}_rate_min", -rate_at_start, -limits.rate_lower[i]),
        ):
            if np.isfinite(bound):
                row = np.zeros((m, 2 * p))
                row[i] = direction
                names.append(name)
                rows.append(row)
                bounds.append(bound)
    return tuple(names), np.array(rows).reshape(-1, m, 2 * p), np.array(bounds)
