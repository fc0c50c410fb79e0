"""Tuning by SLSQP on exact gradients, from a convex start, and by differential evolution.

The convex start is a semidefinite program in W = Q^-1 and Y = K W. For feedback of the whole state
s the condition ``A_K' Q + Q A_K + I <= 0`` is linear in (W, Y) after multiplication by W from both
sides, and ``lambda_max(Q) <= 1/R`` is ``W >= R I``. So the largest R_K is a convex problem in the
gains as long as I_K, input limits and structure are left out; a bound on the gains,
``K W K' <= size^2 I``, keeps it finite. Its solutions for several sizes start the
gradient method, which restores what was left out.
"""

import math
import time
from dataclasses import replace
from typing import get_args

import numpy as np

from flighttune.arrays import FloatArray, check_at_least
from flighttune.control.linear_model import LinearModel, closed_loops, velocity_form
from flighttune.errors import InputError
from flighttune.theory.indicators import IndicatorArrays, indicators_batch, scaled
from flighttune.theory.lmi import blocks, largest, solve, unknown
from flighttune.tuning.problem import Method, TuningProblem, search_space
from flighttune.tuning.program import Objective, Program, stabilising_starts
from flighttune.tuning.result import (
    Assessment,
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

# Bounds on the gains of the convex starts
SIZES = (0.5, 1.0, 2.0, 4.0, 8.0)

# Box of the search where the problem has no tighter one; evolution needs a small one
EVOLVED_GAIN = 10.0
GENERATIONS = 1000
POPULATION = 15

# Cost of an unstable loop, besides its spectral abscissa: more than that of any stable one
UNSTABLE = 1e6


def tune(
    problem: TuningProblem, method: Method = "gradient", *, starts: int = STARTS
) -> TuningResult:
    """Gains of the largest R_K, or the least cost, that meet the constraints of a problem.

    Parameters
    ----------
    problem : TuningProblem
    method : "gradient", "genetic" or "convex"
        Exact gradients from several random starts; differential evolution, as in
        the paper; or the gradient method from the solutions of a semidefinite program.
    starts : int
        Searches of the gradient method.

    Returns
    -------
    TuningResult
        The status is "infeasible" or "failed" where there is no answer: "failed" where no gains to
        start from stabilise the loop, with "convex" none of the semidefinite program.

    Raises
    ------
    InputError
        If the method is unknown or `starts` is not at least 1.

    Examples
    --------
    >>> result = ft.tune(ft.tuning_problem(ft.load_scenario("paper")))
    >>> result.status, round(result.R_K, 4)
    ('optimal', 0.5398)
    """
    if method not in get_args(Method):
        raise InputError(f"`method` must be one of {get_args(Method)}, got {method!r}.")
    check_at_least(1, starts=starts)
    if problem.weights is not None and method != "gradient":
        raise InputError(f"`method` must be gradient with `weights`, got {method!r}.")
    began = time.perf_counter()
    if problem.weights is not None:
        result = tune_by_cost(problem, starts=starts)
    elif method == "genetic":
        result = tune_by_evolution(problem)
    elif method == "convex":
        first = convex_starts(problem)
        result = replace(tune_by_gradient(problem, starts=0, first=first), method="convex")
    else:
        result = tune_by_gradient(problem, starts=starts)
    return replace(result, wall_s=time.perf_counter() - began)


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
            method="gradient",
        )
    ends = searches(problem, k[:PROBES], "R_K")
    smallest, warm = None, k[:0]
    if not any(is_feasible(problem, end) for end in ends):
        smallest = smallest_radius(problem, k)
    if smallest is not None:
        warm = smallest.K[space.free][None]
        ends.append(smallest)
    if smallest is None or smallest.I_K <= problem.I_star:
        rest = np.vstack([warm, k[PROBES:]])
        ends += searches(problem, rest, "R_K") if len(rest) else []
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
    feasible = [end for end in ends if is_feasible(problem, end)]
    if not feasible:
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
    kept = calmest.R_K >= (1.0 - 2.0 * RATE_GIVEN_UP) * best.R_K
    return calmest if kept and is_feasible(problem, calmest) else best


def searches(
    problem: TuningProblem, k: FloatArray, objective: Objective, *, min_R_K: float = 0.0
) -> list[Assessment]:
    """Optima of an objective from each of the free gains k, shape (starts, f)."""
    task = Program([problem], objective, min_R_K=min_R_K)
    return [assessment(problem, K) for K in task.space.K(task.descend(k)[0])]


