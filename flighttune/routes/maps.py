"""Places on Earth and the ground there, and maps: GeoJSON and KML of a path and its corridor."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar
from xml.etree import ElementTree

import numpy as np
from geographiclib.geodesic import Geodesic

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.errors import InputError, naming
from flighttune.base.files import archive, budget, table
from flighttune.base.files.xml import node
from flighttune.base.units import DEG
from flighttune.routes.path import STEP
from flighttune.routes.path import Path as Route
from flighttune.routes.raster import ground_heights

# Latitude and longitude, deg.
LatLon: TypeAlias = tuple[float, float]


@lru_cache(maxsize=4096)  # the flights of a campaign have the same waypoints
def north_east(place: LatLon, origin: LatLon) -> tuple[float, float]:
    """North and east, m, of a place, by distance and azimuth of the geodesic from `origin`."""
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

# Key of a written file for the route from which its path was planned.
ROUTE_KEY = "flighttune"

# Endings of names of GeoJSON's coordinate system.
WGS_84 = "CRS84", "EPSG::4326", "EPSG:4326", "EPSG::4979"

# Maximum absolute value of a number in a file.
TOO_LARGE = 1e9

# Maximum change of course between two points of a corridor, rad.
CHORD = 1.0 * DEG

P = TypeVar("P", list[Any], dict[str, Any])

# A path, latitude and longitude of its start, deg, and the height of its start, m.
Where: TypeAlias = tuple[Route, LatLon, float]


class Corridor(NamedTuple):
    """Bounds in windows of distance along a path, all in m."""

    windows: FloatArray  # (windows, 2): begin and end
    low: FloatArray  # (windows, 2): distances to the right of the path and below it
    high: FloatArray
    claim: str  # its meaning in words


class Mark(NamedTuple):
    """A point to draw."""

    name: str
    lat: float  # deg
    lon: float
    height: float  # m above sea level


# A closed ring of longitudes and latitudes, deg, and whether flights must stay outside.
Area: TypeAlias = tuple[list[list[float]], bool]

# KML elements that are shapes, and elements whose text is read.
SHAPES = ("LineString", "Polygon", "Point", "Track")
READ = ("coordinates", "coord", "altitudeMode", "value", "name")

# A place in a text of KML.
WORD = re.compile(r"\S+")

# Colours of lines and areas in KML, as opacity, blue, green, red.
STYLES = {
    "path": ("ffb04a1f", "00000000"),
    "corridor": ("80808080", "40b04a1f"),
    "fence": ("ff2b2bd6", "142b2bd6"),
}


def areas_of(tables: Iterable[Mapping[str, Any]]) -> tuple[Area, ...]:
    """Rings of fences in GeoJSON; True: flights must stay outside, as for every inner ring."""
    return tuple(
        (ring, zone > 0 or json_part(feature, "properties", dict).get("exclusion") is True)
        for fence in tables
        for feature in features(fence)
        if feature["geometry"]["type"] == "Polygon"
        for zone, ring in enumerate(feature["geometry"]["coordinates"])
    )


def json_number(value: object, name: str, null: float | None = None) -> float:
    """A number of a file, or `null` for null; InputError for text, a boolean or a huge number."""
    if value is None and null is not None:
        return null
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < TOO_LARGE:
        raise InputError(f"{name} must be a number, got {table.abridged(value)}.")
    return float(value)


def json_bool(value: object, name: str) -> bool:
    """A boolean of a file; InputError for another value."""
    if not isinstance(value, bool):
        raise InputError(f"{name} must be true or false, got {table.abridged(value)}.")
    return value


def json_part(tables: Mapping[str, Any], key: str, kind: type[P]) -> P:
    """The list or object of a key, empty if absent or null; InputError for another value."""
    value = tables.get(key)
    if not isinstance(value, kind | None):
        what = "a list" if kind is list else "an object"
        raise InputError(f"`{key}` must be {what}, got {table.abridged(value)}.")
    return kind() if value is None else value


# Endings of the files of Mission Planner.
PLANNER = (".waypoints", ".txt", ".fen")


def map_file(path: Path, endings: Sequence[str], kinds: str) -> tuple[str, Any]:
    """The kind of a file (``kml``, ``planner``, ``plan`` or ``geojson``), and its content."""
    if (ending := path.suffix.lower()) not in endings:
        raise InputError(f"{path}: must be {kinds}, got {path.suffix}.")
    if ending == ".kmz":
        return "kml", _kmz_text(path)
    if ending in (".kml", *PLANNER):
        kind, of = ("kml", budget.KML) if ending == ".kml" else ("planner", budget.LINES)
        return kind, table.file_text(path, of)
    tables = table.json_tables(path)
    return "plan" if ending == ".plan" or "mission" in tables else "geojson", tables


def _kmz_text(path: Path) -> str:
    """The text of the only KML in a zip archive."""

    def is_kml(name: str) -> bool:
        return name.lower().endswith(".kml")

    said = "zip archive with a .kml file", "its .kml"
    with naming(path), archive.opened(path, *said, is_kml, budget.KML) as (file, names):
        if len(names) != 1:
            got = f": {table.abridged(', '.join(names))}" * bool(names)
            raise InputError(f"must hold one .kml file, got {len(names)}{got}.")
        return file.read(names[0]).decode("utf-8-sig")


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Refuse a file with a missing key or a wrong type, in one line with the name of the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except KeyError as error:
        raise InputError(f"{path}: must be {kind}, got none with `{error.args[0]}`.") from error
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        reason = f" ({table.shown(str(error))})" if isinstance(error, ValueError) else ""
        raise InputError(f"{path}: must be {kind}, got values of another kind{reason}.") from error


def feature(kind: str, coordinates: Any, properties: Mapping[str, Any]) -> dict[str, Any]:
    """A shape of GeoJSON with its properties."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def features(tables: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """The features of a GeoJSON object; a bare shape counts as a feature without properties."""
    # GeoJSON before RFC 7946 may use another coordinate system, some 100 m away from WGS 84.
    system = json_part(json_part(tables, "crs", dict), "properties", dict).get("name", WGS_84[0])
    if not str(system).endswith(WGS_84):
        raise InputError(
            f"`crs` must be WGS 84 (CRS84 or EPSG:4326), got {table.abridged(system)}."
        )
    if tables["type"] == "FeatureCollection":
        return [part for shape in tables["features"] for part in _parts(shape)]
    return [*_parts(tables if tables["type"] == "Feature" else {"geometry": tables})]


def _parts(shape: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The single lines, polygons and points of a feature, as one feature each."""
    pending = [shape["geometry"]]
    stated: Any = shape.get("properties")
    while pending:
        if (geometry := pending.pop()) is None:
            continue
        kind = geometry["type"]
        if kind == "GeometryCollection":
            pending += reversed(geometry["geometries"])
        elif kind in ("MultiLineString", "MultiPolygon"):
            kind = kind.removeprefix("Multi")
            yield from (feature(kind, part, stated) for part in geometry["coordinates"])
        else:
            yield {"geometry": geometry, "properties": stated}


