"""Places on the WGS 84 ellipsoid, and files of maps: GeoJSON and KML of a path and its corridor."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar
from xml.etree import ElementTree

import numpy as np
from geographiclib.geodesic import Geodesic

from flighttune.arrays import FloatArray, Floats
from flighttune.errors import InputError
from flighttune.files.mistakes import abridged
from flighttune.files.table import hash_of, json_object
from flighttune.references.path import STEP
from flighttune.references.path import Path as Route
from flighttune.units import DEG

# Latitude and longitude, deg.
LatLon: TypeAlias = tuple[float, float]


@lru_cache(maxsize=4096)  # the flights of a campaign have the same waypoints
def north_east(place: LatLon, origin: LatLon) -> tuple[float, float]:
    """North and east, m, of a place: its distance from `origin` along a geodesic, and its azimuth.

    Longitudes count modulo 360.
    """
    line = Geodesic.WGS84.Inverse(*origin, *place, Geodesic.DISTANCE | Geodesic.AZIMUTH)
    distance, azimuth = line["s12"], line["azi1"] * DEG
    return distance * math.cos(azimuth), distance * math.sin(azimuth)


def on_earth(points: FloatArray, origin: LatLon) -> FloatArray:
    """Latitude and longitude, deg, of points north and east of `origin`, m; shape (n, 2)."""
    lines = (
        Geodesic.WGS84.Direct(*origin, math.atan2(east, north) / DEG, math.hypot(north, east))
        for north, east, *_ in points.tolist()
    )
    return np.array([(line["lat2"], line["lon2"]) for line in lines])


# Distance between the points of a file that is written, m.
APART = 10.0

# Corners in a quarter of the round end of an area.
CORNERS = 16

# Key of what a written file says about the route that its path was planned from.
ROUTE_KEY = "flighttune"

# Numbers of a file are smaller in size.
TOO_LARGE = 1e9

# Largest change of course between two points of a corridor, rad.
CHORD = 1.0 * DEG

P = TypeVar("P", list[Any], dict[str, Any])

# A path, latitude and longitude of its start, deg, and the height of its start, m.
Where: TypeAlias = tuple[Route, LatLon, float]


class Corridor(NamedTuple):
    """Bounds in windows of distance along a path, all in m."""

    windows: FloatArray  # (windows, 2): from where to where
    low: FloatArray  # (windows, 2): distances to the right of the path and below it
    high: FloatArray
    claim: str  # what it is of, in words


class Volume(NamedTuple):
    """All places beside a path up to a width, between two heights over ground, in m."""

    width: float  # to each side, and around both ends
    low: float
    high: float
    claim: str  # in words


class Mark(NamedTuple):
    """A point to draw."""

    name: str
    lat: float  # deg
    lon: float
    height: float  # m above sea level


class Marks(NamedTuple):
    """Lines and areas drawn beside a path."""

    points: tuple[Mark, ...] = ()  # waypoints
    rally: tuple[Mark, ...] = ()
    # closed rings of longitudes and latitudes, deg, and whether they are to stay out of
    areas: tuple[tuple[list[list[float]], bool], ...] = ()


NO_MARKS = Marks()

# Elements of an area in KML, from its shape to its ring.
RING = ("Polygon", "outerBoundaryIs", "LinearRing")

# Colours of lines and areas in KML, as opacity, blue, green, red.
STYLES = {
    "path": ("ffb04a1f", "00000000"),
    "corridor": ("80808080", "40b04a1f"),
    "fence": ("ff2b2bd6", "142b2bd6"),
}


def areas_of(tables: Iterable[Mapping[str, Any]]) -> tuple[tuple[list[list[float]], bool], ...]:
    """Rings of fences in GeoJSON, and whether they are to stay out of; inner rings are."""
    return tuple(
        (ring, zone > 0 or json_part(feature, "properties", dict).get("exclusion") is True)
        for fence in tables
        for feature in features(fence)
        if feature["geometry"]["type"] == "Polygon"
        for zone, ring in enumerate(feature["geometry"]["coordinates"])
    )


def json_number(value: object, name: str, null: float | None = None) -> float:
    """A number of a file, `null` for null; InputError if it is text, a boolean, or too large."""
    if value is None and null is not None:
        return null
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < TOO_LARGE:
        raise InputError(f"{name} must be a number, got {abridged(value)}.")
    return float(value)


def json_bool(value: object, name: str) -> bool:
    """A value of a file that is true or false; InputError if it is another."""
    if not isinstance(value, bool):
        raise InputError(f"{name} must be true or false, got {abridged(value)}.")
    return value


def json_part(tables: Mapping[str, Any], key: str, kind: type[P]) -> P:
    """The list or object of a key, empty if absent or null; InputError if it is another value."""
    value = tables.get(key)
    if not isinstance(value, kind | None):
        what = "a list" if kind is list else "an object"
        raise InputError(f"`{key}` must be {what}, got {abridged(value)}.")
    return kind() if value is None else value


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Refuse a file in which something is missing or of another type, in one line with its name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except KeyError as error:
        raise InputError(f"{path}: must be {kind}, got none with `{error.args[0]}`.") from error
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: must be {kind}, got values of another kind.") from error


def features(tables: Mapping[str, Any]) -> Iterable[Mapping[str, Any]]:
    """The features of a GeoJSON object; a shape alone is one without properties."""
    if tables["type"] == "FeatureCollection":
        return [feature for feature in tables["features"] if feature["geometry"] is not None]
    return [tables if tables["type"] == "Feature" else {"geometry": tables}]


def kml_features(text: str) -> list[dict[str, Any]]:
    """Lines and polygons of KML as features of GeoJSON, lines with their ``altitudeMode``."""
    if "<!DOCTYPE" in text:  # entities could make a small file a large one
        raise InputError("must be KML without a document type.")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"must be KML: {error}.") from error
    shapes = []
    stated = root.findtext(f".//{{*}}Data[@name='{ROUTE_KEY}']/{{*}}value")
    own = {ROUTE_KEY: json_object(stated, f"`{ROUTE_KEY}`")} if stated else {}
    for shape in root.iter():
        if (kind := shape.tag.rpartition("}")[2]) in ("LineString", "Polygon"):
            rings = [_points(x.text or "") for x in shape.iter() if x.tag.endswith("}coordinates")]
            modes = [x.text for x in shape.iter() if x.tag.endswith("}altitudeMode")]
            coordinates = rings if kind == "Polygon" else rings[0]
            mode = {"altitudeMode": (modes or ["clampToGround"])[0]}
            geometry = {"type": kind, "coordinates": coordinates, **mode}
            shapes.append({"properties": own if kind == "LineString" else {}, "geometry": geometry})
    return shapes


def _points(text: str) -> list[list[float]]:
    return [[float(value) for value in point.split(",")] for point in text.split()]


def with_hash(route: Mapping[str, Any], path: object) -> dict[str, Any]:
    """A route to write beside the path that was planned from it; another path has another hash."""
    return {**route, "path_sha256": hash_of(path)}


def route_geojson(
    where: Where,
    title: str,
    corridor: Corridor | None = None,
    marks: Marks = NO_MARKS,
    route: Mapping[str, Any] | None = None,
) -> str:
    """A path as GeoJSON, with heights above sea level, and its corridor window by window.

    Waypoints, rally points and fences follow. The `route` is what the file is read back as.
    """
    claim = {"corridor": corridor.claim} if corridor else {}
    line = _line(where).tolist()
    own = {ROUTE_KEY: with_hash(route, line)} if route else {}
    shapes: list[tuple[dict[str, Any], str, Any]] = [
        ({"name": title, **claim, **own}, "LineString", line)
    ]
    for properties, floor, _ in _pieces(where, corridor):
        shapes.append((properties, "Polygon", [floor[:, :2].tolist()]))
    for mark in (*marks.points, *marks.rally):
        shapes.append(({"name": mark.name}, "Point", [mark.lon, mark.lat, mark.height]))
    for ring, exclusion in marks.areas:
        shapes.append(({"name": "fence", "exclusion": exclusion}, "Polygon", [ring]))
    written = [
        {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": at}}
        for properties, kind, at in shapes
    ]
    return json.dumps({"type": "FeatureCollection", "features": written}) + "\n"


def rings_around(path: Route, width: float) -> list[FloatArray]:
    """Rings of the area within `width` (m) of a path, the outer one first: north, east, (n, 2).

    No place within the width is outside of it: its corners are beyond.
    """
    from shapely import LineString  # here: it is not needed otherwise

    off_path = np.abs(path.curvature).max() * APART**2 / 8.0  # of a chord between two points
    beyond = (width + off_path) / math.cos(math.pi / (4 * CORNERS))
    area = LineString(path.beside(path.points(APART))[:, :2]).buffer(beyond, quad_segs=CORNERS)
    return [np.array(ring.coords) for ring in (area.exterior, *area.interiors)]


def volumes_geojson(where: Where, volumes: Mapping[str, Volume]) -> str:
    """Volumes around a path by name, rounded outwards: areas with width and heights over ground."""
    path, origin, _ = where
    shapes = []
    for name, volume in volumes.items():
        width, high = (math.ceil(10.0 * size) / 10.0 for size in (volume.width, volume.high))
        low = math.floor(10.0 * volume.low) / 10.0
        rings = [
            on_earth(ring, origin)[:, ::-1].round(8).tolist() for ring in rings_around(path, width)
        ]
        sizes = {"width_m": width, "min_over_ground_m": low, "max_over_ground_m": high}
        properties = {"name": name, **sizes, "claim": volume.claim}
        geometry = {"type": "Polygon", "coordinates": rings}
        shapes.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": shapes}, indent=1)


def route_kml(
    where: Where,
    title: str,
    corridor: Corridor | None = None,
    marks: Marks = NO_MARKS,
    route: Mapping[str, Any] | None = None,
) -> str:
    """A path as KML, at heights above sea level, and floor and ceiling of its corridor.

    Waypoints, rally points and fences follow; each kind has a style. The `route` is what the file
    is read back as.
    """
    kml = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ElementTree.SubElement(kml, "Document")
    for name, (line, area) in STYLES.items():
        style = ElementTree.SubElement(document, "Style", id=name)
        for kind, values in (("Line", {"color": line, "width": "3"}), ("Poly", {"color": area})):
            _add_texts(ElementTree.SubElement(style, f"{kind}Style"), values)
    claim = f"Corridor: {corridor.claim}." if corridor else ""
    mark, line = _add_mark(document, title, "path", claim), _line(where)
    if route:
        data = ElementTree.SubElement(mark, "ExtendedData")
        value = json.dumps(with_hash(route, line.tolist()))
        _add_texts(ElementTree.SubElement(data, "Data", name=ROUTE_KEY), {"value": value})
    _add_shape(mark, ["LineString"], line)
    for properties, *rings in _pieces(where, corridor):
        name = "corridor from {from_m} m".format(**properties)
        shapes = ElementTree.SubElement(_add_mark(document, name, "corridor"), "MultiGeometry")
        for ring in rings:
            _add_shape(shapes, RING, ring)
    for point in (*marks.points, *marks.rally):
        place = np.array([[point.lon, point.lat, point.height]])
        _add_shape(_add_mark(document, point.name, "path"), ["Point"], place)
    for corners, exclusion in marks.areas:
        ring = np.array([[lon, lat, 0.0] for lon, lat, *_ in corners])
        mark = _add_mark(document, "stay out" if exclusion else "stay in", "fence")
        _add_shape(mark, RING, ring, mode="clampToGround")
    return ElementTree.tostring(kml, encoding="unicode", xml_declaration=True) + "\n"


def corridor_rings(where: Where, corridor: Corridor | None) -> Iterator[list[list[float]]]:
    """Closed rings of the windows of a corridor, longitudes and latitudes in deg."""
    return (floor[:, :2].tolist() for _, floor, _ in _pieces(where, corridor))


def _add_mark(
    document: ElementTree.Element, name: str, style: str, description: str = ""
) -> ElementTree.Element:
    """Add a placemark, whose shape follows."""
    mark = ElementTree.SubElement(document, "Placemark")
    described = {"description": description} if description else {}
    _add_texts(mark, {"name": name, **described, "styleUrl": f"#{style}"})
    return mark


def _add_texts(parent: ElementTree.Element, texts: Mapping[str, str]) -> None:
    for tag, text in texts.items():
        ElementTree.SubElement(parent, tag).text = text


def _add_shape(
    parent: ElementTree.Element, names: Sequence[str], points: FloatArray, mode: str = "absolute"
) -> None:
    """Add a shape; its coordinates are in the last of the nested `names`."""
    shape = ElementTree.SubElement(parent, names[0])
    ElementTree.SubElement(shape, "altitudeMode").text = mode
    for name in (*names[1:], "coordinates"):
        shape = ElementTree.SubElement(shape, name)
    shape.text = " ".join(",".join(map(str, point)) for point in points.tolist())


def _line(where: Where) -> FloatArray:
    """Coordinates of points of a path."""
    (line,) = _coordinates(where, where[0].points(APART), 0.0, 0.0)
    return line


def _pieces(
    where: Where, corridor: Corridor | None
) -> Iterator[tuple[dict[str, Any], FloatArray, FloatArray]]:
    """Properties of each window of a corridor, and the closed rings of its floor and ceiling.

    The rings are counterclockwise, as GeoJSON asks for. Loiters overlap themselves, windows do not.
    """
    path = where[0]
    for (begin, end), low, high in zip(*corridor[:3], strict=True) if corridor else ():
        window = slice(int(begin / STEP), int(end / STEP) + 2)
        turn, up = np.abs(path.curvature[window]).max() * (end - begin), path.up[window]
        s = np.linspace(begin, end, 2 + int(max((end - begin) / APART, turn / CHORD)))
        right = np.repeat([high[0], low[0], high[0]], [len(s), len(s), 1])
        s = np.concatenate([s, s[::-1], s[:1]])
        floor, ceiling = _coordinates(where, s, right, high[1], low[1])
        numbers = (begin, end, up.min() - high[1], up.max() - low[1])
        keys = ("from_m", "to_m", "min_up_m", "max_up_m")
        rounded = {key: round(float(x), 2) for key, x in zip(keys, numbers, strict=True)}
        yield {"name": "corridor", **rounded}, floor, ceiling


def _coordinates(
    where: Where, s: FloatArray, right: Floats, *distances_below: float
) -> list[FloatArray]:
    """Longitude and latitude, deg, and height, m, of points beside a path, and below it by each of
    some distances, shape (n, 3)."""
    path, origin, h_0 = where
    places = path.beside(s, right)
    lat, lon = on_earth(places, origin).T.round(8)
    heights = h_0 + places[:, 2]
    return [np.column_stack([lon, lat, (heights - x).round(2)]) for x in distances_below]
