"""The Lyapunov equation of closed loops, and where it says that a disturbed loop ends up.

Four bounds on the ultimate size of the loop, loosest first: the loop is ``s' = A s + E v`` with
``||v|| <= L_d``. In velocity form s = (x', e) and v is the derivative of the disturbance, which
enters through ``E = [I; 0]`` alone. The paper's ball knows neither E nor the direction in which the
loop is weak; the invariant ellipsoid and the peak gain do, and `reachable` has the exact figure of
each row.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_positive, read_only_matrix, square_matrices
from flighttune.errors import InputError, ShapeError

Indices: TypeAlias = npt.NDArray[np.intp]

# Up to here one linear system in the n (n + 1)/2 entries beats a Schur form per matrix.
KRONECKER_STATES = 10

# Memory for the linear systems solved at once: about what a core's cache holds.
CHUNK_BYTES = 1 << 22


def lyapunov_solution(A: npt.ArrayLike, S: npt.ArrayLike | None = None) -> FloatArray:
    """Q of ``A' Q + Q A + S = 0``, for one stable matrix or a stack of them, symmetric to the bit.

    `A` has shape (..., n, n), 1/s; `S`, symmetric and by default the identity, broadcasts against
    it. The dual equation ``A X + X A' + S = 0`` is that of the transposed matrices. The relative
    error is about 1e-16 times the ratio of the fastest rate to the distance from instability.
    """
    A = square_matrices("A", A)
    S = np.broadcast_to(np.eye(A.shape[-1]), A.shape) if S is None else square_matrices("S", S)
    if S.shape[-1] != A.shape[-1]:
        raise ShapeError(f"`S` must have shape (..., {A.shape[-1]}, ...), got {S.shape}.")
    if not np.array_equal(S, S.mT):
        raise InputError("`S` must be symmetric.")
    try:
        A, S = np.broadcast_arrays(A, S)
    except ValueError as error:
        raise ShapeError(f"`S` must broadcast against {A.shape}, got {S.shape}.") from error
    try:
        return solution_of_checked(A, S)
    except np.linalg.LinAlgError as error:
        raise InputError("`A` must have no two eigenvalues that add up to zero.") from error


def solution_of_checked(A: FloatArray, S: FloatArray) -> FloatArray:
    """`lyapunov_solution` of finite arrays, S symmetric; LinAlgError without a unique one."""
    n = A.shape[-1]
    solve = _kronecker if n <= KRONECKER_STATES else _bartels_stewart
    chunk = max(1, 4 * CHUNK_BYTES // (8 * n * n * (n + 1) ** 2))
    flat_A, flat_S = A.reshape(-1, n, n), S.reshape(-1, n, n)
    Q = np.empty(flat_A.shape)
    for start in range(0, len(Q), chunk):
        part = slice(start, start + chunk)
        Q[part] = solve(flat_A[part], flat_S[part])
    return Q.reshape(A.shape)


def _kronecker(A: FloatArray, S: FloatArray) -> FloatArray:
    rows, columns, sources = _upper_triangle(A.shape[-1])
    entries = np.concatenate([A.reshape(len(A), -1), np.zeros((len(A), 1))], axis=1)
    system = entries.take(sources[0], axis=1) + entries.take(sources[1], axis=1)
    solved = np.linalg.solve(system, -S[:, rows, columns, None])[..., 0]
    Q = np.empty(A.shape)
    Q[:, rows, columns] = solved
    Q[:, columns, rows] = solved
    return Q


@cache
def _upper_triangle(n: int) -> tuple[Indices, Indices, Indices]:
    """Rows and columns of the entries of Q solved for, and where the system's entries come from."""
    rows, columns = np.triu_indices(n)
    size, zero = len(rows), n * n
    position = np.empty((n, n), dtype=int)
    position[rows, columns] = position[columns, rows] = np.arange(size)
    terms: list[list[list[int]]] = [[[] for _ in range(size)] for _ in range(size)]
    for equation, (i, j) in enumerate(zip(rows, columns, strict=True)):
        for k in range(n):
            terms[equation][position[k, j]].append(k * n + i)
            terms[equation][position[i, k]].append(k * n + j)
    # Each entry of the system is the sum of at most two entries of A. Their sources, shape (2, k,
    # k) with ``k = n (n + 1)/2``, lead into the entries of A row by row and a zero after them.
    padded = [[(*term, zero, zero)[:2] for term in row] for row in terms]
    return rows, columns, np.moveaxis(np.array(padded), -1, 0)


def _bartels_stewart(A: FloatArray, S: FloatArray) -> FloatArray:
    from scipy.linalg import solve_continuous_lyapunov

    Q = np.array([solve_continuous_lyapunov(a.T, -s) for a, s in zip(A, S, strict=True)])
    return (Q + Q.mT) / 2.0


NARROW = 1e-6  # width, in its logit, of the interval in which the search for a multiplier ends


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """An invariant ellipsoid ``s' W^-1 s <= 1``: the loop approaches it and does not leave it."""

    W: FloatArray  # (n, n), square of the unit of s
    # 1/s: the a of ``A W + W A' + a W + (L_d^2 / a) E E' = 0``, the rate at which ``s' W^-1 s``
    # approaches one from outside
    multiplier: float

    @property
    def radius(self) -> float:
        """Longest half axis: the square root of lambda_max(W)."""
        return math.sqrt(float(np.linalg.eigvalsh(self.W)[-1]))


def paper_balls(A_K: npt.ArrayLike, A: npt.ArrayLike, *, I_K: float, L_d: float) -> FloatArray:
    """Radii of the paper's ultimate ball ``||s|| <= 2 L_d L_f I_K`` for three readings of L_f.

    `A_K` (shape (n + p, n + p), 1/s) is the closed loop in velocity form, `A` (shape (n, n)) the
    open-loop Jacobian df/dx, `I_K` in s^2 and `L_d` the bound on the norm of the disturbance's
    derivative. The readings of Theorem 2 of arXiv 2411.13140 are the norms of A_K (its proof
    applies Theorem 1 to ``s' = A_K s + d_s``), of the upper left block ``df/dx + df/du K_P`` (f(x,
    u(x)) as the loop under K_P), and of ``df/dx`` (the letter of its formula). The proof covers
    only the first: the loop can leave the ball of either of the others.
    """
    A_K, A = square_matrices("A_K", A_K, 2), square_matrices("A", A, 2)
    n = len(A)
    check_positive(L_d=L_d)
    norms = [np.linalg.norm(jacobian, 2) for jacobian in (A_K, A_K[:n, :n], A)]
    return 2.0 * L_d * np.array(norms, dtype=np.float64) * I_K


def invariant_ellipsoid(
    A: npt.ArrayLike, E: npt.ArrayLike, *, L_d: float, slack: float = 0.0
) -> Ellipsoid:
    """The invariant ellipsoid of ``s' = A s + E v``, ``|v| <= L_d``, with the smallest radius.

    `slack` is the part of the disturbance's term left in the inequality, so that it holds strictly.
    For each a in (0, -2 abscissa) a Lyapunov equation gives W: S. Boyd et al., *Linear Matrix
    Inequalities in System and Control Theory*, section 6.1.2.
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
    return Ellipsoid(W=W_of(a), multiplier=a)
