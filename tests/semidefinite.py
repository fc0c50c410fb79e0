"""The paper's eigenvalue problem, posed to a solver.

R_K and I_K come from a Lyapunov equation in the package; here they come from a semidefinite
program, as arXiv 2411.13140, section 4.3, poses it.
"""

import warnings

import cvxpy as cp
import numpy as np
from scipy.linalg import solve_continuous_lyapunov

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
    whole = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
    L, top = np.linalg.cholesky(whole), np.linalg.eigvalsh(whole)[-1]
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
