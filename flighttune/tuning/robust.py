"""One gain set for several models: the worst R_K is maximised, channel by channel.

With one model this is the plain problem, solved so that no channel is left undetermined. Where the
sensitivity of the loop is bounded, a search without gradients goes on from there.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import NO_FEEDBACK
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, closed_loops, fed_by
from flighttune.errors import InputError
from flighttune.theory.indicators import indicators, indicators_batch
from flighttune.tuning.peaks import FINE, Peaks
from flighttune.tuning.problem import SearchSpace, TuningProblem, search_space
from flighttune.tuning.program import Program, stabilising_starts
from flighttune.tuning.result import ROUNDING, TuningResult
from flighttune.tuning.simplex import STARTS as SEARCHED_FROM
from flighttune.tuning.simplex import GustLoop, searched
from flighttune.tuning.tune import AGREEMENT, STARTS

# Relative distance within which the bound on the sensitivity holds the gains
HELD = 5e-3


METHOD = "worst of models"

Indices: TypeAlias = npt.NDArray[np.intp]


# Inputs and errors, as their places in the whole model, that act on each other and on nothing else,
# and the problem of these alone.
Channel: TypeAlias = tuple[Indices, Indices, TuningProblem]


def tune_worst_case(problems: Sequence[TuningProblem], *, starts: int = STARTS) -> TuningResult:
    """Gains whose smallest R_K over several models is largest, channel by channel.

    One bound on the eigenvalues of Q of all models (`flighttune.tuning.program.Program`): kinks of
    the worst R_K, where models or eigenvalues meet, are no obstacle. R_K of a loop is the smallest
    of its channels'; each channel is solved by itself.

    `problems`: one a model, with the same inputs, errors, bounds, limits and structure, and no
    bound on I_K. Orders of the models and scalings may differ. R_K of the result is the smallest
    over the models, I_K, E_K and the spectral abscissa are the largest. Gains between channels that
    do not touch each other are 0. Raises InputError if the bounds on gains differ.
    """
    began = time.perf_counter()
    whole = problems[0]
    for problem in problems[1:]:
        if not np.array_equal(problem.gain_bounds, whole.gain_bounds):
            raise InputError("`problems` must share their bounds on gains.")
    # R_K of a loop is that of its slowest channel. Tuned as a whole, the faster channels would be
    # left anywhere above it; so each channel is tuned over all models by itself, and the gains are
    # put together again. What couples the channels, limits and E_K of the whole loop, is checked
    # at the end.
    split = [channels(problem) for problem in problems]
    results = [_tuned([part for _, _, part in same], starts) for same in zip(*split, strict=True)]
    solved = [result for result in results if result is not None]
    tried = sum(searches for _, searches, *_ in solved)
    if len(solved) < len(results):
        within = f" with a sensitivity of at most {whole.sensitivity_max:g}"
        within *= whole.objective != "R_K"
        return TuningResult(
            status="failed",
            reason=f"No gains were found that stabilise every model{within}.",
            method=METHOD,
            problem=whole,
            starts=tried,
            wall_s=time.perf_counter() - began,
        )
    space = search_space(whole)
    K, p = np.zeros(space.base.shape), len(whole.model.errors)
    fed = np.zeros(len(K))
    for (inputs, errors, _), (pair_gains, _, _, pair_fed) in zip(split[0], solved, strict=True):
        K[inputs[:, None], np.concatenate([errors, p + errors])] = pair_gains
        fed[inputs] = pair_fed
    models = [fed_by(case.model, fed) for case in problems]
    loops = [
        indicators(closed_loops(model, K), scaling=case.scaling, errors=p)
        for model, case in zip(models, problems, strict=True)
    ]
    broken = [
        name for name, s in zip(space.names, space.slack(K[space.free]), strict=True) if s < 0.0
    ]
    if (E_K := max(loop.E_K for loop in loops)) > whole.E_star:
        broken.append("E_K")
    active, peak = tuple(broken), None
    if whole.objective != "R_K":
        peaks = (Peaks(case.model, space, FINE) for case in problems)
        peak = math.exp(max(each.largest(K[space.free], fed) for each in peaks))
        active += ("sensitivity",) * (peak >= (1.0 - HELD) * whole.sensitivity_max)
    gusts = whole.objective == "rms"
    return TuningResult(
        status="infeasible" if broken else "optimal",
        reason=f"No gains were found inside the bounds on {', '.join(broken)}." if broken else "",
        method=METHOD,
        problem=whole,
        gains=whole.gains(K, (float(fed[0]), float(fed[1])) if fed.any() else NO_FEEDBACK),
        sensitivity=peak,
        errors_in_gusts=GustLoop(whole).errors(K, fed).tolist() if gusts else None,
        R_K=min(loop.R_K for loop in loops),
        I_K=max(loop.I_K for loop in loops),
        E_K=E_K,
        spectral_abscissa=max(loop.spectral_abscissa for loop in loops),
        active=active,
        starts=tried,
        agreeing=min(agreeing for _, _, agreeing, _ in solved),
        wall_s=time.perf_counter() - began,
    )


def _tuned(problems: list[TuningProblem], starts: int) -> tuple[FloatArray, int, int, float] | None:
    """Best gains of one channel over its models, searches made, those that agree, and feedback.

    None if no gains stabilise all the models, or keep the sensitivity that is asked for.
    """
    space = search_space(problems[0])
    candidates = np.vstack([stabilising_starts(problem, space, starts) for problem in problems])
    worst = np.array([_worst_rate(problems, space, k) for k in candidates])
    if not (most := min(starts, int((worst > 0.0).sum()))):
        return None
    ends, _ = Program(problems, "R_K").descend(candidates[np.argsort(-worst, kind="stable")][:most])
    rates, most_E = [_worst_rate(problems, space, k) for k in ends], problems[0].E_star
    if math.isfinite(most_E):
        errors = [[case.largest_errors(space.K(k)).max() for case in problems] for k in ends]
        rates = [rate * (max(E) <= most_E) for rate, E in zip(rates, errors, strict=True)]
    best = int(np.argmax(rates))
    if problems[0].objective != "R_K":
        if (answer := searched(problems, ends[best])) is None:
            return None
        k, fed, agreeing = answer
        return space.K(k), len(ends) + len(SEARCHED_FROM), agreeing, fed
    agreeing = sum(rate >= (1.0 - AGREEMENT) * rates[best] for rate in rates)
    return space.K(ends[best]), len(ends), agreeing, 0.0


def _worst_rate(problems: list[TuningProblem], space: SearchSpace, k: FloatArray) -> float:
    """Smallest R_K over the models; 0 where one is unstable or an input limit is broken."""
    if (space.slack(k) < -ROUNDING * np.abs(space.bound)).any():
        return 0.0
    return min(
        float(indicators_batch(closed_loops(case.model, space.K(k)), scaling=case.scaling).R_K)
        for case in problems
    )


def channels(problem: TuningProblem) -> tuple[Channel, ...]:
    """The channels of a problem whose model is decoupled; the whole problem where it is coupled.

    R_K of the whole loop is the smallest of the channels', so that the whole problem leaves the
    better channels undetermined. Each channel's own problem does not.

    They are in the order of their first input. The gains between channels are left out: they are 0.
    """
    from scipy.sparse.csgraph import connected_components

    model = problem.model
    n, m, p = model.shape
    acts = np.zeros((n + m + p, n + m + p))
    acts[:n, :n], acts[:n, n : n + m], acts[n + m :, :n] = model.A, model.B, model.C
    count, part = connected_components(acts != 0.0, directed=False)
    groups = [part[:n], part[n : n + m], part[n + m :]]
    driven = list(dict.fromkeys(groups[1].tolist()))
    places = [[np.flatnonzero(group == k) for group in groups] for k in driven]
    if count > len(driven) or not all(len(states) and len(errors) for states, _, errors in places):
        return ((np.arange(m), np.arange(p), problem),)
    return tuple(
        (inputs, errors, _part(problem, states, inputs, errors))
        for states, inputs, errors in places
    )


def _part(
    problem: TuningProblem, states: Indices, inputs: Indices, errors: Indices
) -> TuningProblem:
    model = problem.model
    n, _, p = model.shape
    columns = np.concatenate([errors, p + errors])
    ends = ("lower", "upper", "rate_lower", "rate_upper")
    limits = problem.limits and Limits(
        **{end: getattr(problem.limits, end)[inputs] for end in ends}
    )
    bounds = {
        name: np.asarray(getattr(problem, name))[inputs[:, None], columns]
        for name in ("K_min", "K_max", "K_fixed")
    }
    return replace(
        problem,
        model=LinearModel(
            A=model.A[states[:, None], states],
            B=model.B[states[:, None], inputs],
            C=model.C[errors[:, None], states],
            states=tuple(model.states[i] for i in states),
            inputs=tuple(model.inputs[i] for i in inputs),
            errors=tuple(model.errors[i] for i in errors),
        ),
        limits=limits,
        x_0=None if problem.x_0 is None else problem.x_0[errors],
        scaling=np.asarray(problem.scaling)[np.concatenate([states, n + errors])],
        gusts=None if problem.gusts is None else problem.gusts[errors],
        **bounds,
    )
