"""Flights for identifying an inner loop, and lags with a delay fitted to them.

Multisines are flown for the fit, and a manoeuvre for validation. Fits to a frequency response and
to a flight are nonlinear least squares over the same parameters: log frequency (rad/s), delay (s),
log damping and log lag (s), as far as the order has them. The data choose the order.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, PlantError
from flighttune.control.inner_loop import NO_DELAY, InnerLag, Order
from flighttune.control.limits import Limits
from flighttune.vehicles.identification.file import Channel, IdentifiedChannel, IdentifiedCondition
from flighttune.vehicles.plants.base import N_X_SIGNALS, FlightCondition, Plant, Stop
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.lagged import rest, transition

Lines: TypeAlias = tuple[npt.NDArray[np.int_], ...]

# Sample time of the commands, s.
DT = 0.01

# Period of the multisines, s: their frequencies are multiples of 2 pi / PERIOD.
PERIOD = 20.0

# Frequencies excited, rad/s.
BAND = 0.3, 20.0

# Target frequencies, which the two channels share alternately.
LINES = 30

# Largest command as a share of the room within the magnitude limits.
PEAK_SHARE = 0.4

# Largest rate of the command as a share of its limit.
RATE_SHARE = 0.8

# Number of random phase sets, of which the set with the largest amplitude is used.
PHASE_DRAWS = 100

# Unit of the 3-2-1-1 steps in roll and load factor, their start, and the duration: s.
CHECK_UNIT = 0.9, 0.8
CHECK_START = 1.0, 2.3
CHECK_DURATION = 12.0

# Rate of n_x commands for an aircraft without a limit, 1/s.
FASTEST = 2.0

# Number of attempts, each with half the previous amplitude.
ATTEMPTS = 4


def multisines(limits: Limits, *, seed: int = 0) -> tuple[FloatArray, Lines]:
    """Return one period of multisines inside the limits, no frequency in both channels.

    Returns the changes of roll (rad) and load factor (1) at every sample, shape (samples, 2), and
    the harmonics of `PERIOD` in each. R. Pintelon and J. Schoukens, *System Identification: A
    Frequency Domain Approach*, 2nd ed., Wiley 2012, chapter 5: random-phase multisines on a
    quasi-logarithmic grid, the channels on interleaved lines so that one experiment shows every
    path.
    """
    harmonics = _harmonics(LINES)
    lines = harmonics[::2], harmonics[1::2]
    generators = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    return np.column_stack([*map(multisine, lines, *command_room(limits), generators)]), lines


def _harmonics(count: int) -> npt.NDArray[np.int_]:
    return np.unique(np.round(np.geomspace(*BAND, count) / (math.tau / PERIOD)).astype(int))


def check_manoeuvre(limits: Limits) -> FloatArray:
    """Return 3-2-1-1 steps of both channels, ramped as fast as the limits allow, for validation."""
    # The pulses of 3, 2, 1 and 1 units are the usual ones of flight test: R. V. Jategaonkar,
    # *Flight Vehicle System Identification*, 2nd ed., AIAA 2015, section 2.3.
    return _checks(*command_room(limits))


def _checks(peaks: npt.ArrayLike, rates: npt.ArrayLike) -> FloatArray:
    t = np.arange(round(CHECK_DURATION / DT), dtype=np.float64) * DT
    steps = zip(np.asarray(peaks), np.asarray(rates), CHECK_START, CHECK_UNIT, strict=False)
    return np.column_stack(
        [ramped(pulses(t, start, unit) * 0.8 * peak, rate) for peak, rate, start, unit in steps]
    )


def thrust_changes(
    plant: JSBSimPlant, condition: FlightCondition, seed: int
) -> tuple[FloatArray, Lines, FloatArray]:
    """Return a multisine of n_x about a trim, its harmonics, and the manoeuvre for validation."""
    plant.start(condition)
    now, least, most = n_x_signals(plant)
    limits = plant.limits
    # Both use a share of the room that limits and throttle leave at the trim.
    peak = PEAK_SHARE * min(min(most, limits.upper[2]) - now, now - max(least, limits.lower[2]))
    rate = min(float(limits.rate_upper[2]), FASTEST)
    if not peak > 0.0:
        raise PlantError(
            f"`n_x` of [limits] must leave room about steady flight at {condition.V_a:g} m/s, got "
            f"{limits.lower[2]:g} to {limits.upper[2]:g} about {now:.3g}, of which the throttle "
            f"gives {least:.3g} to {most:.3g}."
        )
    lines = _harmonics(LINES // 2)
    changes = multisine(lines, peak, rate, np.random.default_rng(seed))
    return changes[:, None], (lines,), _checks([peak], [rate])


def command_room(limits: Limits) -> tuple[FloatArray, FloatArray]:
    """Return the largest usable changes of (phi, n_z) about level flight, and of their rates."""
    level = np.array([0.0, 1.0])
    room = np.minimum(limits.upper - level, level - limits.lower)
    rates = np.minimum(limits.rate_upper, -limits.rate_lower)
    for name, values in (("limits", room), ("limits on rates", rates)):
        if values.shape != (2,) or not (np.isfinite(values).all() and (values > 0.0).all()):
            raise InputError(
                f"`{name}` must be finite and leave room about level flight, got {values.tolist()}."
            )
    return PEAK_SHARE * room, RATE_SHARE * rates


def multisine(
    harmonics: npt.NDArray[np.int_], peak: float, rate: float, rng: np.random.Generator
) -> FloatArray:
    """One period of a sum of sines within `peak` and `rate` (1/s), at every sample."""
    t = np.arange(round(PERIOD / DT), dtype=np.float64) * DT
    angles = np.outer(harmonics * (2.0 * math.pi / PERIOD), t)
    # Amplitudes fall with the root of frequency, a compromise between the two limits.
    amplitudes = 1.0 / np.sqrt(harmonics)
    best, largest = np.zeros_like(t), 0.0
    for _ in range(PHASE_DRAWS):
        phases = rng.uniform(0.0, 2.0 * math.pi, len(harmonics))
        sum_of_sines = amplitudes @ np.cos(angles + phases[:, None])
        fastest = np.abs(np.diff(sum_of_sines, append=sum_of_sines[0])).max() / DT
        if (size := float(min(peak / np.abs(sum_of_sines).max(), rate / fastest))) > largest:
            best, largest = size * sum_of_sines, size
    return best


def pulses(t: FloatArray, start: float, unit: float) -> FloatArray:
    """Plus, minus, plus, minus one for 3, 2, 1 and 1 units."""
    levels = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    return levels[np.searchsorted([0.0, 3.0, 5.0, 6.0, 7.0], (t - start) / unit, side="right")]


def ramped(command: FloatArray, rate: float) -> FloatArray:
    """The command at every sample, limited to `rate` per second."""
    ramped = np.zeros_like(command)
    for k in range(1, len(command)):
        ramped[k] = ramped[k - 1] + min(max(command[k] - ramped[k - 1], -rate * DT), rate * DT)
    return ramped


# Commands and responses of channels in one sample, and the reason of an end.
Sample: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], Stop | None]


def fly_turn(plant: Plant, _: FlightCondition, change: Sequence[float]) -> Sample:
    """Command roll and load factor for a sample."""
    gamma, phi, n_z = plant.observe()[1:4]
    # About the command that holds the present path angle, so that the flight stays near the trim.
    command = change[0], math.cos(gamma) / math.cos(phi) + change[1]
    return command, (phi, n_z), plant.advance(*command, DT)


def fly_thrust(plant: Any, condition: FlightCondition, change: Sequence[float]) -> Sample:
    """Command the longitudinal load factor of a plant for a sample."""
    _, gamma, phi = plant.observe()[:3]
    # About the command that holds the present airspeed and path angle.
    command = (math.sin(gamma) + change[0],)
    lift = math.cos(condition.gamma) / math.cos(phi) + (condition.gamma - gamma)
    return command, n_x_signals(plant)[:1], plant.advance(0.0, lift, DT, *command)


def n_x_signals(plant: Plant) -> tuple[float, ...]:
    """Longitudinal load factor, with its minimum and maximum by the throttle."""
    first = plant.signals.index(N_X_SIGNALS[0])
    return plant.observe()[first : first + len(N_X_SIGNALS)]


def respond(
    plant_factory: Callable[[], Plant],
    condition: FlightCondition,
    changes: FloatArray,
    fly: Callable[[Any, FlightCondition, Sequence[float]], Sample] = fly_turn,
) -> tuple[FloatArray, FloatArray]:
    """Fly changes of the commands; return commands and responses, shape (samples, m), rad and 1."""
    reason = ""
    for attempt in range(ATTEMPTS):
        plant = plant_factory()
        plant.start(condition)
        commanded, measured = [], []
        for change in (0.5**attempt * changes).tolist():
            command, flown, stop = fly(plant, condition, change)
            commanded.append(command)
            measured.append(flown)
            if stop is not None:
                reason = stop.reason
                break
        else:
            return np.array(commanded), np.array(measured)
    of_n_x = " of n_x" if fly is fly_thrust else ""
    raise PlantError(
        f"the excitation{of_n_x} must be flown to its end, but even at {0.5 ** (ATTEMPTS - 1):g} "
        f"of its size: {reason}"
    )


SAMPLES = round(PERIOD / DT)

# Starts of the fit in frequency: delays in s; frequency relative to the corner, damping, and lag
# times frequency.
START_DELAYS = 0.0, 0.1
START_SHAPES = (1.0, 0.7, 0.3), (2.0, 0.5, 1.0)

# Distance between responses below which a higher order is not justified.
FINEST = 1e-3

# Starts of the fit in time, rad/s.
START_FREQUENCIES = 4.0, 12.0
TIME_STARTS = [(math.log(w), 0.01, 0.0, 0.0) for w in (1.5, *START_FREQUENCIES)]

# In time, the second order is chosen if its error is below this share of the first order's error.
SECOND_ORDER_GAIN = 0.95

# A channel with a smaller range of its command, rad or 1, counts as not commanded.
SILENT = 1e-6

# Lag of a channel that was not commanded, which no data show and nothing uses.
UNEXCITED = InnerLag(order=1, natural_frequency=10.0)

# Relative step, improvement and gradient that end the search; with the default of 1e-8 the fifth
# digit of a lag would depend on rounding.
_CONVERGED = 1e-12

Parameters: TypeAlias = tuple[float, float, float, float]
Bounds: TypeAlias = tuple[Parameters, Parameters]
Errors: TypeAlias = Callable[[InnerLag], FloatArray]  # response of a lag minus measured response

_FREQUENCY_BOUNDS: tuple[Parameters, Parameters] = (
    (math.log(0.05), 0.0, math.log(0.2), math.log(1e-3)),
    (math.log(200.0), 1.0, math.log(5.0), math.log(10.0)),
)
_TIME_BOUNDS: tuple[Parameters, Parameters] = (
    (math.log(0.2), 0.0, math.log(0.05), 0.0),
    (math.log(200.0), 0.2, math.log(5.0), 0.0),
)


class FrequencyResponse(NamedTuple):
    """Measured frequency response at the lines of one channel."""

    omega: FloatArray  # (lines,), rad/s
    own: npt.NDArray[np.complex128]  # (lines,), 1: from the command of the channel to its response
    # (lines,), unit of the other channel per unit of this channel: from the command of the channel
    # to the response of the other channel, beyond the latter's response to its own command
    other: npt.NDArray[np.complex128] | None = None


class LagCandidate(NamedTuple):
    """A lag fitted at one order."""

    lag: InnerLag
    residual: float  # 1: root mean square distance from the measured response over the lines
    bic: float  # 1: Bayesian information criterion; the lowest wins


def frequency_responses(
    experiment: tuple[FloatArray, FloatArray], lines: Lines
) -> tuple[FrequencyResponse, ...]:
    """Return the response of each channel, of two at most, from the last period of a multisine."""
    commanded, measured = (np.fft.rfft(signals[-SAMPLES:], axis=0) for signals in experiment)
    omegas = [line.astype(np.float64) * (2.0 * math.pi / PERIOD) for line in lines]
    own = [measured[line, i] / commanded[line, i] for i, line in enumerate(lines)]
    responses = []
    for i, omega in enumerate(omegas):
        # A held command is a sinc with a delay of half a sample.
        hold = np.sinc(omega * DT / (2.0 * math.pi)) * np.exp(-0.5j * omega * DT)
        other = None
        if len(lines) > 1:
            # The other channel is excited at the lines between these. Its response to its own
            # command is subtracted, and the rest is coupling.
            j = 1 - i
            magnitude = np.interp(omega, omegas[j], np.abs(own[j]))
            phase = np.interp(omega, omegas[j], np.unwrap(np.angle(own[j])))
            expected = magnitude * np.exp(1j * phase) * commanded[lines[i], j]
            other = (measured[lines[i], j] - expected) / commanded[lines[i], i] / hold
        responses.append(FrequencyResponse(omega=omega, own=own[i] / hold, other=other))
    return tuple(responses)


def candidates(response: FrequencyResponse) -> tuple[LagCandidate, ...]:
    """Return the best lag of each order, lowest information criterion first."""

    def error(lag: InnerLag) -> FloatArray:
        gap = lag.response(response.omega) - response.own
        return np.concatenate([gap.real, gap.imag])

    # First line with a magnitude below 1/sqrt(2), or the end of the band, rad/s.
    low = np.flatnonzero(np.abs(response.own) < math.sqrt(0.5))
    corner = float(response.omega[low[0] if len(low) else -1])
    starts = {
        (math.log(corner * faster), delay, math.log(damping), math.log(part / corner))
        for delay, (faster, damping, part) in product(START_DELAYS, START_SHAPES)
    }
    fitted, count = [], 2 * len(response.omega)
    for order in get_args(Order):
        lag, rss = best_lag(error, order, sorted(starts), _FREQUENCY_BOUNDS)
        # The criterion is ``N log(rss / N) + k log N`` (G. Schwarz, *Annals of Statistics* 6, 1978)
        # for ``N = 2 lines`` numbers and k parameters: lines, not samples, are independent.
        bic = count * math.log(max(rss / count, FINEST**2)) + (order + 1) * math.log(count)
        fitted.append(LagCandidate(lag=lag, residual=math.sqrt(2.0 * (rss / count)), bic=bic))
    return tuple(sorted(fitted, key=lambda candidate: candidate.bic))


def fitted_lag(
    t: FloatArray, commanded: FloatArray, measured: FloatArray, *, lag: InnerLag | None = None
) -> tuple[InnerLag, float]:
    """Return the lag whose response is nearest to `measured`, and the percentage explained."""
    if np.ptp(commanded) <= SILENT:
        return lag or UNEXCITED, math.nan
    # Samples are evenly spaced, commands are held in between, and the first measured value is at
    # rest.
    dt = float(t[-1] - t[0]) / (len(t) - 1)

    def response(lag: InnerLag) -> FloatArray:
        return lag_response(lag, dt, commanded, float(measured[0]))

    if lag is None:
        starts = [(math.log(w), 0.5 * dt, 0.0, 0.0) for w in START_FREQUENCIES]
        (first, first_rss), (second, second_rss) = (
            best_lag(lambda lag: response(lag) - measured, order, starts, _TIME_BOUNDS)
            for order in (1, 2)
        )
        lag = second if second_rss < SECOND_ORDER_GAIN * first_rss else first
    return lag, fit_percent(measured, response(lag))


def fit_percent(measured: FloatArray, model: FloatArray) -> float:
    """Share of the variance of `measured` (samples,) that `model` explains, in percent."""
    total = float(np.var(measured))
    return 100.0 * (1.0 - float(np.mean((measured - model) ** 2)) / total) if total else -math.inf


def lag_response(lag: InnerLag, dt: float, commanded: FloatArray, start: float) -> FloatArray:
    """Return the exact response of a lag, at rest at `start`, to commands held for `dt` (s)."""
    # The delay is `whole` samples and a fraction: in each sample the previous command still acts
    # for `late` seconds, then the present command. Both enter the state at the sample's end.
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
    # Every state is the sum of earlier inputs, each multiplied by a power of `step`; each pass
    # doubles the number of samples in the sum.
    passed = 1
    while passed < len(states):
        states[passed:] += states[:-passed] @ step.T
        step, passed = step @ step, 2 * passed
    return start + states[:, 0]


def best_lag(
    error: Errors, order: Order, starts: Iterable[Parameters], bounds: Bounds
) -> tuple[InnerLag, float]:
    """Least-squares lag for `error` from the best of `starts`, and the sum of squares."""
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
    """Log frequency (rad/s), delay (s), log damping and log lag (s), as far as they exist."""
    logs = math.log(lag.natural_frequency), lag.delay, math.log(lag.damping), math.log(lag.lag)
    return np.array(logs[: lag.order + 1])


def with_parameters(p: FloatArray, order: Order) -> InnerLag:
    """The lag of an order with `parameters`; a negative delay counts as zero."""
    return InnerLag(
        order=order,
        natural_frequency=math.exp(p[0]),
        delay=max(0.0, float(p[1])),
        damping=math.exp(p[2]) if order > 1 else 1.0,
        lag=math.exp(p[3]) if order > 2 else 1.0,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelIdentification:
    """The flown response of one channel, and the fitted lags."""

    frequency: FrequencyResponse
    candidates: tuple[LagCandidate, ...]  # lags of every order, the chosen lag first
    # Signals of the validation manoeuvre, (samples,)
    commanded: FloatArray
    flown: FloatArray

    @cached_property
    def fit(self) -> FloatArray:
        """Response of the chosen lag in the validation manoeuvre, (samples,)."""
        change = self.commanded - self.commanded[0]
        return self.flown[0] + lag_response(self.candidates[0].lag, DT, change, 0.0)

    @property
    def table(self) -> IdentifiedChannel:
        """The channel for its file."""
        best, other = self.candidates[0], self.frequency.other
        simpler = next(fit.lag for fit in self.candidates if fit.lag.order < 3)
        cross = None if other is None else float(np.abs(other).max())
        percent = fit_percent(self.flown, self.fit)
        return IdentifiedChannel.of(
            best.lag, fit_percent=percent, residual=best.residual, cross=cross, simpler=simpler
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Flights at one condition, and the lags identified from them."""

    trim: FlightCondition  # trim of the flights
    channels: Mapping[Channel, ChannelIdentification]

    @cached_property
    def condition(self) -> IdentifiedCondition:
        """The inner loop at the trim, for its file."""
        channels = {name: channel.table for name, channel in self.channels.items()}
        V_a, gamma, h = self.trim.V_a, self.trim.gamma, self.trim.h
        return IdentifiedCondition.model_construct(V_a=V_a, gamma=gamma, h=h, channels=channels)


