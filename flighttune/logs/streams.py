"""Streams with their own clocks and rates on one time base, gaps as NaN, and flight modes."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import RecordingError
from flighttune.logs.read import Stream

# Ending of the angles by quaternion, and whether it rotates front-left-up to east-north-up.
QUATERNIONS = {"q": ("", False), "q_enu": ("", True), "q_cmd": ("_cmd", False)}

# Cost of a rotation between two samples, relative to the cost of a nose off the course.
SMOOTH = 20.0


def with_angles(raw: dict[str, Stream]) -> None:
    """Replace quaternions by roll, pitch and yaw (rad, north-east-down)."""
    for name, (ending, enu) in QUATERNIONS.items():
        phi, theta, psi = (f"{angle}{ending}" for angle in ("phi", "theta", "psi"))
        parts = {part: raw.pop(f"{name}_{part}") for part in "wxyz" if f"{name}_{part}" in raw}
        if not set("xyz") <= set(parts) or phi in raw:
            continue
        t = parts["x"][0]
        x, y, z = (np.interp(t, *parts[part]) for part in "xyz")
        # If the log lacks the part w, its sign is chosen so that attitude is steady and the nose
        # points ahead.
        if "w" in parts:
            w = np.interp(t, *parts["w"])
        else:
            w = np.sqrt(np.maximum(0.0, 1.0 - x * x - y * y - z * z))
            course = np.full(len(t), np.nan)
            if {"v_north", "v_east"} <= set(raw):
                north, east = (np.interp(t, *raw[name]) for name in ("v_north", "v_east"))
                course = np.arctan2(north, east) if enu else np.arctan2(east, north)
            w = w * _signs(w, np.column_stack([x, y, z]), course)
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        yaw = _yaw(w, x, y, z)
        raw[phi] = t, np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        raw[theta] = t, -pitch if enu else pitch
        raw[psi] = t, 0.5 * math.pi - yaw if enu else yaw


def _yaw(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _signs(w: FloatArray, vector: FloatArray, course: FloatArray) -> FloatArray:
    """Signs of w, by dynamic programming over the samples: +1 or -1, shape (n,)."""
    off = [1.0 - np.cos(_yaw(sign * w, *vector.T) - course) for sign in (1.0, -1.0)]
    cost = np.nan_to_num(np.column_stack(off))
    inner, outer = np.sum(vector[1:] * vector[:-1], axis=1), w[1:] * w[:-1]
    stay, flip = (SMOOTH * (1.0 - np.abs(inner + sign * outer)) for sign in (1.0, -1.0))
    total, came = cost[0], np.zeros((len(w), 2), dtype=int)
    for k in range(1, len(w)):
        ways = total + np.array([[stay[k - 1], flip[k - 1]], [flip[k - 1], stay[k - 1]]])
        came[k] = np.argmin(ways, axis=1)
        total = np.min(ways, axis=1) + cost[k]
    state = np.empty(len(w), dtype=int)
    state[-1] = np.argmin(total)
    for k in range(len(w) - 1, 0, -1):
        state[k - 1] = came[k][state[k]]
    return 1.0 - 2.0 * state


# Sample time of the run, s: the fastest stream's sample time within this range.
FINEST_DT, COARSEST_DT = 0.02, 0.2

# A stream has a gap if its samples are further apart than this number of periods.
GAP = 4.0

SLOWEST_S = 5.0  # maximum sample time of roll, s

USUAL = 0.99  # share of the steps between samples from which the period is computed

MAX_SAMPLES = 1_000_000
MAX_BACK = 5.0  # a time stamp may be earlier than the previous one by this, s: messages overtake
MAX_AHEAD = 3600.0  # maximum break of a log, s

ANGLES = ("chi", "chi_ref", "psi", "phi", "theta", "gamma", "gamma_ref", "phi_cmd", "theta_cmd")
# Maximum number of rows of a table that repeat a slow signal.
LONGEST_HOLD = 20

COMMANDS = ("phi_cmd", "theta_cmd", "n_z_cmd", "chi_ref", "gamma_ref")


def on_one_base(
    place: str, raw: dict[str, Stream], start: float, end: float, *, table: bool
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Times from `start` to `end` (s) after the first attitude, and the streams, NaN in gaps."""
    if table and "phi" in raw:
        _check_clock(place, *raw["phi"])
    raw = {name: in_order(place, name, stream) for name, stream in raw.items()}
    raw = {name: stream for name, stream in raw.items() if len(stream[0]) > 1}
    with_angles(raw)
    _with_commands(place, raw)
    if "phi" not in raw:
        column = ", in a column `phi_deg` or by --column phi=COLUMN:UNIT" * table
        raise RecordingError(
            f"{place}: must have roll in numbers at two times or more{column}, got none."
        )
    t_phi = raw["phi"][0]
    periods = {name: _period(t) for name, (t, _) in raw.items()}
    if (period := periods["phi"]) > SLOWEST_S:
        unit = "ms" if period < SLOWEST_S / 1e-3 else "us"
        raise RecordingError(
            f"{place}: must have roll every {SLOWEST_S:g} s, got one every {period:.3g} s; if the "
            f"clock of a table counts {unit}, give --column t=COLUMN:{unit}."
        )
    # The fastest stream sets the sample time; a slower base would average its samples.
    dt = min(max(min(periods.values()), FINEST_DT), COARSEST_DT)
    first, last = t_phi[0] + start, min(t_phi[-1], t_phi[0] + end)
    if not last - first > 10 * dt:
        raise RecordingError(
            f"{place}: the part from {start:g} to {end:g} s must have more than 10 samples, the "
            f"log has {t_phi[-1] - t_phi[0]:.1f} s by its clock."
        )
    ahead = float(np.max(np.diff(t_phi)))
    if ahead > MAX_AHEAD or (last - first) / dt > MAX_SAMPLES:
        at = float(t_phi[np.argmax(np.diff(t_phi))] - t_phi[0])
        raise RecordingError(
            f"{place}: must have at most {MAX_SAMPLES} samples without a break of over "
            f"{MAX_AHEAD:g} s, got {(last - first) / dt:.3g} samples and a break of {ahead:.3g} s "
            f"at {at:.1f} s; a part of it is LOG@START:END, in s."
        )
    # Rounding must not drop the last sample of the part.
    t: FloatArray = first + dt * np.arange(math.floor((last - first) / dt + 1e-6) + 1)
    values = {}
    for name, (times, samples) in raw.items():
        if name in ANGLES:
            samples = np.unwrap(samples)
        fresh = _fresh(samples) if table and name not in COMMANDS else slice(None)
        column = _between(t, times[fresh], samples[fresh], dt)
        column[_far(t, times, GAP * max(periods[name], dt))] = np.nan
        values[name] = np.angle(np.exp(1j * column)) if name in ANGLES else column
    return t - first, values


