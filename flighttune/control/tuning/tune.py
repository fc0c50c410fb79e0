"""Tuning by SLSQP on exact gradients from several starts; infeasible problems; frontiers."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from flighttune.base.arrays import FloatArray, check_at_least
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.program import Objective, Program, stabilising_starts
from flighttune.control.tuning.result import Assessment, Diagnosis, TuningResult, assessment, result

STARTS = 4

# Number of infeasible starts before the smallest I_K is sought
PROBES = 2

AGREEMENT = 1e-4

# Share of R_K traded for a smaller trace of Q if I_K does not bind
RATE_GIVEN_UP = 1e-4


def tune_problem(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the largest R_K, or the smallest cost, under the constraints of a problem."""
    check_at_least(1, starts=starts)
    began = time.perf_counter()
    search = tune_by_gradient if problem.weights is None else tune_by_cost
    return replace(search(problem, starts=starts), wall_s=time.perf_counter() - began)


def tune_by_gradient(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the largest R_K, by SLSQP on exact gradients from several starts.

    The optimisation model of arXiv 2411.13140, section 4.4. The problem is not convex, so a failed
    search does not prove infeasibility. If I_K does not bind, the slowest channel alone sets R_K.
    The gains then have nearly this rate and the smallest trace of Q, the mean-square transient.
    """
    # SLSQP finds a local optimum of a problem that is not convex, hence several starts. On `paper`
    # all four end within 1e-4 of R_K 0.53976, and `agreeing` tells the user how many did. Two
    # starts show whether the bound on I_K leaves any gains. If not, the smallest I_K is sought
    # first: it tells which bound would do, and if it is within the bound it is a feasible start for
    # the others. Not known: how often four starts, which take 0.4 s on `paper`, miss the best
    # gains.
    k = stabilising_starts(problem, starts)
    if not len(k):
        return TuningResult(
            status="failed",
            reason="No stabilising gains were found to start from.",
            method="gradient",
            problem=problem,
        )
    ends = searches(problem, k[:PROBES], "R_K")
    smallest, warm = None, k[:0]
    if not any(end.meets(problem) for end in ends):
        smallest = smallest_radius(problem, k)
    if smallest is not None:
        warm = smallest.K[problem.free][None]
        ends.append(smallest)
    if smallest is None or smallest.I_K <= problem.I_star:
        others = np.vstack([warm, k[PROBES:]])
        ends += searches(problem, others, "R_K") if len(others) else []
    feasible = [end for end in ends if end.meets(problem)]
    best = max(feasible, key=lambda end: end.R_K, default=smallest)
    value = best.R_K if best else 0.0
    reason = "No stabilising gains were found within the limits."
    if best:
        reason = "" if feasible else best.why_not(problem)
    if feasible and best is not None and "I_K" not in best.active:
        best = _calmest_at_rate(problem, best)
    return result(
        problem,
        best,
        status="optimal" if feasible else "infeasible",
        reason=reason,
        method="gradient",
        starts=len(k),
        agreeing=sum(end.R_K >= (1.0 - AGREEMENT) * value for end in feasible),
        smallest_I_K=best.I_K if best and not feasible else None,
    )


def tune_by_cost(problem: TuningProblem, *, starts: int = STARTS) -> TuningResult:
    """Gains of the smallest quadratic cost with an R_K of at least `R_min`, by gradients."""
    fastest = tune_by_gradient(replace(problem, weights=None, R_min=0.0), starts=starts)
    if fastest.status != "optimal" or fastest.gains is None:
        return fastest
    if fastest.R_K < problem.R_min:
        reason = (
            f"`R_min` must be at most {fastest.R_K:.6g}, the largest R_K under the other "
            f"constraints, got {problem.R_min:g}."
        )
        return replace(fastest, status="infeasible", reason=reason)
    # The first search begins at the gains of the largest R_K, which are feasible if any are.
    k = np.vstack([fastest.gains.K[problem.free], stabilising_starts(problem, starts)])
    ends = searches(problem, k, "cost", min_R_K=problem.R_min)
    if not (feasible := [end for end in ends if end.meets(problem)]):
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
    """The smallest I_K within limits and bounds, for any E_K, from free gains k, (starts, f)."""
    best, problem = None, replace(problem, E_star=math.inf)
    for start in k:
        (end,) = searches(problem, start[None], "I_K")
        if not (end.within_limits and end.R_K > 0.0):
            continue
        agree = best is not None and abs(end.I_K - best.I_K) <= AGREEMENT * best.I_K
        if best is None or end.I_K < best.I_K:
            best = end
        if agree:
            break
    return best


def _calmest_at_rate(problem: TuningProblem, best: Assessment) -> Assessment:
    """Gains with nearly the best rate and the smallest trace of Q."""
    # The optimum of R_K leaves faster channels undetermined; a slightly smaller rate determines
    # them.
    rate, k = (1.0 - RATE_GIVEN_UP) * best.R_K, best.K[problem.free][None]
    (calmest,) = searches(problem, k, "trace", min_R_K=rate)
    as_fast = calmest.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return calmest if as_fast and calmest.meets(problem) else best


def searches(
    problem: TuningProblem, k: FloatArray, objective: Objective, *, min_R_K: float = 0.0
) -> list[Assessment]:
    """Optima of an objective from each of the free gains k, shape (starts, f)."""
    task = Program([problem], objective, min_R_K=min_R_K)
    return [assessment(problem, K) for K in problem.K(task.descend(k)[0])]


def diagnosis(problem: TuningProblem) -> Diagnosis:
    """Distance of a problem from feasibility, and the input limit that prevents it."""
    k = stabilising_starts(problem, STARTS)
    smallest = smallest_radius(problem, k)
    unlimited = replace(problem, I_star=math.inf)
    fastest = [candidate for candidate in searches(unlimited, k, "R_K") if candidate.within_limits]
    names, *_, bound = problem.limit_rows
    limit_of_row = [_limit(row) for row in names]
    groups = tuple(dict.fromkeys(limit_of_row))
    # The problem is not convex: the diagnosis describes the best gains found and is no proof.
    # The common factor is a variable of the smooth program.
    factor, at_factor = _smallest_factor(problem, groups, k)
    share = np.full(len(names), math.nan)  # used share of each limit by the gains at the factor
    if at_factor is not None:
        used = bound - problem.slack(at_factor.K[problem.free])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(used > 0.0, used / np.maximum(bound, 0.0), 0.0)
    limits = []
    for name in groups:
        without, alone = smallest_radius(relaxed(problem, (name,), math.inf), k), math.inf
        if without is not None and without.I_K <= problem.I_star:
            alone, _ = _smallest_factor(problem, (name,), np.vstack([without.K[problem.free], k]))
        limit = {
            "name": name,
            "factor_alone": alone,
            "smallest_I_K_without": without.I_K if without else math.inf,
            "use": float(share[[of_row == name for of_row in limit_of_row]].max()),
        }
        limits.append(limit)
    return Diagnosis(
        smallest_I_K=smallest.I_K if smallest else math.inf,
        largest_R_K=max((candidate.R_K for candidate in fastest), default=0.0),
        common_factor=factor,
        gains=problem.gains(at_factor.K) if at_factor else None,
        binding=tuple(name for name in at_factor.active if name != "I_K") if at_factor else (),
        limits=tuple(sorted(limits, key=itemgetter("smallest_I_K_without", "factor_alone"))),
    )


def _smallest_factor(
    problem: TuningProblem, groups: Sequence[str], k: FloatArray
) -> tuple[float, Assessment | None]:
    """Smallest feasible factor on some limits, with its gains; inf if no factor is feasible."""
    if not groups:
        ends = [end for end in searches(problem, k, "R_K") if end.meets(problem)]
        return (0.0, ends[0]) if ends else (math.inf, None)
    relaxable = np.array([_limit(row) in groups for row in problem.limit_rows.names])
    task = Program([problem], "factor", relaxable=relaxable)
    best: tuple[float, Assessment | None] = (math.inf, None)
    for gains, factor in zip(*task.descend(k), strict=True):
        wider = relaxed(problem, groups, factor)
        measured = assessment(wider, problem.K(gains))
        if factor < best[0] and measured.meets(wider):
            best = float(factor), measured
    return best


def relaxed(problem: TuningProblem, groups: Sequence[str], factor: float) -> TuningProblem:
    """The problem with some of its limits multiplied; inf drops a limit."""
    if problem.limits is None:
        return problem
    limits = {}
    for end, bound in asdict(problem.limits).items():
        kind = "_rate" if end.startswith("rate") else ""
        chosen = np.array([f"{name}{kind}" in groups for name in problem.model.inputs])
        dropped = -math.inf if end.endswith("lower") else math.inf
        limits[end] = np.where(chosen, dropped if math.isinf(factor) else factor * bound, bound)
    return replace(problem, limits=Limits(**limits))


def _limit(row: str) -> str:
    """``phi_rate`` of ``phi_rate_min``."""
    return row.removesuffix("_max").removesuffix("_min")


if TYPE_CHECKING:
    import pandas as pd

POINTS = 25
WIDEST = 3.0


def frontier(
    problem: TuningProblem,
    *,
    points: int = POINTS,
    marked: Mapping[str, PIGains] | None = None,
    starts: int = 1,
) -> "pd.DataFrame":
    """The largest R_K for every I_K, and where given gains lie.

    The `I_star` of the problem is not used. `points`: at least 2, from the smallest I_K, where they
    are closest, to `WIDEST` times it or to the largest I_K of the gains `marked`. `starts`:
    searches at each point from random gains, besides the search from the gains of the smallest I_K.

    Returns a row for each point and marked set: ``name`` (``frontier`` or the mark), ``I_star``
    (nan for marks), ``I_K``, ``R_K``, ``spectral_abscissa``, ``E_K``, ``within_limits``, ``active``
    (names, separated by spaces) and each gain, ``K_P[phi,chi]`` and so on. R_K never falls along
    the frontier. Without stable gains within the limits, only the marks have rows. Raises
    InputError if `points` is less than 2.
    """
    import pandas as pd

    check_at_least(2, points=points)
    marks = {name: assessment(problem, gains.K) for name, gains in (marked or {}).items()}
    rows = [_row(problem, name, math.nan, measured) for name, measured in marks.items()]
    k = stabilising_starts(problem, max(STARTS, starts))
    if (smallest := smallest_radius(problem, k)) is None:
        return pd.DataFrame(rows)
    finite = [measured.I_K for measured in marks.values() if math.isfinite(measured.I_K)]
    I_max = max([WIDEST * smallest.I_K, *finite])
    growth = np.linspace(0.0, 1.0, points) ** 2 * math.log(I_max / smallest.I_K)
    I_star = smallest.I_K * np.exp(growth)
    # At the smallest I_K no search is needed.
    best, along = smallest, [_row(problem, "frontier", smallest.I_K, smallest)]
    first = np.vstack([smallest.K[problem.free], k[:starts]])
    task = Program([replace(problem, I_star=I_star[-1])], "R_K")
    ends, _ = task.descend(np.tile(first, (points - 1, 1)), np.repeat(I_star[1:], len(first)))
    ends = ends.reshape(points - 1, len(first), -1)
    for limit, K in zip(I_star[1:], problem.K(ends), strict=True):
        at_limit = replace(problem, I_star=limit)
        candidates = [best, *(assessment(at_limit, gains) for gains in K)]
        best = max(
            (candidate for candidate in candidates if candidate.meets(at_limit)),
            key=lambda candidate: candidate.R_K,
        )
        along.append(_row(problem, "frontier", limit, best))
    return pd.DataFrame(along + rows)


def _row(
    problem: TuningProblem, name: str, I_star: float, measured: Assessment
) -> dict[str, object]:
    figures = ("I_K", "E_K", "R_K", "spectral_abscissa", "within_limits")
    return {
        "name": name,
        "I_star": I_star,
        **{figure: getattr(measured, figure) for figure in figures},
        "active": " ".join(name for name in measured.active if name != "I_K"),
        **dict(zip(problem.gain_names.flat, measured.K.flat, strict=True)),
    }
