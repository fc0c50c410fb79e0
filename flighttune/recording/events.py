"""Lanes and events of flights: limits that hold, steps, gusts, settling, ends."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.metrics import channel_metrics
from flighttune.plants.weather import WIND
from flighttune.present.names import CHANNEL_NAMES
from flighttune.present.palette import LIMIT, rgb
from flighttune.recording.entities import END, EVENTS, DrawnRun, lane_name, times
from flighttune.simulate.measures import NO_STEP
from flighttune.simulate.run import Run

COMMANDS = {"phi": "roll", "n_z": "load-factor"}

LIGHTER = 0.3  # of the way to white: text on the dark ground of the viewer, or on a light one

MAX_HOLDS = 20  # a command held by its limit more often is listed with the number only
WIND_CHANGE = 0.5  # m/s; a change of the wind since the start beyond this is a gust

# Signals that the settling time is computed from.
MEASURED = (
    *("chi_err", "gamma_err", "gamma_ref"),
    *("phi_cmd", "n_z_cmd", "phi_limited", "n_z_limited"),
)

# Log level of each sort of event: the viewer has no other classes.
SORTS = {"end": "ERROR", "limit": "WARN", "wind": "INFO", "track": "INFO"}


FREE, ENDED = "within limits", "ended"
# Code of the limits that act: a sum of signals times factors (0 free, 1 magnitude, 2 rate).
LIMITED = {"phi_limited": 1, "n_z_limited": 3}
HOLDING = [
    ", ".join(filter(None, (roll, n_z))) or FREE
    for n_z in ("", "n_z", "n_z rate")
    for roll in ("", "roll", "roll rate")
]
RATE = 2.0  # of a ``*_limited`` signal
SHORTEST = 0.3  # s; shorter pieces are drawn as the one before: sensor noise would fragment a lane
DIMMED = 0.45  # brightness of a lane while a limit holds a command


@dataclass(frozen=True, slots=True)
class Event:
    """An event at a time of a run."""

    t: float  # s
    sort: str  # key of `SORTS`
    text: str


def events(run: Run) -> list[Event]:
    """All events of a run with at least two samples, in order of time."""
    listed = [*_reference(run), *_held(run), *_gust(run), *_converged(run)]
    if run.status != "completed":
        listed.append(Event(run.duration, "end", run.outcome))
    return sorted(listed, key=lambda event: event.t)


def log_events(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log the events of all runs in one list, in the colours of the runs.

    A change of the wind that several runs meet is listed once, with the first of them.
    """
    lines = [(event, drawn_run) for drawn_run in drawn for event in events(drawn_run.run)]
    lines.sort(key=lambda line: line[0].t)
    # All runs of a scenario meet the same wind: the first run of each such event stands for them.
    first = dict(reversed(lines))
    lines = [line for line in lines if line[0].sort != "wind" or first[line[0]] is line[1]]
    if not lines:
        return
    columns = rr.TextLog.columns(
        text=[f"{drawn_run.run.label}: {event.text}" for event, drawn_run in lines],
        level=[SORTS[event.sort] for event, _ in lines],
        color=[
            [round(part + LIGHTER * (255 - part)) for part in drawn_run.style.rgb]
            for _, drawn_run in lines
        ],
    )
    when = times([event.t for event, _ in lines])
    stream.send_columns(EVENTS, [when], columns)


def _reference(run: Run) -> Iterator[Event]:
    for angle, word in CHANNEL_NAMES.items():
        name = f"{angle}_ref"
        if name not in run.signals:
            continue
        t, values = _of(run, name)
        start = run.signals[angle].to_numpy()[0]
        slopes = np.diff(values)
        steps = np.flatnonzero(np.abs(np.diff(slopes, prepend=slopes[:1])) > NO_STEP)
        if abs(values[0] - start) > NO_STEP:
            text = f"{word} reference {math.degrees(values[0]):.4g} deg"
            yield Event(float(t[0]), "track", f"{text}, from {math.degrees(start):.4g} deg")
        for k in steps[:MAX_HOLDS].tolist():
            moved = math.degrees(values[k])
            yield Event(float(t[k]), "track", f"{word} reference moves at {moved:.4g} deg")


