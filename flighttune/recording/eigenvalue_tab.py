"""The tab with the complex plane: eigenvalues at the trim, and moving with the flight."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.guarantee.mismatch import trim_of
from flighttune.present.palette import LIMIT, NEUTRAL, rgb
from flighttune.present.thinning import evenly
from flighttune.recording import entities
from flighttune.recording.entities import DrawnRun, log_lines, on_screen, times
from flighttune.recording.views import time_view
from flighttune.simulate.run import Run

TAB = "Eigenvalues"
GRID_COLOUR = (70, 70, 70)
ROOM = 0.12
CROSS = 0.012
"""Half size of a cross, over the size of the plane shown."""

LINES = 10
"""About as many grid lines each way."""

LINEARISED = 1500
"""Instants of a flight at which the loop is linearised."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrozenLoop:
    """The loop of a run, linearised about the flight condition of each instant.

    Attributes
    ----------
    t : ndarray, shape (k,), s
    eigenvalues : ndarray of complex, shape (k, 4), 1/s
        Of A_K with airspeed, path angle, roll and load factor as flown.
    trim : ndarray of complex, shape (4,), 1/s
        About wings-level flight on the first reference: what R_K and I_K are computed from.
    """

    t: FloatArray
    eigenvalues: npt.NDArray[np.complex128]
    trim: npt.NDArray[np.complex128]

    @property
    def abscissa(self) -> FloatArray:
        """Largest real part at each instant, shape (k,), 1/s."""
        return self.eigenvalues.real.max(axis=1)

    @property
    def damping(self) -> FloatArray:
        """Smallest damping ratio at each instant, shape (k,)."""
        size = np.maximum(np.abs(self.eigenvalues), 1e-12)
        return (-self.eigenvalues.real / size).min(axis=1)


def frozen_loop(run: Run) -> FrozenLoop | None:
    """Linearise the loop of a run along its flight.

    Parameters
    ----------
    run : Run
        A flight whose scenario says ``V_a_mps`` in its table ``flight``.

    Returns
    -------
    FrozenLoop or None
        None where there are no gains, no such table or no such condition.

    Notes
    -----
    The Jacobians of the chi/gamma law, see `kinematic_model`. Frozen eigenvalues are a picture of
    how the loop changes in flight; they prove nothing about it.
    """
    at, gains, signals = trim_of(run), run.provenance.gains, run.signals
    if at is None or gains is None:
        return None
    law = run.provenance.law
    try:
        trim = np.linalg.eigvals(closed_loop(law.linear_model(at), gains))
    except InputError:
        return None
    kept = evenly(len(signals), most=LINEARISED)
    flown = signals[["V_a", "gamma", "phi", "n_z"]].to_numpy(dtype=float)[kept]
    V_a, gamma, phi, _ = flown.T
    usable = np.isfinite(flown).all(axis=1) & (V_a > 0.0) & (np.abs(gamma) < np.pi / 2)
    usable &= (np.abs(phi) < np.pi / 2) & (np.cos(phi) > 1e-3)
    if not usable.any():
        return None
    A_K = law.loops_along(gains, flown[usable], at.g)
    t = run.t[kept][usable]
    return FrozenLoop(
        t=t, eigenvalues=np.linalg.eigvals(A_K).astype(complex), trim=trim.astype(complex)
    )


