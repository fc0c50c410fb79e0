"""Ascent of the rate of a common Q over the gains: a sequence of semidefinite programs.

The inequality ``A_v' Q + Q A_v + R I <= 0`` is bilinear in gains and Q. Linearised in a step of
both it is a linear matrix inequality, solved inside a trust region; the true rate at the new
gains, by `common_Q`, decides whether the step is taken. Kinks of the rate are no obstacle: every
program sees all vertices and all eigenvalues at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.theory.common import common_Q
from flighttune.theory.indicators import indicators
from flighttune.theory.lmi import Cone, Rows, minimise, symmetric_basis
from flighttune.theory.lyapunov import lyapunov_solution
from flighttune.tuning.problem import TuningProblem, search_space

FIRST_STEP, SMALLEST_STEP = 0.3, 1e-4
"""Trust region on each gain, relative to it (to one for small ones)."""

ITERATIONS = 60
MIN_GAIN = 1e-5
"""Two steps in a row with a smaller relative gain of rate end the ascent."""

SPECTRAL_BOUNDS = 3
"""Unknowns: relative changes of lambda_max(Q0), lambda_min(Q0) and sigma_min(A_K)^2."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """Free gains that meet every constraint, with their rates."""

    k: FloatArray  # shape (f,)
    Q: FloatArray  # shape (n, n), s: common to the vertices
    # `R` and `R_bound` (1/s): rate of Q, and a bound on the rate of any other
    R: float
    R_bound: float
    # `R_K` and `I_K` (1/s and s^2): at the trim
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
    """The program of one step: unknowns dk, Q, R and the relative changes of I_K's factors."""

    def __init__(self, problem: TuningProblem, models: Sequence[LinearModel]) -> None:
        self._problem, self._models = problem, models
        self._space = search_space(problem)
        self._basis = symmetric_basis(sum(models[0].shape[::2]))
        self._limited = math.isfinite(problem.I_star)
        unit = np.eye(self._space.free.sum())
        self._slopes = [
            closed_loops(model, self._space.K(unit))
            - closed_loops(model, self._space.K(0.0 * unit))
            for model in models
        ]
        self._trim_slopes = closed_loops(problem.model, self._space.K(unit)) - closed_loops(
            problem.model, self._space.K(0.0 * unit)
        )

    def step(self, at: Point, size: float, excess: float) -> FloatArray | None:
        """New free gains, or None where the solver has none."""
        f, d = len(at.k), len(self._basis)
        objective = np.zeros(f + d + 1 + SPECTRAL_BOUNDS)
        objective[f + d] = -1.0
        rows = self._trust(at, size)
        cones = self._decay(at)
        if self._limited:
            radius_cones, radius_row = self._radius(at, excess)
            cones += radius_cones
            rows = Rows(
                constant=np.append(rows.constant, radius_row.constant),
                coefficients=np.vstack([rows.coefficients, radius_row.coefficients]),
            )
        solution = minimise(objective, cones, rows)
        if solution.x is None:
            return None
        space = self._space
        return np.clip(at.k + solution.x[:f], space.k_min, space.k_max)

    def excess(self, k: FloatArray) -> float:
        """Excess of log I_K over its limit at free gains k; 0 without any."""
        if not self._limited:
            return 0.0
        I_K = indicators(closed_loops(self._problem.model, self._space.K(k))).I_K
        return max(0.0, math.log(I_K / self._problem.I_star)) if math.isfinite(I_K) else 0.0

    def _decay(self, at: Point) -> list[Cone]:
        """``A_v' Q + Q A_v + R I <= 0`` at every vertex, linearised, and ``Q <= I``."""
        Q0 = at.Q * at.R
        n, extra = len(Q0), np.zeros((SPECTRAL_BOUNDS, *Q0.shape))
        zero, eye = np.zeros((n, n)), np.eye(n)
        cones = []
        for model, slopes in zip(self._models, self._slopes, strict=True):
            A = closed_loops(model, self._space.K(at.k))
            in_k = slopes.mT @ Q0 + Q0 @ slopes
            in_Q = A.T @ self._basis + self._basis @ A
            parts = [-in_k, -in_Q, -eye[None], extra]
            cones.append(Cone(constant=zero, coefficients=np.concatenate(parts)))
        # Q <= I fixes the scale: the rate is then R itself.
        parts = [np.zeros((len(at.k), n, n)), -self._basis, zero[None], extra]
        return [*cones, Cone(constant=eye, coefficients=np.concatenate(parts))]

    def _trust(self, at: Point, size: float) -> Rows:
        """The trust region, the bounds on gains and the input limits."""
        space, eye = self._space, np.eye(len(at.k))
        trust = size * np.maximum(np.abs(at.k), 1.0)
        constant = [
            np.minimum(trust, space.k_max - at.k),
            np.minimum(trust, at.k - space.k_min),
            space.slack(at.k),
        ]
        in_k = np.vstack([-eye, eye, -space.G])
        rest = np.zeros((len(in_k), len(self._basis) + 1 + SPECTRAL_BOUNDS))
        return Rows(constant=np.concatenate(constant), coefficients=np.hstack([in_k, rest]))

    def _radius(self, at: Point, excess: float) -> tuple[list[Cone], Rows]:
        """``log I_K <= log I_star - excess`` at the trim, in bounds on Q0 and on A'A.

        The matrices are linearised, not their eigenvalues, so that kinks stay kinks.
        """
        A = closed_loops(self._problem.model, self._space.K(at.k))
        Q0 = lyapunov_solution(A)
        load = self._trim_slopes.mT @ Q0 + Q0 @ self._trim_slopes
        Q_slopes = lyapunov_solution(A, load)
        gram, gram_slopes = A.T @ A, A.T @ self._trim_slopes
        gram_slopes = gram_slopes + gram_slopes.mT
        spectrum, smallest = np.linalg.eigvalsh(Q0), np.linalg.eigvalsh(gram)[0]
        eye, f, d = np.eye(len(A)), len(at.k), len(self._basis)
        cones = []
        for number, (sign, value, constant, slopes) in enumerate(
            (
                (-1.0, spectrum[-1], Q0, Q_slopes),
                (1.0, spectrum[0], Q0, Q_slopes),
                (1.0, smallest, gram, gram_slopes),
            )
        ):
            coefficients = np.zeros((f + d + 1 + SPECTRAL_BOUNDS, *A.shape))
            coefficients[:f] = sign * slopes / value
            coefficients[f + d + 1 + number] = -sign * eye
            cones.append(Cone(constant=sign * (constant / value - eye), coefficients=coefficients))
        row = np.zeros((1, f + d + 1 + SPECTRAL_BOUNDS))
        # log I_K = 2 log lambda_max - log lambda_min - log sigma_min, and sigma_min is the root of
        # the smallest eigenvalue of A'A: hence one half.
        row[0, -SPECTRAL_BOUNDS:] = -2.0, 1.0, 0.5
        slack = math.log(self._problem.I_star / at.I_K) - excess
        return cones, Rows(constant=np.array([slack]), coefficients=row)
