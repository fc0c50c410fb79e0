"""Lanes of flights: a strip for each run over time, which names the limits that hold commands."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.present.palette import LIMIT, rgb
from flighttune.recording.entities import END, DrawnRun, lane_name, times
from flighttune.simulate.run import Run

FREE, ENDED = "within limits", "ended"
# Code of the limits that act: a sum of signals times factors (0 free, 1 magnitude, 2 rate).
LIMITED = {"phi_limited": 1, "n_z_limited": 3}
HOLDING = [
    ", ".join(filter(None, (roll, n_z))) or FREE
    for n_z in ("", "n_z", "n_z rate")
    for roll in ("", "roll", "roll rate")
]
SHORTEST = 0.3  # s; shorter pieces are drawn as the one before: sensor noise would fragment a lane
DIMMED = 0.45  # brightness of a lane while a limit holds a command


def log_lanes(stream: rr.RecordingStream, flights: Sequence[DrawnRun]) -> None:
    """Log a lane for each run, in its colour."""
    end = END * max(drawn_run.run.duration for drawn_run in flights)
    for drawn_run in flights:
        run, colour = drawn_run.run, drawn_run.style.rgb
        t, states = lane(run)
        after = "" if run.status == "completed" else run.status.replace("_", " ")
        t, states = np.append(t, [run.duration, end]), [*states, after, ENDED]
        dimmed = tuple(round(DIMMED * part) for part in colour)
        colours = {FREE: colour, after: rgb(LIMIT)}
        visible = [state for state in dict.fromkeys(states) if state not in ("", ENDED)]
        style = rr.StateConfiguration(
            values=[*visible, "", ENDED],
            labels=[*visible, "", ""],
            colors=[*(colours.get(state, dimmed) for state in visible), (0, 0, 0), (0, 0, 0)],
            visible=[True] * len(visible) + [False, False],
        )
        path = lane_name(drawn_run, len(flights))
        stream.log(path, style, static=True)
        stream.send_columns(path, [times(t)], rr.StateChange.columns(state=states))


def lane(run: Run) -> tuple[FloatArray, list[str]]:
    """Times (s) at which the limits that hold commands change, and their names or `FREE`."""
    t = run.t[:-1]
    now = np.zeros(len(t), dtype=int)
    for name, factor in LIMITED.items():
        if name in run.signals:
            now += factor * run.signals[name].to_numpy()[:-1].astype(int)
    begun, codes = runs_of_equal(t, now)
    lasting = np.diff(begun, append=run.duration) >= SHORTEST
    lasting[0] = True
    begun, codes = runs_of_equal(begun[lasting], codes[lasting])
    return begun, [HOLDING[code] for code in codes.tolist()]


def runs_of_equal(t: FloatArray, values: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """Times at which a piecewise constant signal begins and changes, and its values there."""
    changes = np.flatnonzero(np.diff(values, prepend=np.nan))
    return t[changes], values[changes]
