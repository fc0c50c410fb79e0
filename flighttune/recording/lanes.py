"""State timelines: a lane a run, in the colour and order of the runs."""

from collections.abc import Sequence

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
    path = f"{PHASES}/{command}"
    values = [f"{member.key} {word}" for member in members for word in HELD.values()]
    dimmed = [tuple(round(DIMMED * part) for part in member.look.rgb) for member in members]
    strong = [member.look.rgb for member in members]
    style = rr.StateConfiguration(
        values=values,
        labels=list(HELD.values()) * len(members),
        colors=[colour for pair in zip(strong, dimmed, strict=True) for colour in pair],
    )
    stream.log(path, style, static=True)
    changed = [changes(member, f"{command}_limited") for member in members]
    at = np.unique(np.concatenate([[0.0], *(t for t, _ in changed)]))
    rows = []
    for member, (t, states) in zip(members, changed, strict=True):
        now = states[np.searchsorted(t, at, side="right") - 1]
        rows.append([f"{member.key} {HELD[held]}" if held in HELD else "" for held in now.tolist()])
    _send(stream, path, at, rows)


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
    at = np.flatnonzero(np.diff(values[:-1], prepend=np.nan))
    return np.append(t[at], t[-1]), np.append(values[at], 0.0)


def _send(
    stream: rr.RecordingStream, path: str, at: FloatArray, rows: Sequence[Sequence[str]]
) -> None:
    """Send states, `rows` having a list over `at` for every lane."""
    flat = [state for moment in zip(*rows, strict=True) for state in moment]
    columns = rr.StateChange.columns(state=flat).partition([len(rows)] * len(at))
    stream.send_columns(path, [times(pd.Index(at))], columns)
