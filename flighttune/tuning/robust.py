"""One gain set for several models: the worst R_K is maximised, channel by channel.

With one model this is the plain problem, solved so that no channel is left undetermined. Where the
sensitivity of the loop is bounded, a search without gradients goes on from there.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import NO_FEEDBACK
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, closed_loops, fed_by
from flighttune.errors import InputError
from flighttune.theory.indicators import indicators, indicators_batch
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.program import Program, stabilising_starts
from flighttune.tuning.result import ROUNDING, TuningResult
from flighttune.tuning.simplex import FINE, GustLoop, Peaks, searched
from flighttune.tuning.simplex import STARTS as SEARCHED_FROM
from flighttune.tuning.tune import AGREEMENT, STARTS

# Relative distance within which the bound on the sensitivity holds the gains
HELD = 5e-3

Indices: TypeAlias = npt.NDArray[np.intp]

# Inputs and errors, as their places in the whole model, that act on each other and on nothing else,
# and the problem of these alone.
Channel: TypeAlias = tuple[Indices, Indices, TuningProblem]


def tune_worst_case(problems: Sequence[TuningProblem], *, starts: int = STARTS) -> TuningResult:
    """Gains whose smallest R_K over several models is largest, channel by channel.

    `problems`: one a model, with the same inputs, errors, bounds, limits and structure, and no
    bound on I_K; orders of the models and scalings may differ. R_K of the result is the smallest
    over the models; I_K, E_K and the spectral abscissa are the largest.
    """
    began, whole = time.perf_counter(), problems[0]
    if not all(np.array_equal(case.gain_bounds, whole.gain_bounds) for case in problems):
        raise InputError("`problems` must share their bounds on gains.")
    # R_K of a loop is that of its slowest channel. Tuned as a whole, the faster channels would be
    # left anywhere above it; so each channel is tuned over all models by itself, and the gains are
    # put together again. What couples the channels, limits and E_K of the whole loop, is checked
    # at the end.
    split = [channels(problem) for problem in problems]
    results = [_tuned([part for _, _, part in same], starts) for same in zip(*split, strict=True)]
    solved = [result for result in results if result is not None]
    tried = sum(searches for _, searches, *_ in solved)
    of_search: dict[str, Any] = {"method": "worst of models", "starts": tried}
    if len(solved) < len(results):
        within = f" with a sensitivity of at most {whole.sensitivity_max:g}"
        within *= whole.objective != "R_K"
        return TuningResult(
            status="failed",
            reason=f"No gains were found that stabilise every model{within}.",
            problem=whole,
            wall_s=time.perf_counter() - began,
            **of_search,
        )
    _, m, p = whole.model.shape
    K, fed = np.zeros((m, 2 * p)), np.zeros(m)
    for (inputs, errors, _), (own, _, _, own_feedback) in zip(split[0], solved, strict=True):
        K[inputs[:, None], np.concatenate([errors, p + errors])] = own
        fed[inputs] = own_feedback
    loops = [
        indicators(closed_loops(fed_by(case.model, fed), K), scaling=case.scaling, errors=p)
        for case in problems
    ]
    k, E_K = K[whole.free], max(loop.E_K for loop in loops)
    slack = zip(whole.limit_rows.names, whole.slack(k), strict=True)
    broken = [name for name, left in slack if left < 0.0]
    if E_K > whole.E_star:
        broken.append("E_K")
    active, peak = tuple(broken), None
    if whole.objective != "R_K":
        peak = math.exp(max(Peaks(case, FINE).largest(k, fed) for case in problems))
        active += ("sensitivity",) * (peak >= (1.0 - HELD) * whole.sensitivity_max)
    gusts = whole.objective == "rms"
    return TuningResult(
        status="infeasible" if broken else "optimal",
        reason=f"No gains were found inside the bounds on {', '.join(broken)}." if broken else "",
        problem=whole,
        gains=whole.gains(K, (float(fed[0]), float(fed[1])) if fed.any() else NO_FEEDBACK),
        sensitivity=peak,
        errors_in_gusts=GustLoop(whole).errors(K, fed).tolist() if gusts else None,
        R_K=min(loop.R_K for loop in loops),
        I_K=max(loop.I_K for loop in loops),
        E_K=E_K,
        spectral_abscissa=max(loop.spectral_abscissa for loop in loops),
        active=active,
        agreeing=min(agreeing for _, _, agreeing, _ in solved),
        wall_s=time.perf_counter() - began,
        **of_search,
    )


def _tuned(problems: list[TuningProblem], starts: int) -> tuple[FloatArray, int, int, float] | None:
    """Best gains of one channel over its models, searches made, those that agree, and feedback."""
    first = problems[0]
    candidates = np.vstack([stabilising_starts(problem, starts) for problem in problems])
    worst = np.array([_worst_rate(problems, k) for k in candidates])
    if not (most := min(starts, int((worst > 0.0).sum()))):
        return None
    ends, _ = Program(problems, "R_K").descend(candidates[np.argsort(-worst, kind="stable")][:most])
    rates = [_worst_rate(problems, k) for k in ends]
    if math.isfinite(first.E_star):
        errors = [max(case.largest_errors(first.K(k)).max() for case in problems) for k in ends]
        rates = [rate * (E <= first.E_star) for rate, E in zip(rates, errors, strict=True)]
    best = int(np.argmax(rates))
    if first.objective != "R_K":
        if (answer := searched(problems, ends[best])) is None:
            return None
        k, fed, agreeing = answer
        return first.K(k), len(ends) + len(SEARCHED_FROM), agreeing, fed
    agreeing = sum(rate >= (1.0 - AGREEMENT) * rates[best] for rate in rates)
    return first.K(ends[best]), len(ends), agreeing, 0.0


def _worst_rate(problems: list[TuningProblem], k: FloatArray) -> float:
    """Smallest R_K over the models; 0 where one is unstable or an input limit is broken."""
    first = problems[0]
    if (first.slack(k) < -ROUNDING * np.abs(first.limit_rows.bound)).any():
        return 0.0
    return min(
        float(indicators_batch(closed_loops(case.model, first.K(k)), scaling=case.scaling).R_K)
        for case in problems
    )


def channels(problem: TuningProblem) -> tuple[Channel, ...]:
    """The channels of a decoupled problem, in the order of their first input; else the whole."""
    from scipy.sparse.csgraph import connected_components

    model = problem.model
    n, m, p = model.shape
    acts = np.zeros((n + m + p, n + m + p))
    acts[:n, :n], acts[:n, n : n + m], acts[n + m :, :n] = model.A, model.B, model.C
    count, part = connected_components(acts != 0.0, directed=False)
    driven = list(dict.fromkeys(part[n : n + m].tolist()))
    places = [[np.flatnonzero(group == k) for group in np.split(part, [n, n + m])] for k in driven]
    if count > len(driven) or not all(len(states) and len(errors) for states, _, errors in places):
        return ((np.arange(m), np.arange(p), problem),)
    return tuple(
        (inputs, errors, _part(problem, states, inputs, errors))
        for states, inputs, errors in places
    )


def _part(
    problem: TuningProblem, states: Indices, inputs: Indices, errors: Indices
) -> TuningProblem:
    model, places = problem.model, (states, inputs, errors)
    n, _, p = model.shape
    columns = np.concatenate([errors, p + errors])
    bounds = {
        name: np.asarray(getattr(problem, name))[inputs[:, None], columns]
        for name in ("K_min", "K_max", "K_fixed")
    }
    own = [tuple(names[i] for i in place) for names, place in zip(model.names, places, strict=True)]
    return replace(
        problem,
        model=LinearModel(
            A=model.A[states[:, None], states],
            B=model.B[states[:, None], inputs],
            C=model.C[errors[:, None], states],
            states=own[0],
            inputs=own[1],
            errors=own[2],
        ),
        limits=problem.limits
        and Limits(**{end: bound[inputs] for end, bound in asdict(problem.limits).items()}),
        x_0=None if problem.x_0 is None else problem.x_0[errors],
        scaling=np.asarray(problem.scaling)[np.concatenate([states, n + errors])],
        gusts=None if problem.gusts is None else problem.gusts[errors],
        **bounds,
    )
