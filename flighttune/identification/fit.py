"""Lags with a delay, fitted to a frequency response or to a flight; the data choose the order.

Both fits are nonlinear least squares over the same parameters: log frequency (rad/s), delay (s),
log damping and log lag (s), as many of them as the order needs.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import NO_DELAY, InnerLag, Order
from flighttune.errors import InputError
from flighttune.identification.experiment import DT, PERIOD, Lines
from flighttune.identification.file import (
    Channel,
    IdentifiedChannel,
    IdentifiedCondition,
    LagTable,
    lag_table,
)
from flighttune.plants.base import FlightCondition
from flighttune.plants.lagged import rest, transition

SAMPLES = round(PERIOD / DT)

# Starts of the fit in frequency: delays in s; frequency over the corner, damping, lag times it.
START_DELAYS = 0.0, 0.1
START_SHAPES = (1.0, 0.7, 0.3), (2.0, 0.5, 1.0)

# Distance between responses below which an order does not earn a further parameter.
FINEST = 1e-3

# Starts of the fit in time, rad/s.
START_FREQUENCIES = 4.0, 12.0
TIME_STARTS = [(math.log(w), 0.01, 0.0, 0.0) for w in (1.5, *START_FREQUENCIES)]

# In time, the second order is taken where it leaves less than this share of the first's error.
SECOND_ORDER_GAIN = 0.95

# Range of a command, rad or 1, up to which the channel counts as not commanded.
SILENT = 1e-6

# Lag of a channel that was not commanded: no data show it, and nothing depends on it.
UNEXCITED = InnerLag(order=1, natural_frequency=10.0)

# Relative step, gain and gradient that end the search: the default of 1e-8 leaves a lag whose fifth
# digit depends on rounding.
_CONVERGED = 1e-12

Parameters: TypeAlias = tuple[float, float, float, float]
Bounds: TypeAlias = tuple[Parameters, Parameters]

_FREQUENCY_BOUNDS: tuple[Parameters, Parameters] = (
    (math.log(0.05), 0.0, math.log(0.2), math.log(1e-3)),
    (math.log(200.0), 1.0, math.log(5.0), math.log(10.0)),
)
_TIME_BOUNDS: tuple[Parameters, Parameters] = (
    (math.log(0.2), 0.0, math.log(0.05), 0.0),
    (math.log(200.0), 0.2, math.log(5.0), 0.0),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """Measured frequency response at the lines of one channel."""

    omega: FloatArray  # (lines,), rad/s
    own: npt.NDArray[np.complex128]  # (lines,), 1: from the command of the channel to its response
    # (lines,), unit of the other channel over that of this one: from the command of the channel to
    # the response of the other one, beyond the response of the other one to its own command
    other: npt.NDArray[np.complex128] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LagCandidate:
    """A lag fitted at one order."""

    lag: InnerLag
    residual: float  # 1: root mean square distance from the measured response over the lines
    bic: float  # 1: Bayesian information criterion; the lowest wins


def frequency_responses(
    experiment: tuple[FloatArray, FloatArray], lines: Lines
) -> tuple[FrequencyResponse, ...]:
    """Return the response of each channel, of two at most, from the last period of a multisine."""
    if len(experiment[1]) < 2 * SAMPLES or not all(len(line) for line in lines):
        raise InputError(
            f"`experiment` must be two periods of {PERIOD:g} s of multisines, got "
            f"{len(experiment[1]) * DT:g} s."
        )
    commanded, measured = (np.fft.rfft(signals[-SAMPLES:], axis=0) for signals in experiment)
    omegas = [line.astype(np.float64) * (2.0 * math.pi / PERIOD) for line in lines]
    own = [measured[line, i] / commanded[line, i] for i, line in enumerate(lines)]
    responses = []
    for i, omega in enumerate(omegas):
        # A held command is a sinc, late by half a sample.
        hold = np.sinc(omega * DT / (2.0 * math.pi)) * np.exp(-0.5j * omega * DT)
        other = None
        if len(lines) > 1:
            # The other channel is excited at the lines between these: its answer to its command
            # is taken off, and what is left is coupling.
            j = 1 - i
            expected = _interpolated(omega, omegas[j], own[j]) * commanded[lines[i], j]
            other = (measured[lines[i], j] - expected) / commanded[lines[i], i] / hold
        responses.append(FrequencyResponse(omega=omega, own=own[i] / hold, other=other))
    return tuple(responses)


def candidates(response: FrequencyResponse) -> tuple[LagCandidate, ...]:
    """Return the best lag of each order, the lowest information criterion first."""
    # The criterion is ``N log(rss / N) + k log N`` (G. Schwarz, *Annals of Statistics* 6, 1978) for
    # ``N = 2 lines`` numbers and k parameters: lines, not samples of time, are independent.
    fitted = [_fitted(response, order) for order in get_args(Order)]
    return tuple(sorted(fitted, key=lambda candidate: candidate.bic))


def fitted_lag(
    t: FloatArray, commanded: FloatArray, measured: FloatArray, *, lag: InnerLag | None = None
) -> tuple[InnerLag, float]:
    """Return the lag whose response is nearest to `measured`, and the percentage explained.

    The samples are evenly spaced, commands held in between, and the first measured value is taken
    as at rest. A `lag` from elsewhere is kept; `UNEXCITED` and NaN where nothing was commanded.
    """
    if not len(t) > 10:
        raise InputError(f"`t` must have more than 10 samples, got {len(t)}.")
    if np.ptp(commanded) <= SILENT:
        return lag or UNEXCITED, math.nan
    dt = float(t[-1] - t[0]) / (len(t) - 1)

    def response(lag: InnerLag) -> FloatArray:
        return lag_response(lag, dt, commanded, float(measured[0]))

    if lag is None:
        starts = [(math.log(w), 0.5 * dt, 0.0, 0.0) for w in START_FREQUENCIES]
        lag = best_of_orders(lambda lag: response(lag) - measured, starts, _TIME_BOUNDS)
    return lag, fit_percent(measured, response(lag))


def best_of_orders(
    error: Callable[[InnerLag], FloatArray], starts: Sequence[Parameters], bounds: Bounds
) -> InnerLag:
    """The `best_lag` of first order, or of second where that is worth it."""
    (first, first_rss), (second, second_rss) = (
        best_lag(error, order, starts, bounds) for order in (1, 2)
    )
    return second if second_rss < SECOND_ORDER_GAIN * first_rss else first


def fit_percent(measured: FloatArray, model: FloatArray) -> float:
    """Share of the variance of `measured` (samples,) that `model` explains, in percent."""
    total = float(np.var(measured))
    return 100.0 * (1.0 - float(np.mean((measured - model) ** 2)) / total) if total else -math.inf


def lag_response(lag: InnerLag, dt: float, commanded: FloatArray, start: float) -> FloatArray:
    """Return the exact response of a lag, at rest at `start`, to commands held for `dt` (s)."""
    # The delay is `whole` samples and a fraction: over each sample the command before it acts for
    # `late` seconds still, then the one of the sample. Both enter the state at its end.
    whole = math.floor(lag.delay / dt)
    late = lag.delay - whole * dt
    step, after = transition(lag, dt), transition(lag, dt - late)
    at_rest = rest(lag)
    new = at_rest - after @ at_rest
    old = after @ (at_rest - transition(lag, late) @ at_rest)
    change = np.concatenate([np.zeros(whole), commanded - start])[: len(commanded)]
    states = np.zeros((len(change), lag.order))
    states[1:] = np.outer(change[:-1], new)
    states[2:] += np.outer(change[:-2], old)
    # Every state is the sum of what entered before, each carried on by a power of `step`: twice as
    # many samples of it in each pass.
    passed = 1
    while passed < len(states):
        states[passed:] += states[:-passed] @ step.T
        step, passed = step @ step, 2 * passed
    return start + states[:, 0]


def _fitted(response: FrequencyResponse, order: Order) -> LagCandidate:
    size, count = order + 1, 2 * len(response.omega)

    def error(lag: InnerLag) -> FloatArray:
        gap = lag.response(response.omega) - response.own
        return np.concatenate([gap.real, gap.imag])

    corner = _corner(response)
    starts = {
        (math.log(corner * faster), delay, math.log(damping), math.log(part / corner))
        for delay, (faster, damping, part) in product(START_DELAYS, START_SHAPES)
    }
    lag, rss = best_lag(error, order, sorted(starts), _FREQUENCY_BOUNDS)
    mean_square = rss / count
    return LagCandidate(
        lag=lag,
        residual=math.sqrt(2.0 * mean_square),
        bic=count * math.log(max(mean_square, FINEST**2)) + size * math.log(count),
    )


def best_lag(
    error: Callable[[InnerLag], FloatArray],
    order: Order,
    starts: Iterable[Parameters],
    bounds: Bounds,
) -> tuple[InnerLag, float]:
    """Lag of the least squares of `error` from the best of `starts`, and the sum of squares."""
    from scipy.optimize import least_squares

    lower, upper = (np.array(edge[: order + 1]) for edge in bounds)
    inside = [np.clip(start[: order + 1], lower + 1e-3, upper - 1e-3) for start in starts]
    tight = dict.fromkeys(("xtol", "ftol", "gtol"), _CONVERGED)

    def at(p: FloatArray) -> FloatArray:
        return error(with_parameters(p, order))

    runs = [least_squares(at, start, bounds=(lower, upper), **tight) for start in inside]
    best = min(runs, key=lambda run: run.cost)
    lag = with_parameters(best.x, order)
    return lag if lag.delay >= NO_DELAY else replace(lag, delay=0.0), 2.0 * float(best.cost)


def parameters(lag: InnerLag) -> FloatArray:
    """Log frequency (rad/s), delay (s), log damping and log lag (s), as the order has them."""
    logs = math.log(lag.natural_frequency), lag.delay, math.log(lag.damping), math.log(lag.lag)
    return np.array(logs[: lag.order + 1])


def with_parameters(p: FloatArray, order: Order) -> InnerLag:
    """The lag of an order with `parameters`; a negative delay is taken as none."""
    return InnerLag(
        order=order,
        natural_frequency=math.exp(p[0]),
        delay=max(0.0, float(p[1])),
        damping=math.exp(p[2]) if order > 1 else 1.0,
        lag=math.exp(p[3]) if order > 2 else 1.0,
    )


def _corner(response: FrequencyResponse) -> float:
    """First line with a magnitude below 1/sqrt(2), or the end of the band, rad/s."""
    low = np.flatnonzero(np.abs(response.own) < math.sqrt(0.5))
    return float(response.omega[low[0]] if len(low) else response.omega[-1])


def _interpolated(
    omega_new: FloatArray, omega: FloatArray, values: npt.NDArray[np.complex128]
) -> npt.NDArray[np.complex128]:
    magnitude = np.interp(omega_new, omega, np.abs(values))
    phase = np.interp(omega_new, omega, np.unwrap(np.angle(values)))
    return np.asarray(magnitude * np.exp(1j * phase), dtype=complex)


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelIdentification:
    """The response of one channel as flown, and the lags fitted to it."""

    frequency: FrequencyResponse
    candidates: tuple[LagCandidate, ...]  # of every order, the chosen one first
    # Of the manoeuvre for validation, (samples,)
    commanded: FloatArray
    flown: FloatArray

    @cached_property
    def fit(self) -> FloatArray:
        """Response of the chosen lag in the manoeuvre, (samples,)."""
        change = self.commanded - self.commanded[0]
        return self.flown[0] + lag_response(self.candidates[0].lag, DT, change, 0.0)

    @property
    def table(self) -> IdentifiedChannel:
        """The channel, as its file has it."""
        best, other = self.candidates[0], self.frequency.other
        simpler = next(fit.lag for fit in self.candidates if fit.lag.order < 3)
        # Not checked: rounding may put a lag beyond the range that it was fitted in.
        return IdentifiedChannel.model_construct(
            **lag_table(best.lag),
            fit_percent=fit_percent(self.flown, self.fit),
            residual=best.residual,
            cross=None if other is None else float(np.abs(other).max()),
            simpler=LagTable.model_construct(**lag_table(simpler)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Flights at one condition, and the lags identified from them."""

    trim: FlightCondition  # about which was flown
    channels: Mapping[Channel, ChannelIdentification]

    @cached_property
    def condition(self) -> IdentifiedCondition:
        """The inner loop at the trim, as its file has it."""
        channels = {name: channel.table for name, channel in self.channels.items()}
        V_a, gamma, h = self.trim.V_a, self.trim.gamma, self.trim.h
        return IdentifiedCondition.model_construct(V_a=V_a, gamma=gamma, h=h, channels=channels)
