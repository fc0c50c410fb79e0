"""Lanes over time, one per run: which limit acts on its commands, and if its guarantee holds."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.guarantee.flight_check import FlightCheck
from flighttune.present.palette import LIMIT, rgb
from flighttune.recording.entities import END, DrawnRun, lane_name, times
from flighttune.simulate.run import Run

HELD = {1: "limit", 2: "rate"}
"""Limit that acts, by the value of the ``*_limited`` signal: magnitude or rate."""

LIMITED = {"roll": "phi_limited", "n_z": "n_z_limited"}
BROKEN, GUARANTEED, FREE, ENDED = "broken", "guaranteed", "no claim", "ended"
NO_CERTIFICATE = "no certificate"
SHORTEST = 0.3
"""Shorter pieces of a lane (s) are drawn as the one before: sensor noise would fragment it."""

DIMMED = 0.45
"""Brightness of a lane while a limit holds a command."""

WIDTH, NARROW, CHARACTER, BESIDE = 290.0, 4.0, 7.0, 4.0
"""Of a lane in a window of 1280 points, of one of "ilrt, ", of other characters, and left of a
label, points."""


def log_lanes(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log a lane for each run, in its colour.

    Parameters
    ----------
    stream : RecordingStream
    drawn : sequence of DrawnRun
    """
    end = END * max(drawn_run.run.duration for drawn_run in drawn)
    for drawn_run in drawn:
        run, colour = drawn_run.run, drawn_run.style.rgb
        t, states = lane(run, drawn_run.claim)
        after = "" if run.status == "completed" else run.status.replace("_", " ")
        t, states = np.append(t, [run.duration, end]), [*states, after, ENDED]
        dimmed = tuple(round(DIMMED * part) for part in colour)
        bad = {BROKEN, after} - {""}
        plain = {GUARANTEED, FREE, NO_CERTIFICATE}
        points = (np.diff(t, append=end) * WIDTH / end).tolist()
        labels = [fitting(*piece) for piece in zip(states, points, strict=True)]
        # a state has one label for all of its pieces: those with a shorter one are another state
        values = [
            state if state in (label, "", ENDED) else f"{state} ({label})"
            for state, label in zip(states, labels, strict=True)
        ]
        styles = dict(zip(values, zip(states, labels, strict=True), strict=True))
        shown = {value: style for value, style in styles.items() if value not in ("", ENDED)}
        colours = [
            rgb(LIMIT) if n in bad else colour if n in plain else dimmed for n, _ in shown.values()
        ]
        style = rr.StateConfiguration(
            values=[*shown, "", ENDED],
            labels=[*(label for _, label in shown.values()), "", ""],
            colors=[*colours, (0, 0, 0), (0, 0, 0)],
            visible=[True] * len(shown) + [False, False],
        )
        path = lane_name(drawn_run, len(drawn))
        stream.log(path, style, static=True)
        stream.send_columns(path, [times(t)], rr.StateChange.columns(state=values))


def fitting(state: str, points: float) -> str:
    """As much of a state's name as a piece of a lane has room for: all, its first word, nothing."""
    first = state.replace(",", " ").split(" ")[0]
    for name in (state, first):
        if BESIDE + sum(NARROW if one in "ilrt, " else CHARACTER for one in name) <= points:
            return name
    return " "  # for an empty one the viewer shows the state


def lane(run: Run, check: FlightCheck | None) -> tuple[FloatArray, list[str]]:
    """When the state of a run begins and changes, and to what.

    Returns
    -------
    t : ndarray, shape (k,), s
    states : list of str
        Limits that hold commands, such as ``roll rate``; else `BROKEN`, `GUARANTEED`, `FREE` where
        nothing is claimed of a flight with a certificate, or `NO_CERTIFICATE`.
    """
    t, signals = run.t[:-1], run.signals
    words = [NO_CERTIFICATE if check is None else FREE, GUARANTEED, BROKEN]
    now = np.zeros(len(t), dtype=int)
    if check is not None:
        now = np.where(check.broken, 2, np.where(np.isfinite(check.bound), 1, 0))
    held = np.zeros(len(t), dtype=int)
    for place, name in enumerate(LIMITED.values()):
        if name in signals:
            held += 3**place * signals[name].to_numpy()[:-1].astype(int)
    now = np.where((held > 0) & (now != 2), len(words) - 1 + held, now)
    words += [_limits(code) for code in range(1, 3 ** len(LIMITED))]
    begun, codes = _without_short(*runs_of_equal(t, now), run.duration)
    return begun, [words[code] for code in codes.tolist()]


def _limits(code: int) -> str:
    """The limits of a code: ``roll rate``, ``roll, n_z rate``."""
    parts = []
    for place, name in enumerate(LIMITED):
        kind = code // 3**place % 3
        if kind:
            parts.append(f"{name} rate" if HELD[kind] == "rate" else name)
    return ", ".join(parts)


def _without_short(
    begun: FloatArray, codes: npt.NDArray[np.int64], end: float
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    lasting = np.diff(begun, append=end)
    kept = lasting >= SHORTEST
    kept[0] = True
    return runs_of_equal(begun[kept], codes[kept])


def runs_of_equal(t: FloatArray, values: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """When a piecewise constant signal begins and changes, and to what."""
    at = np.flatnonzero(np.diff(values, prepend=np.nan))
    return t[at], values[at]
