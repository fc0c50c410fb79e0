"""A route in a recording: planned path, corridor and map."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.flight.conditions import reference_of
from flighttune.metrics import OFF_ROUTE
from flighttune.present.palette import LIMIT, NEUTRAL, rgb
from flighttune.present.thinning import evenly
from flighttune.recording.entities import MAP, ROUTE, DrawnRun, on_screen, times
from flighttune.recording.plots import positions
from flighttune.references.follow import RouteReference
from flighttune.references.maps import LatLon, on_earth
from flighttune.references.path import Path
from flighttune.scenario.load import scenario_of
from flighttune.scenario.route import RouteTable
from flighttune.simulate.run import Run, claimed_along

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
        if (corners := _corners(drawn_run.run, path)) is not None:
            _log_corridor(stream, drawn_run, corners)
    if table.geographic:
        _log_map(stream, flights, path, table, waypoints)


def _log(stream: rr.RecordingStream, path: str, drawing: rr.AsComponents) -> None:
    stream.log(path, drawing, static=True)


def _corners(run: Run, path: Path) -> FloatArray | None:
    """The band around cross-track and height about the path, shape (points, 4, 3), NED in m.

    Its corners are seen along the path, clockwise from the upper left; None without such a band.
    """
    s = path.points(APART)
    s = s[s <= run.signals["along"].max()]
    to_sides, below = (next(claimed_along(run, name, s), None) for name in OFF_ROUTE)
    if to_sides is None or below is None:
        return None
    (left, right), (high, low) = to_sides, below
    sides = (left, high), (right, high), (right, low), (left, low)
    return np.stack([path.beside(s, *side) * TO_NED for side in sides], axis=1)


def _log_corridor(stream: rr.RecordingStream, drawn_run: DrawnRun, corners: FloatArray) -> None:
    """Log a corridor as a tube about the path, of the run's colour."""
    folder = f"{ROUTE}/corridor/{drawn_run.key}"
    # A wall from one cross-section to the next is two triangles.
    i, j = (4 * np.arange(len(corners) - 1)[:, None] + (np.arange(4) + k) % 4 for k in (0, 1))
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
    path: Path,
    table: RouteTable,
    waypoints: FloatArray,
) -> None:
    """Log path, waypoints, fences, corridors and flights by latitude and longitude."""
    origin = table.origin

    def lines(name: str, each: Sequence[FloatArray], colour: str, radius: float = 1.0) -> None:
        style = {"colors": [rgb(colour)], "radii": on_screen(radius)}
        _log(stream, f"{MAP}/{name}", rr.GeoLineStrings(lat_lon=each, **style))

    lines("_path", [_on_map(path.beside(path.points(APART)), origin)], NEUTRAL)
    dots = rr.GeoPoints(lat_lon=_on_map(waypoints, origin), colors=GREY, radii=on_screen(4.0))
    _log(stream, f"{MAP}/_waypoints", dots)
    rings = [ring for drawn_run in flights for c in drawn_run.run.claims for ring in c.fences]
    if rings:
        lines("_fence", [np.array(ring)[:, 1::-1] for ring in rings], LIMIT, 1.5)
    for drawn_run in flights:
        signals, colour = drawn_run.run.signals, drawn_run.style.colour
        if (corners := _corners(drawn_run.run, path)) is not None:
            sides = [_on_map(corners[:, side], origin) for side in (0, 1)]
            lines(f"_corridor/{drawn_run.key}", sides, colour, 0.5)
        line_flown, name = _on_map(positions(signals), origin), drawn_run.key
        lines(name, [line_flown], colour)
        dot = rr.GeoPoints.from_fields(colors=[rgb(colour)], radii=on_screen(6.0))
        _log(stream, f"{MAP}/{name}/now", dot)
        time = times(signals.index[evenly(len(signals))])
        stream.send_columns(f"{MAP}/{name}/now", [time], rr.GeoPoints.columns(positions=line_flown))


def _on_map(points: FloatArray, origin: LatLon) -> FloatArray:
    """Latitude and longitude of points, thinned, shape (n, 2), deg."""
    return on_earth(points[evenly(len(points))], origin)
