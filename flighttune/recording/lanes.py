"""State timelines: a lane a run, in the colour and order of the runs."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.recording.entities import PHASES, RUNS, DrawnRun, times

CHANNELS = {"phi": "Roll command held by a limit", "n_z": "Load-factor command held by a limit"}
"""Commands with lanes of their own, and the heading of the lanes."""

HELD = {1: "limit", 2: "rate"}
"""Text of a lane by the value of the ``*_limited`` signal: magnitude or rate limit."""

DIMMED = 0.6

Style: TypeAlias = tuple[str, tuple[int, ...]]


def log_lanes(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log the runs, how long each flew, and when limits held its commands."""
    _log_runs(stream, drawn)
    for command in CHANNELS:
        if any(f"{command}_limited" in drawn_run.run.signals for drawn_run in drawn):
            _log_phases(stream, drawn, command)


def _log_runs(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    names = [_outcome(drawn_run) for drawn_run in drawn]
    styles: dict[str, Style] = {
        name: (name, drawn_run.style.rgb) for name, drawn_run in zip(names, drawn, strict=True)
    }
    ends = [np.array([0.0, drawn_run.run.duration]) for drawn_run in drawn]
    log_timeline(stream, RUNS, [(t, [n, ""]) for t, n in zip(ends, names, strict=True)], styles)


def _outcome(drawn_run: DrawnRun) -> str:
    run = drawn_run.run
    ended = "" if run.status == "completed" else f": {run.status.replace('_', ' ')}"
    return run.label + ended


def _log_phases(stream: rr.RecordingStream, drawn: Sequence[DrawnRun], command: str) -> None:
    style: dict[str, Style] = {}
    lanes = []
    for drawn_run in drawn:
        dimmed = tuple(round(DIMMED * part) for part in drawn_run.style.rgb)
        for word, colour in zip(HELD.values(), (drawn_run.style.rgb, dimmed), strict=True):
            style[f"{drawn_run.key} {word}"] = (word, colour)
        t, states = changes(drawn_run, f"{command}_limited")
        words = [
            f"{drawn_run.key} {HELD[held]}" if held in HELD else "" for held in states.tolist()
        ]
        lanes.append((t, words))
    log_timeline(stream, f"{PHASES}/{command}", lanes, style)


def log_timeline(
    stream: rr.RecordingStream,
    path: str,
    lanes: Sequence[tuple[FloatArray, Sequence[str]]],
    styles: Mapping[str, Style],
) -> None:
    """Log lanes of states on one entity, which makes them compact.

    Parameters
    ----------
    stream : RecordingStream
    path : str
        Entity.
    lanes : sequence of (ndarray, sequence of str)
        Times (s) at which the state of a lane begins or changes, and the states; empty for none.
    styles : mapping of str to (str, (int, int, int))
        Label and colour of each state; states of different lanes have different names.
    """
    style = rr.StateConfiguration(
        values=list(styles),
        labels=[label for label, _ in styles.values()],
        colors=[colour for _, colour in styles.values()],
    )
    stream.log(path, style, static=True)
    at = np.unique(np.concatenate([[0.0], *(t for t, _ in lanes)]))
    rows = []
    for t, states in lanes:
        now = np.searchsorted(t, at, side="right") - 1
        rows.append([states[k] if k >= 0 else "" for k in now.tolist()])
    flat = [state for moment in zip(*rows, strict=True) for state in moment]
    columns = rr.StateChange.columns(state=flat).partition([len(rows)] * len(at))
    stream.send_columns(path, [times(at)], columns)


def runs_of_equal(t: FloatArray, values: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """When a piecewise constant signal begins and changes, and to what."""
    at = np.flatnonzero(np.diff(values, prepend=np.nan))
    return t[at], values[at]


def changes(drawn_run: DrawnRun, name: str) -> tuple[FloatArray, FloatArray]:
    """When a piecewise constant signal begins and changes, and to what.

    Returns
    -------
    t, values : ndarray, shape (k,), s and unit of the signal, k >= 1
        Ends with 0 at the end of the flight. A run without the signal has a single 0.
    """
    signals = drawn_run.run.signals
    if name not in signals:
        return np.zeros(1), np.zeros(1)
    t, values = drawn_run.run.t, signals[name].to_numpy(dtype=float)
    begun, states = runs_of_equal(t[:-1], values[:-1])
    return np.append(begun, t[-1]), np.append(states, 0.0)