def log_eigenvalues(
    stream: rr.RecordingStream, drawn: Sequence[DrawnRun], loops: Mapping[str, FrozenLoop]
) -> None:
    """Log crosses at the trim, dots that move with the flight, and two plots over time.

    Parameters
    ----------
    stream : RecordingStream
    drawn : sequence of DrawnRun
    loops : mapping of str to FrozenLoop
        By key of the run, at least one; those without one are left out.
    """
    low, high = shown_plane(loops)
    _log_axes(stream, low, high)
    for folder in (entities.ABSCISSA, entities.DAMPING):
        entities.log_time_axis(stream, folder, drawn)
    half = CROSS * float(np.max(high - low))
    crossed: set[str] = set()
    for drawn_run in reversed(drawn):
        if drawn_run.key not in loops:
            continue
        loop, name = loops[drawn_run.key], drawn_run.run.provenance.gains_name
        if name not in crossed:
            crossed.add(name)
            strips = [
                np.array([[x - half, y - sign * half], [x + half, y + sign * half]])
                for x, y in _plane(loop.trim)
                for sign in (1.0, -1.0)
            ]
            width = on_screen(1.2)
            cross = rr.LineStrips2D(strips, colors=[drawn_run.style.rgb], radii=width)
            stream.log(f"{entities.PLANE}/trim/{drawn_run.key}", cross, static=True)
        _log_run(stream, drawn_run, loop)


def _log_run(stream: rr.RecordingStream, drawn_run: DrawnRun, loop: FrozenLoop) -> None:
    path, time = f"{entities.PLANE}/flown/{drawn_run.key}", times(loop.t)
    dot = rr.Points2D.from_fields(colors=[drawn_run.style.rgb], radii=on_screen(4.0))
    stream.log(path, dot, static=True)
    places = _plane(loop.eigenvalues.ravel())
    count = loop.eigenvalues.shape[1]
    columns = rr.Points2D.columns(positions=places).partition([count] * len(loop.t))
    stream.send_columns(path, [time], columns)
    for folder, values in ((entities.ABSCISSA, loop.abscissa), (entities.DAMPING, loop.damping)):
        style = rr.SeriesLines(
            colors=[drawn_run.style.rgb],
            widths=[drawn_run.style.width],
            names=[drawn_run.run.label],
        )
        log_lines(stream, f"{folder}/{drawn_run.key}", style, loop.t, values)


def _log_axes(stream: rr.RecordingStream, low: FloatArray, high: FloatArray) -> None:
    step = 10.0 ** np.floor(np.log10(float(np.max(high - low)) / LINES))
    step *= min((s for s in (1, 2, 5) if s * step * LINES >= np.max(high - low)), default=10)
    real, imaginary = (
        np.arange(np.ceil(a / step), np.floor(b / step) + 1.0) * step
        for a, b in zip(low, high, strict=True)
    )
    strips = [np.array([[x, -high[1]], [x, -low[1]]]) for x in real]
    strips += [np.array([[low[0], -y], [high[0], -y]]) for y in imaginary]
    thin = on_screen(0.5)
    grid = rr.LineStrips2D(strips, colors=[GRID_COLOUR], radii=thin, draw_order=-10.0)
    stream.log(f"{entities.PLANE}/grid", grid, static=True)
    edge = [np.array([[0.0, -high[1]], [0.0, -low[1]]])]
    line = rr.LineStrips2D(edge, colors=[rgb(LIMIT)], radii=on_screen(1.0), draw_order=-5.0)
    stream.log(f"{entities.PLANE}/edge_of_stability", line, static=True)
    off_axis = imaginary[np.abs(imaginary) > step / 2.0]
    places = [(x, 0.0) for x in real] + [(low[0], -y) for y in off_axis]
    labels = [f"{x:z.3g}" for x in real] + [f"{y:+.3g}i" for y in off_axis]
    marks = rr.Points2D(
        places,
        labels=labels,
        show_labels=True,
        colors=[rgb(NEUTRAL)],
        radii=on_screen(1.0),
        draw_order=-5.0,
    )
    stream.log(f"{entities.PLANE}/labels", marks, static=True)


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
        origin=entities.PLANE,
        name="Eigenvalues [1/s]: at trim crosses, as flown dots",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(float(low[0]), float(high[0])), y_range=(float(-high[1]), float(-low[1]))
        ),
    )
    over_time = [
        time_view(origin, name)
        for origin, name in (
            (entities.ABSCISSA, "Largest real part, as flown [1/s]"),
            (entities.DAMPING, "Smallest damping ratio, as flown [1]"),
        )
    ]
    return rrb.Horizontal(plane, rrb.Vertical(*over_time), column_shares=[1, 1])
