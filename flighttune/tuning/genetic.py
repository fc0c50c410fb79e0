"""Tuning by differential evolution, as the paper tunes by a genetic algorithm."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops
from flighttune.theory.indicators import IndicatorArrays, indicators_batch
from flighttune.tuning.problem import TuningProblem, search_space
from flighttune.tuning.result import (
    TuningResult,
    assessment,
    is_feasible,
    result,
)

LARGEST_GAIN = 10.0
"""Box of the search where the problem has no tighter one; evolution needs a small one."""
GENERATIONS = 1000
POPULATION = 15
UNSTABLE = 1e6
"""Cost of an unstable loop, besides its spectral abscissa: more than that of any stable one."""
METHOD = "genetic"


def tune_by_evolution(
    problem: TuningProblem, *, largest_gain: float = LARGEST_GAIN, generations: int = GENERATIONS
) -> TuningResult:
    """Gains of the largest R_K, by SciPy's differential evolution with constraints.

    arXiv 2411.13140, section 4, uses a genetic algorithm on the same optimisation model. Whole
    generations are evaluated at once by the batched indicators.

    `largest_gain`: size of the box searched, inside the problem's own bounds. The same problem
    gives the same result.
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

    def log_radius(k: FloatArray) -> FloatArray:
        measured = loops(k)
        lost = np.log(UNSTABLE) + measured.spectral_abscissa
        return np.where(measured.stable, np.log(measured.I_K), lost)[None]

    constraints = []
    if np.isfinite(problem.I_star):
        constraints.append(NonlinearConstraint(log_radius, -np.inf, np.log(problem.I_star)))
    if space.names:
        constraints.append(NonlinearConstraint(lambda k: space.slack(k.T).T, 0.0, np.inf))
    evolved = differential_evolution(
        lost_rate,
        np.column_stack(
            [np.maximum(space.k_min, -largest_gain), np.minimum(space.k_max, largest_gain)]
        ),
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
        method=METHOD,
        starts=1,
        agreeing=int(feasible),
    )
