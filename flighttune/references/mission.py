"""Waypoints from files: plans of QGroundControl and GeoJSON, and what of them is not flown."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

from flighttune.errors import InputError
from flighttune.files.mistakes import abridged
from flighttune.files.table import json_tables
from flighttune.references.maps import features, json_number, reading

# Endings of files that are read, and of others that hold routes.
ROUTE_FILES = (".plan", ".json", ".geojson")
OTHER_FILES = (".waypoints", ".mission", ".txt", ".kml", ".kmz", ".gpx")

# Commands of MAVLink that are flown, and one that moves the height from which others count.
WAYPOINT, LOITER_TURNS, TAKEOFF, SET_HOME = 16, 18, 22, 179


def _names(text: str) -> dict[int, str]:
    """Names of commands by number, as MAVLink has them in common.xml."""
    return {int(number): f"{name} {number}" for number, name in map(str.split, text.split(","))}


MANOEUVRES = _names("""16 NAV_WAYPOINT, 17 NAV_LOITER_UNLIM, 18 NAV_LOITER_TURNS,
    19 NAV_LOITER_TIME, 20 NAV_RETURN_TO_LAUNCH, 21 NAV_LAND, 22 NAV_TAKEOFF, 31 NAV_LOITER_TO_ALT,
    82 NAV_SPLINE_WAYPOINT, 84 NAV_VTOL_TAKEOFF, 85 NAV_VTOL_LAND, 93 NAV_DELAY, 177 DO_JUMP,
    179 DO_SET_HOME, 3000 DO_VTOL_TRANSITION""")

# Commands that leave the path as it is. The place of a region of interest is looked at, not flown;
# a change of speed is among them because the airspeed is that of [flight].
HARMLESS = _names("""178 DO_CHANGE_SPEED, 181 DO_SET_RELAY, 183 DO_SET_SERVO, 189 DO_LAND_START,
    195 DO_SET_ROI_LOCATION, 197 DO_SET_ROI_NONE, 200 DO_CONTROL_VIDEO, 201 DO_SET_ROI,
    203 DO_DIGICAM_CONTROL, 205 DO_MOUNT_CONTROL, 206 DO_SET_CAM_TRIGG_DIST, 211 DO_GRIPPER,
    214 DO_SET_CAM_TRIGG_INTERVAL, 530 SET_CAMERA_MODE, 531 SET_CAMERA_ZOOM,
    1000 DO_GIMBAL_MANAGER_PITCHYAW, 2000 IMAGE_START_CAPTURE, 2001 IMAGE_STOP_CAPTURE,
    2500 VIDEO_START_CAPTURE, 2501 VIDEO_STOP_CAPTURE""")

# Frames of MAVLink whose heights are above sea level, above the home position, and above terrain.
ABOVE_SEA, ABOVE_HOME, ABOVE_TERRAIN = (0, 5), (3, 6), (10, 11)

# What becomes of an item of a plan.
Fate: TypeAlias = Literal["flown", "harmless", "no place", "refused", "passed"]

# Largest latitude and longitude of a start whose home position may have zeros, deg.
NEAR_DEG = 5.0

# Values of a row of the table `waypoint` of [route], and keys of its place.
Row: TypeAlias = dict[str, float]
PLACE = ("lat_deg", "lon_deg", "up_m")


class RouteFile(NamedTuple):
    """A route as a file states it."""

    # Rows of ``waypoint`` in [route], heights above the first; circles have ``turns``, ``radius_m``
    waypoint: list[Row]
    flight: dict[str, float]  # ``h_m`` and ``ground_m`` of [flight], as far as the file has them
    notes: list[str]  # what is left out of the file or read in another way


def read_route(path: Path, *, skip: bool = False) -> RouteFile:
    """Read a route: a plan of QGroundControl (.plan), or GeoJSON with one LineString.

    `skip`: leave out commands of a plan that change the flight but have no place. Commands that
    leave the path as it is are always left out. Raises InputError if the file cannot be read, is
    none of these, or has a position that cannot be flown.
    """
    if path.suffix.lower() in OTHER_FILES:
        raise InputError(
            f"{path}: a route must be a plan of QGroundControl (.plan) or GeoJSON (.geojson), got "
            f"{path.suffix}; QGroundControl opens .waypoints files and saves them as plans."
        )
    tables = json_tables(path)
    with reading(path, "a plan of QGroundControl or GeoJSON with a LineString"):
        route = _plan(tables, skip) if "mission" in tables else _line(tables)
        if len(route.waypoint) < 2:
            raise InputError(f"must have at least 2 waypoints, got {len(route.waypoint)}.")
    start = route.waypoint[0]["up_m"]
    return route._replace(waypoint=[row | {"up_m": row["up_m"] - start} for row in route.waypoint])


def _plan(tables: Mapping[str, Any], skip: bool) -> RouteFile:
    stated = [*(tables["mission"].get("plannedHomePosition") or ()), None, None, None]
    home = json_number(stated[2], "the height above sea level in `plannedHomePosition`")
    rows: list[Row] = []
    numbers: dict[Fate, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    for number, item in enumerate(_items(tables["mission"]["items"]), start=1):
        name, fate = _fate(item, first=not rows)
        numbers[fate][name].append(number)
        if fate == "flown":
            rows.append(_row(f"item {number} ({name})", item, home))
            if item["command"] == WAYPOINT and any(item["params"][:3]):
                numbers["passed"]["hold time or radius of NAV_WAYPOINT 16"].append(number)
    no_place = numbers["no place"]
    if wrong := _listed(numbers["refused"] | ({} if skip else no_place)):
        skips = f"; `--skip` or `skip = true` in [route] leaves out {_listed(no_place)}"
        raise InputError(
            "`items` must be waypoints (16), circles (18) or a take-off at the beginning (22), at "
            f"heights above home or sea level, got {wrong}{skips if no_place and not skip else ''}."
        )
    # Programs that do not know the home position write zeros.
    if (
        rows
        and not any(stated[:2])
        and abs(rows[0]["lat_deg"]) + abs(rows[0]["lon_deg"]) > NEAR_DEG
    ):
        raise InputError(f"`plannedHomePosition` must be near the route, got {stated[:3]}.")
    notes = []
    if left_out := _listed(numbers["harmless"] | no_place | numbers["passed"]):
        notes.append(f"Not flown of the plan: {left_out}.")
    for number in numbers["flown"][MANOEUVRES[TAKEOFF]]:
        notes.append(f"The route begins where the take-off of item {number} ends.")
    if any(isinstance(shape, list) and shape for shape in (tables.get("geoFence") or {}).values()):
        notes.append("Its fence is not read; `flighttune band --fence` takes one in GeoJSON.")
    heights = {"h_m": home + rows[0]["up_m"], "ground_m": home} if rows else {}
    return RouteFile(rows, heights, notes)


def _fate(item: Mapping[str, Any], *, first: bool) -> tuple[str, Fate]:
    """Name of an item of a plan, and what becomes of it; a take-off is flown if it comes first."""
    if item["type"] != "SimpleItem":
        return abridged(item.get("complexItemType")), "refused"
    command, frame = item["command"], item["frame"]
    if command in HARMLESS:
        return HARMLESS[command], "harmless"
    name = MANOEUVRES.get(command, f"command {abridged(command)}")
    placed = any(item["params"][4:6]) or command == SET_HOME
    if command in (WAYPOINT, LOITER_TURNS) or (command == TAKEOFF and placed and first):
        if frame in (*ABOVE_SEA, *ABOVE_HOME):
            return name, "flown"
        terrain = ": above terrain" if frame in ABOVE_TERRAIN else ""
        return f"{name}, frame {abridged(frame)}{terrain}", "refused"
    return name, "refused" if placed else "no place"


def _listed(numbers: Mapping[str, Sequence[int]]) -> str:
    """Items by number and name."""
    return ", ".join(
        f"item{'s' * (len(items) > 1)} {', '.join(map(str, items))} ({name})"
        for name, items in numbers.items()
    )


def _row(label: str, item: Mapping[str, Any], home: float) -> Row:
    """A waypoint or circles, with the height above the home position."""
    values = item["params"]
    row = _place(label, values[4:7])
    row["up_m"] -= home * (item["frame"] in ABOVE_SEA)
    if item["command"] == LOITER_TURNS:
        turns = json_number(values[0], f"`turns` of {label}")
        radius = json_number(values[2] or 0.0, f"`radius_m` of {label}")
        if turns <= 0.0:
            raise InputError(f"`turns` of {label} must be positive, got {turns:g}.")
        row["turns"] = math.copysign(turns, radius or 1.0)
        row |= {"radius_m": abs(radius)} if radius else {}
    return row


def _items(items: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The items of a mission in order; surveys and corridor scans as those that they consist of."""
    for item in items:
        if parts := item.get("TransectStyleComplexItem", {}).get("Items"):
            yield from _items(parts)
        else:
            yield item


def _line(tables: Mapping[str, Any]) -> RouteFile:
    shapes = [feature["geometry"] for feature in features(tables)]
    lines = [shape for shape in shapes if shape["type"] == "LineString"]
    if len(lines) != 1:
        raise InputError(f"`features` must have one LineString, got {len(lines)}.")
    points = lines[0]["coordinates"]
    if len({len(point[:3]) for point in points}) > 1:
        raise InputError("`coordinates` must have a height at every point of a line, or at none.")
    rows = [
        _place(f"point {number}", [point[1], point[0], *point[2:3], 0.0][:3])
        for number, point in enumerate(points, start=1)
    ]
    notes = ["Of the shapes in the file the LineString alone is read."] * (len(shapes) > 1)
    # Programs that know no heights write zeros.
    if not any(row["up_m"] for row in rows):
        return RouteFile(
            rows, {}, [*notes, "The file has no heights: the route is level, at `h_m`."]
        )
    return RouteFile(rows, {"h_m": rows[0]["up_m"]}, notes)


def _place(name: str, values: Iterable[Any]) -> Row:
    """Latitude, longitude and height of a point of a file."""
    return {key: json_number(x, f"`{key}` of {name}") for key, x in zip(PLACE, values, strict=True)}
