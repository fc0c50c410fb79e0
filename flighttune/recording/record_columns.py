"""The runs inside a recording, exact to the bit: native columns that are not on any plot.

``runs_flown`` holds, once, the description of every run as JSON. The signals of run number 3 are
the series of ``runs_flown/03_PLANT_GAINS``: SI and radians, float64, the first one the time.
"""

import json
import zlib
from collections.abc import Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.errors import RecordingError
from flighttune.recording.description import description
from flighttune.recording.names import RECORD, plain_name, times
from flighttune.simulate.run import Run

ROWS = 4096
"""Samples that are written together, and lost together where a file is cut off."""

TIME = "t"


def folder_of(number: int, run: Run) -> str:
    """Where the signals of a run are."""
    return f"{RECORD}/{number:02d}_{plain_name(run.label)}"


def log_record(stream: rr.RecordingStream, runs: Sequence[Run]) -> None:
    """Log descriptions and signals of all runs, also of those that never flew.

    Raises
    ------
    RecordingError
        If a scenario holds what JSON cannot.
    """
    tables = [_rows(run) for run in runs]
    told = [
        {
            **description(run),
            "folder": folder_of(number, run),
            "columns": [str(name) for name in run.signals],
            "samples": len(rows),
            "crc32": zlib.crc32(rows.tobytes()),
        }
        for number, (run, rows) in enumerate(zip(runs, tables, strict=True))
    ]
    try:
        texts = [json.dumps(entry, ensure_ascii=False) for entry in told]
    except (TypeError, ValueError) as error:
        raise RecordingError(f"the scenario must hold plain values, got {error}.") from error
    if not texts:
        return
    stream.log(RECORD, rr.AnyValues(runs=texts), static=True)
    stream.flush()  # into the file ahead of what it describes
    for number, (run, rows) in enumerate(zip(runs, tables, strict=True)):
        if len(rows):
            _log_signals(stream, folder_of(number, run), run, rows)


def _rows(run: Run) -> FloatArray:
    """Time and signals of a run, a row a sample."""
    t = run.signals.index.to_numpy(dtype=float)
    return np.column_stack([t, run.signals.to_numpy(dtype=float)])


def _log_signals(stream: rr.RecordingStream, folder: str, run: Run, rows: FloatArray) -> None:
    names = [TIME, *(str(name) for name in run.signals)]
    stream.log(folder, rr.SeriesLines(names=names), static=True)
    for start in range(0, len(rows), ROWS):
        part = slice(start, start + ROWS)
        scalars = rr.Scalars.columns(scalars=rows[part])
        stream.send_columns(folder, [times(run.signals.index[part])], scalars)
