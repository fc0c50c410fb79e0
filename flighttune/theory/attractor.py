"""Where a disturbed linear loop ends up: four bounds on its ultimate size, loosest first.

The loop is ``s' = A s + E v`` with ``||v|| <= L_d``. In velocity form s = (x', e) and v is the
derivative of the disturbance, which enters through ``E = [I; 0]`` alone. The paper's ball knows
neither E nor the direction in which the loop is weak; the invariant ellipsoid and the peak gain
do, and `reachable` has the exact figure of each row.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_positive, read_only_matrix, square_matrices
from flighttune.errors import InputError, ShapeError
from flighttune.theory.lyapunov import lyapunov_solution

NARROW = 1e-6  # width, in its logit, of the interval in which the search for a multiplier ends


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """An invariant ellipsoid ``s' W^-1 s <= 1``: the loop approaches it and does not leave it."""

    W: FloatArray  # (n, n), square of the unit of s
    # 1/s: the a of ``A W + W A' + a W + (L_d^2 / a) E E' = 0``, the rate at which ``s' W^-1 s``
    # approaches one from outside
    multiplier: float
    radius: float  # longest half axis: the square root of lambda_max(W)


def paper_balls(A_K: npt.ArrayLike, A: npt.ArrayLike, *, I_K: float, L_d: float) -> FloatArray:
    """Radii of the paper's ultimate ball ``||s|| <= 2 L_d L_f I_K`` for three readings of L_f.

    `A_K` (shape (n + p, n + p), 1/s) is the closed loop in velocity form, `A` (shape (n, n)) the
    open-loop Jacobian df/dx, `I_K` in s^2 and `L_d` the bound on the norm of the disturbance's
    derivative.

    Returns
    -------
    ndarray, shape (3,), unit of s
        With L_f the norm of A_K (Theorem 1 applied to the velocity form), of its upper left block
        ``df/dx + df/du K_P`` (Theorem 2 with f(x, u(x)) read as the loop under K_P), and of
        ``df/dx`` (Theorem 2 to the letter of its formula). The theorem's proof covers only the
        first: the loop can leave the ball of either of the others.

    Notes
    -----
    Theorem 2 of arXiv 2411.13140. Its statement uses L_f = ||df(0)/dx||; its proof applies
    Theorem 1 to ``s' = A_K s + d_s``, whose Jacobian is A_K.
    """
    A_K, A = square_matrices("A_K", A_K, 2), square_matrices("A", A, 2)
    n = len(A)
    check_positive(L_d=L_d)
    norms = [np.linalg.norm(jacobian, 2) for jacobian in (A_K, A_K[:n, :n], A)]
    return 2.0 * L_d * np.array(norms, dtype=np.float64) * I_K


def invariant_ellipsoid(
    A: npt.ArrayLike,
    E: npt.ArrayLike,
    *,
    L_d: float,
    slack: float = 0.0,
) -> Ellipsoid:
    """The invariant ellipsoid of ``s' = A s + E v``, ``|v| <= L_d``, with the smallest radius.

    `slack`: part of the disturbance's term left in the inequality, so that it holds strictly.
    Raises ShapeError or InputError if the matrices do not fit or `A` is not stable.

    Notes
    -----
    For each a in (0, -2 abscissa) a Lyapunov equation gives W; a is found by a search in one
    dimension. S. Boyd et al., *Linear Matrix Inequalities in System and Control Theory*, 6.1.2.
    """
    from scipy.optimize import minimize_scalar

    A, E = square_matrices("A", A, 2), read_only_matrix("E", E)
    if len(E) != len(A) or not E.any():
        raise ShapeError(f"`E` must have {len(A)} rows and not vanish, got shape {E.shape}.")
    rightmost = float(np.linalg.eigvals(A).real.max())
    if not rightmost < 0.0:
        raise InputError(f"`A` must be stable, got spectral abscissa {rightmost:.6g} 1/s.")
    check_positive(L_d=L_d)
    widest = -2.0 * rightmost

    entry = E @ E.T
    entry = entry + slack * float(np.linalg.norm(entry, 2)) * np.eye(len(A))

    def W_of(a: float) -> FloatArray:
        load = entry * (L_d**2 / a)
        return lyapunov_solution((A + a / 2.0 * np.eye(len(A))).T, (load + load.T) / 2.0)

    # W grows without bound at both ends of the range of a: the logit has them at infinity, and the
    # logarithm keeps what the search compares within a few tens.
    def size(logit: float) -> float:
        W = W_of(widest / (1.0 + math.exp(-logit)))
        return 0.5 * math.log(np.linalg.eigvalsh(W)[-1])

    best = minimize_scalar(size, bounds=(-20.0, 20.0), method="bounded", options={"xatol": NARROW})
    a = widest / (1.0 + math.exp(-best.x))
    W = W_of(a)
    return Ellipsoid(W=W, multiplier=a, radius=math.sqrt(float(np.linalg.eigvalsh(W)[-1])))
