"""The 3D scene in local NED: paths, shadows, aircraft, velocity and wind; a route and its map."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd
import rerun as rr
from scipy.spatial.transform import Rotation

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import FlightTuneError
from flighttune.flight.conditions import reference_of
from flighttune.flight.loop.run import Run, claimed_along
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.load import scenario_of
from flighttune.outputs.drawing.chart import evenly
from flighttune.outputs.drawing.palette import LIMIT, NEUTRAL, LineStyle, rgb
from flighttune.outputs.recording import entities
from flighttune.outputs.recording.entities import MAP, ROUTE, DrawnRun, log_still, on_screen, times
from flighttune.outputs.recording.plots import positions
from flighttune.routes.follow import RouteReference
from flighttune.routes.maps import on_earth
from flighttune.routes.path import Path as RoutePath
from flighttune.routes.route_keys import RouteTable
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.base import OVER_GROUND
from flighttune.vehicles.plants.jsbsim.model_files import wing_span
from flighttune.vehicles.plants.weather import WIND

APART = 5.0  # distance between points of the planned path and of the corridor, m
RIB = 5  # points of the corridor between two outlined cross-sections
WALL = 15  # opacity of a wall of the corridor, of 255

GREY = [rgb(NEUTRAL)]
TO_NED = np.array([1.0, 1.0, -1.0])  # axes: north, east and up


def route_of(flights: Sequence[DrawnRun]) -> tuple[RoutePath, RouteTable] | None:
    """Path and table of the route of one scenario's runs; None without a route."""
    if not flights or "route" not in flights[0].run.provenance.scenario:
        return None
    scenario = scenario_of(flights[0].run)
    followed = reference_of(scenario)
    assert isinstance(followed, RouteReference)
    assert scenario.route is not None
    return followed.path, scenario.route


def log_route(
    stream: rr.RecordingStream, flights: Sequence[DrawnRun], path: RoutePath, table: RouteTable
) -> None:
    """Log path, waypoints and corridors; also on a map, with fences, if the place is known."""
    line = path.beside(path.points(APART)) * TO_NED
    waypoints = np.array([[p.north, p.east, -p.up] for p in table.waypoints()])
    corridors = {
        flight.key: (flight.style, corners)
        for flight in flights
        if (corners := _corners(flight.run, path)) is not None
    }
    log_still(stream, f"{ROUTE}/path", rr.LineStrips3D([line], colors=GREY, radii=on_screen(1.0)))
    names: dict[tuple[float, ...], str] = {}
    for number, point in enumerate(map(tuple, waypoints), start=1):  # a route may end at its start
        names[point] = f"{names[point]}, {number}" if point in names else f"WP{number}"
    labels = {"labels": [*names.values()], "show_labels": True, "colors": GREY}
    points = rr.Points3D([*names], radii=on_screen(3.0), **labels)
    log_still(stream, f"{ROUTE}/waypoints", points)
    for key, (style, corners) in corridors.items():
        # A wall from one cross-section to the next is two triangles.
        i, j = (4 * np.arange(len(corners) - 1)[:, None] + (np.arange(4) + k) % 4 for k in (0, 1))
        walls = rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3),
            triangle_indices=np.stack([i, j, i + 4, j, j + 4, i + 4], axis=-1).reshape(-1, 3),
            albedo_factor=(*style.rgb, WALL),
        )
        log_still(stream, f"{ROUTE}/corridor/{key}/walls", walls)
        edges = [*corners.transpose(1, 0, 2), *corners[::RIB, [0, 1, 2, 3, 0]]]
        drawn = rr.LineStrips3D(edges, colors=[style.rgb], radii=on_screen(0.5))
        log_still(stream, f"{ROUTE}/corridor/{key}/edges", drawn)
    if table.geographic:
        _log_map(stream, flights, table, (line, waypoints), corridors)


