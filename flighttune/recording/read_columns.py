"""Runs out of a recording, as `flighttune.recording.record_columns` put them there."""

import json
import tempfile
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from flighttune.arrays import FloatArray
from flighttune.errors import RecordingError
from flighttune.recording.check import brief, check_recording
from flighttune.recording.description import FORMAT, described_run, signal_table
from flighttune.recording.names import RECORD, TIMELINE
from flighttune.recording.salvage import whole_messages
from flighttune.simulate.run import Run

VALUES = "Scalars:scalars"
RUNS = "runs"

Columns = dict[str, list[tuple[int, pa.RecordBatch]]]


def recorded_runs(path: Path) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """The runs of a recording, and a sentence for everything that is missing.

    Raises
    ------
    RecordingError
        If `path` is no recording of flighttune, empty, damaged, or holds no run.
    """
    cut = False
    try:
        check_recording(path, whole=True)
        told, columns = _contents(path, path)
    except RecordingError:
        if not path.is_file() or not path.stat().st_size:
            raise
        cut = True
        told, columns = _salvaged(path)
    missing = ["the end of the file is cut off"] if cut else []
    runs = []
    try:
        for found in told:
            if found["format"] > FORMAT:
                raise RecordingError(
                    f"{path}: layout must be {FORMAT} or older, got {found['format']}; "
                    "read it with a newer flighttune."
                )
            run, lost = _run(path, found, columns.get(f"/{found['folder']}", []))
            runs.append(run)
            missing += [lost] if lost else []
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(
            f"{path}: must describe complete runs, got {type(error).__name__}: {brief(error)}."
        ) from error
    return tuple(runs), tuple(missing)


def _salvaged(path: Path) -> tuple[list[dict[str, Any]], Columns]:
    data = whole_messages(path)
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "part.rrd"
        part.write_bytes(data)
        try:
            check_recording(part)
        except RecordingError as error:
            raise RecordingError(str(error).replace(str(part), str(path))) from error
        return _contents(part, path)


def _contents(file: Path, path: Path) -> tuple[list[dict[str, Any]], Columns]:
    """Descriptions, and the pieces of each entity's signals in order of time."""
    told: list[dict[str, Any]] = []
    columns: Columns = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            chunks = RrdReader(file).stream().filter(content=f"/{RECORD}/**").to_chunks()
        for chunk in chunks:
            batch = chunk.to_record_batch()
            if not chunk.is_static:
                first = batch.column(TIMELINE)[0].value
                columns.setdefault(chunk.entity_path, []).append((first, batch))
            elif chunk.entity_path == f"/{RECORD}":
                told = [json.loads(text) for text in batch.column(RUNS)[0].as_py()]
    except (RuntimeError, ValueError, KeyError, pa.ArrowException) as error:
        reason = brief(str(error).replace(f"{file}: ", "").split("{")[0])
        raise RecordingError(f"{path}: must be a sound recording (.rrd), got: {reason}.") from error
    if not told:
        raise RecordingError(f"{path}: must hold runs to read back, got none.")
    for pieces in columns.values():
        pieces.sort(key=lambda piece: piece[0])
    return told, columns


def _run(
    path: Path, found: Mapping[str, Any], pieces: list[tuple[int, pa.RecordBatch]]
) -> tuple[Run, str | None]:
    """One run, and what is missing of it."""
    names, samples = found["columns"], found["samples"]
    rows = np.vstack(
        [np.empty((0, 1 + len(names))), *(_rows(batch, 1 + len(names)) for _, batch in pieces)]
    )
    signals = signal_table(rows[:, 0], dict(zip(names, rows[:, 1:].T, strict=True)))
    run = described_run(found, signals)
    if len(rows) == samples:
        if zlib.crc32(rows.tobytes()) != found["crc32"]:
            raise RecordingError(
                f"{path}: must hold the signals written, got others: {brief(run.label)}."
            )
        return run, None
    told = f" up to t = {run.duration:g} s" if len(rows) else ""
    lost = f"{run.label}: {len(rows)} of {samples} samples are there{told}"
    whole = f"the whole flight was {run.status}" + (f": {run.reason}" if run.reason else "")
    return replace(run, status="cut_off", reason=f"{lost}; {whole}"), lost


def _rows(batch: pa.RecordBatch, width: int) -> FloatArray:
    values = batch.column(VALUES)
    return values.flatten().to_numpy(zero_copy_only=False).astype(float).reshape(-1, width)
