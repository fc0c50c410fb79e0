"""Streams with clocks and rates of their own on one time base, gaps as NaN."""

import math

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import RecordingError
from flighttune.logs.attitude import with_angles
from flighttune.logs.read import Stream

# Sample time of the run, s: that of the log's fastest stream within this range.
FINEST_DT, COARSEST_DT = 0.02, 0.2

# A stream has a gap where its samples are further apart than this many of its periods.
GAP = 4.0

USUAL = 0.99  # share of the steps between samples that make a period

MAX_SAMPLES = 1_000_000
MAX_BACK = 5.0  # a stamp may be this much before the one in front of it, s: messages overtake
MAX_AHEAD = 3600.0  # longest break of a log, s

ANGLES = ("chi", "chi_ref", "psi", "phi", "theta", "gamma", "gamma_ref", "phi_cmd")
# Rows of a table for which a slow signal may be repeated.
LONGEST_HOLD = 20

COMMANDS = ("phi_cmd", "n_z_cmd", "chi_ref", "gamma_ref")


def on_one_base(
    place: str, raw: dict[str, Stream], start: float, end: float, *, table: bool
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Times (s) from the start, and the streams at them; NaN in gaps.

    `start` and `end` (s) count from the first attitude; of a `table` repeated samples are dropped.
    Raises RecordingError if there is no attitude, or a clock jumps.
    """
    raw = {name: _in_order(place, name, stream) for name, stream in raw.items()}
    raw = {name: stream for name, stream in raw.items() if len(stream[0]) > 1}
    with_angles(raw)
    for name in ("phi", "n_z"):
        if f"{name}_err" in raw and name in raw:
            t, error = raw.pop(f"{name}_err")
            commanded = t, error + _held(t, *raw[name])
            raw[f"{name}_cmd"] = _in_order(place, name, commanded)
    if "phi" not in raw:
        raise RecordingError(f"{place}: must have roll, got a log without attitude.")
    t_phi = raw["phi"][0]
    periods = {name: _period(t) for name, (t, _) in raw.items()}
    # The fastest stream sets the sample time: on a slower base its samples would be means.
    dt = min(max(min(periods.values()), FINEST_DT), COARSEST_DT)
    first, last = t_phi[0] + start, min(t_phi[-1], t_phi[0] + end)
    if not last - first > 10 * dt:
        raise RecordingError(
            f"{place}: the part from {start:g} to {end:g} s must have more than 10 samples, the "
            f"log has {t_phi[-1] - t_phi[0]:.1f} s."
        )
    ahead = float(np.max(np.diff(t_phi)))
    if ahead > MAX_AHEAD or (last - first) / dt > MAX_SAMPLES:
        at = float(t_phi[np.argmax(np.diff(t_phi))] - t_phi[0])
        raise RecordingError(
            f"{place}: must have at most {MAX_SAMPLES} samples without a break of over "
            f"{MAX_AHEAD:g} s, got {(last - first) / dt:.3g} samples and a break of {ahead:.3g} s "
            f"at {at:.1f} s; a part of it is LOG@START:END, in s."
        )
    # Rounding must not take away the sample at the end of the part.
    t: FloatArray = first + dt * np.arange(math.floor((last - first) / dt + 1e-6) + 1)
    values = {}
    for name, (times, samples) in raw.items():
        gap = GAP * max(periods[name], dt)
        if name in ANGLES:
            samples = np.unwrap(samples)
        fresh = _fresh(samples) if table and name not in COMMANDS else slice(None)
        column = _between(t, times[fresh], samples[fresh], dt)
        column[_far(t, times, gap)] = np.nan
        values[name] = np.angle(np.exp(1j * column)) if name in ANGLES else column
    return t - first, values


def _in_order(place: str, name: str, stream: Stream) -> Stream:
    """A stream without its empty samples, in the order of time."""
    t, values = stream
    there = np.isfinite(t) & np.isfinite(values)
    t, values = t[there], values[there]
    back = np.diff(t).min(initial=0.0)
    if back < -MAX_BACK:
        at = float(t[np.argmin(np.diff(t))] - t[0])
        raise RecordingError(
            f"{place}: the clock of `{name}` must run forward, got a jump by {back:.3g} s at "
            f"{at:.1f} s."
        )
    t, order = np.unique(t, return_index=True)
    return t, values[order]


def _period(t: FloatArray) -> float:
    """Mean time between samples, s, without the longest breaks: messages may come in bursts."""
    steps = np.sort(np.diff(t))
    return float(np.mean(steps[: max(1, round(USUAL * len(steps)))]))


def _held(t: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """Values of the last sample before each time; NaN before the first."""
    place = np.searchsorted(times, t, side="right") - 1
    return np.where(place >= 0, values[np.maximum(place, 0)], np.nan)


def _fresh(values: FloatArray) -> npt.NDArray[np.intp]:
    """Places of samples that are new, in a table that repeats slow signals in every row."""
    new = np.append(True, np.diff(values) != 0.0)
    starts = np.flatnonzero(new)
    length = np.diff(np.append(starts, len(values)))
    if len(starts) * LONGEST_HOLD < len(values):
        return np.arange(len(values))
    # A signal that rests for long does not wait for a sample.
    resting = np.repeat(length > 3.0 * np.median(length), length)
    return np.flatnonzero(new | resting)


def _between(t: FloatArray, times: FloatArray, values: FloatArray, dt: float) -> FloatArray:
    """Values at each time: means of a stream that is faster, straight lines of a slower one."""
    if len(times) < 2 or _period(times) > 0.5 * dt:
        return np.interp(t, times, values)
    total = np.concatenate([[0.0], np.cumsum(values)])
    low, high = (np.searchsorted(times, t + side * 0.5 * dt) for side in (-1.0, 1.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (total[high] - total[low]) / (high - low)


def _far(t: FloatArray, times: FloatArray, gap: float) -> npt.NDArray[np.bool_]:
    """Which times lie in a gap of a stream, or outside it."""
    after = np.searchsorted(times, t)
    inside = (after > 0) & (after < len(times))
    right = np.minimum(after, len(times) - 1)
    wide = times[right] - times[np.maximum(right - 1, 0)] > gap
    near = np.minimum(np.abs(t - times[0]), np.abs(t - times[-1])) <= 0.5 * gap
    return np.where(inside, wide & (times[right] != t), ~near)