def _log_map(
    stream: rr.RecordingStream,
    flights: Sequence[DrawnRun],
    table: RouteTable,
    route: tuple[FloatArray, FloatArray],
    corridors: Mapping[str, tuple[LineStyle, FloatArray]],
) -> None:
    """Log path and waypoints (`route`), corridors, fences and flights on a map."""
    line, waypoints = route

    def on_map(points: FloatArray) -> FloatArray:
        """Latitude and longitude of points, thinned, deg."""
        return on_earth(points[evenly(len(points))], table.origin)

    def lines(name: str, each: Sequence[FloatArray], colour: str, radius: float = 1.0) -> None:
        style = {"colors": [rgb(colour)], "radii": on_screen(radius)}
        log_still(stream, f"{MAP}/{name}", rr.GeoLineStrings(lat_lon=each, **style))

    lines("_path", [on_map(line)], NEUTRAL)
    dots = rr.GeoPoints(lat_lon=on_map(waypoints), colors=GREY, radii=on_screen(4.0))
    log_still(stream, f"{MAP}/_waypoints", dots)
    if rings := [ring for flight in flights for c in flight.run.claims for ring in c.fences]:
        lines("_fence", [np.array(ring)[:, 1::-1] for ring in rings], LIMIT, 1.5)
    for key, (style, corners) in corridors.items():
        lines(f"_corridor/{key}", [on_map(corners[:, side]) for side in (0, 1)], style.colour, 0.5)
    for flight in flights:
        signals, now = flight.run.signals, f"{MAP}/{flight.key}/now"
        flown = on_map(positions(signals))
        lines(flight.key, [flown], flight.style.colour)
        dot = rr.GeoPoints.from_fields(colors=[flight.style.rgb], radii=on_screen(6.0))
        log_still(stream, now, dot)
        time = times(signals.index[evenly(len(signals))])
        stream.send_columns(now, [time], rr.GeoPoints.columns(positions=flown))


def _corners(run: Run, path: RoutePath) -> FloatArray | None:
    """The band around cross-track and height about the path, shape (points, 4, 3), NED in m."""
    s = path.points(APART)
    s = s[s <= run.signals["along"].max()]
    to_sides, below = (next(claimed_along(run, name, s), None) for name in OFF_ROUTE)
    if to_sides is None or below is None:
        return None
    (left, right), (high, low) = to_sides, below
    # Corners are seen along the path, clockwise from the upper left.
    sides = (left, high), (right, high), (right, low), (left, low)
    return np.stack([path.beside(s, *side) * TO_NED for side in sides], axis=1)


# Made by ``docs/figures/aircraft_glb.py``; body axes, m.
MODEL = Path(__file__).with_name("aircraft.glb")
MODEL_SPAN = 2.9  # m: wing span of the aircraft in ``aircraft.glb``

FIELD_OF_VIEW = math.radians(52.0)  # vertical field of view for the flight; the viewer's is 55 deg
ASPECT = 0.85  # width over height of the view, or less
VIEWED_FROM = math.radians(-120.0)  # azimuth of the camera, clockwise from the direction of flight
ELEVATION = math.radians(22.0)  # elevation of the camera

SHARE_OF_FLIGHT = 1.0 / 10.0  # width of a drawn aircraft over the size of the flight
ROUND = (1.0, 2.0, 5.0)
FINELY_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
AXES = 2.0  # length of the axis arrows, in spacings of the grid
GROUND_LINES = 12  # approximate number along the longer side of the ground grid

Eye: TypeAlias = tuple[FloatArray, FloatArray]  # position and target of a camera, m

PATH_POINTS = 4000  # maximum number of points of a path; longer flights are thinned
INSTANTS = 500  # maximum number of instants at which arrows are drawn
NUMBERS = 12  # positions of run numbers along their paths
DASHES = 60  # number of dashes in the path of a law
WIND_TIMES = 4.0  # scale of the wind arrow relative to the velocity arrow, as the page says
REACH = 0.9  # length of the velocity arrow at the start, in drawn widths of the aircraft
STILL_AIR = 1e-3  # smaller winds (m/s) have no arrow
SHADOW = 90  # opacity of a shadow, of 255


def all_positions(flights: Sequence[DrawnRun]) -> FloatArray:
    """All finite positions of all runs, shape (n, 3), m."""
    points = np.vstack([positions(drawn_run.run.signals) for drawn_run in flights])
    return points[np.isfinite(points).all(axis=1)]


