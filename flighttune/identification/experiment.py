"""Flights that identify an inner loop: multisines to fit it, a manoeuvre to check the fit."""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.errors import InputError, PlantError
from flighttune.plants.base import N_X_SIGNALS, FlightCondition, Plant, Stop
from flighttune.plants.jsbsim.plant import JSBSimPlant

Lines: TypeAlias = tuple[npt.NDArray[np.int_], ...]

# Sample time of the commands, s.
DT = 0.01

# Period of the multisines, s: their frequencies are multiples of 2 pi / PERIOD.
PERIOD = 20.0

# Frequencies excited, rad/s.
BAND = 0.3, 20.0

# Frequencies aimed at, shared by the two channels in turn.
LINES = 30

# Largest command as a share of what the magnitude limits leave.
PEAK_SHARE = 0.4

# Largest rate of the command as a share of its limit.
RATE_SHARE = 0.8

# Random phases drawn, of which those that allow the largest amplitude are taken.
PHASE_DRAWS = 100

# Unit of the 3-2-1-1 steps in roll and load factor, their start, and the duration: s.
CHECK_UNIT = 0.9, 0.8
CHECK_START = 1.0, 2.3
CHECK_DURATION = 12.0

# Rate of n_x that is commanded where the aircraft has no limit on it, 1/s.
FASTEST = 2.0

# Attempts, each with half the amplitude of the one before.
ATTEMPTS = 4


def multisines(limits: Limits, *, seed: int = 0) -> tuple[FloatArray, Lines]:
    """Return one period of multisines inside the limits, no frequency in both channels.

    The seed draws many sets of phases; the set that lets the sines be largest is taken. R. Pintelon
    and J. Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed., Wiley 2012,
    chapter 5: random-phase multisines on a quasi-logarithmic grid, the channels on interleaved
    lines so that one experiment shows every path.

    Returns the changes of roll (rad) and load factor (1) at every sample, shape (samples, 2), and
    the harmonics of `PERIOD` in roll and in load factor.
    """
    harmonics = _harmonics(LINES)
    lines = harmonics[::2], harmonics[1::2]
    generators = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    columns = map(multisine, lines, *command_room(limits), generators)
    return np.column_stack(list(columns)), lines


def _harmonics(count: int) -> npt.NDArray[np.int_]:
    return np.unique(np.round(np.geomspace(*BAND, count) / (math.tau / PERIOD)).astype(int))


def check_manoeuvre(limits: Limits) -> FloatArray:
    """Return 3-2-1-1 steps of both channels, ramped as fast as the limits allow, for validation.

    The pulses of 3, 2, 1 and 1 units are the usual ones of flight test: R. V. Jategaonkar, *Flight
    Vehicle System Identification*, 2nd ed., AIAA 2015, section 2.3.
    """
    return _checks(*command_room(limits))


def _checks(peaks: npt.ArrayLike, rates: npt.ArrayLike) -> FloatArray:
    t = np.arange(round(CHECK_DURATION / DT), dtype=np.float64) * DT
    steps = zip(np.asarray(peaks), np.asarray(rates), CHECK_START, CHECK_UNIT, strict=False)
    columns = [
        ramped(pulses(t, start, unit) * 0.8 * peak, rate) for peak, rate, start, unit in steps
    ]
    return np.column_stack(columns)


def thrust_changes(
    plant: JSBSimPlant, condition: FlightCondition, seed: int
) -> tuple[FloatArray, Lines, FloatArray]:
    """Return a multisine of n_x about a trim, its harmonics, and the manoeuvre for validation.

    They keep to a share of what the limits and the throttle leave at the trim.
    """
    plant.start(condition)
    now, least, most = n_x_signals(plant)
    limits = plant.limits
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
    """Return the largest changes of (phi, n_z) about level flight, and of their rates, to use."""
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
    """Amplitudes fall with the root of frequency: between peak and rate limit."""
    t = np.arange(round(PERIOD / DT), dtype=np.float64) * DT
    angles = np.outer(harmonics * (2.0 * math.pi / PERIOD), t)
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
    since = (t - start) / unit
    levels = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    return levels[np.searchsorted([0.0, 3.0, 5.0, 6.0, 7.0], since, side="right")]


def ramped(command: FloatArray, rate: float) -> FloatArray:
    ramped = np.zeros_like(command)
    for k in range(1, len(command)):
        step = command[k] - ramped[k - 1]
        ramped[k] = ramped[k - 1] + min(max(step, -rate * DT), rate * DT)
    return ramped


# Commands and responses of some channels, and why the flight ended, of one sample.
Sample: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], Stop | None]


def fly_turn(plant: Plant, _: FlightCondition, change: Sequence[float]) -> Sample:
    """Command roll and load factor for a sample."""
    gamma, phi, n_z = plant.observe()[1:4]
    # About what holds the present path angle: the flight stays near the trim.
    command = change[0], math.cos(gamma) / math.cos(phi) + change[1]
    return command, (phi, n_z), plant.advance(*command, DT)


def fly_thrust(plant: Any, condition: FlightCondition, change: Sequence[float]) -> Sample:
    """Command the longitudinal load factor of a plant that takes it for a sample."""
    _, gamma, phi = plant.observe()[:3]
    # About what holds the present airspeed and path angle.
    command = (math.sin(gamma) + change[0],)
    lift = math.cos(condition.gamma) / math.cos(phi) + (condition.gamma - gamma)
    flown = n_x_signals(plant)[:1]
    return command, flown, plant.advance(0.0, lift, DT, *command)


def n_x_signals(plant: Plant) -> tuple[float, ...]:
    """Longitudinal load factor, and the least and most that the throttle gives."""
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
