"""The Lyapunov equation of closed loops, and its bounds on a disturbed loop.

Four bounds on the ultimate size of the loop, loosest first: the loop is ``s' = A s + E v`` with
``||v|| <= L_d``. In velocity form s = (x', e) and v is the derivative of the disturbance, which
enters through ``E = [I; 0]`` alone. The paper's ball uses neither E nor the weak direction of the
loop; the invariant ellipsoid and the peak gain do, and `reachable` has the exact value for each
row.

A common Q, or a common ellipsoid, for every loop of a polytope takes one linear matrix inequality
per vertex. A loop that varies inside the convex hull of the vertices, at any speed, has the
guarantee of the common matrix. Answers are checked by eigenvalues before they are returned.
"""

import math
import warnings
from contextlib import suppress
from functools import cache
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, check_positive, read_only_matrix, square_matrices
from flighttune.base.errors import InputError, ShapeError
from flighttune.control.theory.lmi import largest, parameter, solve, unknown

Indices: TypeAlias = npt.NDArray[np.intp]

# Up to this n one linear system in the n (n + 1)/2 entries is faster than a Schur form per matrix.
KRONECKER_STATES = 10

# Memory for the linear systems solved at once: about what a core's cache holds.
CHUNK_BYTES = 1 << 22


def lyapunov_solution(A: npt.ArrayLike, S: npt.ArrayLike | None = None) -> FloatArray:
    """Q of ``A' Q + Q A + S = 0``, for one stable matrix or a stack of them, symmetric to the bit.

    `A` has shape (..., n, n), 1/s; `S`, symmetric and by default the identity, broadcasts against
    it. The transposed matrices solve the dual equation ``A X + X A' + S = 0``. The relative
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
    """Rows and columns of the unknown entries of Q, and the sources of the system's entries."""
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

    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # SciPy perturbs what has no solution
        try:
            Q = np.array([solve_continuous_lyapunov(a.T, -s) for a, s in zip(A, S, strict=True)])
        except RuntimeWarning as error:
            raise np.linalg.LinAlgError(str(error)) from error
    return (Q + Q.mT) / 2.0


NARROW = 1e-6  # final width of the search for a multiplier, in its logit


class Ellipsoid(NamedTuple):
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
    derivative. The readings of Theorem 2 of arXiv 2411.13140 are three norms: of A_K (its proof
    applies Theorem 1 to ``s' = A_K s + d_s``), of the upper left block ``df/dx + df/du K_P`` (f(x,
    u(x)) as the loop under K_P), and of ``df/dx`` (the letter of its formula). The proof covers
    only the first reading: the loop can leave the balls of the other two.
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

    `slack` is the share of the disturbance's term that makes the inequality strict.
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

    # W grows without bound at both ends of the range of a. The logit moves the ends to infinity,
    # and the logarithm keeps the compared values within a few tens.
    def size(logit: float) -> float:
        return 0.5 * math.log(np.linalg.eigvalsh(W_of(widest / (1.0 + math.exp(-logit))))[-1])

    best = minimize_scalar(size, bounds=(-20.0, 20.0), method="bounded", options={"xatol": NARROW})
    a = widest / (1.0 + math.exp(-best.x))
    return Ellipsoid(W=W_of(a), multiplier=a)


# Largest relative distance between a checked rate and its checked bound to be called optimal.
GAP = 1e-4

# A common rate below this fraction of the fastest vertex's rate counts as zero.
NO_RATE = 1e-6

# Slack left in the ellipsoid's inequality, as a fraction of the disturbance's term.
SLACK = 1e-6


class CommonQ(NamedTuple):
    """A Q for all vertices, checked by eigenvalues.

    Inaccurate: Q is valid, but a better Q may exist. None: no common Q was found, and `R_bound`
    bounds the rate of any common Q.
    """

    status: Literal["optimal", "inaccurate", "none", "failed"]
    reason: str  # why it is not optimal; empty otherwise
    # (n, n), s: positive, with ``A' Q + Q A + I <= 0`` at every vertex up to rounding
    Q: FloatArray | None = None
    R: float = 0.0  # 1/s: ``1 / lambda_max(Q)``, the rate of decay of ``s' Q s``; 0 without a Q
    # 1/s: no common Q has a higher rate, by the solver's multipliers, made feasible
    R_bound: float = math.inf