def headings(signals: pd.DataFrame) -> FloatArray:
    """Rotation to NED from level axes that turn with the course, shape (n, 4): x, y, z, w."""
    return Rotation.from_euler("z", signals[["chi"]].to_numpy(dtype=float)).as_quat()


def attitudes(signals: pd.DataFrame) -> FloatArray:
    """Rotation from body axes to the axes of `headings`, shape (n, 4): x, y, z, w."""
    pitch = signals["theta" if "theta" in signals else "gamma"]
    crab = signals["psi"] - signals["chi"] if "psi" in signals else 0.0 * pitch
    angles = np.column_stack([crab, pitch, signals["phi"]]).astype(float)
    return Rotation.from_euler("ZYX", angles).as_quat()  # yaw, pitch, roll about the turned axes


def span_of(run: Run) -> float:
    """Wing span, m, of the run's aircraft, else of its scenario's first, else `MODEL_SPAN`."""
    tables = run.provenance.scenario.get("plant") or []
    names = [run.provenance.aircraft, *(table.get("aircraft") for table in tables)]
    return next((_span(name) for name in names if name), MODEL_SPAN)


@cache
def _span(aircraft: str) -> float:
    try:
        return wing_span(load_aircraft(aircraft)) or MODEL_SPAN
    except FlightTuneError:  # the aircraft of an old recording may be missing
        return MODEL_SPAN


def drawn_scale(flights: Sequence[DrawnRun]) -> float:
    """Enlargement of all drawn aircraft."""
    return enlargement(all_positions(flights), max(span_of(flight.run) for flight in flights))


def enlargement(points: FloatArray, span: float) -> float:
    """The factor for positions and the largest wing span, m: a round number, at least 1."""
    factor = float(np.linalg.norm(np.ptp(points, axis=0))) * SHARE_OF_FLIGHT / span
    return max(1.0, round_below(factor, FINELY_ROUND))


def ground_grid(points: FloatArray) -> tuple[list[FloatArray], float]:
    """Lines (2, 3) of a level grid below the flight, as wide as the flight, and its spacing, m."""
    longest = float(np.ptp(points[:, :2], axis=0).max())
    spacing = round_below(max(longest, 1.0) * 2.0 / GROUND_LINES)
    low = np.floor(points[:, :2].min(axis=0) / spacing) * spacing
    high = np.ceil(points[:, :2].max(axis=0) / spacing) * spacing
    high = np.maximum(high, low + AXES * spacing)
    down = float(points[:, 2].max()) + spacing / 2.0
    norths, easts = (
        np.arange(a, b + spacing / 2.0, spacing) for a, b in zip(low, high, strict=True)
    )
    lines = [np.array([[north, low[1], down], [north, high[1], down]]) for north in norths]
    lines += [np.array([[low[0], east, down], [high[0], east, down]]) for east in easts]
    return lines, spacing


def round_below(value: float, steps: tuple[float, ...] = ROUND) -> float:
    """Largest of `steps` times a power of ten that is not above `value`."""
    decade = 10.0 ** math.floor(math.log10(value)) if value > 0.0 else 1.0
    return decade * max(factor for factor in steps if factor * decade <= value or factor == 1.0)


def overview(flights: Sequence[DrawnRun]) -> Eye:
    """Camera that sees all runs, the ground below them and its axes."""
    points = all_positions(flights)
    lines, spacing = ground_grid(points)
    axes = lines[0][0] + AXES * spacing * np.eye(3)[:2]
    width = drawn_scale(flights) * max(span_of(flight.run) for flight in flights)
    return overview_eye(np.vstack([points, axes, *lines]), margin=width / 2.0)