# Number of flown periods; the transient of the start decays in the first.
PERIODS = 2


def _channels(
    experiment: tuple[FloatArray, FloatArray], lines: Lines, check: tuple[FloatArray, FloatArray]
) -> list[ChannelIdentification]:
    """The channels of an experiment, validated in a manoeuvre."""
    return [
        ChannelIdentification(frequency=f, candidates=candidates(f), commanded=command, flown=flown)
        for f, command, flown in zip(
            frequency_responses(experiment, lines), check[0].T, check[1].T, strict=True
        )
    ]


def identify_plant(
    plant_factory: Callable[[], Plant], condition: FlightCondition, limits: Limits, *, seed: int = 0
) -> Identification:
    """Identify the inner loop of a plant about a wings-level trim, inside the limits."""
    changes, lines = multisines(limits, seed=seed)
    experiment = respond(plant_factory, condition, np.tile(changes, (PERIODS, 1)))
    check = respond(plant_factory, condition, check_manoeuvre(limits))
    phi, n_z = _channels(experiment, lines, check)
    return Identification(trim=condition, channels={"phi": phi, "n_z": n_z})


def identify_thrust(
    plant_factory: Callable[..., JSBSimPlant], condition: FlightCondition, *, seed: int = 0
) -> ChannelIdentification:
    """Identify the third channel, n_x, about a trim; PlantError if it cannot be flown."""
    fresh = partial(plant_factory, takes_n_x=True)
    changes, lines, check = thrust_changes(fresh(), condition, seed)
    experiment = respond(fresh, condition, np.tile(changes, (PERIODS, 1)), fly_thrust)
    return _channels(experiment, lines, respond(fresh, condition, check, fly_thrust))[0]
