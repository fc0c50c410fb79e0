"""Ascent of the rate of a common Q over the gains: a sequence of semidefinite programs.

The inequality ``A_v' Q + Q A_v + R I <= 0`` is bilinear in gains and Q. Linearised in a step of
both it is a linear matrix inequality, solved inside a trust region; the true rate at the new
gains, by `common_Q`, decides whether the step is taken. Kinks of the rate are no obstacle: every
program sees all vertices and all eigenvalues at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.theory.common import common_Q
from flighttune.theory.indicators import indicators
from flighttune.theory.lmi import combination, largest, parameter, solve, unknown
from flighttune.theory.lyapunov import lyapunov_solution
from flighttune.tuning.problem import TuningProblem, search_space

FIRST_STEP, SMALLEST_STEP = 0.3, 1e-4
"""Trust region on each gain, relative to it (to one for small ones)."""

ITERATIONS = 60
MIN_GAIN = 1e-5
"""Two steps in a row with a smaller relative gain of rate end the ascent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """Free gains that meet every constraint, with their rates."""

    k: FloatArray  # shape (f,)
    Q: FloatArray  # shape (n, n), s: common to the vertices
    # `R` and `R_bound` (1/s): rate of Q, and a bound on the rate of any other
    R: float
    R_bound: float
    # `R_K` and `I_K` (1/s and s^2): indicators at the trim
    R_K: float
    I_K: float


def point(problem: TuningProblem, models: Sequence[LinearModel], k: FloatArray) -> Point | None:
    """The point of free gains k, or None where a constraint is broken or there is no common Q."""
    space = search_space(problem)
    inside = (space.slack(k) >= 0.0).all() and (space.k_min <= k).all() and (k <= space.k_max).all()
    if not inside:
        return None
    K = space.K(k)
    at_trim = indicators(closed_loops(problem.model, K))
    if not at_trim.I_K <= problem.I_star:
        return None
    common = common_Q(np.array([closed_loops(model, K) for model in models]))
    if common.Q is None:
        return None
    return Point(
        k=k,
        Q=common.Q,
        R=common.R,
        R_bound=common.R_bound,
        R_K=at_trim.R_K,
        I_K=at_trim.I_K,
    )


def ascend(problem: TuningProblem, models: Sequence[LinearModel], start: Point) -> Point:
    """A local optimum of the common rate, from a point that meets the constraints.

    The result is never worse than `start`.
    """
    step, excess, idle = FIRST_STEP, 0.0, 0
    best = start
    program = _Linearised(problem, models)
    for _ in range(ITERATIONS):
        k = program.step(best, step, excess)
        better = None if k is None else point(problem, models, k)
        if better is not None and better.R > best.R:
            idle = idle + 1 if better.R < (1.0 + MIN_GAIN) * best.R else 0
            best, step, excess = better, min(2.0 * step, 1.0), excess / 2.0
        else:
            # Linearised, the bound on I_K may be missed: it is tightened by the excess seen.
            broken = 0.0 if k is None or better is not None else program.excess(k)
            step, excess = step / 2.0, max(excess, broken) if broken > 0.0 else excess / 2.0
        if idle == 2 or step < SMALLEST_STEP:
            break
    return best