def common_Q(vertices: npt.ArrayLike) -> CommonQ:
    """The common Q with the highest rate R at some vertices, shape (k, n, n), 1/s."""
    A = square_matrices("vertices", vertices, 3)
    L, speed = _coordinates(A)
    # Maximise R subject to ``A' Q + Q A + R I <= 0`` at every vertex and ``0 <= Q <= I``: bounded
    # and always feasible, with R = 0 where there is no common Q.
    program = _rate_program(*A.shape[:2])
    if unsolved := program.unsolved(A, L, speed):
        return CommonQ(status="failed", reason=unsolved)
    # The congruence of an inequality also maps its multiplier back to the coordinates of A.
    # Multipliers that are positive, with traces that add up to one, give the bound.
    to_A = np.linalg.inv(L)
    duals = np.array([decay.dual_value for decay in program.decays])
    values, vectors = np.linalg.eigh(to_A.T @ duals @ to_A)
    X = vectors * np.maximum(values, 0.0)[:, None, :] @ vectors.mT
    X = X / max(float(np.trace(X, axis1=1, axis2=2).sum()), 1e-300)
    flow = -(A @ X).sum(axis=0)
    # For any X_k >= 0 whose traces add up to one, R is at most the sum of the positive eigenvalues
    # of ``-sum(A_k X_k + X_k A_k')``.
    bound = float(np.maximum(np.linalg.eigvalsh(flow + flow.T), 0.0).sum())
    Q, R = _from_coordinates(program.form.value, L), 0.0
    slack = -np.linalg.eigvalsh(A.mT @ Q + Q @ A)[:, -1].max()
    if slack > 0.0 and np.linalg.eigvalsh(Q)[0] > 0.0:
        Q = Q / slack  # the multiple that just satisfies the inequality at every vertex
        R = float(1.0 / np.linalg.eigvalsh(Q)[-1])
    if R < NO_RATE * speed:
        reason = f"no common Q was found; its rate is at most {bound:.3g} 1/s"
        return CommonQ(status="none", reason=reason, R_bound=bound)
    close = bound <= (1.0 + GAP) * R
    return CommonQ(
        status="optimal" if close else "inaccurate",
        reason="" if close else f"the rate is only known to lie in [{R:.6g}, {bound:.6g}] 1/s",
        Q=Q,
        R=R,
        R_bound=bound,
    )


