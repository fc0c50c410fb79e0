"""Flights shown in a notebook: a figure, and the recording in the viewer."""

import uuid
from collections.abc import Iterable

from flighttune.errors import InputError
from flighttune.extras import need
from flighttune.flight.fly import FlownScenario
from flighttune.present.chart import Chart, Sheet
from flighttune.present.palette import NEUTRAL
from flighttune.recording.entities import application, runs_to_draw
from flighttune.recording.plots import displayed, limits_of
from flighttune.recording.record import page_of
from flighttune.recording.rrd import log_recording, strict
from flighttune.simulate.run import Run

PANELS = {
    "chi_err": ("Course error", "e_χ [deg]"),
    "gamma_err": ("Path-angle error", "e_γ [deg]"),
    "phi": ("Roll", "φ [deg]"),
    "n_z": ("Load factor", "n_z [1]"),
}


def plot(flown: FlownScenario | Run | Iterable[Run]) -> Sheet:
    """Draw both errors, roll and load factor of flights over time, with their limits.

    Parameters
    ----------
    flown : FlownScenario, Run or iterable of Run

    Returns
    -------
    Sheet
        Angles in degrees; a notebook shows it, ``save`` writes an SVG file.

    Raises
    ------
    InputError
        If no run has flown.
    """
    runs = flown.runs if isinstance(flown, FlownScenario) else flown
    runs = (runs,) if isinstance(runs, Run) else tuple(runs)
    drawn = runs_to_draw(runs)
    if not drawn:
        raise InputError("`flown` must have a run that flew, got none.")
    end = max(drawn_run.run.duration for drawn_run in drawn)
    charts = []
    for signal, (title, label) in PANELS.items():
        chart = Chart(title=title, y=label, x_range=(0.0, end))
        if signal.endswith("_err"):
            chart.level(0.0, NEUTRAL, dash="")
        for limit in limits_of(runs[0].provenance.scenario, signal) or ():
            chart.level(limit)
        for drawn_run in drawn:
            run = drawn_run.run
            if signal in run.signals:
                values = displayed(run.signals, signal)
                chart.run_line(run.t, values, drawn_run.style, run.label, name=run.label)
        charts.append(chart)
    return Sheet(charts=charts)


def show(flown: FlownScenario, *, width: int = 1280, height: int = 720) -> None:
    """Show the recording of flights in the output of a notebook's cell.

    Parameters
    ----------
    flown : FlownScenario
        Result of `flighttune.fly`.
    width, height : int, pixels

    Raises
    ------
    InputError
        If the viewer for notebooks is not installed.
    """
    need("`show`", "rerun_notebook")
    import rerun as rr

    title = flown.scenario.title
    with rr.RecordingStream(application(title), recording_id=uuid.uuid4()) as stream, strict():
        log_recording(stream, flown.runs, page=page_of(flown), title=title)
        stream.notebook_show(width=width, height=height)
