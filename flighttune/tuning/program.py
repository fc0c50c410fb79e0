"""The smooth program behind every gradient search, and one SLSQP run on it.

R_K and I_K have kinks where eigenvalues of Q or singular values of A_K meet, and optima like to
sit there. So the program is over the free gains k and three more variables that bound the spectra:
``top >= log(lambda_i)``, ``bottom <= log(lambda_i)`` and ``sigma_floor <= log(sigma_i)`` for every
i. Then ``log R_K = -top`` and ``log I_K = 2 top - bottom - sigma_floor`` are linear, and only the
bounds are curved. A common factor on chosen input limits can be a variable too.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, minimize

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loops
from flighttune.theory.indicators import scaled
from flighttune.theory.sensitivity import spectra_of_checked
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.search_space import SearchSpace

Objective = Literal["R_K", "I_K", "factor", "trace"]

SLOPES = {
    "R_K": (1.0, 0.0, 0.0, 0.0),
    "I_K": (2.0, -1.0, -1.0, 0.0),
    "factor": (0.0, 0.0, 0.0, 1.0),
}
"""Of the linear objectives in (top, bottom, sigma_floor, factor)."""
ACCURACY = 1e-9
ITERATIONS = 60
RESTARTS = 2
"""Further runs from where one stopped short of an optimum: a fresh curvature often frees it."""
SMALLEST_FACTOR = 1e-6
INSIDE = 1e-8
"""Relative distance kept from every limit, so that rounding does not break it."""
UNSTABLE_LOG = 30.0
"""Stands for the logarithms of an unstable loop's spectra: worse than any stable one's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Program:
    """One objective over the gains of a problem.

    Attributes
    ----------
    problem : TuningProblem
    space : SearchSpace
        Of `problem`.
    objective : "R_K" (maximised), "I_K", "factor" or "trace" (minimised)
        The last is the trace of Q.
    radius_limited : bool
        Whether ``I_K <= I_star`` is a constraint.
    relaxable : ndarray of bool, shape (r,)
        Which limit rows the variable factor multiplies.
    least_R_K : float, 1/s
        A smaller rate is not allowed.
    """

    problem: TuningProblem
    space: SearchSpace
    objective: Objective
    radius_limited: bool
    relaxable: npt.NDArray[np.bool_]
    least_R_K: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum:
    """Where an SLSQP run stopped: free gains, factor, and whether it calls that an optimum."""

    k: FloatArray
    factor: float
    converged: bool


def program(
    problem: TuningProblem,
    space: SearchSpace,
    objective: Objective,
    *,
    relaxable: npt.NDArray[np.bool_] | None = None,
    least_R_K: float = 0.0,
) -> Program:
    """The program of `objective`; `I_star` is a constraint unless I_K itself is minimised."""
    if relaxable is None:
        relaxable = np.zeros(len(space.names), dtype=bool)
    limited = bool(np.isfinite(problem.I_star)) and objective != "I_K"
    return Program(
        problem=problem,
        space=space,
        objective=objective,
        radius_limited=limited,
        relaxable=relaxable,
        least_R_K=least_R_K,
    )


def descend(program: Program, k: FloatArray, factor: float = 1.0) -> Optimum:
    """Run SLSQP from stable free gains k, shape (f,)."""
    curve = _Constraints(program)
    size = len(k)
    logs = curve.logs(k)[0].reshape(3, -1)
    z = np.concatenate([k, [logs[0].max(), logs[1].min(), logs[2].min(), factor]])
    varies = program.objective == "factor"
    lower = np.concatenate(
        [program.space.k_min, [-np.inf] * 3, [SMALLEST_FACTOR if varies else 1.0]]
    )
    slowest = -np.log(program.least_R_K) if program.least_R_K else np.inf
    upper = [*program.space.k_max, slowest, np.inf, np.inf, np.inf if varies else 1.0]

    def run(z: FloatArray) -> OptimizeResult:
        return minimize(
            curve.goal,
            z,
            jac=True,
            method="SLSQP",
            bounds=np.column_stack([lower, upper]),
            constraints={"type": "ineq", "fun": curve.values, "jac": curve.slopes},
            options={"maxiter": ITERATIONS, "ftol": ACCURACY},
        )

    found = run(z)
    for _ in range(RESTARTS):
        if not found.success:
            found = run(found.x)
    k = np.clip(found.x[:size], program.space.k_min, program.space.k_max)
    return Optimum(k=k, factor=float(found.x[-1]), converged=bool(found.success))


