"""Flights that identify an inner loop: multisines to fit it, a manoeuvre to check the fit."""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.errors import InputError, PlantError
from flighttune.plants.base import FlightCondition, Plant

Lines: TypeAlias = tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]

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
    base = 2.0 * math.pi / PERIOD
    ideal = np.geomspace(BAND[0], BAND[1], LINES) / base
    harmonics = np.unique(np.round(ideal).astype(int))
    lines = harmonics[::2], harmonics[1::2]
    generators = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    columns = map(multisine, lines, *command_room(limits), generators)
    return np.column_stack(list(columns)), lines


def check_manoeuvre(limits: Limits) -> FloatArray:
    """Return 3-2-1-1 steps of both channels, ramped as fast as the limits allow, for validation.

    The pulses of 3, 2, 1 and 1 units are the usual ones of flight test: R. V. Jategaonkar, *Flight
    Vehicle System Identification*, 2nd ed., AIAA 2015, section 2.3.
    """
    peaks, rates = command_room(limits)
    t = np.arange(round(CHECK_DURATION / DT), dtype=np.float64) * DT
    columns = [
        ramped(pulses(t, CHECK_START[i], CHECK_UNIT[i]) * 0.8 * peaks[i], rates[i])
        for i in range(2)
    ]
    return np.column_stack(columns)


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
        size = float(min(peak / np.abs(sum_of_sines).max(), rate / fastest))
        if size > largest:
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


def respond(
    plant_factory: Callable[[], Plant], condition: FlightCondition, changes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fly changes of the commands; return commands and responses, shape (samples, 2), rad and 1."""
    reason = ""
    for attempt in range(ATTEMPTS):
        plant = plant_factory()
        plant.start(condition)
        commanded, measured = [], []
        for phi_cmd, n_z_change in (0.5**attempt * changes).tolist():
            _, gamma, phi, n_z = plant.observe()[:4]
            # about what holds the present path angle: the flight stays near the trim
            n_z_cmd = math.cos(gamma) / math.cos(phi) + n_z_change
            commanded.append((phi_cmd, n_z_cmd))
            measured.append((phi, n_z))
            stop = plant.advance(phi_cmd, n_z_cmd, DT)
            if stop is not None:
                reason = stop.reason
                break
        else:
            return np.array(commanded), np.array(measured)
    raise PlantError(
        f"the excitation must be flown to its end, but even at {0.5 ** (ATTEMPTS - 1):g} of its "
        f"size: {reason}"
    )
