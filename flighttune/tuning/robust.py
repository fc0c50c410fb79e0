"""One gain set for several models: the worst R_K is maximised, channel by channel.

With one model this is the plain problem, solved so that no channel is left undetermined.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loops
from flighttune.errors import InputError
from flighttune.theory.indicators import indicators
from flighttune.theory.sensitivity import spectra
from flighttune.tuning.channels import assembled, channels
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.result import ROUNDING, TuningResult
from flighttune.tuning.search_space import SearchSpace, search_space
from flighttune.tuning.starts import stabilising_starts

STARTS = 4
ACCURACY = 1e-10
ITERATIONS = 100
AGREEMENT = 1e-4
METHOD = "worst of models"
UNSTABLE_LOG = 30.0
"""Stands for log(1 / R_K) of an unstable loop: worse than any stable one's."""
INSIDE = 1e-8
"""Relative distance kept from input limits, so that rounding does not break them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """Stacked gains of one channel, how many searches were made and how many agree on them."""

    K: FloatArray
    starts: int
    agreeing: int


def tune_worst_case(problems: Sequence[TuningProblem], *, starts: int = STARTS) -> TuningResult:
    """Gains whose smallest R_K over several models is largest, channel by channel.

    Parameters
    ----------
    problems : sequence of TuningProblem
        One a model, with the same inputs, errors, bounds, limits and structure, and no bound on
        I_K. Orders of the models and scalings may differ.
    starts : int
        Searches a channel.

    Returns
    -------
    TuningResult
        R_K is the smallest over the models, I_K and the spectral abscissa are the largest. Gains
        between channels that do not touch each other are 0.

    Raises
    ------
    InputError
        If there is no problem, the problems differ in what they must share, one bounds I_K, or
        `starts` is not at least 1.

    Notes
    -----
    The epigraph form ``min t, t >= log(lambda_i(Q_v))`` over all eigenvalues i and models v, by
    SLSQP on exact gradients: kinks of the worst R_K, where models or eigenvalues meet, are no
    obstacle. R_K of a loop is the smallest of its channels'; each channel is solved by itself.
    """
    began = time.perf_counter()
    _check(problems, starts)
    whole = problems[0]
    split = [channels(problem) for problem in problems]
    if len({tuple(tuple(c.inputs.tolist()) for c in parts) for parts in split}) > 1:
        raise InputError("`problems` must fall apart into the same channels.")
    found = [_tuned([c.problem for c in same], starts) for same in zip(*split, strict=True)]
    solved = [(c, f.K) for c, f in zip(split[0], found, strict=True) if f is not None]
    tried = sum(f.starts for f in found if f is not None)
    agreeing = min((f.agreeing for f in found if f is not None), default=0)
    if len(solved) < len(found):
        return _failed(tried, time.perf_counter() - began)
    K = assembled(solved, search_space(whole).base.shape)
    loops = [
        indicators(closed_loops(problem.model, K), scaling=problem.scaling) for problem in problems
    ]
    slack = search_space(whole).slack(K[search_space(whole).free])
    broken = [name for name, s in zip(search_space(whole).names, slack, strict=True) if s < 0.0]
    return TuningResult(
        status="infeasible" if broken else "optimal",
        reason=f"No gains were found inside {', '.join(broken)}." if broken else "",
        method=METHOD,
        gains=whole.gains(K),
        R_K=min(one.R_K for one in loops),
        I_K=max(one.I_K for one in loops),
        spectral_abscissa=max(one.spectral_abscissa for one in loops),
        active=tuple(broken),
        smallest_I_K=None,
        starts=tried,
        agreeing=agreeing,
        wall_s=time.perf_counter() - began,
    )


def _check(problems: Sequence[TuningProblem], starts: int) -> None:
    if not problems:
        raise InputError("`problems` must hold at least one, got none.")
    if starts < 1:
        raise InputError(f"`starts` must be at least 1, got {starts}.")
    first = problems[0]
    for problem in problems:
        if math.isfinite(problem.I_star):
            raise InputError(
                f"`I_star` must be inf where the worst R_K is maximised, got {problem.I_star:g}."
            )
        same = (problem.model.inputs, problem.model.errors) == (
            first.model.inputs,
            first.model.errors,
        ) and all(
            np.array_equal(getattr(problem, name), getattr(first, name), equal_nan=True)
            for name in ("K_min", "K_max", "K_fixed")
        )
        if not same:
            raise InputError("`problems` must share inputs, errors and bounds on gains.")


def _tuned(problems: list[TuningProblem], starts: int) -> _Found | None:
    """The best gains of one channel over its models; None if nothing stabilises them all."""
    space = search_space(problems[0])
    candidates = np.vstack([stabilising_starts(problem, space, starts) for problem in problems])
    worst = np.array([_worst_rate(problems, space, k) for k in candidates])
    first = candidates[np.argsort(-worst, kind="stable")][: min(starts, int((worst > 0.0).sum()))]
    ends = [_search(problems, space, k) for k in first]
    rates = [_worst_rate(problems, space, k) for k in ends]
    if not ends:
        return None
    best = int(np.argmax(rates))
    return _Found(
        K=space.K(ends[best]),
        starts=len(ends),
        agreeing=sum(rate >= (1.0 - AGREEMENT) * rates[best] for rate in rates),
    )


def _worst_rate(problems: list[TuningProblem], space: SearchSpace, k: FloatArray) -> float:
    """Smallest R_K over the models; 0 where one is unstable or an input limit is broken."""
    if (space.slack(k) < -ROUNDING * np.abs(space.bound)).any():
        return 0.0
    return min(
        indicators(closed_loops(one.model, space.K(k)), scaling=one.scaling).R_K for one in problems
    )


def _search(problems: list[TuningProblem], space: SearchSpace, k: FloatArray) -> FloatArray:
    room = space.bound - INSIDE * np.abs(space.bound) - space.offset
    remembered: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def logs(k: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = k.tobytes()
        if key not in remembered:
            remembered.clear()
            parts = [_log_eigenvalues(problem, space, k) for problem in problems]
            remembered[key] = (
                np.concatenate([values for values, _ in parts]),
                np.vstack([slopes for _, slopes in parts]),
            )
        return remembered[key]

    def values(z: FloatArray) -> FloatArray:
        return np.concatenate([z[-1] - logs(z[:-1])[0], room - space.G @ z[:-1]])

    def slopes(z: FloatArray) -> FloatArray:
        curved = -logs(z[:-1])[1]
        return np.vstack(
            [
                np.hstack([curved, np.ones((len(curved), 1))]),
                np.hstack([-space.G, np.zeros((len(space.G), 1))]),
            ]
        )

    objective = np.append(np.zeros(len(k)), 1.0)
    found = minimize(
        lambda z: float(objective @ z),
        np.append(k, logs(k)[0].max()),
        jac=lambda _: objective,
        method="SLSQP",
        bounds=[*zip(space.k_min, space.k_max, strict=True), (None, None)],
        constraints={"type": "ineq", "fun": values, "jac": slopes},
        options={"maxiter": ITERATIONS, "ftol": ACCURACY},
    )
    return np.clip(found.x[:-1], space.k_min, space.k_max)


def _log_eigenvalues(
    problem: TuningProblem, space: SearchSpace, k: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Logarithms of the eigenvalues of Q and their slopes in the free gains."""
    model = problem.model
    n, _, p = model.shape
    found = spectra(closed_loops(model, space.K(k)), scaling=problem.scaling)
    if found is None:
        return np.full(n + p, UNSTABLE_LOG), np.zeros((n + p, len(k)))
    slopes = found.eigenvalue_gradients / found.eigenvalues[:, None, None]
    in_K_P = model.B.T @ slopes[:, :n, :n] @ model.C.T
    in_K_I = model.B.T @ slopes[:, :n, n:]
    return np.log(found.eigenvalues), np.concatenate([in_K_P, in_K_I], axis=-1)[:, space.free]


def _failed(starts: int, wall_s: float) -> TuningResult:
    return TuningResult(
        status="failed",
        reason="No gains were found that stabilise every model.",
        method=METHOD,
        gains=None,
        R_K=0.0,
        I_K=math.inf,
        spectral_abscissa=math.nan,
        active=(),
        smallest_I_K=None,
        starts=starts,
        agreeing=0,
        wall_s=wall_s,
    )
