"""Tuning by SLSQP on exact gradients from several starts, and what makes a problem infeasible."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray, check_at_least
from flighttune.control.limits import Limits
from flighttune.tuning.problem import SearchSpace, TuningProblem, search_space
from flighttune.tuning.program import Objective, Program, stabilising_starts
from flighttune.tuning.result import (
    Assessment,
    Diagnosis,
    TuningResult,
    assessment,
    is_feasible,
    result,
    why_infeasible,
)

STARTS = 4

# Starts that must all miss feasibility before the smallest I_K is looked for
PROBES = 2

AGREEMENT = 1e-4

# Share of R_K given up for a smaller trace of Q where I_K does not bind
RATE_GIVEN_UP = 1e-4


def tune_problem(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the largest R_K, or the least cost, that meet the constraints of a problem.

    `starts`: searches by the gradient method, from random starts. The status is "infeasible" or
    "failed" where there is no answer. Raises InputError if `starts` is not at least 1.
    """
    check_at_least(1, starts=starts)
    began = time.perf_counter()
    search = tune_by_gradient if problem.weights is None else tune_by_cost
    return replace(search(problem, starts=starts), wall_s=time.perf_counter() - began)


def tune_by_gradient(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the largest R_K, by SLSQP on exact gradients from several starts.

    The optimisation model of arXiv 2411.13140, section 4.4. The problem is not convex: that no
    feasible gains were found is no proof that none exist.

    `starts`: searches from gains drawn with the problem's seed. The same problem gives the same
    result. Infeasible and failed problems are results too. Where I_K does not bind, R_K is that of
    the slowest channel and leaves the others open: the gains are those of (nearly) that rate with
    the smallest trace of Q, the mean-square transient.
    """
    # SLSQP finds a local optimum of a problem that is not convex, so several starts must do: on
    # `paper` all four end within 1e-4 of R_K 0.53976, and `agreeing` tells the user how many did.
    # Two of them are enough to see whether the bound on I_K leaves any gains at all. If not, the
    # smallest I_K is searched first: it answers "how much would do", and where it is within the
    # bound it is a feasible start for the others. XX: four starts weigh time (0.4 s on
    # `paper`) against the chance to miss the best gains, which nothing here bounds.
    space = search_space(problem)
    k = stabilising_starts(problem, space, starts)
    if not len(k):
        return TuningResult(
            status="failed",
            reason="No stabilising gains were found to start from.",
            method="gradient",
            problem=problem,
        )
    ends = searches(problem, k[:PROBES], "R_K")
    smallest, warm = None, k[:0]
    if not any(is_feasible(problem, end) for end in ends):
        smallest = smallest_radius(problem, k)
    if smallest is not None:
        warm = smallest.K[space.free][None]
        ends.append(smallest)
    if smallest is None or smallest.I_K <= problem.I_star:
        others = np.vstack([warm, k[PROBES:]])
        ends += searches(problem, others, "R_K") if len(others) else []
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
        method="gradient",
        starts=len(k),
        agreeing=sum(end.R_K >= (1.0 - AGREEMENT) * value for end in feasible),
        smallest_I_K=best.I_K if best and not feasible else None,
    )


def tune_by_cost(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the least quadratic cost with an R_K of at least `R_min`, by the gradient method.

    The first search begins at the gains of the largest R_K, which are feasible if any are.
    """
    fastest = tune_by_gradient(replace(problem, weights=None, R_min=0.0), starts=starts)
    if fastest.status != "optimal" or fastest.gains is None:
        return fastest
    if fastest.R_K < problem.R_min:
        reason = (
            f"`R_min` must be at most {fastest.R_K:.6g}, the largest R_K under the other "
            f"constraints, got {problem.R_min:g}."
        )
        return replace(fastest, status="infeasible", reason=reason)
    space = search_space(problem)
    k = np.vstack([fastest.gains.K[space.free], stabilising_starts(problem, space, starts)])
    ends = searches(problem, k, "cost", min_R_K=problem.R_min)
    if not (feasible := [end for end in ends if is_feasible(problem, end)]):
        feasible = [assessment(problem, fastest.gains.K)]
    best = min(feasible, key=lambda end: end.cost)
    return result(
        problem,
        best,
        status="optimal",
        reason="",
        method="gradient",
        starts=len(k),
        agreeing=sum(end.cost <= (1.0 + AGREEMENT) * best.cost for end in feasible),
    )


def smallest_radius(problem: TuningProblem, k: FloatArray) -> Assessment | None:
    """The smallest I_K within limits and bounds from free gains k, shape (starts, f), whatever E_K.

    The search ends when two starts agree.
    """
    best, problem = None, replace(problem, E_star=math.inf)
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
    as_fast = calmest.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return calmest if as_fast and is_feasible(problem, calmest) else best


def searches(
    problem: TuningProblem, k: FloatArray, objective: Objective, *, min_R_K: float = 0.0
) -> list[Assessment]:
    """Optima of an objective from each of the free gains k, shape (starts, f)."""
    task = Program([problem], objective, min_R_K=min_R_K)
    return [assessment(problem, K) for K in task.space.K(task.descend(k)[0])]


def diagnosis(problem: TuningProblem) -> Diagnosis:
    """Distance of a problem from feasibility, and the input limit that is in the way.

    The common factor is a variable of the smooth program: its smallest value is searched for
    directly, by the gradient method, not by trial of factors.

    The problem is not convex: the diagnosis describes the best gains that were found and proves
    nothing.
    """
    space = search_space(problem)
    k = stabilising_starts(problem, space, STARTS)
    smallest = smallest_radius(problem, k)
    unlimited = replace(problem, I_star=math.inf)
    fastest = [candidate for candidate in searches(unlimited, k, "R_K") if candidate.within_limits]
    groups = tuple(dict.fromkeys(map(_group, space.names)))
    factor, at_factor = _smallest_factor(problem, groups, k)
    used = _use(space, at_factor)
    limits = [_limit_diagnosis(problem, name, k, used.get(name, math.nan)) for name in groups]
    return Diagnosis(
        smallest_I_K=smallest.I_K if smallest else math.inf,
        largest_R_K=max((candidate.R_K for candidate in fastest), default=0.0),
        common_factor=factor,
        gains=problem.gains(at_factor.K) if at_factor else None,
        binding=tuple(name for name in at_factor.active if name != "I_K") if at_factor else (),
        limits=tuple(sorted(limits, key=itemgetter("smallest_I_K_without", "factor_alone"))),
    )


def _limit_diagnosis(
    problem: TuningProblem, name: str, k: FloatArray, use: float
) -> dict[str, Any]:
    without = smallest_radius(relaxed(problem, (name,), math.inf), k)
    alone = math.inf
    if without is not None and without.I_K <= problem.I_star:
        free = search_space(problem).free
        alone, _ = _smallest_factor(problem, (name,), np.vstack([without.K[free], k]))
    return {
        "name": name,
        "factor_alone": alone,
        "smallest_I_K_without": without.I_K if without else math.inf,
        "use": use,
    }


def _smallest_factor(
    problem: TuningProblem, groups: Sequence[str], k: FloatArray
) -> tuple[float, Assessment | None]:
    """Smallest factor on some limits that is feasible, with its gains; inf if none is."""
    space = search_space(problem)
    if not groups:
        ends = [end for end in searches(problem, k, "R_K") if is_feasible(problem, end)]
        return (0.0, ends[0]) if ends else (math.inf, None)
    relaxable = np.array([_group(row) in groups for row in space.names])
    task = Program([problem], "factor", relaxable=relaxable)
    best: tuple[float, Assessment | None] = (math.inf, None)
    for gains, factor in zip(*task.descend(k), strict=True):
        wider = relaxed(problem, groups, factor)
        measured = assessment(wider, space.K(gains))
        if factor < best[0] and is_feasible(wider, measured):
            best = float(factor), measured
    return best


def relaxed(problem: TuningProblem, groups: Sequence[str], factor: float) -> TuningProblem:
    """The problem with some of its limits multiplied; inf drops a limit."""
    if problem.limits is None:
        return problem
    limits = {}
    for end in ("lower", "upper", "rate_lower", "rate_upper"):
        kind = "_rate" if end.startswith("rate") else ""
        chosen = np.array([f"{name}{kind}" in groups for name in problem.model.inputs])
        bound = getattr(problem.limits, end)
        dropped = -math.inf if end.endswith("lower") else math.inf
        limits[end] = np.where(chosen, dropped if math.isinf(factor) else factor * bound, bound)
    return replace(problem, limits=Limits(**limits))


def _use(space: SearchSpace, gains: Assessment | None) -> dict[str, float]:
    """Largest share of each limit that gains use."""
    shares: dict[str, float] = {}
    if gains is None:
        return shares
    used = space.bound - space.slack(gains.K[space.free])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(used > 0.0, used / np.maximum(space.bound, 0.0), 0.0)
    for name, value in zip(space.names, share, strict=True):
        shares[_group(name)] = max(float(value), shares.get(_group(name), 0.0))
    return shares


def _group(row: str) -> str:
    """``phi_rate`` of ``phi_rate_min``."""
    return row.removesuffix("_max").removesuffix("_min")
