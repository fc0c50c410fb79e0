"""Files of routes: plans of QGroundControl and GeoJSON in, GeoJSON and KML out."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.routes.path import Path as Route
from flighttune.table_file import json_tables
from flighttune.units import DEG

# Semi-major axis, m, and square of the eccentricity of WGS 84.
AXIS, ECCENTRICITY_2 = 6_378_137.0, 6.694_379_990_14e-3

# Commands of MAVLink that are flown: a waypoint, and circles of a number of turns.
WAYPOINT, LOITER_TURNS = 16, 18

# Frames of MAVLink whose heights are above sea level, and above the home position.
ABOVE_SEA, ABOVE_HOME = (0, 5), (3, 6)

# Distance between the points of a file that is written, m.
APART = 10.0

# Values of a row of the table `waypoint` of [route].
Row = dict[str, float]


def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """Length of a degree of latitude and of longitude on WGS 84, m."""
    sine_2 = math.sin(lat_deg * DEG) ** 2
    across = AXIS / math.sqrt(1.0 - ECCENTRICITY_2 * sine_2)
    along = across * (1.0 - ECCENTRICITY_2) / (1.0 - ECCENTRICITY_2 * sine_2)
    return along * DEG, across * math.cos(lat_deg * DEG) * DEG


def read_route(path: Path, *, skip: bool = False) -> list[Row]:
    """Waypoints of a file, as rows of ``waypoint`` in [route].

    Parameters
    ----------
    path : Path
        A plan of QGroundControl (.plan) or GeoJSON with one LineString (.json, .geojson).
    skip : bool
        Leave out commands that cannot be flown.

    Returns
    -------
    list of dict
        ``lat_deg``, ``lon_deg`` and ``up_m`` above the first waypoint; circles have ``turns`` and
        ``radius_m``.

    Raises
    ------
    InputError
        If the file cannot be read or is none of these, or has a command that cannot be flown.
    """
    tables = json_tables(path)
    try:
        rows = _plan_rows(tables, skip) if "mission" in tables else _line_rows(tables)
        rows = [{key: float(value) for key, value in row.items()} for row in rows]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(
            f"{path}: must be a plan of QGroundControl or GeoJSON with a LineString, got "
            f"{type(error).__name__} {error}."
        ) from error
    start = rows[0]["up_m"] if rows else 0.0
    return [{**row, "up_m": row["up_m"] - start} for row in rows]


def _plan_rows(tables: Mapping[str, Any], skip: bool) -> list[Row]:
    mission = tables["mission"]
    home = mission.get("plannedHomePosition") or [0.0, 0.0, 0.0]
    rows: list[Row] = []
    refused: list[str] = []
    for number, item in enumerate(_simple_items(mission["items"]), start=1):
        command, values, frame = item["command"], item["params"], item["frame"]
        if command not in (WAYPOINT, LOITER_TURNS) or frame not in (*ABOVE_SEA, *ABOVE_HOME):
            refused.append(f"item {number} (command {command}, frame {frame})")
            continue
        lat, lon, height = values[4:7]
        row = {"lat_deg": lat, "lon_deg": lon, "up_m": height - home[2] * (frame in ABOVE_SEA)}
        if command == LOITER_TURNS:
            row["turns"] = math.copysign(values[0], values[2] or 1.0)
            row |= {"radius_m": abs(values[2])} if values[2] else {}
        rows.append(row)
    if refused and not skip:
        raise InputError(
            f"`items` must be waypoints (command {WAYPOINT}) or loiters of a number of turns "
            f"({LOITER_TURNS}), got {', '.join(refused[:5])}; "
            "`--skip`, or `skip = true` in [route], leaves them out."
        )
    return rows


def _simple_items(items: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """The items of a mission in order, with those that surveys and the like consist of."""
    for item in items:
        if item["type"] == "SimpleItem":
            yield item
        else:
            yield from _simple_items(item["TransectStyleComplexItem"]["Items"])


def _line_rows(tables: Mapping[str, Any]) -> list[Row]:
    lines = [shape for shape in geometries(tables) if shape["type"] == "LineString"]
    if len(lines) != 1:
        raise InputError(f"`features` must have one LineString, got {len(lines)}.")
    return [
        {"lon_deg": point[0], "lat_deg": point[1], "up_m": point[2] if len(point) > 2 else 0.0}
        for point in lines[0]["coordinates"]
    ]


def geometries(tables: Mapping[str, Any]) -> Iterable[Mapping[str, Any]]:
    """The shapes of a GeoJSON object."""
    if tables["type"] == "FeatureCollection":
        return [feature["geometry"] for feature in tables["features"]]
    return [tables["geometry"] if tables["type"] == "Feature" else tables]


def route_geojson(path: Route, origin: tuple[float, float], h_0: float, title: str) -> str:
    """A path as GeoJSON, with heights above sea level."""
    shape = {"type": "LineString", "coordinates": _coordinates(path, origin, h_0).tolist()}
    feature = {"type": "Feature", "properties": {"name": title}, "geometry": shape}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"


def route_kml(path: Route, origin: tuple[float, float], h_0: float, title: str) -> str:
    """A path as KML, at heights above sea level."""
    kml = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    mark = ElementTree.SubElement(ElementTree.SubElement(kml, "Document"), "Placemark")
    ElementTree.SubElement(mark, "name").text = title
    line = ElementTree.SubElement(mark, "LineString")
    ElementTree.SubElement(line, "altitudeMode").text = "absolute"
    points = _coordinates(path, origin, h_0).tolist()
    text = " ".join(",".join(map(str, point)) for point in points)
    ElementTree.SubElement(line, "coordinates").text = text
    return ElementTree.tostring(kml, encoding="unicode", xml_declaration=True) + "\n"


def _coordinates(path: Route, origin: tuple[float, float], h_0: float) -> FloatArray:
    """Longitude and latitude, deg, and height, m, of points of a path, shape (n, 3)."""
    s = np.append(np.arange(0.0, path.length, APART), path.length)
    north, east, up = (np.interp(s, path.s, x) for x in (path.north, path.east, path.up))
    per_lat, per_lon = metres_per_degree(origin[0])
    lat, lon = origin[0] + north / per_lat, origin[1] + east / per_lon
    return np.column_stack([lon.round(8), lat.round(8), (h_0 + up).round(2)])
