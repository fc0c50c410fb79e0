"""Where things are in a recording: timeline and folders."""

import numpy as np
import pandas as pd
import rerun as rr

APPLICATION = "flighttune"
TIMELINE = "flight_time"
"""Time since the start of the flight."""

PAGE = "page"
WORLD = "world"
PATHS = f"{WORLD}/paths"
SHADOWS = f"{WORLD}/shadows"
AIRCRAFT = f"{WORLD}/aircraft"
"""Folder of frames that move with each aircraft and turn with its course."""

BODY = "body"
"""Below such a frame: the aircraft with its attitude."""

GROUND = f"{WORLD}/ground"
PLOTS = "plots"
PHASES = "phases"
RUNS = "runs"
"""Lanes that name the runs in their colours."""

NANOSECONDS = 1e9


def times(index: pd.Index) -> rr.TimeColumn:
    """Time column of a run, rounded to the nearest nanosecond (float seconds would be cut off)."""
    seconds = index.to_numpy(dtype=float)
    return rr.TimeColumn(
        TIMELINE, duration=np.rint(seconds * NANOSECONDS).astype("timedelta64[ns]")
    )
