"""The runs inside a recording, exact to the bit: written as native columns, and read back.

``runs_flown`` holds, once, the description of every run as JSON and its SHA-256. The signals of run
number 3 are the series of ``runs_flown/03_PLANT_GAINS``: SI and radians, float64, the first one the
time.
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import RrdReader

from flighttune.arrays import FloatArray
from flighttune.errors import RecordingError
from flighttune.recording.entities import RECORD, TIMELINE, plain_name, times
from flighttune.recording.run_record import RunRecord, first_line
from flighttune.seal import RECORDING_FILE, sealed_bytes
from flighttune.simulate.run import Run

ROWS = 4096
"""Samples in one chunk of the file."""

VALUES = "Scalars:scalars"


def log_runs(stream: rr.RecordingStream, runs: Sequence[Run]) -> None:
    """Log descriptions and signals of all runs, also of those that never flew.

    Raises
    ------
    RecordingError
        If a scenario holds what JSON cannot.
    """
    records = [RunRecord.of(run) for run in runs]
    folders = [f"{RECORD}/{k:02d}_{plain_name(run.label)}" for k, run in enumerate(runs)]
    for folder, record in zip(folders, records, strict=True):
        if len(record.rows):
            stream.log(folder, rr.SeriesLines(names=list(record.columns)), static=True)
        for start in range(0, len(record.rows), ROWS):
            rows = record.rows[start : start + ROWS]
            scalars = rr.Scalars.columns(scalars=rows)
            stream.send_columns(folder, [times(rows[:, 0])], scalars)
    if records:
        every = rr.AnyValues(
            folders=folders,
            runs=[record.description for record in records],
            sha256=[record.sha256 for record in records],
        )
        stream.log(RECORD, every, static=True)


def check_recording(path: str | Path) -> None:
    """Make sure that `path` is a recording as flighttune wrote it.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty, or not as it was written: cut off, damaged, edited,
        of another program or of flighttune 0.1.0.
    """
    sealed_bytes(Path(path), RECORDING_FILE)


def executable() -> Path:
    """Path of the ``rerun`` program that came with the Rerun SDK."""
    # Not the script of that name: it is a shim, and ending the shim would orphan the viewer.
    import rerun_cli

    name = "rerun.exe" if os.name == "nt" else "rerun"
    return Path(next(iter(rerun_cli.__path__))) / name


def recorded_runs(path: Path) -> tuple[RunRecord, ...]:
    """Read the records of the runs in a recording.

    Raises
    ------
    RecordingError
        As `check_recording`, and if it holds no run.
    """
    check_recording(path)
    try:
        records = _records(path)
    except (RuntimeError, ValueError, KeyError, pa.ArrowException) as error:
        got = first_line(error)
        raise RecordingError(f"{path}: must be a recording of runs, got: {got}.") from error
    if not records:
        raise RecordingError(f"{path}: must hold runs to read back, got none.")
    return records


def _records(path: Path) -> tuple[RunRecord, ...]:
    reader = RrdReader(path)
    stated: dict[str, list[str]] = {"folders": [], "runs": [], "sha256": []}
    chunks: dict[str, list[pa.RecordBatch]] = {}
    store = reader.store(store=reader.recordings()[0])
    for chunk in store.stream().filter(content=f"/{RECORD}/**").to_chunks():
        batch = chunk.to_record_batch()
        if not chunk.is_static:
            chunks.setdefault(chunk.entity_path, []).append(batch)
        elif chunk.entity_path == f"/{RECORD}":
            stated = {name: batch.column(name)[0].as_py() for name in stated}
    return tuple(
        RunRecord(
            description=description,
            rows=_rows(chunks.get(f"/{folder}", []), len(json.loads(description)["columns"])),
            sha256=sha256,
        )
        for folder, description, sha256 in zip(*stated.values(), strict=True)
    )


def _rows(chunks: list[pa.RecordBatch], columns: int) -> FloatArray:
    # Chunks come in the order of the index, which is not that of time.
    chunks = sorted(chunks, key=lambda chunk: chunk.column(TIMELINE)[0].value)
    values = [chunk.column(VALUES).flatten().to_numpy(zero_copy_only=False) for chunk in chunks]
    return np.concatenate([np.zeros(0), *values]).reshape(-1, columns)
