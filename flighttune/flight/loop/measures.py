"""Measures of a tracking error over time; `flighttune.flight.metrics` states the definitions."""

import math
from collections import namedtuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray

# Errors up to this are none, rad.
NO_STEP = 1e-6

# Smallest change that is timed, rad.
SMALLEST_STEP = math.radians(0.1)

# Share of the commanded change within which a response has settled.
SETTLING_BAND = 0.05

# Difference from one sample to the next up to which a reference is at rest, rad or m/s: the
# rounding of a course that has been turned many times shall not move it.
AT_REST = 1e-9

# Part of the time from which on a response is taken as steady.
STEADY_FROM = 0.75

# Measures of one channel.
METRICS = (
    *("ITAE", "ITAE_mean", "PT_s", "MO_rad", "MS_rad", "ST_rad", "rise_s", "settling_s"),
    *("effort_rms", "saturation_s"),
)

# Values of `METRICS`, NaN where a measure has no value; then what only other measures need: the
# largest error, that of the last quarter of the time, the commanded change, and the time from which
# on the reference is at rest.
BESIDE = "peak_rad", "late_rad", "change_rad", "rest_s"
ErrorMeasures = namedtuple("ErrorMeasures", (*METRICS, *BESIDE))


def error_measures(
    t: FloatArray, ref: FloatArray, error: FloatArray, effort: FloatArray, limited: FloatArray
) -> ErrorMeasures:
    """Tracking measures of one channel at the times `t` (two or more, s, from 0)."""
    # `error` is reference minus actual, `effort` the command minus that of steady flight on the
    # reference, and `limited` not zero where a limit holds the command.
    size, spacing, moved = np.abs(error), t[1:] - t[:-1], moves(ref)
    weighted, peak = t * size, float(np.max(size))
    itae = float(np.sum(spacing * (weighted[1:] + weighted[:-1]))) / 2.0
    late = np.searchsorted(t, STEADY_FROM * t[-1])
    steady = error[late:]
    peak_time, overshoot, rise = step_measures(t, error)
    # the largest distance of the reference from where the flight starts
    change = float(np.max(np.abs(ref - ref[0] + error[0])))
    band = SETTLING_BAND * max(change, SMALLEST_STEP)
    if change < SMALLEST_STEP:  # there is no end of a change from which to count
        settling = 0.0 if peak <= band else math.nan
    else:
        settling = settling_time(t, ref, size, band)
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
        peak,
        float(np.max(size[late:])),
        change,
        float(t[moved[-1]]) if len(moved) > 0 else 0.0,
    )


def step_measures(t: FloatArray, error: FloatArray) -> tuple[float, float, float]:
    """Peak time, overshoot and rise time."""
    away = int(np.argmax(np.abs(error) > NO_STEP))  # the first
    if not abs(error[away]) > NO_STEP:
        return math.nan, 0.0, math.nan
    t, error = t[away:], error[away:]
    step = abs(error[0])
    beyond = -math.copysign(1.0, error[0]) * error
    peak = int(np.argmax(beyond))
    peak_time, overshoot = float(t[peak]), max(0.0, float(beyond[peak]))
    if step < SMALLEST_STEP:
        return peak_time, overshoot, math.nan
    to_go = -beyond / step
    return peak_time, overshoot, first_below(t, to_go, 0.1) - first_below(t, to_go, 0.9)


def moves(ref: FloatArray) -> npt.NDArray[np.intp]:
    """Samples at which a reference is not what it was at the sample before."""
    return np.flatnonzero(np.abs(ref[1:] - ref[:-1]) > AT_REST) + 1


def settling_time(t: FloatArray, ref: FloatArray, size: FloatArray, band: float) -> float:
    """Longest time from the end of a change of `ref` until the `size` of the error is in `band`."""
    outside = np.flatnonzero(size > band)
    moved = moves(ref)
    if len(moved) > 0 and size[0] < SMALLEST_STEP:  # nothing is commanded before
        outside = outside[outside >= moved[0]]
    if len(outside) == 0:
        return 0.0
    if outside[-1] == len(t) - 1:
        return math.nan
    if len(moved) == 0:  # a step at t = 0: the same as below, without its arrays
        return float(t[outside[-1] + 1] - t[0])
    # The last change before each sample, and what is at rest after it: errors while the reference
    # moves take no time.
    ends = np.append(np.zeros(1, dtype=np.intp), moved)
    began = ends[np.searchsorted(ends, outside, side="right") - 1]
    resting = np.abs(ref[outside + 1] - ref[outside]) <= AT_REST
    return float(np.max(t[outside + resting] - t[began]))


def first_below(t: FloatArray, to_go: FloatArray, level: float) -> float:
    """Time at which `to_go`, the part of the step still to go, first passes `level`."""
    k = int(np.argmax(to_go <= level))  # the first
    if not to_go[k] <= level:
        return math.nan
    before, after = to_go[k - 1], to_go[k]
    return float(t[k] + (t[k - 1] - t[k]) / (before - after) * (level - after))
