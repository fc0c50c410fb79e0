"""A route in a recording: planned path, corridor and map."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.flight.conditions import reference_of
from flighttune.metrics import OFF_ROUTE
from flighttune.present.palette import NEUTRAL, rgb
from flighttune.present.thinning import evenly
from flighttune.recording.entities import MAP, ROUTE, TRUE_SIZE, DrawnRun, on_screen, times
from flighttune.recording.plots import positions
from flighttune.recording.scene import log_aircraft, span_of
from flighttune.references.earth import LatLon
from flighttune.references.follow import RouteReference
from flighttune.references.maps import on_earth
from flighttune.references.path import Path
from flighttune.scenario.load import scenario_of
from flighttune.scenario.route import RouteTable
from flighttune.simulate.run import claimed_along

APART = 5.0  # distance between points of the planned path and of the corridor, m
RIB = 5  # points of the corridor from one cross-section that is outlined to the next
WALL = 15  # opacity of a wall of the corridor, of 255

GREY = [rgb(NEUTRAL)]
TO_NED = np.array([1.0, 1.0, -1.0])  # of north, east and up


def route_of(flights: Sequence[DrawnRun]) -> tuple[Path, RouteTable] | None:
    """Path and table of the route of the runs of one scenario; None if they fly none."""
    if not flights or "route" not in flights[0].run.provenance.scenario:
        return None
    scenario = scenario_of(flights[0].run)
    followed = reference_of(scenario)
    assert isinstance(followed, RouteReference)
    assert scenario.route is not None
    return followed.path, scenario.route


def log_route(
    stream: rr.RecordingStream, flights: Sequence[DrawnRun], path: Path, table: RouteTable
) -> None:
    """Log path, waypoints, corridors, and a map where the place is known."""
    line = path.beside(path.points(APART)) * TO_NED
    waypoints = np.array([[p.north, p.east, -p.up] for p in table.waypoints()])
    _log(stream, f"{ROUTE}/path", rr.LineStrips3D([line], colors=GREY, radii=on_screen(1.0)))
    names: dict[tuple[float, ...], str] = {}
    for number, point in enumerate(map(tuple, waypoints), start=1):  # it may end at its start
        names[point] = f"{names[point]}, {number}" if point in names else f"WP{number}"
    labels = {"labels": [*names.values()], "show_labels": True, "colors": GREY}
    _log(stream, f"{ROUTE}/waypoints", rr.Points3D([*names], radii=on_screen(3.0), **labels))
    for drawn_run in flights:
        run, frame = drawn_run.run, f"{TRUE_SIZE}/{drawn_run.key}"
        log_aircraft(stream, drawn_run, run.signals, frame, span_of(run))
        _log_corridor(stream, drawn_run, path)
    if table.geographic:
        _log_map(stream, flights, table.origin, line, waypoints)


def _log(stream: rr.RecordingStream, path: str, drawing: rr.AsComponents) -> None:
    stream.log(path, drawing, static=True)


def _log_corridor(stream: rr.RecordingStream, drawn_run: DrawnRun, path: Path) -> None:
    """Log the band around cross-track and height as a tube about the path, of the run's colour."""
    folder = f"{ROUTE}/corridor/{drawn_run.key}"
    s = path.points(APART)
    s = s[s <= drawn_run.run.signals["along"].max()]
    to_sides, below = (next(claimed_along(drawn_run.run, name, s), None) for name in OFF_ROUTE)
    if to_sides is None or below is None:
        return
    (left, right), (high, low) = to_sides, below
    # Seen along the path, clockwise from the upper left.
    sides = (left, high), (right, high), (right, low), (left, low)
    corners = np.stack([path.beside(s, *side) * TO_NED for side in sides], axis=1)
    # A wall from one cross-section to the next is two triangles.
    i, j = (4 * np.arange(len(s) - 1)[:, None] + (np.arange(4) + k) % 4 for k in (0, 1))
    triangles = np.stack([i, j, i + 4, j, j + 4, i + 4], axis=-1).reshape(-1, 3)
    colour = drawn_run.style.rgb
    walls = rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        triangle_indices=triangles,
        albedo_factor=(*colour, WALL),
    )
    _log(stream, f"{folder}/walls", walls)
    edges = [*corners.transpose(1, 0, 2), *corners[::RIB, [0, 1, 2, 3, 0]]]
    thin = on_screen(0.5)
    _log(stream, f"{folder}/edges", rr.LineStrips3D(edges, colors=[colour], radii=thin))


def _log_map(
    stream: rr.RecordingStream,
    flights: Sequence[DrawnRun],
    origin: LatLon,
    path: FloatArray,
    waypoints: FloatArray,
) -> None:
    line, points = _on_map(path, origin), _on_map(waypoints, origin)
    thin, size = on_screen(1.0), on_screen(4.0)
    _log(stream, f"{MAP}/_path", rr.GeoLineStrings(lat_lon=[line], colors=GREY, radii=thin))
    _log(stream, f"{MAP}/_waypoints", rr.GeoPoints(lat_lon=points, colors=GREY, radii=size))
    for drawn_run in flights:
        signals, colours = drawn_run.run.signals, [drawn_run.style.rgb]
        line_flown, name = _on_map(positions(signals), origin), f"{MAP}/{drawn_run.key}"
        _log(stream, name, rr.GeoLineStrings(lat_lon=[line_flown], colors=colours, radii=thin))
        dot = rr.GeoPoints.from_fields(colors=colours, radii=on_screen(6.0))
        _log(stream, f"{name}/now", dot)
        time = times(signals.index[evenly(len(signals))])
        stream.send_columns(f"{name}/now", [time], rr.GeoPoints.columns(positions=line_flown))


def _on_map(points: FloatArray, origin: LatLon) -> FloatArray:
    """Latitude and longitude of points, thinned, shape (n, 2), deg."""
    return on_earth(points[evenly(len(points))], origin)