def common_ellipsoid(
    vertices: npt.ArrayLike, E: npt.ArrayLike, *, L_d: float
) -> tuple[Ellipsoid | None, str]:
    """The smallest common invariant ellipsoid of all vertices, for disturbances of norm L_d.

    `vertices` (shape (k, n, n), 1/s) are the loops of ``s' = A s + E v``. Returns None and a reason
    if none was found. The multiplier is the a of ``A W + W A' + a W + (L_d^2 / a) E E' <= 0``:
    S. Boyd et al., *Linear Matrix Inequalities in System and Control Theory*, section 6.1.2.
    """
    A = square_matrices("vertices", vertices, 3)
    E = read_only_matrix("E", E)
    if E.shape[0] != A.shape[-1]:
        raise ShapeError(f"`E` must have {A.shape[-1]} rows, got shape {E.shape}.")
    check_positive(L_d=L_d)
    fastest = -2.0 * np.linalg.eigvals(A).real.max()
    if not fastest > 0.0:
        return None, "a vertex is not stable"
    tried: dict[float, FloatArray] = {}

    def radius(fraction: float) -> float:
        if (W := _ellipsoid(A, E, fraction * fastest)) is None:
            return 2.0 / max(fraction, 1e-3) * np.linalg.norm(E, 2) / fastest
        tried[fraction] = W
        return float(np.sqrt(np.linalg.eigvalsh(W)[-1]))

    from scipy.optimize import minimize_scalar

    # The inequality is convex in W for a fixed multiplier a, but not in both. As a share of twice
    # the slowest decay, a has an optimum inside (0, 1): a small a multiplies the disturbance by
    # 1/a, and a large a leaves the loops no decay. For the gains of the paper over its envelope the
    # radius for L_d = 1 is 21.9, 15.1 and 17.2 at the first three shares below. There is none at
    # 0.5, and the smallest is 14.72 at 0.196. Not known: whether the radius always has a single
    # minimum over a, as in all computed cases. A worse multiplier only makes the claim wider.
    for coarse in (0.05, 0.15, 0.3, 0.5):
        radius(coarse)
    if not tried:
        return None, "no common ellipsoid was found at any multiplier"

    def best() -> float:
        return min(tried, key=lambda fraction: np.linalg.eigvalsh(tried[fraction])[-1])

    bounds = best() / 3.0, min(3.0 * best(), 1.0)
    minimize_scalar(radius, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return Ellipsoid(W=L_d**2 * tried[best()], multiplier=best() * fastest), ""


def _ellipsoid(A: FloatArray, E: FloatArray, a: float) -> FloatArray | None:
    """W of the smallest radius at one multiplier for L_d = 1; None unless it is invariant."""
    n = A.shape[-1]
    shifted = A + a / 2.0 * np.eye(n)
    # W plays the role of Q for the transposed loops.
    L, speed = _coordinates(shifted.mT)
    load = E @ E.T / a
    to_s = np.linalg.inv(L)
    inside = to_s @ (load + SLACK * np.linalg.norm(load, 2) * np.eye(n)) @ to_s.T / speed
    scale = float(np.linalg.norm(inside, 2))
    program = _ellipsoid_program(*A.shape[:2])
    program.load.value = inside / scale
    if program.unsolved(shifted.mT, L, speed):
        return None
    W = scale * _from_coordinates(program.form.value, L)
    flow = np.linalg.eigvalsh(shifted @ W + W @ shifted.mT + load)
    return W if flow[:, -1].max() < 0.0 < np.linalg.eigvalsh(W)[0] else None


class _Program(NamedTuple):
    """A problem that is compiled once for k vertices and n states, with its parameters.

    With ``Q = L S L'`` and ``B = L' A L'^-1`` the inequality ``A' Q + Q A + R I <= 0`` is
    ``B' S + S B + R G <= 0``, with ``G = (L L')^-1`` in place of the identity: a congruence. L
    makes S of order one, which the accuracy of the solver requires.
    """

    problem: Any
    form: Any  # S, (n, n)
    loops: tuple[Any, ...]  # B of each vertex, (n, n)
    unit: Any  # G, (n, n)
    load: Any  # (n, n)
    decays: tuple[Any, ...]  # the inequality of each vertex

    def unsolved(self, A: FloatArray, L: FloatArray, speed: float) -> str:
        """Solve it for the vertices A / `speed`; why it has no solution, or an empty text."""
        for loop, value in zip(self.loops, L.T @ A @ np.linalg.inv(L.T) / speed, strict=True):
            loop.value = value
        self.unit.value = _from_coordinates(
            np.eye(len(L)), np.asarray(np.linalg.inv(L), dtype=float)
        )
        return solve(self.problem)


@cache
def _rate_program(k: int, n: int) -> _Program:
    """Maximise R subject to ``A' Q + Q A + R I <= 0`` at every vertex and ``0 <= Q <= I``."""
    loops, I = tuple(parameter(n, n) for _ in range(k)), parameter(n, n, symmetric=True)  # noqa: E741
    Q, R = unknown(n, n, symmetric=True), unknown()
    decays = tuple(A.T @ Q + Q @ A + R * I << 0 for A in loops)
    return _Program(largest(R, [*decays, Q << I, Q >> 0]), Q, loops, I, None, decays)


@cache
def _ellipsoid_program(k: int, n: int) -> _Program:
    """Minimise r subject to ``A W + W A' + E E' / a <= 0`` at every vertex and ``W <= r I``."""
    loops, I = tuple(parameter(n, n) for _ in range(k)), parameter(n, n, symmetric=True)  # noqa: E741
    load = parameter(n, n, symmetric=True)
    W, r = unknown(n, n, symmetric=True), unknown()
    decays = tuple(A.T @ W + W @ A + load << 0 for A in loops)  # the loops are transposed
    return _Program(largest(-r, [*decays, W << r * I]), W, loops, I, load, decays)


def _from_coordinates(S: FloatArray, L: FloatArray) -> FloatArray:
    """``L S L'``, symmetric to the bit."""
    Q = L @ S @ L.T
    return (Q + Q.T) / 2.0


def _coordinates(A: FloatArray) -> tuple[FloatArray, float]:
    """L of norm 1 and a rate: ``L L' / rate`` is the Lyapunov solution of the mean vertex."""
    mean = A.mean(axis=0)
    L = np.eye(len(mean))
    if not np.linalg.eigvals(mean).real.max() < 0.0:
        return L, float(np.linalg.norm(mean, 2)) or 1.0
    Q0 = lyapunov_solution(mean)
    top = np.linalg.eigvalsh(Q0)[-1]
    with suppress(np.linalg.LinAlgError):
        L = np.linalg.cholesky(Q0 / top)
    return L, float(1.0 / top)
