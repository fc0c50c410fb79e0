"""Tuning by SLSQP on exact gradients from several starts."""

import time
from collections.abc import Iterable
from typing import Literal

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops
from flighttune.theory.indicators import indicators_batch, scaled, spectra_of_checked
from flighttune.tuning.problem import TuningProblem, search_space
from flighttune.tuning.result import (
    Assessment,
    TuningResult,
    assessment,
    is_feasible,
    result,
    why_infeasible,
)
from flighttune.tuning.starts import stabilising_starts

STARTS = 4
PROBES = 2
"""Starts that must all miss feasibility before the smallest I_K is looked for."""
AGREEMENT = 1e-4
RATE_GIVEN_UP = 1e-4
"""Share of R_K given up for a smaller trace of Q where I_K does not bind."""
METHOD = "gradient"

Objective = Literal["R_K", "I_K", "factor", "trace"]

SLOPES = {
    "R_K": (1.0, 0.0, 0.0, 0.0),
    "I_K": (2.0, -1.0, -1.0, 0.0),
    "factor": (0.0, 0.0, 0.0, 1.0),
}
"""Of the linear objectives in (top, bottom, sigma_floor, factor)."""
ACCURACY = 1e-9
ITERATIONS = 60
RUNS = 3
"""SLSQP is started again where it stopped short of an optimum: a fresh curvature often helps."""
SMALLEST_FACTOR = 1e-6
INSIDE = 1e-8
"""Relative distance kept from every limit: SLSQP meets constraints to about 1e-9, and a result must
not break a limit by its rounding."""
UNSTABLE_LOG = 30.0
"""Stands for the logarithms of an unstable loop's spectra: worse than any stable one's."""


def tune_by_gradient(
    problem: TuningProblem, *, starts: int = STARTS, first: FloatArray | None = None
) -> TuningResult:
    """Gains of the largest R_K, by SLSQP with exact gradients from several starts.

    Parameters
    ----------
    problem : TuningProblem
    starts : int
        Searches from gains drawn with the problem's seed.
    first : ndarray, shape (..., m, 2 p), optional
        Stacked gains to start from as well, before the drawn ones; unstable ones are passed over.

    Returns
    -------
    TuningResult
        The same for the same problem. Infeasible and failed problems are results too. Where I_K
        does not bind, R_K is that of the slowest channel and leaves the others open: the gains
        are those of (nearly) that rate with the smallest trace of Q, the mean-square transient.

    Notes
    -----
    The optimisation model of arXiv 2411.13140, section 4.4. The problem is not convex: that no
    feasible gains were found is no proof that none exist.
    """
    began = time.perf_counter()
    space = search_space(problem)
    k = stabilising_starts(problem, space, starts)
    if first is not None:
        given = first.reshape(-1, *space.base.shape)[:, space.free]
        loops = closed_loops(problem.model, space.K(given))
        k = np.vstack([given[indicators_batch(loops, scaling=problem.scaling).stable], k])
    if not len(k):
        return TuningResult(
            status="failed",
            reason="No stabilising gains were found to start from.",
            method=METHOD,
            wall_s=time.perf_counter() - began,
        )
    found = searches(problem, k[:PROBES], "R_K")
    smallest = None
    if not any(is_feasible(problem, one) for one in found):
        smallest = smallest_radius(problem, k)
    if smallest is None or smallest.I_K <= problem.I_star:
        warm = k[:0] if smallest is None else smallest.K[space.free][None]
        found += searches(problem, np.vstack([warm, k[PROBES:]]), "R_K")
        found += [smallest] if smallest is not None else []
    feasible = [one for one in found if is_feasible(problem, one)]
    best = max(feasible, key=lambda one: one.R_K, default=smallest)
    value = best.R_K if best else 0.0
    if feasible and best is not None and "I_K" not in best.active:
        best = _calmest_at_rate(problem, best)
    return result(
        problem,
        best,
        status="optimal" if feasible else "infeasible",
        reason="" if feasible else why_infeasible(problem, best),
        method=METHOD,
        starts=len(k),
        agreeing=sum(one.R_K >= (1.0 - AGREEMENT) * value for one in feasible),
        wall_s=time.perf_counter() - began,
        smallest_I_K=best.I_K if best and not feasible else None,
    )


def smallest_radius(problem: TuningProblem, k: FloatArray) -> Assessment | None:
    """The smallest I_K found within limits and bounds from free gains k, shape (starts, f).

    The search ends when it has been reached twice.
    """
    best = None
    for start in k:
        (found,) = searches(problem, [start], "I_K")
        if not (found.within_limits and found.R_K > 0.0):
            continue
        if best is not None and abs(found.I_K - best.I_K) <= AGREEMENT * best.I_K:
            return min(best, found, key=lambda one: one.I_K)
        if best is None or found.I_K < best.I_K:
            best = found
    return best


def _calmest_at_rate(problem: TuningProblem, best: Assessment) -> Assessment:
    """Of the gains with nearly the best rate, those with the smallest trace of Q."""
    task = Program(problem, "trace", min_R_K=(1.0 - RATE_GIVEN_UP) * best.R_K)
    k, _ = task.descend(best.K[task.space.free])
    found = assessment(problem, task.space.K(k))
    kept = found.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return found if kept and is_feasible(problem, found) else best


def searches(
    problem: TuningProblem, k: Iterable[FloatArray], objective: Objective
) -> list[Assessment]:
    """What SLSQP reaches for an objective from each of the free gains k, shape (starts, f)."""
    task = Program(problem, objective)
    return [assessment(problem, task.space.K(task.descend(start)[0])) for start in k]


