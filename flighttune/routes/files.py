"""Files of routes: plans of QGroundControl and GeoJSON in, GeoJSON and KML out."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from xml.etree import ElementTree

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.errors import InputError
from flighttune.routes.path import STEP
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

# Largest change of course between two points of a corridor, rad.
CHORD = 1.0 * DEG

# Values of a row of the table `waypoint` of [route].
Row = dict[str, float]

# A path, latitude and longitude of its start, deg, and the height of its start, m.
Where: TypeAlias = tuple[Route, tuple[float, float], float]


class Corridor(NamedTuple):
    """Bounds in windows of distance along a path, all in m."""

    windows: FloatArray  # (windows, 2): from where to where
    low: FloatArray  # (windows, 2): distances to the right of the path and below it
    high: FloatArray


def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """Length of a degree of latitude and of longitude on WGS 84, m."""
    sine_2 = math.sin(lat_deg * DEG) ** 2
    across = AXIS / math.sqrt(1.0 - ECCENTRICITY_2 * sine_2)
    along = across * (1.0 - ECCENTRICITY_2) / (1.0 - ECCENTRICITY_2 * sine_2)
    return along * DEG, across * math.cos(lat_deg * DEG) * DEG


def on_earth(points: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Latitude and longitude, deg, of points north and east of `origin`, m."""
    return np.array(origin) + points[:, :2] / metres_per_degree(origin[0])


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
    with reading(path, "a plan of QGroundControl or GeoJSON with a LineString"):
        rows = _plan_rows(tables, skip) if "mission" in tables else _line_rows(tables)
        rows = [{key: float(value) for key, value in row.items()} for row in rows]
    start = rows[0]["up_m"] if rows else 0.0
    return [{**row, "up_m": row["up_m"] - start} for row in rows]


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Refuse a file in which something is missing or of another type, in one line with its name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{path}: must be {kind}, got {type(error).__name__} {error}.") from error


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
    shapes = [feature["geometry"] for feature in features(tables)]
    lines = [shape for shape in shapes if shape["type"] == "LineString"]
    if len(lines) != 1:
        raise InputError(f"`features` must have one LineString, got {len(lines)}.")
    return [
        {"lon_deg": point[0], "lat_deg": point[1], "up_m": point[2] if len(point) > 2 else 0.0}
        for point in lines[0]["coordinates"]
    ]


def features(tables: Mapping[str, Any]) -> Iterable[Mapping[str, Any]]:
    """The features of a GeoJSON object; a shape alone is one without properties."""
    if tables["type"] == "FeatureCollection":
        return [feature for feature in tables["features"] if feature["geometry"] is not None]
    return [tables if tables["type"] == "Feature" else {"geometry": tables}]


def route_geojson(where: Where, title: str, corridor: Corridor | None = None) -> str:
    """A path as GeoJSON, with heights above sea level, and its corridor window by window."""
    shapes = [({"name": title}, "LineString", _line(where).tolist())]
    for properties, floor, _ in _pieces(where, corridor):
        shapes.append((properties, "Polygon", [floor[:, :2].tolist()]))
    written = [
        {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": at}}
        for properties, kind, at in shapes
    ]
    return json.dumps({"type": "FeatureCollection", "features": written}) + "\n"


def route_kml(where: Where, title: str, corridor: Corridor | None = None) -> str:
    """A path as KML, at heights above sea level, and floor and ceiling of its corridor."""
    kml = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ElementTree.SubElement(kml, "Document")
    mark = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(mark, "name").text = title
    _add_shape(mark, ["LineString"], _line(where))
    for properties, *rings in _pieces(where, corridor):
        mark = ElementTree.SubElement(document, "Placemark")
        ElementTree.SubElement(mark, "name").text = "corridor from {from_m} m".format(**properties)
        shapes = ElementTree.SubElement(mark, "MultiGeometry")
        for ring in rings:
            _add_shape(shapes, ["Polygon", "outerBoundaryIs", "LinearRing"], ring)
    return ElementTree.tostring(kml, encoding="unicode", xml_declaration=True) + "\n"


def _add_shape(parent: ElementTree.Element, names: Sequence[str], points: FloatArray) -> None:
    """Add a shape at absolute heights; its coordinates are in the last of the nested `names`."""
    shape = ElementTree.SubElement(parent, names[0])
    ElementTree.SubElement(shape, "altitudeMode").text = "absolute"
    for name in (*names[1:], "coordinates"):
        shape = ElementTree.SubElement(shape, name)
    shape.text = " ".join(",".join(map(str, point)) for point in points.tolist())


def _line(where: Where) -> FloatArray:
    """Coordinates of points of a path."""
    return _coordinates(where, where[0].points(APART))


def _pieces(
    where: Where, corridor: Corridor | None
) -> Iterator[tuple[dict[str, Any], FloatArray, FloatArray]]:
    """Properties of each window of a corridor, and the closed rings of its floor and ceiling.

    The rings are counterclockwise, as GeoJSON asks for. Loiters overlap themselves, windows do not.
    """
    path = where[0]
    for (begin, end), low, high in zip(*corridor, strict=True) if corridor else ():
        own = slice(int(begin / STEP), int(end / STEP) + 2)
        turn, up = np.abs(path.curvature[own]).max() * (end - begin), path.up[own]
        s = np.linspace(begin, end, 2 + int(max((end - begin) / APART, turn / CHORD)))
        right = np.repeat([high[0], low[0], high[0]], [len(s), len(s), 1])
        s = np.concatenate([s, s[::-1], s[:1]])
        floor, ceiling = (_coordinates(where, s, right, below) for below in (high[1], low[1]))
        numbers = (begin, end, up.min() - high[1], up.max() - low[1])
        keys = ("from_m", "to_m", "min_up_m", "max_up_m")
        rounded = {key: round(float(x), 2) for key, x in zip(keys, numbers, strict=True)}
        yield {"name": "corridor", **rounded}, floor, ceiling


def _coordinates(
    where: Where, s: FloatArray, right: Floats = 0.0, below: float = 0.0
) -> FloatArray:
    """Longitude and latitude, deg, and height, m, of points beside a path, shape (n, 3)."""
    path, origin, h_0 = where
    places = path.beside(s, right, below)
    lat, lon = on_earth(places, origin).T
    return np.column_stack([lon.round(8), lat.round(8), (h_0 + places[:, 2]).round(2)])
