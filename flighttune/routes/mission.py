"""Files of ground stations and maps: waypoints read from them, a planned path written as a plan."""

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from flighttune.base.errors import InputError
from flighttune.base.files.table import hash_of, shown
from flighttune.base.units import DEG
from flighttune.routes import items as mavlink
from flighttune.routes import maps
from flighttune.routes.fence import circle_of
from flighttune.routes.path import Stretch

# Endings of files that can be read.
ROUTE_FILES = (".plan", ".json", ".geojson", ".waypoints", ".txt", ".kml", ".kmz")

KINDS = (
    "a plan of QGroundControl, waypoints of Mission Planner, or KML or GeoJSON with a LineString"
)


def read_route(
    path: Path,
    *,
    skip: bool = False,
    terrain: str | Path | None = None,
    airspeeds: tuple[float, float] | None = mavlink.ANY_AIRSPEED,
) -> mavlink.RouteFile:
    """Read a route: a .plan of QGroundControl, .waypoints of Mission Planner, KML or GeoJSON.

    `skip`: omit commands that change the flight but have no place. Commands that do not change the
    path are always omitted. `terrain`: a file for heights above terrain. `airspeeds`: the range of
    the aircraft, m/s; None if the user states one airspeed for the whole route.
    """
    kind, content = maps.map_file(path, ROUTE_FILES, KINDS)
    with maps.reading(path, KINDS):
        if kind == "planner":
            read = _planner(content, skip, terrain, airspeeds)
        elif kind == "plan":
            read = _plan(content, skip, terrain, airspeeds)
        else:
            read = _line(maps.kml_features(content) if kind == "kml" else maps.features(content))
        rows = read.route["waypoint"]
        if len(rows) < 2:
            rally = len(read.route.get("rally", ()))
            other = f" and {rally} rally points" if rally else "; `--fence` takes files of fences"
            raise InputError(f"must have at least 2 waypoints, got {len(rows)}{other}.")
    start = rows[0].get("up_m", 0.0)
    above = {
        key: [row | {"up_m": row.get("up_m", 0.0) - start} for row in read.route.get(key, ())]
        for key in ("waypoint", "rally")
    }
    return read._replace(route=read.route | above)


def _written(stated: object, path: object) -> mavlink.RouteFile | None:
    """The route that flighttune wrote beside a path, if the path of the file is unchanged."""
    if not isinstance(stated, Mapping) or stated.get("path_sha256") != hash_of(path):
        return None
    flight = {key: maps.json_number(value, f"`{key}`") for key, value in stated["flight"].items()}
    rows = {
        key: [
            {**row, "up_m": maps.json_number(row["up_m"], "`up_m`")} for row in stated["route"][key]
        ]
        for key in ("waypoint", "rally")
    }
    notes = ["The waypoints are those from which flighttune planned the path of the file."]
    return mavlink.RouteFile(
        {**stated["route"], **rows, "notes": notes}, flight, {**stated["limits"]}
    )


def _planner(text: str, *options: Any) -> mavlink.RouteFile:
    home, items = mavlink.planner_items(text)
    if home is not None:
        return mavlink.read_items(
            items, (*home[:2], maps.json_number(home[2], "the height of home")), *options
        )
    return mavlink.read_items(items, None, *options, first=int(items[0]["doJumpId"]))


def _plan(tables: Mapping[str, Any], *options: Any) -> mavlink.RouteFile:
    mission = tables["mission"]
    if read := _written(tables.get(maps.ROUTE_KEY), mission):
        return read
    if (speed := maps.json_number(mission.get("cruiseSpeed", 1.0), "`cruiseSpeed`")) <= 0.0:
        raise InputError(f"`cruiseSpeed` must be positive, got {speed:g} m/s.")
    stated = [*maps.json_part(mission, "plannedHomePosition", list), None, None, None][:3]
    height = maps.json_number(stated[2], "the height above sea level in `plannedHomePosition`")
    home = (*(maps.json_number(x, "`plannedHomePosition`", 0.0) for x in stated[:2]), height)
    read = mavlink.read_items(mission["items"], home, *options)
    points = maps.json_part(maps.json_part(tables, "rallyPoints", dict), "points", list)
    # A missing number becomes None, which is refused.
    rally = [
        mavlink.place(f"rally point {i}", [*point, None, None, None][:3])
        for i, point in enumerate(points, 1)
    ]
    return read._replace(route=read.route | {"rally": rally})


# Altitude modes of KML in which heights count; in other modes KML ignores them.
STATED_HEIGHTS = "absolute", "relativeToGround"


