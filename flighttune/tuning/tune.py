"""The one way in: a problem and the name of a method."""

from typing import Literal, get_args

from flighttune.errors import InputError
from flighttune.tuning.genetic import tune_by_evolution
from flighttune.tuning.gradient import STARTS, tune_by_gradient
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.result import TuningResult

Method = Literal["gradient", "genetic"]


def tune(
    problem: TuningProblem, method: Method = "gradient", *, starts: int = STARTS
) -> TuningResult:
    """Gains of the largest R_K that meet the constraints of a problem.

    Parameters
    ----------
    problem : TuningProblem
    method : "gradient" or "genetic"
        SLSQP on exact gradients from several starts; or differential evolution as in the paper.
    starts : int
        Searches of the gradient method.

    Returns
    -------
    TuningResult
        With status "infeasible" or "failed" where there is no answer.

    Raises
    ------
    InputError
        If the method is unknown or `starts` is not at least 1.
    """
    if method not in get_args(Method):
        raise InputError(f"`method` must be one of {get_args(Method)}, got {method!r}.")
    if starts < 1:
        raise InputError(f"`starts` must be at least 1, got {starts}.")
    if method == "genetic":
        return tune_by_evolution(problem)
    return tune_by_gradient(problem, starts=starts)
