"""The rate of a common Q climbed over the gains: a sequence of semidefinite programs.

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
from flighttune.control.closed_loop import closed_loops
from flighttune.control.linear_model import LinearModel
from flighttune.theory.common import CommonQ, common_Q
from flighttune.theory.evp import symmetric_basis
from flighttune.theory.indicators import indicators
from flighttune.theory.lmi import Cone, Rows, minimise
from flighttune.theory.sensitivity import spectra
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.search_space import search_space

FIRST_STEP, SMALLEST_STEP = 0.3, 1e-4
"""Trust region on each gain, relative to it (to one for small ones)."""

ITERATIONS = 60
ENOUGH = 1e-5
"""A relative gain of rate below this, twice, ends the climb."""

BOUNDS = 3
"""Unknowns that bound the spectra: log lambda_max, log lambda_min, log sigma_min."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """Free gains that meet every constraint, with their rates.

    Attributes
    ----------
    k : ndarray, shape (f,)
    common : CommonQ
        Over the vertices, with a positive rate.
    R_K, I_K : float, 1/s and s^2
        At the trim.
    """

    k: FloatArray
    common: CommonQ
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
    return Point(k=k, common=common, R_K=at_trim.R_K, I_K=at_trim.I_K)


def climb(problem: TuningProblem, models: Sequence[LinearModel], start: Point) -> Point:
    """A local optimum of the common rate, from a point that meets the constraints.

    Parameters
    ----------
    problem : TuningProblem
    models : sequence of LinearModel
        The vertices.
    start : Point

    Returns
    -------
    Point
        Never worse than `start`.
    """
    step, excess, idle = FIRST_STEP, 0.0, 0
    best = start
    program = _Linearised(problem, models)
    for _ in range(ITERATIONS):
        k = program.step(best, step, excess)
        better = None if k is None else point(problem, models, k)
        if better is not None and better.common.R > best.common.R:
            idle = idle + 1 if better.common.R < (1.0 + ENOUGH) * best.common.R else 0
            best, step, excess = better, min(2.0 * step, 1.0), excess / 2.0
        else:
            broken = 0.0 if k is None or better is not None else program.excess(k)
            step, excess = step / 2.0, max(excess, broken) if broken > 0.0 else excess / 2.0
        if idle == 2 or step < SMALLEST_STEP:
            break
    return best


class _Linearised:
    """The program of one step: unknowns (dk, Q, R, and the three bounds of the spectra)."""

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
        objective = np.zeros(f + d + 1 + BOUNDS)
        objective[f + d] = -1.0
        solution = minimise(objective, self._cones(at), self._rows(at, size, excess))
        if solution.x is None:
            return None
        space = self._space
        return np.clip(at.k + solution.x[:f], space.k_min, space.k_max)

    def excess(self, k: FloatArray) -> float:
        """How far log I_K is above its limit at free gains k."""
        I_K = indicators(closed_loops(self._problem.model, self._space.K(k))).I_K
        return math.log(I_K / self._problem.I_star) if math.isfinite(I_K) else 0.0

    def _cones(self, at: Point) -> list[Cone]:
        Q0 = at.common.Q * at.common.R
        n, extra = len(Q0), np.zeros((BOUNDS, *Q0.shape))
        cones = []
        for model, slopes in zip(self._models, self._slopes, strict=True):
            A = closed_loops(model, self._space.K(at.k))
            in_k = slopes.mT @ Q0 + Q0 @ slopes
            in_Q = A.T @ self._basis + self._basis @ A
            coefficients = [-in_k, -in_Q, -np.eye(n)[None], extra]
            cones.append(Cone(constant=np.zeros((n, n)), coefficients=np.concatenate(coefficients)))
        still = np.zeros((len(at.k), n, n))
        capped = np.concatenate([still, -self._basis, np.zeros((1, n, n)), extra])
        return [*cones, Cone(constant=np.eye(n), coefficients=capped)]

    def _rows(self, at: Point, size: float, excess: float) -> Rows:
        space, f = self._space, len(at.k)
        trust = size * np.maximum(np.abs(at.k), 1.0)
        eye = np.eye(f)
        constants = [
            np.minimum(trust, space.k_max - at.k),
            np.minimum(trust, at.k - space.k_min),
            space.slack(at.k),
        ]
        parts = [-eye, eye, -space.G]
        width = f + len(self._basis) + 1 + BOUNDS
        rows = [np.hstack([part, np.zeros((len(part), width - f))]) for part in parts]
        if self._limited:
            constant, coefficients = self._radius_rows(at, excess, width)
            constants.append(constant)
            rows.append(coefficients)
        return Rows(constant=np.concatenate(constants), coefficients=np.vstack(rows))

    def _radius_rows(self, at: Point, excess: float, width: int) -> tuple[FloatArray, FloatArray]:
        """``log I_K <= log I_star - excess``, every eigenvalue and singular value linearised."""
        found = spectra(closed_loops(self._problem.model, self._space.K(at.k)))
        if found is None:
            return np.empty(0), np.empty((0, width))
        logs, slopes = [], []
        for values, gradients in (
            (found.eigenvalues, found.eigenvalue_gradients),
            (found.singular_values, found.singular_value_gradients),
        ):
            logs.append(np.log(values))
            slopes.append(
                np.einsum("kij,fij->kf", gradients / values[:, None, None], self._trim_slopes)
            )
        n, f = len(logs[0]), len(at.k)
        rows = np.zeros((3 * n + 1, width))
        for part, (slope, sign) in enumerate(
            ((slopes[0], -1.0), (slopes[0], 1.0), (slopes[1], 1.0))
        ):
            here = slice(part * n, (part + 1) * n)
            rows[here, :f] = sign * slope
            rows[here, width - BOUNDS + part] = -sign
        rows[-1, -BOUNDS:] = -2.0, 1.0, 1.0
        last = math.log(self._problem.I_star) - excess
        return np.concatenate([-logs[0], logs[0], logs[1], [last]]), rows
