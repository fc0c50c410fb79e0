"""Gains for an envelope, and for several models: the worst rate is maximised.

The rate over an envelope is the rate of the common Q at the vertices of `jacobian_hull`. For given
gains this is a convex problem. In gains and Q together ``A_v' Q + Q A_v + R I <= 0`` is bilinear.
Linearised in a step of gains and Q it is a linear matrix inequality, solved inside a trust region.
The step is accepted by the true rate at the new gains, from `common_Q`. Kinks of the rate are no
obstacle, since every program has all vertices and all eigenvalues.

For several models the worst R_K is maximised channel by channel. With one model this is the plain
problem, solved so that no channel is left undetermined. If the sensitivity of the loop is bounded,
another search continues from there.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.gains import NO_FEEDBACK, PIGains
from flighttune.control.limits import Limits
from flighttune.control.linear_model import (
    Envelope,
    LinearModel,
    closed_loops,
    fed_by,
    jacobian_hull,
    loops_of,
)
from flighttune.control.theory.indicators import Indicators, indicators, indicators_batch
from flighttune.control.theory.lmi import combination, largest, parameter, solve, unknown
from flighttune.control.theory.lyapunov import CommonQ, common_Q, lyapunov_solution
from flighttune.control.tuning.noise import NoisyLoop
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.program import Program, loop_slopes, stabilising_starts
from flighttune.control.tuning.result import ROUNDING, TuningResult, assessment, result
from flighttune.control.tuning.shaped import FINE, GustLoop, Peaks, searched
from flighttune.control.tuning.shaped import STARTS as SEARCHED_FROM
from flighttune.control.tuning.tune import AGREEMENT, STARTS, tune_by_gradient

# Relative accuracy of the largest factor
FACTOR_TOLERANCE = 1e-3

# Maximum factor on an envelope
LARGEST_FACTOR = 64.0

# Points of a curve of rates
SAMPLES = 41

# Accuracy of the largest factor: at a smaller one the solver's error exceeds the rate
END_SHOWN = 0.995

# Maximum number of steps that enlarge an envelope towards the required envelope
GROWTHS = 12

# Trust region on each gain, relative to the gain (to one for small gains)
FIRST_STEP, SMALLEST_STEP = 0.3, 1e-4

ITERATIONS = 60

# Two consecutive steps with a smaller relative improvement of the rate end the ascent
MIN_GAIN = 1e-5


class Point(NamedTuple):
    """Free gains that meet every constraint, with their rates."""

    k: FloatArray  # shape (f,)
    common: CommonQ  # common Q of the vertices, always with a Q
    trim: Indicators


def point(problem: TuningProblem, models: Sequence[LinearModel], k: FloatArray) -> Point | None:
    """The point of free gains k; None if a constraint is broken or there is no common Q."""
    low, high = problem.k_bounds
    if not ((problem.slack(k) >= 0.0).all() and (low <= k).all() and (k <= high).all()):
        return None
    K = problem.K(k)
    if not (trim := indicators(closed_loops(problem.model, K))).I_K <= problem.I_star:
        return None
    common = common_Q(np.array([closed_loops(model, K) for model in models]))
    return None if common.Q is None else Point(k=k, common=common, trim=trim)


def ascend(problem: TuningProblem, models: Sequence[LinearModel], start: Point) -> Point:
    """A local optimum of the common rate, never worse than the given feasible point."""
    step, excess, idle = FIRST_STEP, 0.0, 0
    best = start
    program = _Linearised(problem, models)
    for _ in range(ITERATIONS):
        k = program.step(best, step, excess)
        better = None if k is None else point(problem, models, k)
        if better is not None and better.common.R > best.common.R:
            idle = idle + 1 if better.common.R < (1.0 + MIN_GAIN) * best.common.R else 0
            best, step, excess = better, min(2.0 * step, 1.0), excess / 2.0
        else:
            # The linearised bound on I_K may be missed, so it is tightened by the excess.
            broken = 0.0 if k is None or better is not None else program.excess(k)
            step, excess = step / 2.0, max(excess, broken) if broken > 0.0 else excess / 2.0
        if idle == 2 or step < SMALLEST_STEP:
            break
    return best


class _Linearised:
    """The program of one step: unknowns dk, Q, R and the relative changes of I_K's factors."""

    # It is compiled once; only its parameters change from step to step.
    def __init__(self, problem: TuningProblem, models: Sequence[LinearModel]) -> None:
        self._problem, self._models = problem, models
        self._limited = math.isfinite(problem.I_star)
        self._trim_slopes = loop_slopes(problem.model, problem)
        f, n = len(self._trim_slopes), len(self._trim_slopes[0])
        self._dk, Q, R = unknown(f), unknown(n, n, symmetric=True), unknown()
        self._loops = [parameter(n, n) for _ in models]
        self._Q0 = parameter(n, n, symmetric=True)
        self._lower, self._upper = parameter(f), parameter(f)
        # The trust region with the bounds on gains, and the input limits. Q <= I fixes the scale,
        # so that the rate is R itself.
        constraints = [self._lower <= self._dk, self._dk <= self._upper, Q << np.eye(n)]
        if len(G := problem.limit_rows.G):
            self._slack = parameter(len(G))
            constraints.append(G @ self._dk <= self._slack)
        for A, model in zip(self._loops, models, strict=True):
            dA = combination(self._dk, loop_slopes(model, problem).reshape(f, n * n))
            moved = dA.T @ self._Q0 + self._Q0 @ dA
            constraints.append(A.T @ Q + Q @ A + moved + R * np.eye(n) << 0)
        if self._limited:
            constraints += self._radius_constraints(f, n)
        self._program = largest(R, constraints)

    def _radius_constraints(self, f: int, n: int) -> list[Any]:
        """``log I_K <= log I_star - excess`` at the trim, in bounds on Q0 and on A'A."""
        self._trim = [(parameter(n, n, symmetric=True), parameter(f, n * n)) for _ in range(3)]
        self._room = parameter()
        highest, lowest, gram = (
            matrix + combination(self._dk, slopes) for matrix, slopes in self._trim
        )
        # ``I_K = lambda_max(Q0)^2 / (lambda_min(Q0) sigma_min(A))``. The matrices are linearised,
        # not their eigenvalues, which preserves kinks.
        rise, eye = unknown(3), np.eye(n)  # relative changes of the three eigenvalues
        # I_K contains sigma_min(A), the root of the smallest eigenvalue of A'A: hence one half.
        return [
            highest << (1.0 + rise[0]) * eye,
            lowest >> (1.0 + rise[1]) * eye,
            gram >> (1.0 + rise[2]) * eye,
            2.0 * rise[0] - rise[1] - 0.5 * rise[2] <= self._room,
        ]

    def step(self, point: Point, size: float, excess: float) -> FloatArray | None:
        """Free gains after one step; None if the solver fails."""
        problem, (low, high) = self._problem, self._problem.k_bounds
        trust = size * np.maximum(np.abs(point.k), 1.0)
        self._upper.value = np.minimum(trust, high - point.k)
        self._lower.value = -np.minimum(trust, point.k - low)
        if problem.limit_rows.names:
            self._slack.value = problem.slack(point.k)
        self._Q0.value = np.asarray(point.common.Q) * point.common.R
        for A, model in zip(self._loops, self._models, strict=True):
            A.value = closed_loops(model, problem.K(point.k))
        if self._limited:
            self._set_radius(point, excess)
        return None if solve(self._program) else np.clip(point.k + self._dk.value, low, high)

    def excess(self, k: FloatArray) -> float:
        """Excess of log I_K over its limit at free gains k; 0 without a limit."""
        if not self._limited:
            return 0.0
        I_K = indicators(closed_loops(self._problem.model, self._problem.K(k))).I_K
        return max(0.0, math.log(I_K / self._problem.I_star)) if math.isfinite(I_K) else 0.0

    def _set_radius(self, point: Point, excess: float) -> None:
        A = closed_loops(self._problem.model, self._problem.K(point.k))
        Q0 = lyapunov_solution(A)
        Q_slopes = lyapunov_solution(A, self._trim_slopes.mT @ Q0 + Q0 @ self._trim_slopes)
        gram, gram_slopes = A.T @ A, A.T @ self._trim_slopes
        gram_slopes = gram_slopes + gram_slopes.mT
        spectrum, smallest = np.linalg.eigvalsh(Q0), np.linalg.eigvalsh(gram)[0]
        values = spectrum[-1], spectrum[0], smallest
        parts = (Q0, Q_slopes), (Q0, Q_slopes), (gram, gram_slopes)
        for (matrix, slopes), (now, change), value in zip(self._trim, parts, values, strict=True):
            matrix.value = now / value
            slopes.value = change.reshape(slopes.shape) / value
        self._room.value = math.log(self._problem.I_star / point.trim.I_K) - excess


