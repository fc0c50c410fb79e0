"""Timeline and entities of a recording, and the key, colour and name of each run in it."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from flighttune.base.words import distinct
from flighttune.flight.loop.run import Run
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.palette import LineStyle

TIMELINE = "flight_time"  # time since the start of the flight

PAGE = "page"
WORLD = "world"
PATHS = f"{WORLD}/paths"
SHADOWS = f"{WORLD}/shadows"
AIRCRAFT = f"{WORLD}/aircraft"  # frames that move with each aircraft and turn with its course
BODY = "body"  # below such a frame: the aircraft with its attitude

GROUND = f"{WORLD}/ground"
ROUTE = f"{WORLD}/route"  # planned path, waypoints and corridor
MAP = "map"
PLOTS = "plots"

# Lines without a run, and measured signals. The viewer draws in the order of names: the underscore
# puts them below the lines of the runs.
REFERENCE = "_reference"
LIMITS = "_limits"
MEASURED = "_measured"
AXIS = "_axis"

OVERVIEW_TAB, PAGE_TAB = "Overview", "Scenario and metrics"

LEGEND = "runs"  # number, colour and outcome of each run

END = 1.1  # end of time axes, relative to the longest flight


def application(title: str) -> str:
    """Application of a recording: the viewer keeps one layout for each scenario."""
    name = plain_name(title).lower().replace(".", "_")  # Rerun warns of most characters
    return f"flighttune-{name}"[:80].rstrip("-_")


def plain_name(text: str) -> str:
    """`text` in letters, digits, dots and underscores, as Rerun's names require."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", text).strip("_") or "unnamed"


def reading(tab: str) -> str:
    """Entity of the sentence that explains a tab."""
    return f"how_to_read/{plain_name(tab)}"


def times(seconds: npt.ArrayLike) -> rr.TimeColumn:
    """Time column of a run."""
    # Whole nanoseconds: Rerun truncates float seconds, which puts a third of them 1 ns early.
    nanoseconds = np.rint(np.asarray(seconds, dtype=float) * 1e9)
    return rr.TimeColumn(TIMELINE, duration=nanoseconds.astype("timedelta64[ns]"))


def log_lines(
    stream: rr.RecordingStream,
    path: str,
    style: rr.SeriesLines,
    t: npt.ArrayLike,
    values: npt.ArrayLike,
) -> None:
    """Log lines over time (s), all of one entity, with their style; `values` has a column each."""
    stream.log(path, style, static=True)
    stream.send_columns(path, [times(t)], rr.Scalars.columns(scalars=values))


def log_still(stream: rr.RecordingStream, path: str, *drawing: rr.AsComponents) -> None:
    """Log timeless data."""
    stream.log(path, *drawing, static=True)


def on_screen(width: float) -> Any:
    """Thickness of a line or dot in screen points, at any distance."""
    return rr.components.Radius.ui_points(width)


class DrawnRun(NamedTuple):
    """One run as a recording draws it."""

    run: Run  # with at least two samples
    key: str  # its name in the tree of the recording, unique
    style: LineStyle
    number: int  # its number among the drawn runs, from 1


def runs_to_draw(runs: Sequence[Run]) -> list[DrawnRun]:
    """The runs with at least two samples, in order."""
    keys = distinct(plain_name(run.label) for run in runs)
    styles = run_styles(runs)
    flew = [(run, key) for run, key in zip(runs, keys, strict=True) if len(run.signals) > 1]
    return [
        DrawnRun(run, key, styles[run.label], number) for number, (run, key) in enumerate(flew, 1)
    ]