class _Constraints:
    """Values and slopes of ``c(z) >= 0``, z = (k, top, bottom, sigma_floor, factor).

    The spectra of the last k are remembered: SLSQP asks for values and slopes in turn.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._k: FloatArray = np.empty(0)
        self._logs: tuple[FloatArray, FloatArray] = (np.empty(0), np.empty(0))
        space, scaling = program.space, np.asarray(program.problem.scaling)
        k = np.vstack([np.zeros(len(space.k_min)), np.eye(len(space.k_min))])
        loops = scaled(closed_loops(program.problem.model, space.K(k)), scaling)
        self._loop, self._in_k = loops[0], (loops[1:] - loops[0]).reshape(len(k) - 1, -1)
        bound = space.bound - INSIDE * np.abs(space.bound)
        self._fixed_room = np.where(program.relaxable, 0.0, bound) - space.offset
        self._relaxed_room = np.where(program.relaxable, bound, 0.0)

    def goal(self, z: FloatArray) -> tuple[float, FloatArray]:
        """What is minimised, and its slope."""
        slope = np.zeros(len(z))
        if self._program.objective == "trace":
            logs, slopes = self.logs(z[:-4])
            weights = np.exp(logs[: len(self._loop)])
            slope[:-4] = weights @ slopes[: len(weights)] / weights.sum()
            return float(np.log(weights.sum())), slope
        slope[-4:] = SLOPES[self._program.objective]
        return float(slope @ z), slope

    def values(self, z: FloatArray) -> FloatArray:
        """``c(z)``, nowhere below zero where z is feasible."""
        k, (top, bottom, sigma_floor, factor) = z[:-4], z[-4:]
        largest, smallest, sigma = self.logs(k)[0].reshape(3, -1)
        room = self._fixed_room + factor * self._relaxed_room - self._program.space.G @ k
        parts = [top - largest, smallest - bottom, sigma - sigma_floor, room]
        if self._program.radius_limited:
            log_I_K = 2.0 * top - bottom - sigma_floor
            parts.append(np.array([self._log_I_star - log_I_K]))
        return np.concatenate(parts)

    def slopes(self, z: FloatArray) -> FloatArray:
        """Jacobian of `values`."""
        k, G = z[:-4], self._program.space.G
        slopes = self.logs(k)[1]
        n = len(slopes) // 3
        signs = np.repeat([-1.0, 1.0, 1.0], n)
        curved = np.hstack([signs[:, None] * slopes, np.zeros((3 * n, 4))])
        for part in range(3):
            curved[part * n : (part + 1) * n, len(k) + part] = -signs[part * n]
        straight = np.hstack([-G, np.zeros((len(G), 3)), self._relaxed_room[:, None]])
        if not self._program.radius_limited:
            return np.vstack([curved, straight])
        radius = np.concatenate([np.zeros(len(k)), [-2.0, 1.0, 1.0, 0.0]])
        return np.vstack([curved, straight, radius])

    @property
    def _log_I_star(self) -> float:
        return float(np.log(self._program.problem.I_star)) - INSIDE

    def logs(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """log(lambda), log(lambda), log(sigma), shape (3 n), and their slopes in k, (3 n, f)."""
        if not np.array_equal(k, self._k):
            self._k, self._logs = k.copy(), self._spectra(k)
        return self._logs

    def _spectra(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        n = len(self._loop)
        found = spectra_of_checked(self._loop + (k @ self._in_k).reshape(n, n))
        if found is None:
            logs = np.repeat([UNSTABLE_LOG, -UNSTABLE_LOG, -UNSTABLE_LOG], n)
            return logs, np.zeros((len(logs), len(k)))
        values = np.concatenate([found.eigenvalues, found.singular_values])
        slopes = np.concatenate([found.eigenvalue_gradients, found.singular_value_gradients])
        logs = np.log(values)
        log_slopes = slopes.reshape(2 * n, -1) @ self._in_k.T / values[:, None]
        return (
            np.concatenate([logs[:n], logs]),
            np.concatenate([log_slopes[:n], log_slopes]),
        )
