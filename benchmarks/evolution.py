"""The paper's own search, by a genetic algorithm: differential evolution with constraints."""

import time
from dataclasses import replace

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.control.linear_model import closed_loops
from flighttune.control.theory.indicators import IndicatorArrays, indicators_batch
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.result import TuningResult, assessment, result

# Box of the search where the problem has no tighter one: evolution needs a small one
EVOLVED_GAIN = 10.0
GENERATIONS = 1000
POPULATION = 15

# Cost of an unstable loop, besides its spectral abscissa: more than that of any stable one
UNSTABLE = 1e6


def tune_by_evolution(problem: TuningProblem, *, generations: int = GENERATIONS) -> TuningResult:
    """Gains of the largest R_K, by SciPy's differential evolution with constraints.

    arXiv 2411.13140, section 4, uses a genetic algorithm on the same optimisation model. Whole
    generations are evaluated at once by the batched indicators.

    The same problem gives the same result.
    """
    from scipy.optimize import NonlinearConstraint, differential_evolution

    began = time.perf_counter()

    def loops(k: FloatArray) -> IndicatorArrays:
        """Indicators of a whole generation of free gains, shape (f, members)."""
        A_K = closed_loops(problem.model, problem.K(k.T))
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
        return logs(problem.largest_errors(problem.K(k.T)).max(axis=-1), loops(k))

    constraints = [
        NonlinearConstraint(log, -np.inf, np.log(bound))
        for log, bound in ((log_radius, problem.I_star), (log_error, problem.E_star))
        if np.isfinite(bound)
    ]
    if problem.limit_rows.names:
        constraints.append(NonlinearConstraint(lambda k: problem.slack(k.T).T, 0.0, np.inf))
    evolved = differential_evolution(
        lost_rate,
        np.clip(problem.k_bounds, -EVOLVED_GAIN, EVOLVED_GAIN).T,
        constraints=constraints,
        maxiter=generations,
        popsize=POPULATION,
        tol=1e-6,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(np.random.SeedSequence(problem.seed)),
    )
    best = assessment(problem, problem.K(evolved.x))
    feasible = best.meets(problem)
    outcome = result(
        problem,
        best if best.R_K > 0.0 else None,
        status="optimal" if feasible else "infeasible",
        reason="" if feasible else "No generation had gains that meet every constraint.",
        method="genetic",
        starts=1,
        agreeing=int(feasible),
    )
    return replace(outcome, wall_s=time.perf_counter() - began)
