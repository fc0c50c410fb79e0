"""The quadratic cost of a manoeuvre from its first error, and its slope in the gains."""

import math

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops
from flighttune.errors import InputError
from flighttune.theory.lyapunov import solution_of_checked
from flighttune.tuning.problem import TuningProblem


def quadratic_cost(problem: TuningProblem, K: FloatArray) -> tuple[float, FloatArray]:
    """J of stacked gains K, shape (m, 2 p), and its slope in K; inf for an unstable loop.

    Notes
    -----
    With e the errors, u the commands and weights w, ``J = int sum w_e e^2 + w_u (u - u_end)^2 dt``.
    The deviations z = (x, int e) from their end values obey ``z' = A_K z``, and
    ``u - u_end = K H z`` with ``H = diag(C, I)``. So ``J = z_0' P z_0`` with
    ``A_K' P + P A_K + H_e' w_e H_e + (K H)' w_u K H = 0``; with ``A_K X + X A_K' + z_0 z_0' = 0``
    the slope is ``2 (B' P + w_u K H) X H'``.
    """
    model, weights, x_0 = problem.model, problem.weights, problem.x_0
    if weights is None or x_0 is None:
        raise InputError("`weights` and `x_0` must be given for a quadratic cost.")
    n, m, p = model.shape
    A = closed_loops(model, K)
    if not np.isfinite(A).all() or np.linalg.eigvals(A).real.max() >= 0.0:
        return math.inf, np.zeros(K.shape)
    H = np.block([[model.C, np.zeros((p, p))], [np.zeros((p, n)), np.eye(p)]])
    commands, errors = K @ H, H[:p]
    z_0 = np.concatenate([np.linalg.pinv(model.C) @ x_0, np.zeros(p)])
    load = errors.T * weights[0] @ errors + commands.T * weights[1] @ commands
    try:
        P = solution_of_checked(A, (load + load.T) / 2.0)
        X = solution_of_checked(A.T, np.outer(z_0, z_0))
    except np.linalg.LinAlgError:  # so near to instability that rounding decides
        return math.inf, np.zeros(K.shape)
    B = np.vstack([model.B, np.zeros((p, m))])
    return float(z_0 @ P @ z_0), 2.0 * (B.T @ P + weights[1][:, None] * commands) @ X @ H.T