def _held(run: Run) -> Iterator[Event]:
    for command, word in COMMANDS.items():
        name = f"{command}_limited"
        if name not in run.signals:
            continue
        t, states = runs_of_equal(*_of(run, name))
        ends = np.append(t[1:], run.duration)
        limited = np.flatnonzero(states != 0.0)
        for k in limited[:MAX_HOLDS].tolist():
            limit = "its rate limit" if states[k] == RATE else "its limit"
            lasting = f"{ends[k] - t[k]:.2f} s"
            yield Event(float(t[k]), "limit", f"{word} command held by {limit} for {lasting}")
        if len(limited) > MAX_HOLDS:
            more = f"{word} command held {len(limited) - MAX_HOLDS} times more, not listed"
            yield Event(float(t[limited[MAX_HOLDS]]), "limit", more)


def _gust(run: Run) -> Iterator[Event]:
    if not set(WIND) <= set(run.signals):
        return
    wind = run.signals[list(WIND)].to_numpy()
    away = np.linalg.norm(wind - wind[0], axis=1)
    t = run.t
    if not away.max() > WIND_CHANGE:
        return
    begun, peak = int(np.argmax(away > WIND_CHANGE)), int(np.argmax(away))
    yield Event(float(t[begun]), "wind", f"the wind has changed by {WIND_CHANGE:g} m/s")
    yield Event(float(t[peak]), "wind", f"wind has changed by {away[peak]:.1f} m/s since the start")


def _converged(run: Run) -> Iterator[Event]:
    if not set(MEASURED) <= set(run.signals):
        return
    if not np.isfinite(run.signals[list(MEASURED)].to_numpy()).all():
        return
    measures = channel_metrics(run)
    for angle, word in CHANNEL_NAMES.items():
        t, error = _of(run, f"{angle}_err")
        taken = float(measures.at[angle, "settling_s"])
        if math.isfinite(taken):
            begun = float(t[int(np.argmax(np.abs(error) > NO_STEP))])
            text = f"{word} error settled (5 %) after {taken:.2f} s"
            yield Event(begun + taken, "track", text)


def _of(run: Run, name: str) -> tuple[np.ndarray, np.ndarray]:
    return run.t, run.signals[name].to_numpy(dtype=float)


def log_lanes(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log a lane for each run, in its colour."""
    end = END * max(drawn_run.run.duration for drawn_run in drawn)
    for drawn_run in drawn:
        run, colour = drawn_run.run, drawn_run.style.rgb
        t, states = lane(run)
        after = "" if run.status == "completed" else run.status.replace("_", " ")
        t, states = np.append(t, [run.duration, end]), [*states, after, ENDED]
        dimmed = tuple(round(DIMMED * part) for part in colour)
        colours = {FREE: colour, after: rgb(LIMIT)}
        shown = [state for state in dict.fromkeys(states) if state not in ("", ENDED)]
        style = rr.StateConfiguration(
            values=[*shown, "", ENDED],
            labels=[*shown, "", ""],
            colors=[*(colours.get(state, dimmed) for state in shown), (0, 0, 0), (0, 0, 0)],
            visible=[True] * len(shown) + [False, False],
        )
        path = lane_name(drawn_run, len(drawn))
        stream.log(path, style, static=True)
        stream.send_columns(path, [times(t)], rr.StateChange.columns(state=states))


def lane(run: Run) -> tuple[FloatArray, list[str]]:
    """When the state of a run begins and changes (s), and to what.

    A state names the limits that hold commands, such as ``roll rate``; else it is `FREE`.
    """
    t = run.t[:-1]
    now = np.zeros(len(t), dtype=int)
    for name, factor in LIMITED.items():
        if name in run.signals:
            now += factor * run.signals[name].to_numpy()[:-1].astype(int)
    begun, codes = runs_of_equal(t, now)
    kept = np.diff(begun, append=run.duration) >= SHORTEST
    kept[0] = True
    begun, codes = runs_of_equal(begun[kept], codes[kept])
    return begun, [HOLDING[code] for code in codes.tolist()]


def runs_of_equal(t: FloatArray, values: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """When a piecewise constant signal begins and changes, and to what."""
    at = np.flatnonzero(np.diff(values, prepend=np.nan))
    return t[at], values[at]