def _with_commands(place: str, raw: dict[str, Stream]) -> None:
    """Replace errors by commands: the last measured value plus its error."""
    for name in ("phi", "theta", "n_z"):
        if f"{name}_err" in raw and name in raw:
            (t, error), (times, measured) = raw.pop(f"{name}_err"), raw[name]
            last = np.searchsorted(times, t, side="right") - 1
            commanded = np.where(last >= 0, error + measured[np.maximum(last, 0)], np.nan)
            raw[f"{name}_cmd"] = in_order(place, name, (t, commanded))


def _check_clock(place: str, t: FloatArray, phi: FloatArray) -> None:
    """Refuse a clock too coarse for the samples, which would lose most and delay the rest."""
    there = np.isfinite(t) & np.isfinite(phi)
    t, phi = t[there], phi[there]
    same = int(np.count_nonzero((np.diff(t) == 0.0) & (np.diff(phi) != 0.0)))
    if same > 0.5 * len(t) and _period(np.unique(t)) > FINEST_DT:
        raise RecordingError(
            f"{place}: the clock must tell samples apart, got {same} of {len(t)} with the time of "
            "the one before and another roll."
        )


def in_order(place: str, name: str, stream: Stream) -> Stream:
    """A stream without its empty samples, in order of time."""
    t, values = stream
    there = np.isfinite(t) & np.isfinite(values)
    t, values = t[there], values[there]
    if (back := np.diff(t).min(initial=0.0)) < -MAX_BACK:
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
    return float(np.mean(steps[: max(1, round(USUAL * len(steps)))])) if len(steps) else math.inf


def _fresh(values: FloatArray) -> npt.NDArray[np.intp]:
    """Indices of new samples in a table that repeats slow signals in every row."""
    new = np.append(True, np.diff(values) != 0.0)
    starts = np.flatnonzero(new)
    length = np.diff(np.append(starts, len(values)))
    if len(starts) * LONGEST_HOLD < len(values):
        return np.arange(len(values))
    # A signal that is constant for long counts as sampled.
    return np.flatnonzero(new | np.repeat(length > 3.0 * np.median(length), length))


