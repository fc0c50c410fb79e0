"""Measures of a tracking error over time; `flighttune.metrics` states the definitions."""

import math
from collections import namedtuple

import numpy as np

from flighttune.arrays import FloatArray

# Errors up to this are none, rad.
NO_STEP = 1e-6

# First error from which on there is a step to time, rad.
SMALLEST_STEP = math.radians(0.1)

SETTLING_BAND = 0.05

# Part of the time from which on a response is taken as steady.
STEADY_FROM = 0.75


# Measures of one channel and their units.
METRICS = {
    "ITAE": "rad s^2",
    "ITAE_mean": "rad s",
    "PT_s": "s",
    "MO_rad": "rad",
    "MS_rad": "rad",
    "ST_rad": "rad",
    "rise_s": "s",
    "settling_s": "s",
    "effort_rms": "rad (chi), 1 (gamma)",
    "saturation_s": "s",
}

# Values of `METRICS`, from `error_measures`; NaN where a measure has no value.
ErrorMeasures = namedtuple("ErrorMeasures", METRICS)


def error_measures(
    t: FloatArray, error: FloatArray, effort: FloatArray, limited: FloatArray
) -> ErrorMeasures:
    """Tracking measures of one channel at the times `t` (two or more, s, from 0).

    `error` (rad) is reference minus actual, `effort` the command minus that of steady flight on the
    reference, and `limited` not zero where a limit holds the command.
    """
    weighted, spacing = t * np.abs(error), t[1:] - t[:-1]
    itae = float(np.sum(spacing * (weighted[1:] + weighted[:-1]))) / 2.0
    steady = error[t >= STEADY_FROM * t[-1]]
    peak_time, overshoot, rise, settling = step_measures(t, error)
    return ErrorMeasures(
        itae,
        itae / t[-1],
        peak_time,
        overshoot,
        float(np.mean(steady)),
        float(np.std(steady)),
        rise,
        settling,
        math.sqrt(np.mean(effort**2)),
        float(np.sum(spacing[limited[:-1] != 0.0])),
    )


def step_measures(t: FloatArray, error: FloatArray) -> tuple[float, float, float, float]:
    """Peak time, overshoot, rise time and settling time."""
    away = np.flatnonzero(np.abs(error) > NO_STEP)
    if len(away) == 0:
        return math.nan, 0.0, math.nan, math.nan
    t, error = t[away[0] :], error[away[0] :]
    step = abs(error[0])
    beyond = -math.copysign(1.0, error[0]) * error
    peak = int(np.argmax(beyond))
    peak_time, overshoot = float(t[peak]), max(0.0, float(beyond[peak]))
    if step < SMALLEST_STEP:
        return peak_time, overshoot, math.nan, math.nan
    to_go = -beyond / step
    rise = first_below(t, to_go, 0.1) - first_below(t, to_go, 0.9)
    # The first sample is outside the band by definition, so there always is a last one.
    settled = int(np.flatnonzero(np.abs(to_go) > SETTLING_BAND)[-1]) + 1
    settling = float(t[settled] - t[0]) if settled < len(t) else math.nan
    return peak_time, overshoot, rise, settling


def first_below(t: FloatArray, to_go: FloatArray, level: float) -> float:
    """Time at which `to_go`, the part of the step still to go, first passes `level`."""
    below = np.flatnonzero(to_go <= level)
    if len(below) == 0:
        return math.nan
    k = int(below[0])
    if k == 0:
        return float(t[0])
    before, after = to_go[k - 1], to_go[k]
    return float(t[k] + (t[k - 1] - t[k]) / (before - after) * (level - after))