def convex_starts(problem: TuningProblem) -> FloatArray:
    """Stacked gains of the convex problem for each of `SIZES`, shape (at most 5, m, 2 p).

    `problem`: model, scaling and the bounds and fixed values of gains are used, the rest is not.
    Gains on states that its loop does not feed back are left out: with lag or delay the start is
    then a guess, no longer an optimum. The result is empty where the solver found no answer at all.
    """
    solutions = [state_feedback(problem.model, problem.scaling, size) for size in SIZES]
    n = len(problem.model.states)
    output = np.linalg.pinv(problem.model.C)
    lower, upper = problem.gain_bounds
    stacked = [np.hstack([K[:, :n] @ output, K[:, n:]]) for K in solutions if K is not None]
    return np.clip(np.array(stacked).reshape(-1, *lower.shape), lower, upper)


def state_feedback(
    model: LinearModel, scaling: FloatArray | None, size: float
) -> FloatArray | None:
    """K of ``u' = K s`` with the largest R_K under ``K W K' <= size^2 I``, or None.

    `model`: n states, m inputs, p errors. `scaling` (shape (n + p,)): units of the state s = (x',
    e). `size`: bound on the gains in the norm of the optimal W. Returns None where the solver has
    no answer (shape (m, n + p)).
    """
    A, B = velocity_form(model)
    order, m = B.shape
    scale = np.ones(order) if scaling is None else scaling
    A, B = scaled(A, scale), B / scale[:, None]
    W, Y = unknown(order, order, symmetric=True), unknown(m, order)
    rate, eye = unknown(), np.eye(order)
    flow = A @ W + B @ Y
    decay = blocks([[-(flow + flow.T), W], [W, eye]])
    bound = blocks([[size**2 * np.eye(m), Y], [Y.T, W]])
    unsolved = solve(largest(rate, [decay >> 0, W >> rate * eye, bound >> 0]))
    return None if unsolved else np.linalg.solve(W.value, Y.value.T).T / scale


def tune_by_evolution(problem: TuningProblem, *, generations: int = GENERATIONS) -> TuningResult:
    """Gains of the largest R_K, by SciPy's differential evolution with constraints.

    arXiv 2411.13140, section 4, uses a genetic algorithm on the same optimisation model. Whole
    generations are evaluated at once by the batched indicators.

    The same problem gives the same result.
    """
    from scipy.optimize import NonlinearConstraint, differential_evolution

    space = search_space(problem)

    def loops(k: FloatArray) -> IndicatorArrays:
        """Indicators of a whole generation of free gains, shape (f, members)."""
        A_K = closed_loops(problem.model, space.K(k.T))
        return indicators_batch(A_K, scaling=problem.scaling)

    def lost_rate(k: FloatArray) -> FloatArray:
        measured = loops(k)
        return np.where(measured.stable, -measured.R_K, UNSTABLE + measured.spectral_abscissa)

    def logs(values: FloatArray, measured: IndicatorArrays) -> FloatArray:
        lost = np.log(UNSTABLE) + measured.spectral_abscissa
        return np.where(np.isinf(values), lost, np.log(values))[None]

    def log_radius(k: FloatArray) -> FloatArray:
        measured = loops(k)
        return logs(measured.I_K, measured)

    def log_error(k: FloatArray) -> FloatArray:
        return logs(problem.largest_errors(space.K(k.T)).max(axis=-1), loops(k))

    constraints = [
        NonlinearConstraint(log, -np.inf, np.log(bound))
        for log, bound in ((log_radius, problem.I_star), (log_error, problem.E_star))
        if np.isfinite(bound)
    ]
    if space.names:
        constraints.append(NonlinearConstraint(lambda k: space.slack(k.T).T, 0.0, np.inf))
    evolved = differential_evolution(
        lost_rate,
        np.clip([space.k_min, space.k_max], -EVOLVED_GAIN, EVOLVED_GAIN).T,
        constraints=constraints,
        maxiter=generations,
        popsize=POPULATION,
        tol=1e-6,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(np.random.SeedSequence(problem.seed)),
    )
    best = assessment(problem, space.K(evolved.x))
    feasible = is_feasible(problem, best)
    return result(
        problem,
        best if best.R_K > 0.0 else None,
        status="optimal" if feasible else "infeasible",
        reason="" if feasible else "No generation had gains that meet every constraint.",
        method="genetic",
        starts=1,
        agreeing=int(feasible),
    )
