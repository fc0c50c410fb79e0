"""The paper's eigenvalue problem, and two about its other answers, posed to a solver.

R_K and I_K come from a Lyapunov equation in the package; here they come from semidefinite programs,
as arXiv 2411.13140, section 4.3, poses them.
"""

import warnings

import cvxpy as cp
import numpy as np

from flighttune.theory.lyapunov import lyapunov_solution

OPTIONS = {
    "solver": "CLARABEL",
    "tol_gap_abs": 1e-9,
    "tol_gap_rel": 1e-9,
    "tol_feas": 1e-9,
    "equilibrate_enable": False,
}


def rate(Q):
    """R_K of a Q."""
    return 1.0 / np.linalg.eigvalsh(Q)[-1]


def radius(A, Q):
    """I_K of a Q."""
    values = np.linalg.eigvalsh(Q)
    return values[-1] ** 2 / (values[0] * np.linalg.svd(A, compute_uv=False)[-1])


def largest_rate(A):
    """The Q with the smallest lambda_max under ``A' Q + Q A + I <= 0``."""
    L, top = _scaled(A)
    eye = np.eye(len(A))
    answers = []
    mixed = np.linalg.cholesky(L @ L.T / top + 1e-3 * eye)
    for T in (eye, np.linalg.inv(mixed).T, np.linalg.inv(L).T):  # congruences: the same problem
        S, highest = cp.Variable(A.shape, symmetric=True), cp.Variable()
        F, M = L.T @ A @ T, L.T @ T  # of T' (A' Q + Q A + I) T with Q = L S L'
        decay = F.T @ S @ M + M.T @ S @ F + T.T @ T
        ceiling = L @ S @ L.T / top << highest * eye
        answers.append(_solved(highest, [decay << 0, ceiling], A, L, S))
    return max((Q for Q in answers if Q is not None), key=rate)


def smallest_radius(A, *, rate_loss=None):
    """The Q with the smallest I_K: at any rate, or at the largest less a fraction.

    ``lambda_max^2 / lambda_min`` is convex: minimise t under ``m I <= Q <= l I`` and
    ``l^2 / m <= t``.
    """
    L, top = _scaled(A)
    eye = np.eye(len(A))
    S, highest, lowest = cp.Variable(A.shape, symmetric=True), cp.Variable(), cp.Variable()
    Q = L @ S @ L.T
    constraints = [
        A.T @ Q + Q @ A + eye << 0,
        Q / top << highest * eye,
        Q / top >> lowest * eye,
    ]
    if rate_loss is not None:
        constraints.append(highest <= 1.0 / (1.0 - rate_loss))
    return _solved(cp.quad_over_lin(highest, lowest), constraints, A, L, S)


def _scaled(A):
    """Cholesky factor L of the Lyapunov equation's Q, and its largest eigenvalue."""
    Q = lyapunov_solution(A)
    return np.linalg.cholesky(Q), np.linalg.eigvalsh(Q)[-1]


def _solved(objective, constraints, A, L, S):
    """The multiple of Q that just satisfies the inequality; None where there is none."""
    with warnings.catch_warnings():
        # The multiple that is returned is feasible however far the solver came.
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        try:
            cp.Problem(cp.Minimize(objective), constraints).solve(**OPTIONS)
        except cp.SolverError:
            return None
    if S.value is None:
        return None
    Q = L @ S.value @ L.T
    slack = -np.linalg.eigvalsh(A.T @ Q + Q @ A)[-1]
    return Q / slack if slack > 0.0 and np.linalg.eigvalsh(Q)[0] > 0.0 else None
