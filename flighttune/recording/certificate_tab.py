"""The tab that compares flights with the guarantees of their gains."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from flighttune.arrays import FloatArray
from flighttune.guarantee.flight_check import FlightCheck
from flighttune.present.thinning import peaks
from flighttune.recording.entities import (
    GUARANTEE,
    DrawnRun,
    log_lines,
    log_time_axis,
    plain_name,
)
from flighttune.recording.views import time_view

TAB = "Certificate"
SMALLEST = 1e-6  # smaller sizes are drawn as this: they are rounding
DECADES = 4.5  # most shown at first: a run that stands on its reference goes down for ever
FAINT = 130  # opacity of bounds, of 255
ROOM = 0.04  # of the range, above and below it


def log_certificates(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log ``log10 ||s||`` of each run that has a claim, with its bound."""
    folders = _folders(drawn)
    for folder in folders.values():
        log_time_axis(stream, folder, drawn)
    for drawn_run in drawn:
        if drawn_run.claim is not None:
            folder = folders[drawn_run.run.provenance.gains_name]
            _log_run(stream, drawn_run, drawn_run.claim, folder)


def _folders(drawn: Sequence[DrawnRun]) -> dict[str, str]:
    """Paths of the lines of each gain set."""
    claimed = [drawn_run.run for drawn_run in drawn if drawn_run.claim is not None]
    names = dict.fromkeys(run.provenance.gains_name for run in claimed)
    return {name: f"{GUARANTEE}/{k:02d}_{plain_name(name)}" for k, name in enumerate(names)}


def _log_run(
    stream: rr.RecordingStream, drawn_run: DrawnRun, claim: FlightCheck, folder: str
) -> None:
    line, label = drawn_run.style, drawn_run.run.label
    t, lines = claim.t, _logarithms(claim)
    kept = peaks(lines)
    path = f"{folder}/{drawn_run.key}"
    style = rr.SeriesLines(
        colors=[(*line.rgb, 255), (*line.rgb, FAINT)],
        widths=[line.width, 1.2],
        names=[label, f"{label}, guaranteed"],
    )
    log_lines(stream, path, style, t[kept], lines[kept])
    if claim.settled is None:
        return
    path = f"{folder}/_{drawn_run.key}_ultimate"
    style = rr.SeriesLines(
        colors=[(*line.rgb, FAINT)], widths=[3.0], names=[f"{label}, ultimate bound"]
    )
    ends = [drawn_run.run.duration / 2.0, drawn_run.run.duration]
    level = np.full(2, np.log10(max(claim.settled.claim.radius, SMALLEST)))
    log_lines(stream, path, style, ends, level)


def _logarithms(claim: FlightCheck) -> FloatArray:
    return np.log10(np.maximum(np.column_stack([claim.size, claim.bound]), SMALLEST))


def certificate_tab(drawn: Sequence[DrawnRun]) -> list[rrb.TimeSeriesView]:
    """A view for each gain set: all plants that flew it, over one range of decades."""
    claims = [drawn_run.claim for drawn_run in drawn if drawn_run.claim is not None]
    lines = np.concatenate([_logarithms(claim).ravel() for claim in claims])
    high = float(np.nanmax(lines))
    low = max(float(np.nanmin(lines)), high - DECADES)
    room = ROOM * max(high - low, 1.0)
    return [
        time_view(
            folder,
            f"{name}: log10 |s|, guarantee thin, ultimate bound wide",
            (low - room, high + room),
        )
        for name, folder in _folders(drawn).items()
    ]
