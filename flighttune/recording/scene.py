"""The 3D scene in local NED: paths, shadows, and aircraft with velocity and wind."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.plants.air_path import OVER_GROUND
from flighttune.plants.weather import WIND
from flighttune.present.palette import NEUTRAL, rgb
from flighttune.present.thinning import evenly
from flighttune.recording import entities, geometry
from flighttune.recording.derived import positions
from flighttune.recording.entities import DrawnRun, on_screen, times

# Made by ``docs/figures/aircraft_glb.py``; body axes, m.
MODEL = Path(__file__).with_name("aircraft.glb")

PATH_POINTS = 4000  # maximum number of points of a path; longer flights are thinned
INSTANTS = 500  # maximum number of instants at which arrows are drawn
DASHES = 60  # number of dashes in the path of a law
WIND_TIMES = 4.0  # scale of the wind arrow over that of the velocity arrow, as the page says
REACH = 0.9  # length of the velocity arrow at the start, in drawn widths of the aircraft
STILL_AIR = 1e-3  # wind (m/s) up to which there is no arrow
SHADOW = 90  # opacity of a shadow, of 255

GROUND_COLOUR = (88, 88, 88)
WIND_COLOUR = rgb(NEUTRAL)


def log_scene(stream: rr.RecordingStream, drawn: Sequence[DrawnRun]) -> None:
    """Log world axes (x north, y east, z down), paths and moving aircraft of all runs."""
    points = geometry.all_positions(drawn)
    factor = geometry.drawn_scale(drawn)
    lines, spacing = geometry.ground_grid(points)
    log_ground(stream, lines)
    corner = lines[0][0]
    arrows = rr.Arrows3D(
        origins=[corner, corner],
        vectors=geometry.AXES * spacing * np.eye(3)[:2],
        labels=["north", "east"],
        colors=[rgb(NEUTRAL)],
        radii=on_screen(1.5),
    )
    stream.log(f"{entities.GROUND}/axes", arrows, static=True)
    for drawn_run in drawn:
        # In a plot a NaN is only a gap, but it breaks the camera of a 3D view.
        signals = drawn_run.run.signals
        signals = signals.loc[np.isfinite(positions(signals)).all(axis=1)]
        width = factor * geometry.span_of(drawn_run.run)
        _log_path(stream, drawn_run, signals, floor=float(corner[2]))
        _log_aircraft(stream, drawn_run, signals, width=width)
        _log_arrows(stream, drawn_run, signals, width=width)


def log_ground(stream: rr.RecordingStream, lines: Sequence[FloatArray]) -> None:
    """Log world axes and a level grid."""
    # x forward, y right, z down: north, east, down. Rerun's RIGHT_HAND_Z_DOWN is another frame.
    stream.log(entities.WORLD, rr.ViewCoordinates.FRD, static=True)
    grid = rr.LineStrips3D(lines, radii=on_screen(0.5), colors=[GROUND_COLOUR])
    stream.log(entities.GROUND, grid, static=True)


def aircraft_model(
    colour: tuple[int, int, int], width: float
) -> tuple[rr.Asset3D, rr.InstancePoses3D]:
    """The aircraft in the colour of its run, `width` m wide."""
    # The scale is set on the instance, because the transform of the entity holds the attitude.
    return (
        rr.Asset3D(path=MODEL, albedo_factor=colour),
        rr.InstancePoses3D(scales=[[width / geometry.MODEL_SPAN] * 3]),
    )


def _log_path(
    stream: rr.RecordingStream, drawn_run: DrawnRun, signals: pd.DataFrame, *, floor: float
) -> None:
    path = positions(signals)
    path = path[evenly(len(path), most=PATH_POINTS)]
    # A law is dashed, so that both show where its path lies on that of an aircraft.
    dashes = [path] if _is_aircraft(drawn_run) else _dashes(path)
    width = on_screen(drawn_run.style.width if _is_aircraft(drawn_run) else 1.0)
    line = rr.LineStrips3D(dashes, radii=width, colors=[drawn_run.style.rgb])
    stream.log(f"{entities.PATHS}/{drawn_run.key}", line, static=True)
    number = rr.Points3D(
        path[-1:],
        labels=[str(drawn_run.number)],
        show_labels=True,
        colors=[drawn_run.style.rgb],
        radii=on_screen(2.0),
    )
    stream.log(f"{entities.PATHS}/{drawn_run.key}/number", number, static=True)
    flat = np.column_stack([path[:, :2], np.full(len(path), floor)])
    line = rr.LineStrips3D([flat], radii=on_screen(0.8), colors=[(*drawn_run.style.rgb, SHADOW)])
    stream.log(f"{entities.SHADOWS}/{drawn_run.key}", line, static=True)


def _log_aircraft(
    stream: rr.RecordingStream, drawn_run: DrawnRun, signals: pd.DataFrame, *, width: float
) -> None:
    signals = signals.iloc[evenly(len(signals))]
    frame, time = f"{entities.AIRCRAFT}/{drawn_run.key}", times(signals.index)
    carried = rr.Transform3D.columns(
        translation=positions(signals), quaternion=geometry.headings(signals)
    )
    stream.send_columns(frame, [time], carried)
    turned = rr.Transform3D.columns(quaternion=geometry.attitudes(signals))
    stream.send_columns(f"{frame}/{entities.BODY}", [time], turned)
    if _is_aircraft(drawn_run):
        shape = aircraft_model(drawn_run.style.rgb, width)
    else:
        shape = (
            rr.LineStrips3D(_ghost(width), radii=on_screen(1.0), colors=[drawn_run.style.rgb]),
        )
    stream.log(f"{frame}/{entities.BODY}", *shape, static=True)


def _is_aircraft(drawn_run: DrawnRun) -> bool:
    """Whether a run is of an aircraft; a law is drawn as an outline and dashes."""
    return drawn_run.run.provenance.aircraft is not None


def _ghost(width: float) -> list[FloatArray]:
    """Outlines of wing, fuselage, tailplane and fin in body axes, m."""
    wing = [[0.1, -0.5], [0.1, 0.5], [-0.04, 0.5], [-0.04, -0.5], [0.1, -0.5]]
    body = [[0.35, 0.0], [-0.42, 0.0]]
    tail = [[-0.34, -0.16], [-0.34, 0.16], [-0.42, 0.16], [-0.42, -0.16], [-0.34, -0.16]]
    fin = np.array([[-0.34, 0.0, 0.0], [-0.42, 0.0, -0.13], [-0.42, 0.0, 0.0]])
    flat = [np.column_stack([np.array(part), np.zeros(len(part))]) for part in (wing, body, tail)]
    return [width * part for part in (*flat, fin)]


def _dashes(path: FloatArray) -> list[FloatArray]:
    """Pieces of a path with gaps of the same length between them."""
    edges = np.linspace(0, len(path) - 1, 2 * DASHES).astype(int)
    pieces = [path[a : b + 1] for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [piece for piece in pieces if len(piece) > 1]


def _log_arrows(
    stream: rr.RecordingStream, drawn_run: DrawnRun, signals: pd.DataFrame, *, width: float
) -> None:
    """Log the arrows of velocity and wind, in axes that turn with the course."""
    signals = signals.iloc[evenly(len(signals), most=INSTANTS)]
    V = float(drawn_run.run.signals["V_a"].iloc[0])
    scale = REACH * width / V if math.isfinite(V) and V > 0.0 else 0.0  # m per m/s
    time = times(signals.index)
    frame = f"{entities.AIRCRAFT}/{drawn_run.key}"
    chi, gamma = (signals[name].to_numpy(dtype=float) for name in ("chi", "gamma"))
    # With columns over ground beside them, `chi` and `gamma` are through the air: so is the speed.
    over_ground = "V_g" in signals and OVER_GROUND[0] not in signals
    speed = signals["V_g" if over_ground else "V_a"].to_numpy(dtype=float)
    ahead = np.column_stack([np.cos(gamma), np.zeros_like(gamma), -np.sin(gamma)])
    arrows = {"velocity": (ahead * (scale * speed)[:, None], drawn_run.style.rgb)}
    if set(WIND) <= set(signals) and np.abs(signals[list(WIND)].to_numpy()).max() > STILL_AIR:
        north, east, down = (signals[name].to_numpy(dtype=float) for name in WIND)
        level = (north + 1j * east) * np.exp(-1j * chi)  # turned back by the course
        wind = np.column_stack([level.real, level.imag, down])
        arrows["wind"] = (wind * (WIND_TIMES * scale), WIND_COLOUR)
    for name, (vectors, colour) in arrows.items():
        style = rr.Arrows3D.from_fields(colors=[colour], radii=on_screen(1.0))
        stream.log(f"{frame}/{name}", style, static=True)
        stream.send_columns(f"{frame}/{name}", [time], rr.Arrows3D.columns(vectors=vectors))
