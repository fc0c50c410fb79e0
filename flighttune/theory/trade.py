"""The Q of one closed loop that is best for the radius, by semidefinite programming.

The paper's I_K depends on which Q is taken. Its numbers come from the Lyapunov equation's solution,
the smallest Q of all; these are the Q with the smallest I_K, at full rate and at any rate.
"""

import numpy as np
import numpy.typing as npt

from flighttune.errors import InputError
from flighttune.theory.lmi import Cone, LmiSolution, minimise
from flighttune.theory.quadratic import (
    EvpResult,
    StableLoop,
    checked_Q,
    radius_indicator,
    with_more_unknowns,
)


def tightest_radius(A_K: npt.ArrayLike, *, rate_loss: float = 1e-6) -> EvpResult:
    """The Q with the smallest I_K among those whose rate is R_K, less a fraction.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s
    rate_loss : float, 1
        Fraction of R_K given up, in (0, 1). The optimal Q is unique where the top eigenvector of
        the Lyapunov equation's solution excites every mode, as in a coupled loop; in a decoupled
        loop the other blocks are free, and much can be had for nothing.

    Returns
    -------
    EvpResult
        Never worse in I_K than the Lyapunov equation's solution.

    Raises
    ------
    ShapeError, InputError
        If `A_K` is not square or not finite, or `rate_loss` is outside (0, 1).
    """
    if not 0.0 < rate_loss < 1.0:
        raise InputError(f"`rate_loss` must lie in (0, 1), got {rate_loss}.")
    loop = StableLoop.of(A_K)
    return loop if isinstance(loop, EvpResult) else _trade(loop, 1.0 / (1.0 - rate_loss))


def best_trade(A_K: npt.ArrayLike) -> EvpResult:
    """The Q with the smallest I_K at whatever rate that takes.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s

    Returns
    -------
    EvpResult
        Its R_K is at most that of `paper_evp`, its I_K at most that of `tightest_radius`.

    Raises
    ------
    ShapeError, InputError
        If `A_K` is not square or not finite.

    Notes
    -----
    ``lambda_max(Q)^2 / lambda_min(Q)`` is convex in Q: minimise t subject to
    ``m I <= Q <= l I`` and ``[[t, l], [l, m]] >= 0``.
    """
    loop = StableLoop.of(A_K)
    return loop if isinstance(loop, EvpResult) else _trade(loop, None)


def _trade(loop: StableLoop, largest_cap: float | None) -> EvpResult:
    """Minimise t over ``(Q, t, l, m)``, all in units of the Lyapunov solution's lambda_max."""
    size, eye = len(loop.basis), np.eye(loop.n)
    t, largest, smallest = size, size + 1, size + 2
    cones = [
        Cone(constant=-eye, coefficients=with_more_unknowns(-loop.derivative, 3)),
        Cone(constant=0.0 * eye, coefficients=with_more_unknowns(-loop.basis / loop.top, 3)),
        Cone(constant=0.0 * eye, coefficients=with_more_unknowns(loop.basis / loop.top, 3)),
        Cone(constant=np.zeros((2, 2)), coefficients=np.zeros((size + 3, 2, 2))),
    ]
    cones[1].coefficients[largest] = eye
    cones[2].coefficients[smallest] = -eye
    cones[3].coefficients[[t, smallest], [0, 1], [0, 1]] = 1.0
    cones[3].coefficients[largest] = [[0.0, 1.0], [1.0, 0.0]]
    if largest_cap is not None:
        cap = Cone(constant=np.array([[largest_cap]]), coefficients=np.zeros((size + 3, 1, 1)))
        cap.coefficients[largest] = -1.0
        cones.append(cap)
    return _radius_result(loop, minimise(np.eye(size + 3)[t], cones))


def _radius_result(loop: StableLoop, solution: LmiSolution) -> EvpResult:
    """The better of the solver's Q and the Lyapunov equation's, with the solver's status."""
    Q = checked_Q(loop, solution)
    if Q is None or solution.status != "optimal":
        status, reason = "inaccurate", solution.reason or "the solver's Q is not feasible"
    else:
        status, reason = "optimal", ""
    known = loop.L @ loop.L.T
    if Q is None or radius_indicator(loop, known) < radius_indicator(loop, Q):
        Q = known
    return EvpResult(
        status=status,
        reason=reason,
        Q=Q,
        R_K=float(1.0 / np.linalg.eigvalsh(Q)[-1]),
        I_K=radius_indicator(loop, Q),
    )