def kml_features(text: str) -> list[dict[str, Any]]:
    """Lines, tracks, polygons and points of KML as features of GeoJSON, with ``altitudeMode``."""
    if "<!DOCTYPE" in text:  # entities could expand a small file to a huge text
        raise InputError("must be KML without a document type.")
    shapes = _Shapes()
    parser = ElementTree.XMLParser(target=shapes)
    try:
        parser.feed(text)
        parser.close()
    except ElementTree.ParseError as error:
        raise InputError(f"must be KML: {error}.") from error
    if shapes.stated:
        own = {ROUTE_KEY: table.json_object(shapes.stated, f"`{ROUTE_KEY}`")}
        for shape in shapes.found:
            if shape["geometry"]["type"] == "LineString":
                shape["properties"] |= own
    return shapes.found


class _Shapes:
    """Handler of a KML parser, element by element, without a tree in memory."""

    def __init__(self) -> None:
        self.found: list[dict[str, Any]] = []
        self.stated = ""  # the route that flighttune wrote
        self._inside: list[str] = []  # tags of the elements above
        self._text: list[str] | None = None
        self._shape, self._depth, self._places = "", 0, 0
        self._rings: list[list[list[float]]] = []
        self._mode = self._name = ""

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        """An element begins."""
        kind = tag.rpartition("}")[2]
        if self._inside and self._inside[-1] in READ:  # its text ends here
            self._put_text(self._inside[-1], self._inside[-2:-1])
        if len(self._inside) > budget.KML.depth:
            raise InputError("must not be nested so deeply.")
        if kind == "Placemark":
            self._name = ""
        self._inside.append(f"{ROUTE_KEY} {kind}" if attributes.get("name") == ROUTE_KEY else kind)
        if kind in SHAPES:
            if self._shape:
                raise InputError(f"must have no {kind} inside a {self._shape}.")
            self._shape, self._depth = kind, len(self._inside)
            self._rings, self._mode = [], ""
        self._text = [] if kind in READ else None

    def data(self, text: str) -> None:
        """A piece of text."""
        if self._text is not None:
            self._text.append(text)

    def end(self, _: str) -> None:
        """An element ends."""
        kind = self._inside.pop()
        self._put_text(kind, self._inside[-1:])
        if self._shape and len(self._inside) < self._depth:
            rings, kind, self._shape = self._rings, self._shape, ""
            if kind == "Track":
                kind, rings = "LineString", [[point for ring in rings for point in ring]]
            named = {"name": self._name} if self._name else {}
            shape = feature(kind, rings if kind == "Polygon" else [*rings, []][0], named)
            shape["geometry"]["altitudeMode"] = self._mode or "clampToGround"
            self.found.append(shape)

    def _put_text(self, kind: str, above: list[str]) -> None:
        """Take the text of an element of `READ`, in the element `above`, up to its first child."""
        if self._text is None:
            return
        text, self._text = "".join(self._text), None
        if kind == "value" and above == [f"{ROUTE_KEY} Data"]:
            self.stated = self.stated or text
        elif kind == "name" and above == ["Placemark"]:
            self._name = self._name or " ".join(text.split())
        elif kind == "altitudeMode" and self._shape:
            self._mode = self._mode or text
        elif kind == "coord" and self._shape == "Track":  # blanks separate its numbers
            self._add(",".join(text.split()))
        elif kind == "coordinates" and self._shape in ("LineString", "Polygon"):
            self._add(text)

    def _add(self, text: str) -> None:
        self._rings.append([])
        for word in WORD.finditer(text):
            self._rings[-1].append(_point(word[0]))
            self._places += 1
            if self._places > budget.KML.entries:
                raise InputError(
                    f"must have at most {budget.KML.entries} places in its shapes, got more."
                )