def envelope_rate(gains: PIGains, envelope: Envelope, *, g: float) -> CommonQ:
    """The rate of gains of the chi/gamma law over an envelope, and its common Q; `g` in m/s^2."""
    return common_Q(loops_of(jacobian_hull(envelope, g=g).models(), gains))


def largest_factor(gains: PIGains, envelope: Envelope, trim: Envelope, *, g: float) -> float:
    """The largest scaling of an envelope about the trim over which gains have a common Q."""
    _check_contains(envelope, trim)

    def certified(factor: float) -> bool:
        try:
            scaled = envelope.scaled(trim, factor)
        except InputError:  # beyond +-pi/2 or standstill it is no longer an envelope
            return False
        return envelope_rate(gains, scaled, g=g).R > 0.0

    # Scaled envelopes are nested, so that bisection finds the factor, to `FACTOR_TOLERANCE`. It is
    # 0 if not even the trim is certified, and at most `LARGEST_FACTOR`.
    inside, outside = 0.0, 1.0
    while certified(outside):
        inside, outside = outside, 2.0 * outside
        if outside > LARGEST_FACTOR:
            return inside
    if inside == 0.0 and not certified(0.0):
        return 0.0
    while outside - inside > FACTOR_TOLERANCE * outside:
        middle = (inside + outside) / 2.0
        inside, outside = (middle, outside) if certified(middle) else (inside, middle)
    return inside


