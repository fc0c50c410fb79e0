"""Tuning by SLSQP on exact gradients from several starts."""

import time
from collections.abc import Iterable

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loops
from flighttune.theory.indicators import indicators_batch
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.program import Objective, descend, program
from flighttune.tuning.result import (
    Assessment,
    TuningResult,
    assessment,
    is_feasible,
    result,
    why_infeasible,
)
from flighttune.tuning.search_space import search_space
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
    feasible gains were found is no proof that there are none.
    """
    began = time.perf_counter()
    space = search_space(problem)
    k = stabilising_starts(problem, space, starts)
    if first is not None:
        given = first.reshape(-1, *space.base.shape)[:, space.free]
        loops = closed_loops(problem.model, space.K(given))
        k = np.vstack([given[indicators_batch(loops, scaling=problem.scaling).stable], k])
    if not len(k):
        return result(
            problem, None, status="failed", reason="No stabilising gains were found to start from.",
            method=METHOD, starts=0, agreeing=0, wall_s=time.perf_counter() - began,
        )  # fmt: skip
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
    """The smallest I_K found within limits and bounds from free gains k, shape (starts, f)."""
    found = searches(problem, k, "I_K")
    kept = [one for one in found if one.within_limits and one.R_K > 0.0]
    return min(kept, key=lambda one: one.I_K, default=None)


def _calmest_at_rate(problem: TuningProblem, best: Assessment) -> Assessment:
    """Of the gains with nearly the best rate, those with the smallest trace of Q."""
    space = search_space(problem)
    task = program(problem, space, "trace", least_R_K=(1.0 - RATE_GIVEN_UP) * best.R_K)
    found = assessment(problem, space.K(descend(task, best.K[space.free]).k))
    kept = found.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return found if kept and is_feasible(problem, found) else best


def searches(
    problem: TuningProblem, k: Iterable[FloatArray], objective: Objective
) -> list[Assessment]:
    """What SLSQP reaches for an objective from each of the free gains k, shape (starts, f)."""
    space = search_space(problem)
    task = program(problem, space, objective)
    return [assessment(problem, space.K(descend(task, one).k)) for one in k]