def overview_eye(points: FloatArray, *, margin: float) -> Eye:
    """Camera that sees all `points` and `margin` (m) around them, from the left and above."""
    low, high = points.min(axis=0), points.max(axis=0)
    # The direction of flight is a diagonal of its bounding box.
    moved = (low + high) / 2.0 - points[0]
    north, east = (high - low)[:2] * np.where(moved[:2] < 0.0, -1.0, 1.0)
    azimuth = math.atan2(east, north) + VIEWED_FROM
    level = math.cos(ELEVATION)
    back = np.array([level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(ELEVATION)])
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    up = np.cross(right, back)
    # A point is in the picture if it is no further from the axis than the edge there.
    centre = (low + high) / 2.0
    depth, across = (points - centre) @ back, (points - centre) @ np.column_stack([right, up])
    slopes = math.tan(FIELD_OF_VIEW / 2.0) * np.array([ASPECT, 1.0])
    distance = float(np.max((np.abs(across) + margin) / slopes + depth[:, None]))
    return centre + distance * back, centre


def chase_eye(width: float) -> Eye:
    """Camera behind and above an aircraft `width` m wide, in axes that turn with its course."""
    return width * np.array([-2.0, -0.9, -1.0]), width * np.array([0.3, 0.0, 0.0])


def somewhere(drawn_run: DrawnRun) -> DrawnRun:
    """The run at finite poses only: NaN is a gap in a plot but breaks a camera."""
    signals = drawn_run.run.signals
    pose = [positions(signals), signals[["chi", "gamma", "phi"]].to_numpy(dtype=float)]
    signals = signals.loc[np.isfinite(np.hstack(pose)).all(axis=1)]
    return drawn_run._replace(run=replace(drawn_run.run, signals=signals))


def log_scene(stream: rr.RecordingStream, flights: Sequence[DrawnRun]) -> None:
    """Log world axes (x north, y east, z down), paths and moving aircraft of all runs."""
    factor, (lines, spacing) = drawn_scale(flights), ground_grid(all_positions(flights))
    # x forward, y right, z down: north, east, down. Rerun's RIGHT_HAND_Z_DOWN is a different frame.
    log_still(stream, entities.WORLD, rr.ViewCoordinates.FRD)
    grid = rr.LineStrips3D(lines, radii=on_screen(0.5), colors=[(88, 88, 88)])
    log_still(stream, entities.GROUND, grid)
    corner = lines[0][0]
    arrows = rr.Arrows3D(
        origins=[corner, corner],
        vectors=AXES * spacing * np.eye(3)[:2],
        labels=["north", "east"],
        colors=[rgb(NEUTRAL)],
        radii=on_screen(1.5),
    )
    log_still(stream, f"{entities.GROUND}/axes", arrows)
    for flight in flights:
        _log_path(stream, flight, floor=float(corner[2]))
        _log_aircraft(stream, flight, factor * span_of(flight.run))


def _log_path(stream: rr.RecordingStream, flight: DrawnRun, *, floor: float) -> None:
    path, colour = positions(flight.run.signals), flight.style.rgb
    path = path[evenly(len(path), most=PATH_POINTS)]
    # The path of a law is dashed, so that it does not hide an aircraft's path.
    pieces = [path] if _is_aircraft(flight) else dashes(path)
    width = on_screen(flight.style.width if _is_aircraft(flight) else 1.0)
    entity = f"{entities.PATHS}/{flight.key}"
    log_still(stream, entity, rr.LineStrips3D(pieces, radii=width, colors=[colour]))
    # Paths often end together, so each number stands a little before the next run's number.
    place = len(path) - 1 - (flight.number - 1) * len(path) // NUMBERS % len(path)
    number = rr.Points3D(
        path[place : place + 1],
        labels=[str(flight.number)],
        show_labels=True,
        colors=[colour],
        radii=on_screen(2.0),
    )
    log_still(stream, f"{entity}/number", number)
    flat = np.column_stack([path[:, :2], np.full(len(path), floor)])
    shadow = rr.LineStrips3D([flat], radii=on_screen(0.8), colors=[(*colour, SHADOW)])
    log_still(stream, f"{entities.SHADOWS}/{flight.key}", shadow)


