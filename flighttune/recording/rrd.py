"""Runs to one Rerun recording with its blueprint, written by columns."""

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr
from rerun.error_utils import strict_mode

from flighttune.arrays import FloatArray
from flighttune.palette import LIMIT, NEUTRAL, rgb
from flighttune.recording.blueprint import blueprint
from flighttune.recording.cast import Member, cast
from flighttune.recording.certificate_tab import log_certificates
from flighttune.recording.certified import certified
from flighttune.recording.check import check_recording
from flighttune.recording.eigenvalue_tab import log_eigenvalues
from flighttune.recording.events import log_events
from flighttune.recording.frozen_loop import frozen_loop
from flighttune.recording.lanes import log_lanes
from flighttune.recording.names import LIMITS, MEASURED, PAGE, PLOTS, REFERENCE, application, times
from flighttune.recording.plots import Plot, displayed, limits_of, shown_plots
from flighttune.recording.record_columns import log_record
from flighttune.recording.scene import log_scene
from flighttune.recording.thinning import peaks
from flighttune.simulate.run import Run
from flighttune.whole_file import whole_file

FAINT = 150
"""Opacity of thin lines, of 255."""

FAINTEST = 110
"""Opacity of what sensors showed."""


def write_recording(runs: Sequence[Run], path: str | Path, *, page: str, title: str) -> None:
    """Write all runs of a scenario to one recording that opens by itself in Rerun.

    Angles are shown in degrees. A signal that a run does not have is not drawn, and a run with
    fewer than two samples appears on the page only.

    Parameters
    ----------
    runs : sequence of Run
        Runs of one scenario, in its order; `flighttune.palette` gives up to eighteen their colours.
    path : str or Path
        File to write or replace; parent folders are made.
    page : str
        Markdown of the text page, see `flighttune.recording.page.scenario_page`.
    title : str
        Name of the recording in the viewer.

    Raises
    ------
    RecordingError
        If the file cannot be written.
    """
    path = Path(path)
    with whole_file(path) as part, strict():
        stream = rr.RecordingStream(application(title), recording_id=uuid.uuid4())
        try:
            _log(stream, part, runs, page=page, title=title)
        finally:
            stream.disconnect()
        check_recording(part, whole=True)


def _log(
    stream: rr.RecordingStream, part: Path, runs: Sequence[Run], *, page: str, title: str
) -> None:
    members = cast(runs)
    plots = shown_plots([member.run for member in members])
    claims = {m.key: found for m in members if (found := certified(m.run)) is not None}
    loops = {m.key: found for m in members if (found := frozen_loop(m.run)) is not None}
    stream.save(part, default_blueprint=blueprint(members, plots, claims=claims, loops=loops))
    stream.send_recording_name(title)
    stream.log(PAGE, rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN), static=True)
    log_record(stream, runs)
    if members:
        log_scene(stream, members, claims)
        log_lanes(stream, members)
        log_events(stream, members, claims)
    if claims:
        log_certificates(stream, members, claims)
    if loops:
        log_eigenvalues(stream, members, loops)
    for plot in dict.fromkeys(plot for tab in plots.values() for plot in tab):
        _log_plot(stream, plot, members)
    stream.flush()


@contextmanager
def strict() -> Iterator[None]:
    """Let Rerun raise on wrong data instead of dropping it with a warning."""
    before = strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)


def _log_plot(stream: rr.RecordingStream, plot: Plot, members: Sequence[Member]) -> None:
    folder = f"{PLOTS}/{plot.signal}"
    having = [member for member in members if plot.signal in member.run.signals]
    for member in having:
        signals, look = member.run.signals, member.look
        names = [name for name in plot.signals if name in signals]
        style = rr.SeriesLines(
            colors=[(*look.rgb, 255), (*look.rgb, FAINT)][: len(names)],
            widths=[look.width, 1.0][: len(names)],
            names=[member.run.label, f"{member.run.label}, command"][: len(names)],
        )
        values = np.column_stack([displayed(signals, name) for name in names])
        _log_lines(stream, f"{folder}/{member.key}", style, signals.index, values)
        if plot.measured and plot.measured in signals:
            _log_measured(stream, f"{folder}/{MEASURED}/{member.key}", member, plot.measured)
        if plot.band and set(plot.band) <= set(signals):
            _log_band(stream, f"{folder}/{member.key}_tube", member, plot.band)
    longest = max(having, key=lambda member: member.run.duration).run
    index = longest.signals.index
    if plot.common is not None and plot.common in longest.signals:
        style = rr.SeriesLines(colors=[rgb(NEUTRAL)], widths=[2.0], names=["reference"])
        values = displayed(longest.signals, plot.common)
        _log_lines(stream, f"{folder}/{REFERENCE}", style, index, values)
    bounds = limits_of(longest.provenance.scenario, plot.limit) if plot.limit else None
    if bounds is not None:
        names = ["lower limit", "upper limit"]
        style = rr.SeriesLines(colors=[rgb(LIMIT)] * 2, widths=[2.0] * 2, names=names)
        _log_lines(stream, f"{folder}/{LIMITS}", style, index[[0, -1]], np.array([bounds, bounds]))


def _log_measured(stream: rr.RecordingStream, path: str, member: Member, name: str) -> None:
    signals = member.run.signals
    style = rr.SeriesLines(
        colors=[(*member.look.rgb, FAINTEST)], widths=[1.0], names=[f"{member.run.label}, measured"]
    )
    _log_lines(stream, path, style, signals.index, displayed(signals, name)[:, None])


def _log_band(stream: rr.RecordingStream, path: str, member: Member, band: tuple[str, str]) -> None:
    signals = member.run.signals
    style = rr.SeriesLines(
        colors=[(*rgb(LIMIT), FAINT)] * 2,
        widths=[1.0] * 2,
        names=[f"{member.run.label}, {side} end of its tube" for side in ("lower", "upper")],
    )
    values = np.column_stack([displayed(signals, name) for name in band])
    _log_lines(stream, path, style, signals.index, values)


def _log_lines(
    stream: rr.RecordingStream,
    path: str,
    style: rr.SeriesLines,
    index: pd.Index,
    values: FloatArray,
) -> None:
    stream.log(path, style, static=True)
    kept = peaks(values)
    stream.send_columns(path, [times(index[kept])], rr.Scalars.columns(scalars=values[kept]))
