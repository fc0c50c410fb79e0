"""The paper's eigenvalue problem, and two about its other answers, posed to a solver.

R_K and I_K come from a Lyapunov equation in the package; here they come from semidefinite programs,
as arXiv 2411.13140, section 4.3, poses them.
"""

import numpy as np

from flighttune.theory.lmi import Cone, minimise, symmetric_basis
from flighttune.theory.lyapunov import lyapunov_solution


def rate(Q):
    """R_K of a Q."""
    return 1.0 / np.linalg.eigvalsh(Q)[-1]


def radius(A, Q):
    """I_K of a Q."""
    values = np.linalg.eigvalsh(Q)
    return values[-1] ** 2 / (values[0] * np.linalg.svd(A, compute_uv=False)[-1])


def largest_rate(A):
    """The Q with the smallest lambda_max under ``A' Q + Q A + I <= 0``."""
    L, top, basis, flow = _scaled(A)
    eye, size = np.eye(len(A)), len(basis)
    answers = []
    mixed = np.linalg.cholesky(L @ L.T / top + 1e-3 * eye)
    for T in (eye, np.linalg.inv(mixed).T, np.linalg.inv(L).T):  # congruences: the same problem
        cones = [
            Cone(constant=-T.T @ T, coefficients=_padded(-T.T @ flow @ T, 1)),
            Cone(constant=0.0 * eye, coefficients=_padded(-basis / top, 1, {0: eye})),
        ]
        found = minimise(np.eye(size + 1)[size], cones).x
        if found is not None:
            answers.append(_feasible(A, np.tensordot(found[:size], basis, 1)))
    return max((Q for Q in answers if Q is not None), key=rate)


def smallest_radius(A, *, rate_loss=None):
    """The Q with the smallest I_K: at any rate, or at the largest less a fraction.

    ``lambda_max^2 / lambda_min`` is convex: minimise t under ``m I <= Q <= l I`` and
    ``[[t, l], [l, m]] >= 0``.
    """
    _, top, basis, flow = _scaled(A)
    eye, size = np.eye(len(A)), len(basis)
    corners = [np.diag([1.0, 0.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([0.0, 1.0])]
    cones = [
        Cone(constant=-eye, coefficients=_padded(-flow, 3)),
        Cone(constant=0.0 * eye, coefficients=_padded(-basis / top, 3, {1: eye})),
        Cone(constant=0.0 * eye, coefficients=_padded(basis / top, 3, {2: -eye})),
        Cone(
            constant=np.zeros((2, 2)),
            coefficients=_padded(np.zeros((size, 2, 2)), 3, dict(enumerate(corners))),
        ),
    ]
    if rate_loss is not None:
        cap = {1: -np.ones((1, 1))}
        constant = np.array([[1.0 / (1.0 - rate_loss)]])
        cones.append(Cone(constant=constant, coefficients=_padded(np.zeros((size, 1, 1)), 3, cap)))
    found = minimise(np.eye(size + 3)[size], cones)
    return _feasible(A, np.tensordot(found.x[:size], basis, 1))


def _scaled(A):
    """Cholesky factor L of the Lyapunov equation's Q, its top, a basis L S L' and its flow."""
    Q = lyapunov_solution(A)
    L = np.linalg.cholesky(Q)
    basis = L @ symmetric_basis(len(A)) @ L.T
    return L, np.linalg.eigvalsh(Q)[-1], basis, A.T @ basis + basis @ A


def _padded(coefficients, extra, given=()):
    """Coefficients with those of `extra` further unknowns behind."""
    rest = np.zeros((extra, *coefficients.shape[1:]))
    for i, matrix in dict(given).items():
        rest[i] = matrix
    return np.concatenate([coefficients, rest])


def _feasible(A, Q):
    """The multiple of Q that just satisfies the inequality; None where there is none."""
    slack = -np.linalg.eigvalsh(A.T @ Q + Q @ A)[-1]
    return Q / slack if slack > 0.0 and np.linalg.eigvalsh(Q)[0] > 0.0 else None