class Program:
    """One objective over the gains of a problem, as a smooth program for SLSQP.

    R_K and I_K have kinks where eigenvalues of Q or singular values of A_K meet, and optima like to
    lie there. So the variables are z = (k, top, bottom, sigma_floor, factor): the free gains and
    bounds on the spectra, ``top >= log(lambda_i)``, ``bottom <= log(lambda_i)`` and ``sigma_floor
    <= log(sigma_i)`` for every i. Then ``log R_K = -top`` and ``log I_K = 2 top - bottom -
    sigma_floor`` are linear, and only the bounds are curved. The factor multiplies chosen limits.

    Parameters
    ----------
    problem : TuningProblem
        ``I_K <= I_star`` is a constraint unless I_K itself is minimised.
    objective : "R_K" (maximised), "I_K", "factor" or "trace" (minimised)
        The last is the trace of Q.
    relaxable : ndarray of bool, shape (r,), optional
        Which limit rows the factor multiplies; none by default.
    min_R_K : float, 1/s
        A smaller rate is not allowed.
    """

    def __init__(
        self,
        problem: TuningProblem,
        objective: Objective,
        *,
        relaxable: npt.NDArray[np.bool_] | None = None,
        min_R_K: float = 0.0,
    ) -> None:
        self._objective, self._min_R_K = objective, min_R_K
        self.space = space = search_space(problem)
        self._log_I_star = np.inf if objective == "I_K" else np.log(problem.I_star) - INSIDE
        f = len(space.k_min)
        loops = closed_loops(problem.model, space.K(np.vstack([np.zeros(f), np.eye(f)])))
        loops = scaled(loops, np.asarray(problem.scaling))  # affine in the free gains
        self._loop, self._in_k = loops[0], (loops[1:] - loops[0]).reshape(f, loops[0].size)
        bound = space.bound - INSIDE * np.abs(space.bound)
        relaxable = np.zeros(len(bound), dtype=bool) if relaxable is None else relaxable
        self._fixed_slack = np.where(relaxable, 0.0, bound) - space.offset
        self._relaxed_slack = np.where(relaxable, bound, 0.0)
        # the spectra of the last k: SLSQP asks for values and slopes in turn
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def descend(self, k: FloatArray) -> tuple[FloatArray, float]:
        """Free gains and factor at which SLSQP stops, from stable free gains k, shape (f,)."""
        from scipy.optimize import minimize

        largest, smallest, sigma = self._logs(k)[0].reshape(3, -1)
        z = np.concatenate([k, [largest.max(), smallest.min(), sigma.min(), 1.0]])
        varies = self._objective == "factor"
        slowest = -np.log(self._min_R_K) if self._min_R_K else np.inf
        lower = [*self.space.k_min, *[-np.inf] * 3, SMALLEST_FACTOR if varies else 1.0]
        upper = [*self.space.k_max, slowest, np.inf, np.inf, np.inf if varies else 1.0]
        for _ in range(RUNS):
            found = minimize(
                self.goal,
                z,
                jac=True,
                method="SLSQP",
                bounds=np.column_stack([lower, upper]),
                constraints={"type": "ineq", "fun": self.values, "jac": self.slopes},
                options={"maxiter": ITERATIONS, "ftol": ACCURACY},
            )
            z = found.x
            if found.success:
                break
        return np.clip(z[: len(k)], self.space.k_min, self.space.k_max), float(z[-1])

    def goal(self, z: FloatArray) -> tuple[float, FloatArray]:
        """What is minimised, and its slope."""
        slope = np.zeros(len(z))
        if self._objective == "trace":
            logs, slopes = self._logs(z[:-4])
            weights = np.exp(logs[: len(self._loop)])
            slope[:-4] = weights @ slopes[: len(weights)] / weights.sum()
            return float(np.log(weights.sum())), slope
        slope[-4:] = SLOPES[self._objective]
        return float(slope @ z), slope

    def values(self, z: FloatArray) -> FloatArray:
        """``c(z)``, nowhere below zero where z is feasible."""
        k, (top, bottom, sigma_floor, factor) = z[:-4], z[-4:]
        largest, smallest, sigma = self._logs(k)[0].reshape(3, -1)
        slack = self._fixed_slack + factor * self._relaxed_slack - self.space.G @ k
        parts = [top - largest, smallest - bottom, sigma - sigma_floor, slack]
        if np.isfinite(self._log_I_star):
            parts.append(np.array([self._log_I_star - (2.0 * top - bottom - sigma_floor)]))
        return np.concatenate(parts)

    def slopes(self, z: FloatArray) -> FloatArray:
        """Jacobian of `values`."""
        k, G = z[:-4], self.space.G
        slopes = self._logs(k)[1]
        n = len(slopes) // 3
        signs = np.repeat([-1.0, 1.0, 1.0], n)
        curved = np.hstack([signs[:, None] * slopes, np.zeros((3 * n, 4))])
        for part in range(3):
            curved[part * n : (part + 1) * n, len(k) + part] = -signs[part * n]
        straight = np.hstack([-G, np.zeros((len(G), 3)), self._relaxed_slack[:, None]])
        if not np.isfinite(self._log_I_star):
            return np.vstack([curved, straight])
        radius = np.concatenate([np.zeros(len(k)), [-2.0, 1.0, 1.0, 0.0]])
        return np.vstack([curved, straight, radius])

    def _logs(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """log(lambda), log(lambda), log(sigma), shape (3 n,), and their slopes in k, (3 n, f)."""
        if self._last is None or not np.array_equal(k, self._last[0]):
            self._last = (k.copy(), *self._spectra(k))
        return self._last[1:]

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
        return np.concatenate([logs[:n], logs]), np.concatenate([log_slopes[:n], log_slopes])
