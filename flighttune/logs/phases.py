"""Flight modes of a log, when its aircraft was armed and airborne, and what its sensors show."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.logs.read import Stream
from flighttune.logs.time_base import in_order

# Least and largest value at which an aircraft is armed and airborne, by kind of log.
STATES = {
    "ULog": {"armed": (2, 2), "airborne": (0, 0)},
    "DataFlash": {"armed": (1, 1), "airborne": (1, 1)},
    "MAVLink": {"armed": (128, 255), "airborne": (2, 4)},
}
AXES = "xyz"
EVENTS = (
    "mode",
    "armed",
    "airborne",
    "fix",
    *(f"{x}_{axis}" for x in ("clip", "vibe") for axis in AXES),
)

FIX_3D = 3  # fix of a receiver of satellites from which on it has a position with height
MAX_VIBRATION = 30.0  # m/s2, up to which ArduPilot's documentation takes vibration as acceptable
SHOWN = 6  # intervals of a mode that are listed
NOTHING = np.zeros(0), np.zeros(0)  # an empty stream


class Phase(NamedTuple):
    """A time in which an aircraft was in a mode, armed or airborne, s from the first attitude."""

    name: str
    start: float
    end: float


def phases(
    place: str, kind: str, raw: dict[str, Stream], modes: Mapping[str, str]
) -> tuple[list[Phase], list[str]]:
    """Phases of a log, and sentences on what is odd; their streams are taken out of `raw`."""
    events = {name: raw.pop(name) for name in EVENTS if name in raw}
    attitude = raw.get("phi", raw.get("q_x", raw.get("q_enu_x")))
    if attitude is None or not np.isfinite(attitude[0]).any():
        return [], []
    zero, last = float(np.nanmin(attitude[0])), float(np.nanmax(attitude[0]))
    events = {name: in_order(place, name, (t - zero, x)) for name, (t, x) in events.items()}
    listed = []
    for name, (low, high) in STATES.get(kind, {}).items():
        t, value = events.get(name, NOTHING)
        state = np.where((value >= low) & (value <= high), 1.0, 0.0)
        listed += [Phase(name, *times) for *times, on in _intervals((t, state), last - zero) if on]
    for start, end, value in _intervals(events.get("mode", NOTHING), last - zero):
        listed.append(Phase(modes.get(f"{value:.0f}", f"mode {value:.0f}"), start, end))
    return listed, _odd(events, last - zero)


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
    """Start and end (s) of each value of a stream that holds it until the next; none below 0 s."""
    t, values = stream
    changes = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    starts = np.maximum(t[changes], 0.0)
    for start, end, value in zip(starts, np.append(starts, last)[1:], values[changes], strict=True):
        if end > start:
            yield float(start), float(end), float(value)


def _odd(events: Mapping[str, Stream], last: float) -> list[str]:
    """Sentences on clipping and vibration of the accelerometers, and on a lost position."""
    sentences = []
    clips = [events.get(f"clip_{axis}", NOTHING) for axis in AXES]
    rises = [(t[1:], np.maximum(np.diff(count), 0.0)) for t, count in clips]
    if count := sum(float(rise.sum()) for _, rise in rises):
        first = min(float(t[rise > 0.0][0]) for t, rise in rises if rise.any())
        sentences.append(f"accelerometers clipped {count:.0f} times, first at {first:.1f} s")
    if len(sizes := np.hstack([events.get(f"vibe_{axis}", NOTHING)[1] for axis in AXES])):
        most = float(sizes.max())
        end = f", where up to {MAX_VIBRATION:g} is acceptable" if most > MAX_VIBRATION else ""
        sentences.append(f"vibration of the accelerometers up to {most:.3g} m/s2{end}")
    if lost := [x for x in _intervals(events.get("fix", NOTHING), last) if x[2] < FIX_3D]:
        total = sum(end - start for start, end, _ in lost)
        sentences.append(
            f"no position in three dimensions from satellites for {total:.1f} s, first at "
            f"{lost[0][0]:.1f} s"
        )
    return sentences


def inside(t: FloatArray, chosen: list[Phase]) -> FloatArray:
    """1 where a time (s) lies in one of some phases, NaN elsewhere."""
    there = np.any([(t >= start) & (t <= end) for _, start, end in chosen], axis=0)
    return np.where(there, 1.0, np.nan)