def _point(word: str) -> list[float]:
    try:
        return [float(value) for value in word.split(",", 4)]
    except ValueError as error:
        raise InputError(
            "`coordinates` must be longitude,latitude,height in numbers with points, without "
            f"blanks after the commas, got {table.abridged(word)}."
        ) from error


def with_hash(route: Mapping[str, Any], path: object) -> dict[str, Any]:
    """A route to write beside its planned path, with the hash of the path."""
    return {**route, "path_sha256": table.hash_of(path)}


class RouteMap(NamedTuple):
    """A path, and what is drawn beside it: its corridor, waypoints, rally points and fences."""

    where: Where
    title: str
    points: Sequence[Mark] = ()  # waypoints
    rally: Sequence[Mark] = ()
    areas: Sequence[Area] = ()
    corridor: Corridor | None = None
    stated: Mapping[str, Any] | None = None  # the route that a reader of the file gets

    def geojson(self) -> str:
        """The map as GeoJSON, with heights above sea level; each window is a feature."""
        line = self._line()
        claim = {"corridor": self.corridor.claim} if self.corridor else {}
        own = {ROUTE_KEY: with_hash(self.stated, line.tolist())} if self.stated else {}
        shapes = [feature("LineString", line.tolist(), {"name": self.title, **claim, **own})]
        for properties, floor, _ in self._pieces():
            shapes.append(feature("Polygon", [floor[:, :2].tolist()], properties))
        for mark in (*self.points, *self.rally):
            shapes.append(feature("Point", [mark.lon, mark.lat, mark.height], {"name": mark.name}))
        for ring, exclusion in self.areas:
            shapes.append(feature("Polygon", [ring], {"name": "fence", "exclusion": exclusion}))
        return json.dumps({"type": "FeatureCollection", "features": shapes}) + "\n"

    def kml(self) -> str:
        """The map as KML, at heights above sea level, with floor and ceiling of the corridor."""
        line, claim = self._line(), f"Corridor: {self.corridor.claim}." if self.corridor else ""
        own = []
        if self.stated:
            value = node("value", json.dumps(with_hash(self.stated, line.tolist())))
            own = [node("ExtendedData", node("Data", value, name=ROUTE_KEY))]
        shape = kml_shape(line, "LineString")
        marks = [placemark(self.title, "path", *own, shape, description=claim)]
        for properties, *rings in self._pieces():
            shape = node("MultiGeometry", *(kml_area([ring]) for ring in rings))
            name = "corridor from {from_m} m".format(**properties)
            marks.append(placemark(name, "corridor", shape))
        for mark in (*self.points, *self.rally):
            shape = kml_shape(np.array([[mark.lon, mark.lat, mark.height]]), "Point")
            marks.append(placemark(mark.name, "path", shape))
        for ring, exclusion in self.areas:
            corners = np.array([[lon, lat, 0.0] for lon, lat, *_ in ring])
            shape = kml_area([corners], mode="clampToGround")
            marks.append(placemark("stay out" if exclusion else "stay in", "fence", shape))
        return kml_text(STYLES, marks)

    def corridor_rings(self) -> list[list[list[float]]]:
        """Closed rings of the windows of the corridor, longitudes and latitudes in deg."""
        return [floor[:, :2].tolist() for _, floor, _ in self._pieces()]

    def _line(self) -> FloatArray:
        """Coordinates of points of the path."""
        (line,) = coordinates(self.where, self.where[0].points(APART), 0.0, 0.0)
        return line

    def _pieces(self) -> Iterator[tuple[dict[str, Any], FloatArray, FloatArray]]:
        """Properties of each window of the corridor, and the rings of its floor and ceiling."""
        path, corridor = self.where[0], self.corridor
        for (begin, end), low, high in zip(*corridor[:3], strict=True) if corridor else ():
            window = slice(int(begin / STEP), int(end / STEP) + 2)
            turn, up = np.abs(path.curvature[window]).max() * (end - begin), path.up[window]
            s = np.linspace(begin, end, 2 + int(max((end - begin) / APART, turn / CHORD)))
            # The rings are closed and counterclockwise, as GeoJSON requires. A loiter overlaps
            # itself; a window does not.
            right = np.repeat([high[0], low[0], high[0]], [len(s), len(s), 1])
            s = np.concatenate([s, s[::-1], s[:1]])
            floor, ceiling = coordinates(self.where, s, right, high[1], low[1])
            numbers = (begin, end, up.min() - high[1], up.max() - low[1])
            keys = ("from_m", "to_m", "min_up_m", "max_up_m")
            rounded = {key: round(float(x), 2) for key, x in zip(keys, numbers, strict=True)}
            yield {"name": "corridor", **rounded}, floor, ceiling


