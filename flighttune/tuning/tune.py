"""Tuning by the name of a method."""

import time
from dataclasses import replace
from typing import get_args

from flighttune.arrays import check_at_least
from flighttune.errors import InputError
from flighttune.tuning.convex import tune_from_convex_start
from flighttune.tuning.genetic import tune_by_evolution
from flighttune.tuning.gradient import STARTS, tune_by_gradient
from flighttune.tuning.problem import Method, TuningProblem
from flighttune.tuning.result import TuningResult


def tune(
    problem: TuningProblem, method: Method = "gradient", *, starts: int = STARTS
) -> TuningResult:
    """Gains of the largest R_K that meet the constraints of a problem.

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
        The status is "infeasible" or "failed" where there is no answer.

    Raises
    ------
    InputError
        If the method is unknown or `starts` is not at least 1.
    """
    if method not in get_args(Method):
        raise InputError(f"`method` must be one of {get_args(Method)}, got {method!r}.")
    check_at_least(1, starts=starts)
    began = time.perf_counter()
    if method == "genetic":
        result = tune_by_evolution(problem)
    elif method == "convex":
        result = tune_from_convex_start(problem)
    else:
        result = tune_by_gradient(problem, starts=starts)
    return replace(result, wall_s=time.perf_counter() - began)