class _Linearised:
    """The program of one step: unknowns dk, Q, R and the relative changes of I_K's factors.

    It is compiled once; what changes from step to step are its parameters.
    """

    def __init__(self, problem: TuningProblem, models: Sequence[LinearModel]) -> None:
        self._problem, self._models = problem, models
        self._space = search_space(problem)
        self._limited = math.isfinite(problem.I_star)
        self._trim_slopes = self._slopes(problem.model)
        f, n = len(self._trim_slopes), len(self._trim_slopes[0])
        self._dk, Q, R = unknown(f), unknown(n, n, symmetric=True), unknown()
        self._loops = [parameter(n, n) for _ in models]
        self._Q0 = parameter(n, n, symmetric=True)
        self._lower, self._upper = parameter(f), parameter(f)
        # The trust region with the bounds on gains, and the input limits. Q <= I fixes the scale,
        # so that the rate is R itself.
        constraints = [self._lower <= self._dk, self._dk <= self._upper, Q << np.eye(n)]
        if len(self._space.G):
            self._slack = parameter(len(self._space.G))
            constraints.append(self._space.G @ self._dk <= self._slack)
        for A, model in zip(self._loops, models, strict=True):
            dA = combination(self._dk, self._slopes(model).reshape(f, n * n))
            moved = dA.T @ self._Q0 + self._Q0 @ dA
            constraints.append(A.T @ Q + Q @ A + moved + R * np.eye(n) << 0)
        if self._limited:
            constraints += self._radius_constraints(f, n)
        self._program = largest(R, constraints)

    def _slopes(self, model: LinearModel) -> FloatArray:
        """Derivatives of the closed loop by each free gain, shape (f, n, n)."""
        unit = np.eye(self._space.free.sum())
        K = self._space.K
        return closed_loops(model, K(unit)) - closed_loops(model, K(0.0 * unit))

    def _radius_constraints(self, f: int, n: int) -> list[Any]:
        """``log I_K <= log I_star - excess`` at the trim, in bounds on Q0 and on A'A.

        ``I_K = lambda_max(Q0)^2 / (lambda_min(Q0) sigma_min(A))``. The matrices are linearised, not
        their eigenvalues, so that kinks stay kinks.
        """
        self._trim = [(parameter(n, n, symmetric=True), parameter(f, n * n)) for _ in range(3)]
        self._room = parameter()
        highest, lowest, gram = (
            matrix + combination(self._dk, slopes) for matrix, slopes in self._trim
        )
        rise, eye = unknown(3), np.eye(n)  # relative changes of the three eigenvalues
        # I_K has sigma_min(A), the root of the smallest eigenvalue of A'A: hence one half.
        return [
            highest << (1.0 + rise[0]) * eye,
            lowest >> (1.0 + rise[1]) * eye,
            gram >> (1.0 + rise[2]) * eye,
            2.0 * rise[0] - rise[1] - 0.5 * rise[2] <= self._room,
        ]

    def step(self, at: Point, size: float, excess: float) -> FloatArray | None:
        """New free gains, or None where the solver has none."""
        space = self._space
        trust = size * np.maximum(np.abs(at.k), 1.0)
        self._upper.value = np.minimum(trust, space.k_max - at.k)
        self._lower.value = -np.minimum(trust, at.k - space.k_min)
        if len(space.G):
            self._slack.value = space.slack(at.k)
        self._Q0.value = at.Q * at.R
        for A, model in zip(self._loops, self._models, strict=True):
            A.value = closed_loops(model, space.K(at.k))
        if self._limited:
            self._set_radius(at, excess)
        if not solve(self._program).solved:
            return None
        return np.clip(at.k + self._dk.value, space.k_min, space.k_max)

    def excess(self, k: FloatArray) -> float:
        """Excess of log I_K over its limit at free gains k; 0 without any."""
        if not self._limited:
            return 0.0
        I_K = indicators(closed_loops(self._problem.model, self._space.K(k))).I_K
        return max(0.0, math.log(I_K / self._problem.I_star)) if math.isfinite(I_K) else 0.0

    def _set_radius(self, at: Point, excess: float) -> None:
        A = closed_loops(self._problem.model, self._space.K(at.k))
        Q0 = lyapunov_solution(A)
        load = self._trim_slopes.mT @ Q0 + Q0 @ self._trim_slopes
        Q_slopes = lyapunov_solution(A, load)
        gram, gram_slopes = A.T @ A, A.T @ self._trim_slopes
        gram_slopes = gram_slopes + gram_slopes.mT
        spectrum, smallest = np.linalg.eigvalsh(Q0), np.linalg.eigvalsh(gram)[0]
        factors = (
            (spectrum[-1], Q0, Q_slopes),
            (spectrum[0], Q0, Q_slopes),
            (smallest, gram, gram_slopes),
        )
        for (matrix, slopes), (value, now, change) in zip(self._trim, factors, strict=True):
            matrix.value = now / value
            slopes.value = change.reshape(slopes.shape) / value
        self._room.value = math.log(self._problem.I_star / at.I_K) - excess