def kml_text(
    styles: Mapping[str, tuple[str, str]], placemarks: Iterable[ElementTree.Element]
) -> str:
    """A KML file of placemarks; `styles`: colours of the lines and areas of each style."""
    document = node("Document")
    for name, (line, area) in styles.items():
        of_line = node("LineStyle", node("color", line), node("width", "3"))
        document.append(node("Style", of_line, node("PolyStyle", node("color", area)), id=name))
    document.extend(placemarks)
    kml = node("kml", document, xmlns="http://www.opengis.net/kml/2.2")
    return ElementTree.tostring(kml, encoding="unicode", xml_declaration=True) + "\n"


def placemark(
    name: str, style: str, *parts: ElementTree.Element, description: str = ""
) -> ElementTree.Element:
    """A placemark with its name and style."""
    described = [node("description", description)] if description else []
    return node("Placemark", node("name", name), *described, node("styleUrl", f"#{style}"), *parts)


def kml_shape(points: FloatArray, kind: str) -> ElementTree.Element:
    """A point or a line, with heights above sea level."""
    return node(kind, node("altitudeMode", "absolute"), _coordinates_of(points))


def kml_area(rings: Sequence[FloatArray], mode: str = "absolute") -> ElementTree.Element:
    """A Polygon with its outer ring first; the others are holes."""
    borders = ["outerBoundaryIs", *["innerBoundaryIs"] * (len(rings) - 1)]
    parts = (
        node(border, node("LinearRing", _coordinates_of(ring)))
        for border, ring in zip(borders, rings, strict=True)
    )
    return node("Polygon", node("altitudeMode", mode), *parts)