def _log_aircraft(stream: rr.RecordingStream, flight: DrawnRun, width: float) -> None:
    """Log the moving aircraft of a run, `width` (m) wide, with the arrows of velocity and wind."""
    frame, colour = f"{entities.AIRCRAFT}/{flight.key}", flight.style.rgb
    signals = flight.run.signals.iloc[evenly(len(flight.run.signals), most=INSTANTS)]
    time = [times(signals.index)]
    for name, vectors in _arrows(flight.run, signals, width).items():
        shade = colour if name == "velocity" else rgb(NEUTRAL)
        style = rr.Arrows3D.from_fields(colors=[shade], radii=on_screen(1.0))
        log_still(stream, f"{frame}/{name}", style)
        stream.send_columns(f"{frame}/{name}", time, rr.Arrows3D.columns(vectors=vectors))
    signals = flight.run.signals.iloc[evenly(len(flight.run.signals))]
    time = [times(signals.index)]
    carried = rr.Transform3D.columns(translation=positions(signals), quaternion=headings(signals))
    stream.send_columns(frame, time, carried)
    turned = rr.Transform3D.columns(quaternion=attitudes(signals))
    stream.send_columns(f"{frame}/{entities.BODY}", time, turned)
    if _is_aircraft(flight):
        # The scale is set on the instance, because the entity's transform has the attitude.
        size = rr.InstancePoses3D(scales=[[width / MODEL_SPAN] * 3])
        shape = rr.Asset3D(path=MODEL, albedo_factor=colour), size
    else:
        shape = (rr.LineStrips3D(_ghost(width), radii=on_screen(1.0), colors=[colour]),)
    log_still(stream, f"{frame}/{entities.BODY}", *shape)


def _is_aircraft(drawn_run: DrawnRun) -> bool:
    """Whether a run flew an aircraft; a law is drawn as an outline and dashes."""
    made_by = drawn_run.run.provenance
    return made_by.aircraft is not None or made_by.log is not None


def _ghost(width: float) -> list[FloatArray]:
    """Outlines of wing, fuselage, tailplane and fin in body axes, m."""
    wing = [[0.1, -0.5], [0.1, 0.5], [-0.04, 0.5], [-0.04, -0.5], [0.1, -0.5]]
    body = [[0.35, 0.0], [-0.42, 0.0]]
    tail = [[-0.34, -0.16], [-0.34, 0.16], [-0.42, 0.16], [-0.42, -0.16], [-0.34, -0.16]]
    fin = np.array([[-0.34, 0.0, 0.0], [-0.42, 0.0, -0.13], [-0.42, 0.0, 0.0]])
    flat = [np.column_stack([np.array(part), np.zeros(len(part))]) for part in (wing, body, tail)]
    return [width * part for part in (*flat, fin)]


def dashes(path: FloatArray) -> list[FloatArray]:
    """Pieces of a path with gaps of the same length between them."""
    edges = np.linspace(0, len(path) - 1, 2 * DASHES).astype(int)
    pieces = [path[a : b + 1] for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [piece for piece in pieces if len(piece) > 1]


def _arrows(run: Run, signals: pd.DataFrame, width: float) -> dict[str, FloatArray]:
    """Arrows of velocity and wind at samples of a run, in axes that turn with its course, m."""
    airspeed = "V_a" if "V_a" in signals else "V_g"  # a log may lack airspeed
    V = float(run.signals[airspeed].iloc[0])
    scale = REACH * width / V if math.isfinite(V) and V > 0.0 else 0.0  # m per m/s
    chi, gamma = (signals[name].to_numpy(dtype=float) for name in ("chi", "gamma"))
    # If columns over ground exist, `chi` and `gamma`, and so the speed, are through the air.
    over_ground = "V_g" in signals and OVER_GROUND[0] not in signals
    speed = signals["V_g" if over_ground else airspeed].to_numpy(dtype=float)
    ahead = np.column_stack([np.cos(gamma), np.zeros_like(gamma), -np.sin(gamma)])
    arrows = {"velocity": ahead * (scale * speed)[:, None]}
    if set(WIND) <= set(signals) and np.abs(signals[list(WIND)].to_numpy()).max() > STILL_AIR:
        north, east, down = (signals[name].to_numpy(dtype=float) for name in WIND)
        level = (north + 1j * east) * np.exp(-1j * chi)  # rotated back by the course
        arrows["wind"] = np.column_stack([level.real, level.imag, down]) * (WIND_TIMES * scale)
    return arrows
