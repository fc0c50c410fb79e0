"""The tab with the complex plane: eigenvalues at the trim, and moving with the flight."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.arrays import FloatArray
from flighttune.palette import LIMIT, NEUTRAL, rgb
from flighttune.recording.cast import Member
from flighttune.recording.frozen_loop import FrozenLoop
from flighttune.recording.names import ABSCISSA, DAMPING, PLANE, times

TAB = "Eigenvalues"
GRID_COLOUR = (70, 70, 70)
ROOM = 0.12
CROSS = 0.012
"""Half size of a cross, over the size of the plane shown."""

LINES = 10
"""About as many grid lines each way."""


def log_eigenvalues(
    stream: rr.RecordingStream, members: Sequence[Member], loops: Mapping[str, FrozenLoop]
) -> None:
    """Log crosses at the trim, dots that move with the flight, and two plots over time.

    Parameters
    ----------
    stream : RecordingStream
    members : sequence of Member
    loops : mapping of str to FrozenLoop
        By key of the member, at least one; those without one are left out.
    """
    low, high = shown_plane(loops)
    _log_axes(stream, low, high)
    half = CROSS * float(np.max(high - low))
    crossed: set[str] = set()
    for member in reversed(members):
        if member.key not in loops:
            continue
        loop, name = loops[member.key], member.run.provenance.gains_name
        if name not in crossed:
            crossed.add(name)
            strips = [
                np.array([[x - half, y - sign * half], [x + half, y + sign * half]])
                for x, y in _plane(loop.trim)
                for sign in (1.0, -1.0)
            ]
            width = rr.components.Radius.ui_points(1.2)
            cross = rr.LineStrips2D(strips, colors=[member.look.rgb], radii=width)
            stream.log(f"{PLANE}/trim/{member.key}", cross, static=True)
        _log_run(stream, member, loop)


def _log_run(stream: rr.RecordingStream, member: Member, loop: FrozenLoop) -> None:
    path, time = f"{PLANE}/flown/{member.key}", times(pd.Index(loop.t))
    dot = rr.Points2D.from_fields(
        colors=[member.look.rgb], radii=rr.components.Radius.ui_points(4.0)
    )
    stream.log(path, dot, static=True)
    places = _plane(loop.eigenvalues.ravel())
    count = loop.eigenvalues.shape[1]
    columns = rr.Points2D.columns(positions=places).partition([count] * len(loop.t))
    stream.send_columns(path, [time], columns)
    for folder, values in ((ABSCISSA, loop.abscissa), (DAMPING, loop.damping)):
        style = rr.SeriesLines(
            colors=[member.look.rgb], widths=[member.look.width], names=[member.run.label]
        )
        stream.log(f"{folder}/{member.key}", style, static=True)
        stream.send_columns(f"{folder}/{member.key}", [time], rr.Scalars.columns(scalars=values))


def _log_axes(stream: rr.RecordingStream, low: FloatArray, high: FloatArray) -> None:
    step = 10.0 ** np.floor(np.log10(float(np.max(high - low)) / LINES))
    step *= min((s for s in (1, 2, 5) if s * step * LINES >= np.max(high - low)), default=10)
    real, imaginary = (
        np.arange(np.ceil(a / step), np.floor(b / step) + 1.0) * step
        for a, b in zip(low, high, strict=True)
    )
    strips = [np.array([[x, -high[1]], [x, -low[1]]]) for x in real]
    strips += [np.array([[low[0], -y], [high[0], -y]]) for y in imaginary]
    thin = rr.components.Radius.ui_points(0.5)
    grid = rr.LineStrips2D(strips, colors=[GRID_COLOUR], radii=thin, draw_order=-10.0)
    stream.log(f"{PLANE}/grid", grid, static=True)
    edge = [np.array([[0.0, -high[1]], [0.0, -low[1]]])]
    line = rr.LineStrips2D(
        edge, colors=[rgb(LIMIT)], radii=rr.components.Radius.ui_points(1.0), draw_order=-5.0
    )
    stream.log(f"{PLANE}/edge_of_stability", line, static=True)
    off_axis = imaginary[np.abs(imaginary) > step / 2.0]
    places = [(x, 0.0) for x in real] + [(low[0], -y) for y in off_axis]
    labels = [f"{x:z.3g}" for x in real] + [f"{y:+.3g}i" for y in off_axis]
    marks = rr.Points2D(
        places,
        labels=labels,
        show_labels=True,
        colors=[rgb(NEUTRAL)],
        radii=rr.components.Radius.ui_points(1.0),
        draw_order=-5.0,
    )
    stream.log(f"{PLANE}/labels", marks, static=True)


def _plane(eigenvalues: npt.NDArray[np.complex128]) -> FloatArray:
    """Real part to the right and imaginary part up, in a view whose second axis goes down."""
    return np.column_stack([eigenvalues.real, -eigenvalues.imag])


def shown_plane(loops: Mapping[str, FrozenLoop]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of what is shown: all crosses, and nearly all that is flown.

    Returns
    -------
    low, high : ndarray, shape (2,), 1/s
        Real and imaginary part.
    """
    trims = np.concatenate([loop.trim for loop in loops.values()])
    flown = np.concatenate([loop.eigenvalues.ravel() for loop in loops.values()])
    ends = []
    for part in ("real", "imag"):
        usual = np.percentile(getattr(flown, part), [1.0, 99.0])
        ends.append([0.0, *getattr(trims, part), *usual])
    low, high = np.array([min(e) for e in ends]), np.array([max(e) for e in ends])
    room = ROOM * float(np.max(high - low))
    low, high = low - room, high + room
    lacking = max(0.0, float(high[1] - low[1] - (high[0] - low[0])))
    return low - np.array([0.8 * lacking, 0.0]), high + np.array([0.2 * lacking, 0.0])


def eigenvalue_tab(loops: Mapping[str, FrozenLoop]) -> rrb.Container:
    """The complex plane beside the slowest and the least damped eigenvalue over time."""
    low, high = shown_plane(loops)
    plane = rrb.Spatial2DView(
        origin=PLANE,
        name="Eigenvalues [1/s]: at trim crosses, as flown dots",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(float(low[0]), float(high[0])), y_range=(float(-high[1]), float(-low[1]))
        ),
    )
    over_time = [
        rrb.TimeSeriesView(
            origin=origin,
            name=name,
            axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for origin, name in (
            (ABSCISSA, "Largest real part, as flown [1/s]"),
            (DAMPING, "Smallest damping ratio, as flown [1]"),
        )
    ]
    return rrb.Horizontal(plane, rrb.Vertical(*over_time), column_shares=[1, 1])