def _coordinates_of(points: FloatArray) -> ElementTree.Element:
    return node("coordinates", " ".join(",".join(map(str, point)) for point in points.tolist()))


def coordinates(
    where: Where, s: FloatArray, right: Floats, *distances_below: float
) -> list[FloatArray]:
    """Longitude, latitude (deg) and height (m), (n, 3), at distances beside and below a path."""
    path, origin, h_0 = where
    places = path.beside(s, right)
    lat, lon = on_earth(places, origin).T.round(8)
    return [np.column_stack([lon, lat, (h_0 + places[:, 2] - x).round(2)]) for x in distances_below]


# Distance between the places at which the height of the ground is read, m.
LOOKED_AT = 5.0


def ground_at(file: str | Path, places: FloatArray) -> FloatArray:
    """Height of the ground, m above sea level, at places (n, 2), latitude and longitude in deg."""
    with naming(file):
        heights = ground_heights(Path(file), places)
    if (lost := np.isnan(heights)).any():
        raise _none_at(file, *places[lost][0])
    return heights


def _none_at(file: str | Path, lat: float, lon: float) -> InputError:
    return InputError(f"{file}: must have the height of the ground at {lat:.5f}, {lon:.5f} deg.")


def clearance(file: str | Path, where: Where, corridor: Corridor | None = None) -> dict[str, Any]:
    """The place where a path or its corridor is lowest over the ground, sampled every 5 m."""
    path, origin, h_0 = where
    s, right, below = path.points(LOOKED_AT), np.zeros(()), np.zeros(())
    if corridor is not None:
        window = np.searchsorted(corridor.windows[:, 1], s).clip(max=len(corridor.low) - 1)
        (left, _), (far, lowest) = corridor.low[window].T, corridor.high[window].T
        shares = np.linspace(0.0, 1.0, 2 + int((far - left).max() / LOOKED_AT))[:, None]
        right, s = (left + shares * (far - left)).ravel(), np.tile(s, len(shares))
        below = np.tile(lowest, len(shares))
    places = path.beside(s, right, below)
    on_map = on_earth(places, origin)
    ground = ground_at(file, on_map)
    over = h_0 + places[:, 2] - ground
    i = int(np.argmin(over))
    return {
        "over_ground_m": float(over[i]),
        "along_m": float(s[i]),
        "stretch": path.stretch_at(float(s[i])).words,
        **dict(zip(("lat_deg", "lon_deg"), on_map[i].tolist(), strict=True)),
        "ground_m": float(ground[i]),
        "file": str(file),
    }


def clearance_words(subject: str, lowest: dict[str, Any]) -> str:
    """The smallest height over ground, in a sentence."""
    place = "on the {stretch}, {along_m:.0f} m along, at {lat_deg:.5f}, {lon_deg:.5f}"
    ground = "the ground is {ground_m:.0f} m above sea level there ({file})"
    over = lowest["over_ground_m"]
    how = f"comes down to {over:.1f} m over" if over >= 0.0 else f"is {-over:.1f} m below"
    return f"{subject} {how} the ground {place}; {ground}.".format(**lowest)


NOT_SEEN = "Terrain was not looked at: `--terrain FILE` does."
