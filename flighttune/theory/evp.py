"""The paper's eigenvalue problem for one closed loop, by semidefinite programming.

`paper_evp` poses the problem as the paper does and asks a solver; `indicators` has the same number
in closed form. They are independent ways to one result. `trade` has what only a solver can give.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.theory.lmi import Cone, minimise
from flighttune.theory.lyapunov import lyapunov_solution
from flighttune.theory.quadratic import (
    EvpResult,
    StableLoop,
    checked_Q,
    radius_indicator,
    with_more_unknowns,
    without_Q,
)

GAP = 1e-6
"""Largest relative distance between a checked answer and its checked bound to be called optimal."""


def paper_evp(A_K: npt.ArrayLike) -> EvpResult:
    """The largest R_K and its Q, by semidefinite programming.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s

    Returns
    -------
    EvpResult
        Optimal if `R_K` and the bound from the dual problem are within `GAP`. Where several Q are
        optimal, the one in the middle of them (interior point), not the smallest.

    Raises
    ------
    ShapeError, InputError
        If `A_K` is not square or not finite.

    Notes
    -----
    The EVP of arXiv 2411.13140, section 4.3: minimise g subject to ``Q <= g I`` and
    ``A_K' Q + Q A_K + I <= 0``. For accuracy on stiff loops the unknown is Z in ``Q = L Z L'``,
    with L the Cholesky factor of the Lyapunov equation's solution; the problem is the same one for
    every invertible L. The bound: for any Y >= 0 of trace one, lambda_max(Q) is at least the trace
    of the X with ``A_K X + X A_K' + Y = 0``.
    """
    loop = StableLoop.of(A_K)
    if isinstance(loop, EvpResult):
        return loop
    results = []
    for congruence, equilibrate in _ways(loop):
        results.append(_solved(loop, _rate_cones(loop, congruence), equilibrate))
        if results[-1].status == "optimal":
            return results[-1]
    return max(results, key=lambda result: result.R_K)


def _ways(loop: StableLoop) -> Iterator[tuple[FloatArray, bool]]:
    """Ways to pose the same problem, by congruence of its first inequality; most need only one."""
    mixed = np.linalg.cholesky(loop.L @ loop.L.T / loop.top + 1e-3 * np.eye(loop.n))
    yield np.eye(loop.n), False
    yield np.eye(loop.n), True
    yield np.asarray(np.linalg.inv(mixed).T, dtype=float), True
    yield np.asarray(np.linalg.inv(loop.L).T, dtype=float), False


def _rate_cones(loop: StableLoop, congruence: FloatArray) -> tuple[Cone, Cone]:
    capped = Cone(
        constant=np.zeros((loop.n, loop.n)),
        coefficients=with_more_unknowns(-loop.basis / loop.top, 1),
    )
    capped.coefficients[-1] = np.eye(loop.n)
    decaying = Cone(
        constant=-congruence.T @ congruence,
        coefficients=with_more_unknowns(-congruence.T @ loop.derivative @ congruence, 1),
    )
    return decaying, capped


def _solved(loop: StableLoop, cones: tuple[Cone, Cone], equilibrate: bool) -> EvpResult:
    size = len(loop.basis)
    solution = minimise(np.eye(size + 1)[size], cones, equilibrate=equilibrate)
    Q = checked_Q(loop, solution)
    if Q is None:
        return without_Q("failed", solution.reason or "the solver's Q is not feasible")
    bound = _rate_bound(loop, solution.duals[1])
    R_K = float(1.0 / np.linalg.eigvalsh(Q)[-1])
    gap = bound / R_K - 1.0
    return EvpResult(
        status="optimal" if gap <= GAP else "inaccurate",
        reason="" if gap <= GAP else f"R_K is only known to a fraction of {gap:.1e}",
        Q=Q,
        R_K=R_K,
        I_K=radius_indicator(loop, Q),
        R_K_bound=bound,
    )


def _rate_bound(loop: StableLoop, multiplier: FloatArray) -> float:
    values, vectors = np.linalg.eigh(multiplier)
    values = np.maximum(values, 0.0)
    if not values.sum() > 0.0:
        return np.inf
    Y = vectors * (values / values.sum()) @ vectors.T
    return float(1.0 / np.trace(lyapunov_solution(loop.A_K.T, (Y + Y.T) / 2.0)))
