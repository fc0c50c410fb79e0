"""State timelines: a lane a run, in the colour and order of the runs."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
import pandas as pd
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.recording.cast import Member
from flighttune.recording.names import PHASES, RUNS, times

CHANNELS = {"phi": "Roll command held by a limit", "n_z": "Load-factor command held by a limit"}
"""Commands that have a timeline, and its heading."""

HELD = {1: "limit", 2: "rate"}
"""Value of a ``*_limited`` signal to what its lane says: magnitude or rate limit."""

DIMMED = 0.6

Style: TypeAlias = tuple[str, tuple[int, ...]]


def log_lanes(stream: rr.RecordingStream, members: Sequence[Member]) -> None:
    """Log which runs there are, how long each flew, and when its commands were held by limits."""
    _log_runs(stream, members)
    for command in CHANNELS:
        if any(f"{command}_limited" in member.run.signals for member in members):
            _log_phases(stream, members, command)


def _log_runs(stream: rr.RecordingStream, members: Sequence[Member]) -> None:
    names = [_outcome(member) for member in members]
    style = rr.StateConfiguration(
        values=names, labels=names, colors=[member.look.rgb for member in members]
    )
    stream.log(RUNS, style, static=True)
    at = np.unique([0.0, *(member.run.duration for member in members)])
    rows = [
        [name if t < member.run.duration else "" for t in at]
        for name, member in zip(names, members, strict=True)
    ]
    _send(stream, RUNS, at, rows)


def _outcome(member: Member) -> str:
    run = member.run
    return (
        run.label if run.status == "completed" else f"{run.label}: {run.status.replace('_', ' ')}"
    )


def _log_phases(stream: rr.RecordingStream, members: Sequence[Member], command: str) -> None:
    style: dict[str, Style] = {}
    lanes = []
    for member in members:
        dimmed = tuple(round(DIMMED * part) for part in member.look.rgb)
        for word, colour in zip(HELD.values(), (member.look.rgb, dimmed), strict=True):
            style[f"{member.key} {word}"] = (word, colour)
        t, states = changes(member, f"{command}_limited")
        words = [f"{member.key} {HELD[held]}" if held in HELD else "" for held in states.tolist()]
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
    _send(stream, path, at, rows)


def runs_of_equal(t: FloatArray, values: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """When a piecewise constant signal begins and changes, and to what."""
    at = np.flatnonzero(np.diff(values, prepend=np.nan))
    return t[at], values[at]


def changes(member: Member, name: str) -> tuple[FloatArray, FloatArray]:
    """When a piecewise constant signal begins and changes, and to what.

    Returns
    -------
    t, values : ndarray, shape (k,), s and unit of the signal, k >= 1
        Ends with 0 at the end of the flight. A run without the signal has a single 0.
    """
    signals = member.run.signals
    if name not in signals:
        return np.zeros(1), np.zeros(1)
    t, values = signals.index.to_numpy(dtype=float), signals[name].to_numpy(dtype=float)
    begun, states = runs_of_equal(t[:-1], values[:-1])
    return np.append(begun, t[-1]), np.append(states, 0.0)


def _send(
    stream: rr.RecordingStream, path: str, at: FloatArray, rows: Sequence[Sequence[str]]
) -> None:
    """Send states, `rows` having a list over `at` for every lane."""
    flat = [state for moment in zip(*rows, strict=True) for state in moment]
    columns = rr.StateChange.columns(state=flat).partition([len(rows)] * len(at))
    stream.send_columns(path, [times(pd.Index(at))], columns)