def _check_contains(envelope: Envelope, trim: Envelope) -> None:
    if not envelope.contains(trim):
        raise InputError(f"`envelope` must contain the trim {trim}, got {envelope}.")


def rate_curve(
    gains: PIGains, envelope: Envelope, trim: Envelope, *, g: float, up_to: float = 2.0
) -> tuple[FloatArray, FloatArray]:
    """Factors on an envelope about the trim, at most `up_to`, and the certified rates, 1/s."""
    end = largest_factor(gains, envelope, trim, g=g)
    factors = np.linspace(0.0, END_SHOWN * end if end < up_to else up_to, SAMPLES)
    rates = [envelope_rate(gains, envelope.scaled(trim, factor), g=g).R for factor in factors]
    # The last rate is 0 if no common Q was found there.
    if end < up_to:
        factors, rates = np.append(factors, end), [*rates, 0.0]
    return factors, np.array(rates)


def tune_over_envelope(
    problem: TuningProblem, envelope: Envelope, trim: Envelope, *, g: float, starts: int = 2
) -> TuningResult:
    """Gains with the largest rate over an envelope, under the constraints of a tuning problem.

    The model of the problem is the law's model at the trim, where I_K and input limits apply; `g`
    is in m/s^2. If the first gains have no common Q over the whole envelope, they are tuned for the
    largest part of it, scaled about the trim, that has a common Q. `starts`: searches from random
    gains, besides the search from the best gains for the trim.
    """
    began = time.perf_counter()
    _check_contains(envelope, trim)
    if not np.all(np.asarray(problem.scaling) == 1.0):
        raise InputError("`scaling` must be all ones for a rate over an envelope.")
    if math.isfinite(problem.E_star):
        value = f"{problem.E_star:g}"
        raise InputError(f"`E_star` must be inf for a rate over an envelope, got {value}.")
    # A common Q of all vertices bounds the rate from below. For fixed gains it is a linear matrix
    # inequality; in gains and Q together it is not. So each step solves the inequality linearised
    # about the present gains and is accepted only if the true common rate grows. The result is a
    # local optimum, and a search from other gains may end higher. The gains for the trim alone are
    # the natural first start. Not known: whether they are a good start beyond the tried cases.
    nominal, firsts = tune_by_gradient(problem), []
    if nominal.status == "optimal" and nominal.gains is not None:
        firsts = [nominal.gains.K[problem.free], *stabilising_starts(problem, starts)]
    searches = [_grow(problem, k, envelope, trim, g=g) for k in firsts]
    reached = [search for search in searches if search is not None]
    factor, best = 0.0, None
    status = "failed" if nominal.status == "failed" else "infeasible"
    reason = nominal.reason or "No gains met the constraints."
    if reached:
        factor, best = max(reached, key=lambda search: (search[0], search[1].common.R))
        reason = f"No common Q was found beyond {factor:.3g} of the envelope about the trim."
    whole = best.common if best is not None and factor >= 1.0 else None
    return result(
        problem,
        best and assessment(problem, problem.K(best.k)),
        status="found" if whole else status,
        reason="" if whole else reason,
        R_envelope=whole.R if whole else 0.0,
        R_envelope_bound=whole.R_bound if whole else math.inf,
        factor=factor,
        method="envelope",
        starts=starts,
        wall_s=time.perf_counter() - began,
    )


