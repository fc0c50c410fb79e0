"""Panels over time and in space: tracking, commands with limits, paths."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.present.figures import (
    DASHES,
    PANEL,
    RC,
    REFERENCE,
    levels,
    line,
    on_white,
    panel,
    svg_uri,
    thinned,
)
from flighttune.present.frame import Picture, pictured
from flighttune.present.palette import LineStyle
from flighttune.recording.plots import displayed, limits_of
from flighttune.report.facts import Facts
from flighttune.simulate.run import Run

TRACKING = (
    ("chi", "Course; reference grey", "χ [deg]"),
    ("gamma", "Flight-path angle; reference grey", "γ [deg]"),
    ("chi_err", "Course error", r"$e_\chi$ [deg]"),
    ("gamma_err", "Path-angle error", r"$e_\gamma$ [deg]"),
)
COMMANDS = (
    ("phi", "Roll command; limits red, bars: command limited", r"$\varphi_\mathrm{cmd}$ [deg]"),
    ("n_z", "Load-factor command; limits red, bars: command limited", r"$n_{z,\mathrm{cmd}}$ [1]"),
)
LANE = 0.022
"""Height of the bar of one run as a part of the panel."""

FINEST = 300
"""Bars that fit next to each other in a flight."""

SPACE_HEIGHT = 4.0
"""Height of the figure in space, inches."""

FLATTEST = 0.4
"""Smallest ratio of two edges of the box in space; shorter ones are stretched."""


def tracking(facts: Facts) -> list[Picture]:
    """Course and path angle with their references, and both errors."""
    pictures = []
    for signal, title, unit in TRACKING:
        with panel(title, unit) as axes:
            if not signal.endswith("_err"):
                longest = max(facts.runs, key=lambda run: run.duration)
                t, reference = longest.t, displayed(longest.signals, f"{signal}_ref")
                axes.plot(*thinned(t, reference), color=REFERENCE, lw=1.6)
            else:
                axes.axhline(0.0, color=REFERENCE, lw=1.0)
            for run, style in _styled(facts):
                line(axes, run.t, displayed(run.signals, signal), style, most=facts.points)
            axes.set_xlim(0.0, max(run.duration for run in facts.runs))
            pictures.append(pictured(axes, title))
    return pictures


def commands(facts: Facts) -> list[Picture]:
    """Commands after their limits, the limits, and bars while a command is limited."""
    pictures = []
    for name, title, unit in COMMANDS:
        with panel(title, unit, height=3.0) as axes:
            for place, (run, style) in enumerate(_styled(facts)):
                line(
                    axes,
                    run.t,
                    displayed(run.signals, f"{name}_cmd"),
                    style,
                    most=facts.points,
                )
                held = run.signals[f"{name}_limited"].to_numpy() != 0.0
                axes.broken_barh(
                    _spans(run.t, held),
                    (LANE * (1.3 * place + 0.4), LANE),
                    transform=axes.get_xaxis_transform(),
                    color=on_white(style.colour),
                )
            levels(axes, *(limits_of(facts.runs[0].provenance.scenario, name) or ()))
            axes.set_xlim(0.0, max(run.duration for run in facts.runs))
            low, high = axes.get_ylim()
            axes.set_ylim(low - LANE * (1.5 * len(facts.runs) + 1.0) * (high - low), high)
            pictures.append(pictured(axes, title))
    return pictures


def paths(facts: Facts) -> list[Picture]:
    """The paths in space, from above, and their heights."""
    pictures = [_space(facts), _from_above(facts)]
    with panel("Height over the start", "height [m]") as axes:
        for run, style in _styled(facts):
            line(axes, run.t, -run.signals["down"].to_numpy(), style, most=facts.points)
        axes.set_xlim(0.0, max(run.duration for run in facts.runs))
        pictures.append(pictured(axes, "Heights over time"))
    return pictures


def _from_above(facts: Facts) -> Picture:
    """North up, or to the right where the flight is longer that way."""
    points = np.vstack([run.signals[["north", "east"]].to_numpy() for run in facts.runs])
    north, east = np.ptp(points, axis=0)
    x, y = ("north", "east") if north > east else ("east", "north")
    with panel("From above, start at the cross", f"{y} [m]", f"{x} [m]", height=3.0) as axes:
        for run, style in _styled(facts):
            line(
                axes, run.signals[x].to_numpy(), run.signals[y].to_numpy(), style, most=facts.points
            )
        axes.plot(0.0, 0.0, "k+", ms=9)
        axes.set_aspect("equal", adjustable="datalim")
        if y == "east":
            axes.invert_yaxis()
        return pictured(axes, "Paths from above")


def _space(facts: Facts) -> Picture:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):
        figure = Figure(figsize=(PANEL[0], SPACE_HEIGHT))
        axes: Any = figure.add_axes((0.0, 0.03, 0.94, 0.92), projection="3d")
        points = [
            run.signals[["north", "east", "down"]].to_numpy()[
                :: len(run.signals) // facts.points + 1
            ]
            for run in facts.runs
        ]
        for own, (_, style) in zip(points, _styled(facts), strict=True):
            north, east, down = own.T
            dashes = {"ls": DASHES} if style.dashed else {}
            axes.plot(east, north, -down, color=on_white(style.colour), lw=style.width, **dashes)
        size = np.ptp(np.vstack(points), axis=0)[[1, 0, 2]]
        edges = np.maximum(size / size.max(), FLATTEST)
        axes.set_box_aspect(tuple(edges), zoom=0.98)
        axes.view_init(elev=24.0, azim=-60.0)
        for axis, edge in zip("xyz", edges, strict=True):
            axes.locator_params(axis=axis, nbins=round(2 + 3 * edge))
        for name, text in (("x", "east [m]"), ("y", "north [m]"), ("z", "height [m]")):
            getattr(axes, f"set_{name}label")(text, labelpad=7.0)
        axes.set_title("Paths in space", loc="left")
        return Picture(uri=svg_uri(figure), alt="Paths of all runs in space")


def _styled(facts: Facts) -> Iterator[tuple[Run, LineStyle]]:
    """Every run that flew with its line style."""
    for run in facts.runs:
        yield run, facts.styles[run.label]


def _spans(t: FloatArray, flag: np.ndarray) -> list[tuple[float, float]]:
    """Start and length of every stretch in which `flag` is true; those too close are one."""
    edges = np.flatnonzero(np.diff(flag.astype(int), prepend=0, append=0))
    ends = np.append(t, t[-1])[edges].tolist()
    spans: list[tuple[float, float]] = []
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        if spans and start - sum(spans[-1]) < t[-1] / FINEST:
            start = spans.pop()[0]
        spans.append((start, end - start))
    return spans
