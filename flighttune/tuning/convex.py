"""Tuning from a convex start: the semidefinite program in W = Q^-1 and Y = K W.

For feedback of the whole state s the condition ``A_K' Q + Q A_K + I <= 0`` is linear in (W, Y)
after multiplication by W from both sides, and ``lambda_max(Q) <= 1/R`` is ``W >= R I``. So the
largest R_K is a convex problem in the gains as long as I_K, input limits and structure are left
out; a bound on the gains, ``K W K' <= size^2 I``, keeps it finite. Its solutions for several sizes
start the gradient method, which restores what was left out.
"""

from dataclasses import replace

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel
from flighttune.theory.lmi import blocks, largest, solve, unknown
from flighttune.tuning.gradient import tune_by_gradient
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.result import TuningResult

SIZES = (0.5, 1.0, 2.0, 4.0, 8.0)
METHOD = "convex"


def tune_from_convex_start(problem: TuningProblem) -> TuningResult:
    """Gains of the largest R_K, by the gradient method from gains of a convex problem.

    `problem`: gains on states that its loop does not feed back are left out of the start; with lag
    or delay it is then a guess, no longer an optimum. There is no random start, so that the seed
    plays no part. The status is "failed" where no convex start stabilises the loop.
    """
    result = tune_by_gradient(problem, starts=0, first=convex_starts(problem))
    return replace(result, method=METHOD)


def convex_starts(problem: TuningProblem) -> FloatArray:
    """Stacked gains of the convex problem for each of `SIZES`, shape (at most 5, m, 2 p).

    `problem`: model, scaling and the bounds and fixed values of gains are used, the rest is not.
    The result is empty where the solver found no answer at all.
    """
    solutions = [state_feedback(problem.model, problem.scaling, size) for size in SIZES]
    n = len(problem.model.states)
    output = np.linalg.pinv(problem.model.C)
    lower, upper = problem.gain_bounds
    stacked = [np.hstack([K[:, :n] @ output, K[:, n:]]) for K in solutions if K is not None]
    return np.clip(np.array(stacked).reshape(-1, *lower.shape), lower, upper)


def state_feedback(
    model: LinearModel, scaling: FloatArray | None, size: float
) -> FloatArray | None:
    """K of ``u' = K s`` with the largest R_K under ``K W K' <= size^2 I``, or None.

    `model`: n states, m inputs, p errors. `scaling` (shape (n + p,)): units of the state s = (x',
    e). `size`: bound on the gains in the norm of the optimal W. Returns None where the solver has
    no answer (shape (m, n + p)).
    """
    n, m, p = model.shape
    order = n + p
    scale = np.ones(order) if scaling is None else scaling
    A, B = np.zeros((order, order)), np.vstack([model.B, np.zeros((p, m))])
    A[:n, :n], A[n:, :n] = model.A, model.C
    A, B = A * (scale / scale[:, None]), B / scale[:, None]
    W, Y = unknown(order, order, symmetric=True), unknown(m, order)
    rate, eye = unknown(), np.eye(order)
    flow = A @ W + B @ Y
    decay = blocks([[-(flow + flow.T), W], [W, eye]])
    bound = blocks([[size**2 * np.eye(m), Y], [Y.T, W]])
    if not solve(largest(rate, [decay >> 0, W >> rate * eye, bound >> 0])).solved:
        return None
    return np.linalg.solve(W.value, Y.value.T).T / scale