def _grow(
    problem: TuningProblem, k: FloatArray, envelope: Envelope, trim: Envelope, *, g: float
) -> tuple[float, Point] | None:
    """Ascend on ever larger parts of the envelope; the reached factor and its point."""
    reached: tuple[float, Point] | None = None
    for _ in range(GROWTHS):
        part = largest_factor(problem.gains(problem.K(k)), envelope, trim, g=g)
        factor = 1.0 if part >= 1.0 else 0.95 * part
        if reached is not None and factor < 1.0 and factor <= reached[0] * 1.005:
            break
        models = jacobian_hull(envelope.scaled(trim, factor), g=g).models()
        if (start := point(problem, models, k)) is None:
            break
        best = ascend(problem, models, start)
        reached, k = (factor, best), best.k
        if factor >= 1.0:
            break
    return reached


# Relative distance within which the bound on the sensitivity counts as active
HELD = 5e-3

Indices: TypeAlias = npt.NDArray[np.intp]

# An uncoupled channel: indices of its inputs and errors in the whole model, and its own problem.
Channel: TypeAlias = tuple[Indices, Indices, TuningProblem]


def tune_worst_case(problems: Sequence[TuningProblem], *, starts: int = STARTS) -> TuningResult:
    """Gains whose smallest R_K over several models is largest, channel by channel.

    `problems`: one for each model, with the same inputs, errors, bounds, limits and structure, and
    no bound on I_K; orders of the models and scalings may differ. R_K of the result is the smallest
    over the models; I_K, E_K and the spectral abscissa are the largest.
    """
    began, whole = time.perf_counter(), problems[0]
    if not all(np.array_equal(case.gain_bounds, whole.gain_bounds) for case in problems):
        raise InputError("`problems` must share their bounds on gains.")
    # The slowest channel sets R_K of a loop. Tuned as a whole, faster channels would be
    # undetermined. So each channel is tuned over all models by itself, and the gains are combined.
    # Limits and E_K of the whole loop, which couple the channels, are checked at the end.
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
        peak = math.exp(max(Peaks(case, FINE).logs(k, fed).max() for case in problems))
        active += ("sensitivity",) * (peak >= (1.0 - HELD) * whole.sensitivity_max)
    gusts, in_noise = whole.objective == "rms", None
    if whole.noise is not None:
        in_noise = NoisyLoop(whole.model, whole.noise).rms(K, fed)
        busiest = np.max(in_noise.rates / whole.noise.rates_max)
        active += ("command_rate",) * bool(busiest >= 1.0 - HELD)
    return TuningResult(
        status="infeasible" if broken else "optimal",
        reason=f"No gains were found inside the bounds on {', '.join(broken)}." if broken else "",
        problem=whole,
        gains=whole.gains(K, (float(fed[0]), float(fed[1])) if fed.any() else NO_FEEDBACK),
        sensitivity=peak,
        errors_in_gusts=GustLoop(whole).errors(K, fed).tolist() if gusts else None,
        in_noise=in_noise,
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
    """Best gains of one channel over its models, number of (agreeing) searches, and feedback."""
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
    """Smallest R_K over the models; 0 if a loop is unstable or an input limit is broken."""
    first = problems[0]
    if (first.slack(k) < -ROUNDING * np.abs(first.limit_rows.bound)).any():
        return 0.0
    return min(
        float(indicators_batch(closed_loops(case.model, first.K(k)), scaling=case.scaling).R_K)
        for case in problems
    )


def channels(problem: TuningProblem) -> tuple[Channel, ...]:
    """The channels of a decoupled problem, in order of first input; else the whole problem."""
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
        noise=problem.noise and problem.noise.of(inputs, errors),
        **bounds,
    )
