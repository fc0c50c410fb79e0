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

# Limit that acts, by the value of the ``*_limited`` signal: magnitude or rate.
HELD = {1: "limit", 2: "rate"}
LIMITED = {"roll": "phi_limited", "n_z": "n_z_limited"}

BROKEN, GUARANTEED, FREE, ENDED = "broken", "guaranteed", "within limits", "ended"
SHORTEST = 0.3  # s; shorter pieces are drawn as the one before: sensor noise would fragment a lane
DIMMED = 0.45  # brightness of a lane while a limit holds a command


def log_lanes(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log a lane for each run, in its colour."""
    end = END * max(drawn_run.run.duration for drawn_run in drawn)
    for drawn_run in drawn:
        run, colour = drawn_run.run, drawn_run.style.rgb
        t, states = lane(run, drawn_run.claim)
        after = "" if run.status == "completed" else run.status.replace("_", " ")
        t, states = np.append(t, [run.duration, end]), [*states, after, ENDED]
        dimmed = tuple(round(DIMMED * part) for part in colour)
        colours = {GUARANTEED: colour, FREE: colour, BROKEN: rgb(LIMIT), after: rgb(LIMIT)}
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


def lane(run: Run, check: FlightCheck | None) -> tuple[FloatArray, list[str]]:
    """When the state of a run begins and changes (s), and to what.

    A state names the limits that hold commands, such as ``roll rate``. Otherwise it is `BROKEN`,
    `GUARANTEED`, or `FREE` where nothing is claimed.
    """
    t, signals = run.t[:-1], run.signals
    words = [FREE, GUARANTEED, BROKEN]
    now = np.zeros(len(t), dtype=int)
    if check is not None:
        now = np.where(check.broken, 2, np.where(np.isfinite(check.bound), 1, 0))
    limited = np.zeros(len(t), dtype=int)
    for place, name in enumerate(LIMITED.values()):
        if name in signals:
            limited += 3**place * signals[name].to_numpy()[:-1].astype(int)
    now = np.where((limited > 0) & (now != 2), len(words) - 1 + limited, now)
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
