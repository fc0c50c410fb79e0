"""Why a problem is infeasible, and what would have to give."""

import math
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.tuning.problem import SearchSpace, TuningProblem, search_space
from flighttune.tuning.program import Program, stabilising_starts
from flighttune.tuning.result import Assessment, Diagnosis, assessment, is_feasible
from flighttune.tuning.tune import STARTS, searches, smallest_radius


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
