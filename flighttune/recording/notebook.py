"""Flights shown in a notebook: a figure, and the recording in the viewer."""

import uuid
from collections.abc import Iterable
from importlib.util import find_spec
from typing import TYPE_CHECKING

from flighttune.errors import InputError
from flighttune.flight.fly import FlownScenario
from flighttune.present.figures import RC, levels, line
from flighttune.present.palette import NEUTRAL
from flighttune.recording.entities import application, runs_to_draw
from flighttune.recording.plots import displayed, limits_of
from flighttune.recording.record import page_of
from flighttune.recording.rrd import log_recording, strict
from flighttune.simulate.run import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = {
    "chi_err": "course error [deg]",
    "gamma_err": "path-angle error [deg]",
    "phi": "roll [deg]",
    "n_z": "load factor [1]",
}
SIZE = 9.4, 5.2
"""Of the figure, inches."""


def plot(flown: FlownScenario | Run | Iterable[Run]) -> "Figure":
    """Draw both errors, roll and load factor of flights over time, with their limits.

    Parameters
    ----------
    flown : FlownScenario, Run or iterable of Run

    Returns
    -------
    Figure
        Angles in degrees; a notebook shows it, ``savefig`` writes it.

    Raises
    ------
    InputError
        If no run has flown.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    one = isinstance(flown, Run)
    runs = (flown,) if one else flown.runs if isinstance(flown, FlownScenario) else tuple(flown)
    drawn = runs_to_draw(runs)
    if not drawn:
        raise InputError("`flown` must have a run that flew, got none.")
    with mpl.rc_context(RC):
        figure = Figure(figsize=SIZE, layout="constrained")
        all_axes = figure.subplots(2, 2, sharex=True).ravel()
        for axes, (signal, label) in zip(all_axes, PANELS.items(), strict=True):
            for drawn_run in drawn:
                run = drawn_run.run
                if signal in run.signals:
                    values = displayed(run.signals, signal)
                    line(axes, run.t, values, drawn_run.style, label=run.label)
            levels(axes, *(limits_of(runs[0].provenance.scenario, signal) or ()))
            if signal.endswith("_err"):
                axes.axhline(0.0, color=NEUTRAL, lw=0.8)
            axes.set_ylabel(label)
        for axes in all_axes[2:]:
            axes.set_xlabel("t [s]")
        all_axes[0].set_xlim(0.0, max(drawn_run.run.duration for drawn_run in drawn))
        handles, labels = all_axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(drawn), 3))
    return figure


def show(flown: FlownScenario, *, width: int = 1280, height: int = 720) -> None:
    """Show the recording of flights in the output of a notebook's cell.

    Parameters
    ----------
    flown : FlownScenario
        What `flighttune.fly` returns.
    width, height : int, pixels

    Raises
    ------
    InputError
        If the viewer for notebooks is not installed.
    """
    import rerun as rr

    if find_spec("rerun_notebook") is None:
        raise InputError(
            "`show` needs rerun-notebook; install it with: pip install 'flighttune[notebook]'"
        )
    title = flown.scenario.title
    with rr.RecordingStream(application(title), recording_id=uuid.uuid4()) as stream, strict():
        log_recording(stream, flown.runs, page=page_of(flown), title=title)
        stream.notebook_show(width=width, height=height)
