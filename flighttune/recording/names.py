"""Where things are in a recording: timeline and folders."""

import re
from collections.abc import Iterable

import numpy as np
import pandas as pd
import rerun as rr

APPLICATION = "flighttune"
TIMELINE = "flight_time"
"""Time since the start of the flight."""

PAGE = "page"
WORLD = "world"
PATHS = f"{WORLD}/paths"
TRAILS = f"{WORLD}/trails"
SHADOWS = f"{WORLD}/shadows"
AIRCRAFT = f"{WORLD}/aircraft"
"""Folder of frames that move with each aircraft and turn with its course."""

BODY = "body"
"""Below such a frame: the aircraft with its attitude."""

GROUND = f"{WORLD}/ground"
PLOTS = "plots"
REFERENCE = "_reference"
LIMITS = "_limits"
MEASURED = "_measured"
"""Lines that belong to no run, and what sensors showed; the viewer draws in the order of names, so
that these are below the runs."""

RECORD = "runs_flown"
"""The runs themselves, for reading back."""

PHASES = "phases"
CLAIMS = "claims"
EVENTS = "events"
PLANE = "plane"
"""The complex plane."""

GUARANTEE = f"{PLOTS}/guarantee"
ABSCISSA = f"{PLOTS}/abscissa"
DAMPING = f"{PLOTS}/damping"

RUNS = "runs"
"""Lanes that name the runs in their colours."""

NANOSECONDS = 1e9


def application(title: str) -> str:
    """Application of a recording: the viewer keeps one layout for each, so scenarios differ."""
    return f"{APPLICATION}-{plain_name(title).lower()}"[:80].rstrip("-_")


def plain_name(text: str) -> str:
    """`text` in letters, digits, dots and underscores, as names in Rerun want them."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", text).strip("_") or "unnamed"


def told_apart(names: Iterable[str]) -> list[str]:
    """Names in order, those that were there before with ``_2``, ``_3`` and so on behind them."""
    taken: dict[str, None] = {}
    for stem in names:
        name, again = stem, 2
        while name in taken:
            name, again = f"{stem}_{again}", again + 1
        taken[name] = None
    return list(taken)


def times(index: pd.Index) -> rr.TimeColumn:
    """Time column of a run, rounded to the nearest nanosecond (float seconds would be cut off)."""
    seconds = index.to_numpy(dtype=float)
    return rr.TimeColumn(
        TIMELINE, duration=np.rint(seconds * NANOSECONDS).astype("timedelta64[ns]")
    )
