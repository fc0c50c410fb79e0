"""Tuning by SLSQP on exact gradients from several starts."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops
from flighttune.theory.indicators import indicators_batch
from flighttune.tuning.problem import TuningProblem, search_space
from flighttune.tuning.program import Objective, Program
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


def tune_by_gradient(
    problem: TuningProblem, *, starts: int = STARTS, first: FloatArray | None = None
) -> TuningResult:
    """Gains of the largest R_K, by SLSQP on exact gradients from several starts.

    The optimisation model of arXiv 2411.13140, section 4.4. The problem is not convex: that no
    feasible gains were found is no proof that none exist.

    `starts`: searches from gains drawn with the problem's seed. `first` (shape (..., m, 2 p)):
    stacked gains to start from as well, before the drawn ones; unstable ones are passed over. The
    same problem gives the same result. Infeasible and failed problems are results too. Where I_K
    does not bind, R_K is that of the slowest channel and leaves the others open: the gains are
    those of (nearly) that rate with the smallest trace of Q, the mean-square transient.
    """
    space = search_space(problem)
    k = stabilising_starts(problem, space, starts)
    if first is not None:
        first_k = first.reshape(-1, *space.base.shape)[:, space.free]
        loops = closed_loops(problem.model, space.K(first_k))
        k = np.vstack([first_k[indicators_batch(loops, scaling=problem.scaling).stable], k])
    if not len(k):
        return TuningResult(
            status="failed",
            reason="No stabilising gains were found to start from.",
            method=METHOD,
        )
    ends = searches(problem, k[:PROBES], "R_K")
    smallest, warm = None, k[:0]
    if not any(is_feasible(problem, end) for end in ends):
        smallest = smallest_radius(problem, k)
    if smallest is not None:
        warm = smallest.K[space.free][None]
        ends.append(smallest)
    if smallest is None or smallest.I_K <= problem.I_star:
        ends += searches(problem, np.vstack([warm, k[PROBES:]]), "R_K")
    feasible = [end for end in ends if is_feasible(problem, end)]
    best = max(feasible, key=lambda end: end.R_K, default=smallest)
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
        agreeing=sum(end.R_K >= (1.0 - AGREEMENT) * value for end in feasible),
        smallest_I_K=best.I_K if best and not feasible else None,
    )


def smallest_radius(problem: TuningProblem, k: FloatArray) -> Assessment | None:
    """The smallest I_K within limits and bounds from free gains k, shape (starts, f).

    The search ends when two starts agree.
    """
    best = None
    for start in k:
        (end,) = searches(problem, start[None], "I_K")
        if not (end.within_limits and end.R_K > 0.0):
            continue
        if best is not None and abs(end.I_K - best.I_K) <= AGREEMENT * best.I_K:
            return min(best, end, key=lambda gains: gains.I_K)
        if best is None or end.I_K < best.I_K:
            best = end
    return best


def _calmest_at_rate(problem: TuningProblem, best: Assessment) -> Assessment:
    """Gains with nearly the best rate and the smallest trace of Q."""
    # The optimum of R_K leaves faster channels open; a little less rate makes them definite.
    rate = (1.0 - RATE_GIVEN_UP) * best.R_K
    k = best.K[search_space(problem).free][None]
    (calmest,) = searches(problem, k, "trace", min_R_K=rate)
    kept = calmest.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return calmest if kept and is_feasible(problem, calmest) else best


def searches(
    problem: TuningProblem, k: FloatArray, objective: Objective, *, min_R_K: float = 0.0
) -> list[Assessment]:
    """Optima of an objective from each of the free gains k, shape (starts, f)."""
    task = Program([problem], objective, min_R_K=min_R_K)
    return [assessment(problem, K) for K in task.space.K(task.descend(k)[0])]
