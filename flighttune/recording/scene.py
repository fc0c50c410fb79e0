"""The 3D scene: paths, their shadows, and the aircraft of all runs in local NED."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.palette import NEUTRAL, rgb
from flighttune.recording.airframe import span_of
from flighttune.recording.cast import Member
from flighttune.recording.certified import Certified
from flighttune.recording.geometry import (
    attitudes,
    enlargement,
    flown,
    ground_grid,
    headings,
    positions,
    widest,
)
from flighttune.recording.mesh import SPAN, Mesh, aircraft_mesh
from flighttune.recording.motion import log_motion
from flighttune.recording.names import AIRCRAFT, BODY, GROUND, PATHS, SHADOWS, WORLD, times
from flighttune.recording.thinning import evenly

MOST_POINTS = 4000
"""Points of a path as drawn; longer flights are thinned."""

SHADOW = 90
"""Opacity of a shadow, of 255."""

GROUND_COLOUR = (88, 88, 88)

PALE = 0.55
"""How far the fuselage is mixed with white."""


def log_scene(
    stream: rr.RecordingStream, members: Sequence[Member], claims: Mapping[str, Certified]
) -> None:
    """Log world axes (x north, y east, z down), paths and moving aircraft of all runs.

    Parameters
    ----------
    stream : RecordingStream
    members : sequence of Member
    claims : mapping of str to Certified
        By key of the member; those without one have no cone.
    """
    points = flown(members)
    factor = enlargement(points, widest(members))
    lines, spacing = ground_grid(points)
    floor = float(lines[0][0, 2])
    mesh = aircraft_mesh()
    stream.log(WORLD, rr.ViewCoordinates.FRD, static=True)
    _log_ground(stream, lines, spacing)
    for member in members:
        _log_path(stream, member, floor)
        span = span_of(member.run)
        _log_aircraft(stream, member, mesh, factor * span / SPAN)
        log_motion(stream, member, claims.get(member.key), width=factor * span)


def _log_ground(stream: rr.RecordingStream, lines: list[FloatArray], spacing: float) -> None:
    thin = rr.components.Radius.ui_points(0.5)
    stream.log(GROUND, rr.LineStrips3D(lines, radii=thin, colors=[GROUND_COLOUR]), static=True)
    corner = lines[0][0]
    arrows = rr.Arrows3D(
        origins=[corner, corner],
        vectors=np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]) * spacing,
        labels=["north", "east"],
        colors=[rgb(NEUTRAL)],
        radii=rr.components.Radius.ui_points(1.5),
    )
    stream.log(f"{GROUND}/axes", arrows, static=True)


def _log_path(stream: rr.RecordingStream, member: Member, floor: float) -> None:
    path = positions(member.run.signals)
    path = path[np.isfinite(path).all(axis=1)]
    path = path[evenly(len(path), most=MOST_POINTS)]
    width = rr.components.Radius.ui_points(member.look.width)
    line = rr.LineStrips3D([path], radii=width, colors=[member.look.rgb])
    stream.log(f"{PATHS}/{member.key}", line, static=True)
    flat = np.column_stack([path[:, :2], np.full(len(path), floor)])
    width = rr.components.Radius.ui_points(0.8)
    line = rr.LineStrips3D([flat], radii=width, colors=[(*member.look.rgb, SHADOW)])
    stream.log(f"{SHADOWS}/{member.key}", line, static=True)


def _log_aircraft(stream: rr.RecordingStream, member: Member, mesh: Mesh, factor: float) -> None:
    signals = member.run.signals
    signals = signals.loc[np.isfinite(positions(signals)).all(axis=1)]
    signals = signals.iloc[evenly(len(signals))]
    time = times(signals.index)
    frame = f"{AIRCRAFT}/{member.key}"
    carried = rr.Transform3D.columns(translation=positions(signals), quaternion=headings(signals))
    stream.send_columns(frame, [time], carried)
    turned = rr.Transform3D.columns(quaternion=attitudes(signals))
    stream.send_columns(f"{frame}/{BODY}", [time], turned)
    shape = rr.Mesh3D(
        vertex_positions=mesh.vertices * factor,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.triangles,
        vertex_colors=paint(mesh, member.look.rgb),
    )
    stream.log(f"{frame}/{BODY}", shape, static=True)


def paint(mesh: Mesh, rgb: tuple[int, int, int]) -> np.ndarray:
    """Colours of the corners: wing and tail in that of the run, the rest pale."""
    strong = np.array(rgb, dtype=float)
    pale: FloatArray = strong + (255.0 - strong) * PALE
    return np.where(mesh.accent[:, None], strong, pale).round().astype(np.uint8)