def _between(t: FloatArray, times: FloatArray, values: FloatArray, dt: float) -> FloatArray:
    """Values at each time: means of a faster stream, linear interpolation of a slower stream."""
    if len(times) < 2 or _period(times) > 0.5 * dt:
        return np.interp(t, times, values)
    total = np.concatenate([[0.0], np.cumsum(values)])
    low, high = (np.searchsorted(times, t + side * 0.5 * dt) for side in (-1.0, 1.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (total[high] - total[low]) / (high - low)


def _far(t: FloatArray, times: FloatArray, gap: float) -> npt.NDArray[np.bool_]:
    """Whether each time lies in a gap of a stream, or outside the stream."""
    after = np.searchsorted(times, t)
    inside = (after > 0) & (after < len(times))
    right = np.minimum(after, len(times) - 1)
    wide = times[right] - times[np.maximum(right - 1, 0)] > gap
    near = np.minimum(np.abs(t - times[0]), np.abs(t - times[-1])) <= 0.5 * gap
    return np.where(inside, wide & (times[right] != t), ~near)


# Clipped samples and vibration of the accelerometers, by axis.
CLIPS, VIBRATIONS = ("clip_x", "clip_y", "clip_z"), ("vibe_x", "vibe_y", "vibe_z")
EVENTS = ("mode", "armed", "airborne", "fix", *CLIPS, *VIBRATIONS)

FIX_3D = 3  # satellite fix type from which the position includes height
MAX_VIBRATION = 30.0  # m/s2: largest vibration that ArduPilot's documentation calls acceptable
SHOWN = 6  # maximum number of listed intervals of a mode
NOTHING = np.zeros(0), np.zeros(0)  # an empty stream


class Phase(NamedTuple):
    """A time in which an aircraft was in a mode, armed or airborne, s from the first attitude."""

    name: str
    start: float
    end: float


def phases(
    place: str, raw: dict[str, Stream], modes: dict[str, str], states: dict[str, list[float]]
) -> tuple[list[Phase], list[str]]:
    """Phases of a log, and sentences on its sensors; their streams are removed from `raw`."""
    events = {name: raw.pop(name) for name in EVENTS if name in raw}
    attitude = raw.get("phi", raw.get("q_x", raw.get("q_enu_x")))
    if attitude is None or not np.isfinite(attitude[0]).any():
        return [], []
    zero, last = float(np.nanmin(attitude[0])), float(np.nanmax(attitude[0]))
    events = {name: in_order(place, name, (t - zero, x)) for name, (t, x) in events.items()}
    listed = []
    for name, (low, high) in states.items():
        t, value = events.get(name, NOTHING)
        state = np.where((value >= low) & (value <= high), 1.0, 0.0)
        listed += [Phase(name, *times) for *times, on in _intervals((t, state), last - zero) if on]
    for start, end, value in _intervals(events.get("mode", NOTHING), last - zero):
        listed.append(Phase(modes.get(f"{value:.0f}", f"mode {value:.0f}"), start, end))
    return listed, _of_sensors(events, last - zero)


def in_words(listed: list[Phase]) -> list[str]:
    """A sentence on each mode and state, with its times."""
    sentences = []
    for name in dict.fromkeys(phase.name for phase in listed):
        times = [phase[1:] for phase in listed if phase.name == name]
        total = sum(end - start for start, end in times)
        shown = ", ".join(f"{start:.1f} to {end:.1f}" for start, end in times[:SHOWN])
        more = f" and {len(times) - SHOWN} times more" if len(times) > SHOWN else ""
        sentences.append(f"{name} for {total:.1f} s: {shown} s{more}")
    return sentences


def _intervals(stream: Stream, last: float) -> Iterator[tuple[float, float, float]]:
    """Start and end (s) of each value of a stream that holds its values; none below 0 s."""
    t, values = stream
    changes = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    starts = np.maximum(t[changes], 0.0)
    for start, end, value in zip(starts, np.append(starts, last)[1:], values[changes], strict=True):
        if end > start:
            yield float(start), float(end), float(value)


def _of_sensors(events: Mapping[str, Stream], last: float) -> list[str]:
    """Sentences on clipping and vibration of the accelerometers, and on a lost position."""
    sentences = []
    clips = (events.get(name, NOTHING) for name in CLIPS)
    rises = [(t[1:], np.maximum(np.diff(count), 0.0)) for t, count in clips]
    if count := sum(float(rise.sum()) for _, rise in rises):
        first = min(float(t[rise > 0.0][0]) for t, rise in rises if rise.any())
        sentences.append(f"The accelerometers clipped {count:.0f} times, first at {first:.1f} s.")
    if len(sizes := np.hstack([events.get(name, NOTHING)[1] for name in VIBRATIONS])):
        most = float(sizes.max())
        end = f", where up to {MAX_VIBRATION:g} is acceptable" if most > MAX_VIBRATION else ""
        sentences.append(f"The accelerometers vibrate by up to {most:.3g} m/s²{end}.")
    if lost := [x for x in _intervals(events.get("fix", NOTHING), last) if x[2] < FIX_3D]:
        total = sum(end - start for start, end, _ in lost)
        sentences.append(
            f"Satellites gave no position in three dimensions for {total:.1f} s, first at "
            f"{lost[0][0]:.1f} s."
        )
    return sentences


def inside(t: FloatArray, chosen: list[Phase]) -> FloatArray:
    """1 for a time (s) in one of the phases, else NaN."""
    there = np.any([(t >= start) & (t <= end) for _, start, end in chosen], axis=0)
    return np.where(there, 1.0, np.nan)