def _line(shapes: Sequence[Mapping[str, Any]]) -> mavlink.RouteFile:
    lines = [x for x in shapes if x["geometry"]["type"] == "LineString"]
    if len(lines) != 1:
        kinds = Counter(shown(str(x["geometry"]["type"])) for x in shapes)
        got = ", ".join(f"{count} of {kind}" for kind, count in kinds.items()) or "none"
        raise InputError(f"must have one LineString, or in KML one track, got {got}.")
    line = lines[0]["geometry"]
    points, mode = line["coordinates"], line.get("altitudeMode", "absolute")
    if read := _written(maps.json_part(lines[0], "properties", dict).get(maps.ROUTE_KEY), points):
        return read
    if mode not in STATED_HEIGHTS:
        points = [point[:2] for point in points]
    if len({len(point[:3]) for point in points}) > 1:
        raise InputError("`coordinates` must have a height at every point of a line, or at none.")
    rows: list[mavlink.Row] = []
    same: list[str] = []
    for number, point in enumerate(points, start=1):
        name = f"point {number}"
        row = mavlink.place(name, [point[1], point[0], *point[2:3], 0.0][:3])
        same += mavlink.add_row(rows, row, name)
    notes = ["Of the shapes in the file the line alone is read."] * (len(shapes) > 1)
    flight = {"h_m": rows[0]["up_m"]} if rows else {}
    # Programs without heights write zeros.
    if not any(row["up_m"] for row in rows):
        clamped = "" if mode in STATED_HEIGHTS else f" that count, as its line is {mode}"
        flight = {}
        notes.append(f"The file has no heights{clamped}: the route is level, at `h_m`.")
    elif mode != STATED_HEIGHTS[0]:
        flight, notes = {}, [*notes, "Heights in the file are above the ground: `h_m` is assumed."]
    return mavlink.RouteFile({"waypoint": rows, "notes": [*notes, *same]}, flight)


# Largest change of course between two waypoints of a turn-around, rad: autopilots pass them inside.
APART = 45.0 * DEG

# Frames of heights above the home position, and of commands without a place.
ABOVE_HOME, NO_FRAME = 3, 2


def route_plan(route: maps.RouteMap, V_a: float, ground: float) -> tuple[str, str]:
    """A plan of a path at `V_a` (m/s) from a home at `ground` (m), and a note on its fence."""
    # Circles have the planned radius and turns. Turn-arounds become waypoints along their path. A
    # corridor replaces the areas to stay in. The note describes the changes of a fence with more
    # vertices than vehicles accept.
    path, origin, h_0 = route.where
    no_options = 0, 0, 0, None  # parameters of a waypoint: no hold, radius, side or yaw

    def at(s: float) -> tuple[float, ...]:
        point = path.beside(np.array([s]))
        (lat, lon), up = maps.on_earth(point, origin)[0].tolist(), float(point[0, 2])
        return round(lat, 8), round(lon, 8), round(h_0 + up - ground, 2)

    steps: list[tuple[int, tuple[float | None, ...], tuple[float, ...]]] = [
        (mavlink.TAKEOFF, (15, 0, 0, None), at(0.0)),
        (mavlink.SPEED, (0, round(V_a, 2), -1, 0), (0, 0, 0)),
    ]
    for stretch in path.stretches:
        if stretch.kind == "loiter":
            point = route.points[stretch.waypoint - 1]
            turns = round(abs(stretch.turn) / math.tau, 2)
            radius = math.copysign(round(stretch.radius, 1), stretch.turn)
            centre = point.lat, point.lon, round(point.height - ground, 2)
            steps.append((mavlink.TURNS, (turns, 0, radius, 1), centre))
        else:
            steps += [(mavlink.WAYPOINT, no_options, at(s)) for s in _passed(stretch)]
    if path.stretches[-1].kind == "leg":
        steps.append((mavlink.WAYPOINT, no_options, at(path.length)))
    items = [
        {"type": "SimpleItem", "autoContinue": True, "doJumpId": number, "command": command}
        | {"frame": NO_FRAME if command == mavlink.SPEED else ABOVE_HOME}
        | {"params": [*values, *place]}
        for number, (command, values, place) in enumerate(steps, start=1)
    ]
    fence, said = _fewer_vertices(route)
    areas = [_area(*area) for area in fence]
    first = route.points[0]
    tables: dict[str, Any] = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {
            "version": 2,
            "circles": [area for area in areas if "circle" in area],
            "polygons": [area for area in areas if "polygon" in area],
        },
        "mission": {
            "version": 2,
            "firmwareType": 12,
            "vehicleType": 1,
            "cruiseSpeed": round(V_a, 2),
            "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [first.lat, first.lon, ground],
            "items": items,
        },
        "rallyPoints": {
            "version": 2,
            "points": [[x.lat, x.lon, round(x.height - ground, 2)] for x in route.rally],
        },
    }
    if route.stated:
        tables[maps.ROUTE_KEY] = maps.with_hash(route.stated, tables["mission"])
    return json.dumps(tables, indent=1) + "\n", said


def _area(ring: list[list[float]], exclusion: bool) -> dict[str, Any]:
    """An area of a fence; a circle if the ring replaces a circle."""
    area = {"version": 1, "inclusion": not exclusion}
    if circle := circle_of(ring, outside=exclusion):
        (lat, lon), radius = circle
        return area | {"circle": {"center": [round(lat, 8), round(lon, 8)], "radius": radius}}
    return area | {"polygon": [[lat, lon] for lon, lat, *_ in ring[:-1]]}


