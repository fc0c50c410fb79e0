"""Files of ground stations and maps: waypoints read from them, a planned path written as a plan."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from flighttune.errors import InputError
from flighttune.files.table import file_text, hash_of, json_tables
from flighttune.references.fence import circle_of
from flighttune.references.items import (
    SPEED,
    TAKEOFF,
    TURNS,
    WAYPOINT,
    Mission,
    Row,
    add_row,
    place,
    planner_items,
    read_items,
)
from flighttune.references.maps import (
    ROUTE_KEY,
    Marks,
    Where,
    features,
    json_number,
    json_part,
    kml_features,
    on_earth,
    reading,
    with_hash,
)
from flighttune.references.path import Stretch
from flighttune.units import DEG

# Largest change of course between two waypoints of a turn-around, rad: autopilots pass them inside.
APART = 45.0 * DEG

# Frames of heights above the home position, and of commands without a place.
ABOVE_HOME, NO_FRAME = 3, 2


def route_plan(
    where: Where, marks: Marks, V_a: float, ground: float, stated: Mapping[str, Any] | None = None
) -> str:
    """A plan of the path at the airspeed `V_a` (m/s) from a home position at `ground` (m).

    Circles have the radius and the turns that are planned, and turn-arounds are waypoints along
    their path. flighttune reads the file as what is `stated`.
    """
    path, origin, h_0 = where
    items: list[dict[str, Any]] = []

    def add(command: int, values: Sequence[float | None], s: float | None = None) -> None:
        place: list[float | None] = [0, 0, 0]
        if s is not None:
            point = path.beside(np.array([s]))
            (lat, lon), up = on_earth(point, origin)[0].tolist(), float(point[0, 2])
            place = [round(lat, 8), round(lon, 8), round(h_0 + up - ground, 2)]
        items.append(_item(command, [*values, *place], len(items) + 1))

    add(TAKEOFF, (15, 0, 0, None), 0.0)
    add(SPEED, (0, round(V_a, 2), -1, 0))
    for stretch in path.stretches:
        if stretch.kind == "loiter":
            point = marks.points[stretch.waypoint - 1]
            turns = round(abs(stretch.turn) / math.tau, 2)
            radius = math.copysign(round(stretch.radius, 1), stretch.turn)
            values = turns, 0, radius, 1, point.lat, point.lon, round(point.height - ground, 2)
            items.append(_item(TURNS, values, len(items) + 1))
        else:
            for s in _passed(stretch):
                add(WAYPOINT, (0, 0, 0, None), s)
    if path.stretches[-1].kind == "leg":
        add(WAYPOINT, (0, 0, 0, None), path.length)
    areas = [_area(*area) for area in marks.areas]
    first = marks.points[0]
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
            "points": [[x.lat, x.lon, round(x.height - ground, 2)] for x in marks.rally],
        },
    }
    if stated:
        tables[ROUTE_KEY] = with_hash(stated, tables["mission"])
    return json.dumps(tables, indent=1) + "\n"


def _area(ring: list[list[float]], exclusion: bool) -> dict[str, Any]:
    """An area of a fence: a circle where the ring is one that stands for it."""
    area = {"version": 1, "inclusion": not exclusion}
    if circle := circle_of(ring, outside=exclusion):
        (lat, lon), radius = circle
        return area | {"circle": {"center": [round(lat, 8), round(lon, 8)], "radius": radius}}
    return area | {"polygon": [[lat, lon] for lon, lat, *_ in ring[:-1]]}


def _passed(stretch: Stretch) -> Iterator[float]:
    """Distances along the route of the waypoints of a stretch that is no loiter, m."""
    if stretch.kind == "turn":
        yield stretch.start + 0.5 * stretch.length
    elif stretch.kind == "turn-around":
        # The bends of a bulb: its courses change by up to three times the circumference of one.
        count = max(2, math.ceil(stretch.length / (stretch.radius * APART)))
        yield from (stretch.start + i * stretch.length / count for i in range(count + 1))


def _item(command: int, values: Sequence[float | None], number: int) -> dict[str, Any]:
    frame = NO_FRAME if command == SPEED else ABOVE_HOME
    common = {"type": "SimpleItem", "autoContinue": True, "doJumpId": number}
    return common | {"command": command, "frame": frame, "params": list(values)}


# Endings of files that are read.
ROUTE_FILES = (".plan", ".json", ".geojson", ".waypoints", ".txt", ".kml")

KINDS = (
    "a plan of QGroundControl, waypoints of Mission Planner, or KML or GeoJSON with a LineString"
)


class RouteFile(NamedTuple):
    """A route as a file states it."""

    # Keys of [route]: ``waypoint`` with heights above the first, ``widen``, ``rally``, ``notes``
    route: dict[str, Any]
    # ``h_m``, ``ground_m`` and ``V_a_mps`` of [flight], as far as the file has them
    flight: dict[str, float]
    limits: Mapping[str, Any] = MappingProxyType({})  # [limits], which flighttune writes


def read_route(path: Path, *, skip: bool = False, terrain: str | Path | None = None) -> RouteFile:
    """Read a route: a .plan of QGroundControl, .waypoints of Mission Planner, KML or GeoJSON.

    `skip`: leave out commands that change the flight but have no place. Commands that leave the
    path as it is are always left out. `terrain`: a file that heights above terrain are flown by.
    Raises InputError if the file cannot be read, is none of these, or has an item that cannot be
    flown.
    """
    if (ending := path.suffix.lower()) not in ROUTE_FILES:
        raise InputError(f"{path}: must be {KINDS}, got {path.suffix}.")
    text_file = ending in (".waypoints", ".txt", ".kml")
    content: Any = file_text(path) if text_file else json_tables(path)
    with reading(path, KINDS):
        if ending == ".kml":
            read = _line(kml_features(content))
        elif text_file:
            read = _waypoints(content, skip, terrain)
        elif "mission" in content:
            read = _plan(content, skip, terrain)
        else:
            read = _line(features(content))
        rows = read.route["waypoint"]
        if len(rows) < 2:
            raise InputError(
                f"must have at least 2 waypoints, got {len(rows)}; `--fence` takes files of fences."
            )
    start = rows[0].get("up_m", 0.0)
    above = {
        key: [row | {"up_m": row.get("up_m", 0.0) - start} for row in read.route.get(key, ())]
        for key in ("waypoint", "rally")
    }
    return read._replace(route=read.route | above)


def _written(stated: object, path: object) -> RouteFile | None:
    """The route that flighttune wrote beside a path, if that is still the path of the file."""
    if not isinstance(stated, Mapping) or stated.get("path_sha256") != hash_of(path):
        return None
    flight = {key: json_number(value, f"`{key}`") for key, value in stated["flight"].items()}
    rows = {
        key: [{**row, "up_m": json_number(row["up_m"], "`up_m`")} for row in stated["route"][key]]
        for key in ("waypoint", "rally")
    }
    notes = ["The waypoints are those from which flighttune planned the path of the file."]
    return RouteFile({**stated["route"], **rows, "notes": notes}, flight, {**stated["limits"]})


def _plan(tables: Mapping[str, Any], skip: bool, terrain: str | Path | None) -> RouteFile:
    mission = tables["mission"]
    if read := _written(tables.get(ROUTE_KEY), mission):
        return read
    if (speed := json_number(mission.get("cruiseSpeed", 1.0), "`cruiseSpeed`")) <= 0.0:
        raise InputError(f"`cruiseSpeed` must be positive, got {speed:g} m/s.")
    stated = [*json_part(mission, "plannedHomePosition", list), None, None, None][:3]
    height = json_number(stated[2], "the height above sea level in `plannedHomePosition`")
    home = (*(json_number(x, "`plannedHomePosition`", 0.0) for x in stated[:2]), height)
    read = read_items(mission["items"], home, skip, terrain)
    points = json_part(json_part(tables, "rallyPoints", dict), "points", list)
    rally = [place(f"rally point {i}", point[:3]) for i, point in enumerate(points, start=1)]
    return _mission(read, home, rally)


def _waypoints(text: str, skip: bool, terrain: str | Path | None) -> RouteFile:
    """A file of Mission Planner, whose first line of values is the home position."""
    (lat, lon, height), items = planner_items(text)
    home = lat, lon, json_number(height, "the height of home")
    read = read_items(items, home, skip, terrain)
    return _mission(read, home, read.rally)


def _mission(read: Mission, home: tuple[float, ...], rally: list[Row]) -> RouteFile:
    rows = read.rows
    if not (abs(home[0]) <= 90.0 and abs(home[1]) <= 180.0):  # also catches NaN
        raise InputError(
            "the home position must have a latitude up to 90 and a longitude up to 180 deg, got "
            f"{home[0]:g} and {home[1]:g}."
        )
    flight = {"h_m": home[2] + rows[0]["up_m"], "ground_m": home[2]} if rows else {}
    flight |= {} if read.speed is None else {"V_a_mps": read.speed}
    table = {"waypoint": rows, "widen": True, "rally": rally, "notes": read.notes}
    return RouteFile(table, flight)


def _line(found: Any) -> RouteFile:
    shapes = [*found]
    lines = [x["geometry"] for x in shapes if x["geometry"]["type"] == "LineString"]
    if len(lines) != 1:
        raise InputError(f"must have one LineString, got {len(lines)}.")
    points = lines[0]["coordinates"]
    stated = next(json_part(x, "properties", dict) for x in shapes if x["geometry"] is lines[0])
    if read := _written(stated.get(ROUTE_KEY), points):
        return read
    if len({len(point[:3]) for point in points}) > 1:
        raise InputError("`coordinates` must have a height at every point of a line, or at none.")
    rows: list[Row] = []
    same: list[str] = []
    for number, point in enumerate(points, start=1):
        name = f"point {number}"
        same += add_row(rows, place(name, [point[1], point[0], *point[2:3], 0.0][:3]), name)
    notes = ["Of the shapes in the file the LineString alone is read."] * (len(shapes) > 1)
    flight = {"h_m": rows[0]["up_m"]} if rows else {}
    if lines[0].get("altitudeMode", "absolute") != "absolute":
        flight, notes = {}, [*notes, "Heights in the file are above the ground: `h_m` is assumed."]
    # Programs that know no heights write zeros.
    elif not any(row["up_m"] for row in rows):
        flight, notes = {}, [*notes, "The file has no heights: the route is level, at `h_m`."]
    return RouteFile({"waypoint": rows, "notes": [*notes, *same]}, flight)
