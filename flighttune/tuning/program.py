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
from flighttune.theory.sensitivity import spectra
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.search_space import SearchSpace

Objective = Literal["R_K", "I_K", "factor"]

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
    objective : "R_K" (maximised), "I_K" or "factor" (minimised)
    radius_limited : bool
        Whether ``I_K <= I_star`` is a constraint.
    relaxable : ndarray of bool, shape (r,)
        Which limit rows the variable factor multiplies.
    """

    problem: TuningProblem
    space: SearchSpace
    objective: Objective
    radius_limited: bool
    relaxable: npt.NDArray[np.bool_]


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
    )


def descend(program: Program, k: FloatArray, factor: float = 1.0) -> Optimum:
    """Run SLSQP from stable free gains k, shape (f,)."""
    curve = _Constraints(program)
    size = len(k)
    logs = curve.logs(k)[0].reshape(3, -1)
    z = np.concatenate([k, [logs[0].max(), logs[1].min(), logs[2].min(), factor]])
    slope = np.zeros(size + 4)
    slope[size:] = {
        "R_K": (1.0, 0.0, 0.0, 0.0),
        "I_K": (2.0, -1.0, -1.0, 0.0),
        "factor": (0.0, 0.0, 0.0, 1.0),
    }[program.objective]
    varies = program.objective == "factor"
    lower = np.concatenate(
        [program.space.k_min, [-np.inf] * 3, [SMALLEST_FACTOR if varies else 1.0]]
    )
    upper = np.concatenate([program.space.k_max, [np.inf] * 3, [np.inf if varies else 1.0]])

    def run(z: FloatArray) -> OptimizeResult:
        return minimize(
            lambda z: float(slope @ z),
            z,
            jac=lambda _: slope,
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
        self._model = program.problem.model
        self._k: FloatArray = np.empty(0)
        self._logs: tuple[FloatArray, FloatArray] = (np.empty(0), np.empty(0))
        space = program.space
        bound = space.bound - INSIDE * np.abs(space.bound)
        self._fixed_room = np.where(program.relaxable, 0.0, bound) - space.offset
        self._relaxed_room = np.where(program.relaxable, bound, 0.0)

    def values(self, z: FloatArray) -> FloatArray:
        k, (top, bottom, sigma_floor, factor) = z[:-4], z[-4:]
        largest, smallest, sigma = self.logs(k)[0].reshape(3, -1)
        room = self._fixed_room + factor * self._relaxed_room - self._program.space.G @ k
        parts = [top - largest, smallest - bottom, sigma - sigma_floor, room]
        if self._program.radius_limited:
            log_I_K = 2.0 * top - bottom - sigma_floor
            parts.append(np.array([self._log_I_star - log_I_K]))
        return np.concatenate(parts)

    def slopes(self, z: FloatArray) -> FloatArray:
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
        program = self._program
        A_K = closed_loops(self._model, program.space.K(k))
        found = spectra(A_K, scaling=program.problem.scaling)
        if found is None:
            logs = np.repeat([UNSTABLE_LOG, -UNSTABLE_LOG, -UNSTABLE_LOG], len(A_K))
            return logs, np.zeros((len(logs), len(k)))
        eigen = found.eigenvalue_gradients / found.eigenvalues[:, None, None]
        singular = found.singular_value_gradients / found.singular_values[:, None, None]
        eigen, singular = self._in_gains(eigen), self._in_gains(singular)
        log_eigen, log_singular = np.log(found.eigenvalues), np.log(found.singular_values)
        return (
            np.concatenate([log_eigen, log_eigen, log_singular]),
            np.vstack([eigen, eigen, singular]),
        )

    def _in_gains(self, gradient: FloatArray) -> FloatArray:
        """Gradients in A_K, shape (..., n + p, n + p), to those in k, shape (..., f)."""
        n, _, _ = self._model.shape
        B, C = self._model.B, self._model.C
        in_K_P = B.T @ gradient[..., :n, :n] @ C.T
        in_K_I = B.T @ gradient[..., :n, n:]
        return np.concatenate([in_K_P, in_K_I], axis=-1)[..., self._program.space.free]