def _passed(stretch: Stretch) -> Iterator[float]:
    """Distances along the route of the waypoints of a stretch other than a loiter, m."""
    if stretch.kind == "turn":
        yield stretch.start + 0.5 * stretch.length
    elif stretch.kind == "turn-around":
        # A turn-around changes its course by up to three full circles.
        count = max(2, math.ceil(stretch.length / (stretch.radius * APART)))
        yield from (stretch.start + i * stretch.length / count for i in range(count + 1))


# Number of vertices that every vehicle accepts; a circle counts as one vertex.
MOST, VEHICLES = 64, "PX4 takes at most 64 and ArduPilot 70"

# Sizes of details to simplify away, m; the first is the rounding of places in a file.
SIZES = (0.01, *np.geomspace(0.1, 2000.0, 40).tolist())

# Steps of the search for the distance between two areas.
HALVINGS = 14


def _fewer_vertices(route: maps.RouteMap) -> tuple[list[maps.Area], str]:
    """Areas of at most `MOST` vertices that contain a path or its corridor windows; a note."""
    (path, origin, _), windows = route.where, route.corridor_rings()
    # The corridor, clipped to the areas to stay in, replaces them. Circles stay circles. Areas to
    # stay in become smaller, and areas to stay out of become larger. The note has the lost
    # distance; it is empty if nothing changes.
    circles = [
        (x, out) for x, out in route.areas if circle_of(x, outside=out) and (out or not windows)
    ]
    polygons = [area for area in route.areas if area not in circles]
    room = MOST - len(circles)
    if not windows and _vertices(polygons) <= room:
        return [*route.areas], ""
    core: Any = shapely.LineString(path.beside(path.points(10.0))[:, :2])
    if windows:
        core = shapely.union_all([_polygon(ring, origin) for ring in windows])
    stated = [(_polygon(ring, origin), out) for ring, out in polygons]
    around = [area for area, out in stated if windows and not out and area.covers(core)]
    zones = [(area, out) for area, out in stated if out or not windows]
    clear = [out and not area.intersects(core) for area, out in zones]
    for smaller, size in [(x, size) for x in (False, True) for size in SIZES]:
        kept = [(_changed(*zone, size), zone[1]) if smaller else zone for zone in zones]
        wide = [(core.buffer(size).simplify(size), False)] if windows else []
        for area in around:
            wide = [(wide[0][0].intersection(area), False)]
        shapes = [*wide, *kept]
        rings = [ring for shape in shapes for ring in _rings(*shape, origin)]
        fits = _vertices(rings) <= room and all(
            shape.geom_type == "Polygon" and (out or shape.covers(core)) for shape, out in shapes
        )
        if fits and all(x[0].disjoint(core) for x, free in zip(kept, clear, strict=True) if free):
            break
    else:
        rings = [*((ring, False) for ring in windows), *polygons]
        count = len(circles) + _vertices(rings)
        return [*rings, *circles], f"has {count} vertices and circles, of which {VEHICLES}"
    pairs = [(core, wide[0][0])] if windows else []
    pairs += [(a, b) if out else (b, a) for (a, out), (b, _) in zip(zones, kept, strict=True)]
    lost = max(_beyond(*pair) for pair in pairs)
    count = len(circles) + _vertices(rings)
    cost = "goes up to {:.1f} m beyond the corridor" if windows else "is up to {:.1f} m narrower"
    said = f"has {count} vertices and circles, as {VEHICLES}, and {cost.format(lost)}"
    return [*rings, *circles], said


def _vertices(areas: Sequence[maps.Area]) -> int:
    return sum(len(ring) - 1 for ring, _ in areas)


def _polygon(ring: list[list[float]], origin: maps.LatLon) -> Any:
    """A closed ring as a polygon north and east of a place, m."""
    return shapely.Polygon([maps.north_east((lat, lon), origin) for lon, lat, *_ in ring]).buffer(
        0.0
    )


def _rings(shape: Any, outside: bool, origin: maps.LatLon) -> list[maps.Area]:
    """The rings of a polygon, whose holes are areas to stay out of."""
    return [
        (
            maps.on_earth(np.array(ring.coords), origin)[:, ::-1].round(8).tolist(),
            outside or number > 0,
        )
        for part in ([] if shape.is_empty else getattr(shape, "geoms", [shape]))
        for number, ring in enumerate([part.exterior, *part.interiors])
    ]


def _changed(area: Any, outside: bool, size: float) -> Any:
    """An area without details of a size: grown if flights must stay outside, else shrunk."""
    return area.buffer(size if outside else -size, join_style="mitre").simplify(size)


def _beyond(inner: Any, outer: Any) -> float:
    """Largest distance of the places of an area from another area, m."""
    low, high = 0.0, math.dist(*np.reshape(outer.bounds, (2, 2)))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if inner.buffer(middle).covers(outer) else (middle, high)
    return high
