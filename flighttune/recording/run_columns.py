"""The runs inside a recording, exact to the bit: written as native columns, checked and read back.

``runs_flown`` holds, once, the description of every run as JSON. The signals of run number 3 are
the series of ``runs_flown/03_PLANT_GAINS``: SI and radians, float64, the first one the time.
"""

import json
import os
import subprocess
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from flighttune.errors import RecordingError
from flighttune.recording.entities import APPLICATION, RECORD, TIMELINE, plain_name, times
from flighttune.recording.parquet import (
    check_file,
    described_run,
    description,
    errors_of_description,
    first_line,
    signal_table,
)
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
    entries = []
    for number, run in enumerate(runs):
        folder = f"{RECORD}/{number:02d}_{plain_name(run.label)}"
        rows = np.column_stack([run.signals.index, run.signals])
        columns = [str(name) for name in run.signals]
        crc32 = zlib.crc32(rows.tobytes())
        entry = {"folder": folder, "columns": columns, "samples": len(rows), "crc32": crc32}
        entries.append(json.dumps({**description(run), **entry}, ensure_ascii=False))
        if len(rows):
            stream.log(folder, rr.SeriesLines(names=["t", *columns]), static=True)
        for start in range(0, len(rows), ROWS):
            part = slice(start, start + ROWS)
            scalars = rr.Scalars.columns(scalars=rows[part])
            stream.send_columns(folder, [times(run.signals.index[part])], scalars)
    if entries:
        stream.log(RECORD, rr.AnyValues(runs=entries), static=True)


def check_recording(path: str | Path) -> None:
    """Make sure that `path` is a whole recording written by flighttune: decode all of it once.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty, cut off, damaged, not from Rerun, or written by
        another program.
    """
    path = Path(path)
    check_file(path, "recording (.rrd)")
    _opened(path)
    _decode_elsewhere(path)
    check_index(path)


def _opened(path: Path) -> RrdReader:
    with _rerun_errors(path):
        reader = RrdReader(path)
        programs = sorted({entry.application_id for entry in reader.recordings()})
    if not any(name == APPLICATION or name.startswith(f"{APPLICATION}-") for name in programs):
        got = first_line(", ".join(programs) or "nothing")
        raise RecordingError(f"{path}: must be a recording of flighttune, got one of {got}.")
    return reader


def executable() -> Path:
    """Path of the ``rerun`` program that came with the Rerun SDK."""
    # Not the script of that name: it is a shim, and ending the shim would orphan the viewer.
    import rerun_cli

    name = "rerun.exe" if os.name == "nt" else "rerun"
    return Path(next(iter(rerun_cli.__path__))) / name


def _decode_elsewhere(path: Path) -> None:
    """Decode a file in a process that may crash: one flipped bit can abort the Rust decoder."""
    decoder = subprocess.run(
        [executable(), "rrd", "stats", str(path)], capture_output=True, text=True, errors="replace"
    )
    # The decoder skips what it cannot read, with an error in its log and exit status 0.
    if decoder.returncode or "ERROR" in decoder.stderr:
        raise RecordingError(
            f"{path}: must be a sound recording (.rrd), got one that Rerun cannot decode."
        )


def check_index(path: Path) -> None:
    """Make sure that every chunk in the index at the end of a file is there and can be decoded.

    Reading the file from its start instead would skip what does not decode, without an error.

    Raises
    ------
    RecordingError
        If a chunk or the index is missing or damaged, or another program wrote the file.
    """
    reader = _opened(path)
    with _rerun_errors(path):
        for store in (*reader.recordings(), *reader.blueprints()):
            for _ in reader.store(store=store).stream():
                pass


@contextmanager
def _rerun_errors(path: Path) -> Iterator[None]:
    try:
        with warnings.catch_warnings():
            # Without its index Rerun reads what there is of a file, and only warns.
            warnings.simplefilter("error", RerunWarning)
            yield
    except (RuntimeError, ValueError, KeyError, pa.ArrowException, RerunWarning) as error:
        reason = first_line(str(error).split(f"{path}: ")[-1])
        if isinstance(error, RerunWarning):
            reason = "one cut off before its end"
        raise RecordingError(f"{path}: must be a sound recording (.rrd), got {reason}.") from error


def recorded_runs(path: Path) -> tuple[Run, ...]:
    """Read the runs of a recording.

    Raises
    ------
    RecordingError
        If `path` is no recording of flighttune, damaged, or holds no run.
    """
    check_recording(path)
    entries: list[dict[str, Any]] = []
    chunks: dict[str, list[pa.RecordBatch]] = {}
    reader = _opened(path)
    with _rerun_errors(path):
        store = reader.store(store=reader.recordings()[0])
        for chunk in store.stream().filter(content=f"/{RECORD}/**").to_chunks():
            batch = chunk.to_record_batch()
            if not chunk.is_static:
                chunks.setdefault(chunk.entity_path, []).append(batch)
            elif chunk.entity_path == f"/{RECORD}":
                entries = [json.loads(text) for text in batch.column("runs")[0].as_py()]
    if not entries:
        raise RecordingError(f"{path}: must hold runs to read back, got none.")
    with errors_of_description(path):
        return tuple(_run(entry, chunks.get(f"/{entry['folder']}", [])) for entry in entries)


def _run(entry: Mapping[str, Any], chunks: list[pa.RecordBatch]) -> Run:
    # Chunks come in the order of the index, which is not that of time.
    chunks = sorted(chunks, key=lambda chunk: chunk.column(TIMELINE)[0].value)
    names = entry["columns"]
    values = [chunk.column(VALUES).flatten().to_numpy(zero_copy_only=False) for chunk in chunks]
    rows = np.concatenate([np.zeros(0), *values]).reshape(-1, 1 + len(names))
    signals = signal_table(rows[:, 0], dict(zip(names, rows[:, 1:].T, strict=True)))
    run = described_run(entry, signals)
    # Rerun has no checksum of its own over what a column holds.
    if len(rows) != entry["samples"] or zlib.crc32(rows.tobytes()) != entry["crc32"]:
        raise RecordingError(f"must hold the signals written, got others: {first_line(run.label)}.")
    return run
