"""How much rate a radius buys: the frontier of R_K against I_K."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.tuning.gradient import STARTS, smallest_radius, tune_by_gradient
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.result import Assessment, assessment
from flighttune.tuning.search_space import search_space
from flighttune.tuning.starts import stabilising_starts

POINTS = 25
WIDEST = 3.0


def frontier(
    problem: TuningProblem,
    *,
    points: int = POINTS,
    I_max: float | None = None,
    marked: Mapping[str, PIGains] | None = None,
) -> pd.DataFrame:
    """The largest R_K for every I_K, and where given gains lie.

    Parameters
    ----------
    problem : TuningProblem
        Its `I_star` plays no part; limits, structure, scaling and seed do.
    points : int
        Points of the frontier, at least 2; from the smallest I_K on, closest there.
    I_max : float, s^2, optional
        Largest I_K; by default `WIDEST` times the smallest, or the largest marked one if more.
    marked : mapping of str to PIGains, optional
        Gains to place beside the frontier.

    Returns
    -------
    DataFrame
        A row each point and marked set, columns ``name`` (``frontier`` or the mark), ``I_star``
        (nan for marks), ``I_K``, ``R_K``, ``spectral_abscissa``, ``within_limits``, ``active``
        (names, separated by spaces) and one for each gain, ``K_P[phi,chi]`` and so on. R_K never
        falls along the frontier. Marks alone if no stable gains were found within the limits.

    Raises
    ------
    InputError
        If `points` is less than 2.
    """
    if points < 2:
        raise InputError(f"`points` must be at least 2, got {points}.")
    marks = {name: assessment(problem, gains.K) for name, gains in (marked or {}).items()}
    rows = [_row(problem, name, math.nan, one) for name, one in marks.items()]
    k = stabilising_starts(problem, search_space(problem), STARTS)
    smallest = smallest_radius(problem, k)
    if smallest is None:
        return pd.DataFrame(rows)
    if I_max is None:
        finite = [one.I_K for one in marks.values() if math.isfinite(one.I_K)]
        I_max = max([WIDEST * smallest.I_K, *finite])
    growth = np.linspace(0.0, 1.0, points) ** 2 * math.log(max(I_max / smallest.I_K, 1.0))
    best, along = smallest, []
    for step in growth:
        I_star = smallest.I_K * math.exp(step)
        found = tune_by_gradient(replace(problem, I_star=I_star), starts=1, first=best.K)
        if found.status == "optimal" and found.gains is not None and found.R_K > best.R_K:
            best = assessment(problem, found.gains.K)
        along.append(_row(problem, "frontier", I_star, best))
    return pd.DataFrame(along + rows)


def _row(problem: TuningProblem, name: str, I_star: float, one: Assessment) -> dict[str, object]:
    p = len(problem.model.errors)
    gains = {
        f"{'K_P' if j < p else 'K_I'}[{channel},{problem.model.errors[j % p]}]": float(one.K[i, j])
        for i, channel in enumerate(problem.model.inputs)
        for j in range(2 * p)
    }
    return {
        "name": name,
        "I_star": I_star,
        "I_K": one.I_K,
        "R_K": one.R_K,
        "spectral_abscissa": one.spectral_abscissa,
        "within_limits": one.within_limits,
        "active": " ".join(name for name in one.active if name != "I_K"),
        **gains,
    }
