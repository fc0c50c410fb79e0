"""Fences: areas over ground to stay inside or outside, and the room they leave along a path."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import abridged
from flighttune.routes import maps, volumes
from flighttune.routes.items import HEADER, planner_items, stated_lines
from flighttune.routes.path import STEP
from flighttune.routes.path import Path as Route

# Distance between the points of a path at which the distance to the fence is measured, m.
SCAN_STEP = 0.1

# Maximum number of edges: each takes about 20 ms on a route of 16 km.
MAX_EDGES = 1000
TOO_MANY_EDGES = (
    f"a fence must have at most {MAX_EDGES} edges, "
    "with those of circles and the parts of long ones."
)

# Largest distance, m, between an edge straight in latitude and longitude and its straight parts.
MAX_SAG = 0.05

# Properties of a fence.
HEIGHTS = ("min_up_m", "max_up_m")
KNOWN = (*HEIGHTS, "name", "exclusion")

# Properties, in small letters, that other programs write and that do not concern the fence:
# simplestyle (https://github.com/mapbox/simplestyle-spec), row numbers of databases, and fields of
# KML as GDAL writes them.
OF_OTHERS = {
    *("title", "description", "marker-size", "marker-symbol", "marker-color"),
    *("stroke", "stroke-opacity", "stroke-width", "fill", "fill-opacity"),
    *("fid", "id", "gid", "objectid", "ogc_fid", "uuid"),
    *("name", "timestamp", "begin", "end", "altitudemode", "tessellate", "extrude", "visibility"),
    *("draworder", "icon", "styleurl", "stylehash"),
}

# Corners of the polygon that replaces a circle. It lies inside a circle to stay in, and around a
# circle to stay out of.
CIRCLE_CORNERS = 64

# Corners that differ by less in latitude and longitude, deg, count as equal: 1 cm.
SAME_CORNER_DEG = 1e-7

# Signs that turn minima and maxima into distances to the left and right, up and down.
DISTANCE_SIGNS = np.array([-1.0, 1.0], dtype=np.float32)

# Smallest cosine to divide by: an edge may be parallel to the path or across it.
TINY = 1e-12

# Heights without a floor or ceiling.
FAR = (-np.inf, np.inf)

SIDES = ("left", "right", "up", "down")

ALL_AREAS = " Flights must stay inside all areas; those of a plan for PX4 count as one."


@dataclass(frozen=True, kw_only=True, eq=False)
class Fence:
    """Where flights may be, in m from the start."""

    rings: tuple[FloatArray, ...]  # (edges, 2) each: north and east of where the edges begin
    outside: tuple[bool, ...]  # whether flights must stay outside each ring
    # (edges,): distance of each from the line that is straight in latitude and longitude
    sag: FloatArray
    names: tuple[str, ...]  # labels of the edges, then of ceiling and floor
    low: float
    high: float

    @cached_property
    def start(self) -> FloatArray:
        """North and east of where each edge of all rings begins, shape (edges, 2), m."""
        return np.concatenate(self.rings)

    @cached_property
    def end(self) -> FloatArray:
        """North and east of where each edge ends, shape (edges, 2), m."""
        return np.concatenate([np.roll(ring, -1, axis=0) for ring in self.rings])

    @property
    def heights(self) -> str:
        """Floor and ceiling in words."""
        return " and ".join(
            f"no {name}" if np.isinf(height) else f"a {name} at {height:g} m above the start"
            for name, height in {"floor": self.low, "ceiling": self.high}.items()
        )

    def nearest(self, path: Route, *, sides: bool = False) -> dict[str, Any]:
        """Place of the smallest margin of a path (m, negative outside), and its first exit.

        With `sides` floor and ceiling are left out.
        """
        inside = path.s <= path.length
        places = np.column_stack([path.north, path.east])[inside]
        points, heights = np.asarray(shapely.points(places)), path.up[inside]
        margins = [self.high - heights, heights - self.low]
        if sides:
            margins = [np.full(len(heights), np.inf)] * 2
        for ring, outside in zip(self.rings, self.outside, strict=True):
            area = shapely.Polygon(ring)
            sign = np.where(shapely.contains(area, points) == outside, -1.0, 1.0)
            margins.append(sign * shapely.distance(area.exterior, points))
        kind, i = np.unravel_index(np.argmin(margins), np.shape(margins))
        along, side, edge = float(path.s[i]), SIDES[2 + kind % 2], kind - 2
        if kind > 1:
            lines = _lines(self.rings[edge])
            nearest = np.argmin(shapely.distance(lines, points[i]))
            edge = sum(map(len, self.rings[:edge])) + nearest
            to = shapely.shortest_line(points[i], lines[nearest])
            north, east = shapely.get_coordinates(to)[1]
            course, (n, e) = path.course[i], places[i]
            right = (east - e) * math.cos(course) - (north - n) * math.sin(course)
            side = SIDES[int(right > 0.0)]
        out = np.min(margins, axis=0) < 0.0
        return {
            "margin_m": float(margins[kind][i]),
            "side": side,
            "edge": self.names[edge],
            "along_m": along,
            "stretch": path.stretch_at(along).words,
            "leaves_m": float(path.s[out.argmax()]) if out.any() else None,
        }

    def beyond(
        self, path: Route, around: Mapping[str, volumes.Volume], start: float
    ) -> list[tuple[str, "Beyond"]]:
        """How far volumes around a path are beyond the sides, the ceiling and the floor, by name.

        `start`: height of the start over ground, m.
        """
        near, found = self.nearest(path, sides=True), []
        for name, volume in around.items():
            drawn = volume.outwards
            # Between its points the path may come nearer to an edge.
            needed = volumes.reach(path, drawn.width) + 0.5 * STEP
            over, under = drawn.high - start - self.high, self.low - (drawn.low - start)
            found.append((name, Beyond(needed - near["margin_m"], near)))
            if name != volumes.BUFFER:  # which lies on the ground, whatever the floor of a fence
                found.append((name, Beyond(over, {"edge": self.names[-2], "side": "up"})))
                found.append((name, Beyond(under, {"edge": self.names[-1], "side": "down"})))
        return [(name, x) for name, x in found if x.by_m > 0.0]


class Beyond(NamedTuple):
    """How far a volume is beyond a fence."""

    by_m: float
    place: Mapping[str, Any]  # edge and side; beside the path as `Fence.nearest` says it


class Room(NamedTuple):
    """Distances from a path within which a flight is certainly inside a fence.

    Arrays have the shape (windows, 2, 2): to the left and right, up and down.
    """

    limits: FloatArray  # m; -inf if the path is outside
    along: FloatArray  # where they are, m
    edges: npt.NDArray[np.str_]  # names of the fence's edges
    path: Route
    fence: Fence

    def nearest(self, away: FloatArray) -> dict[str, Any]:
        """Place of the smallest margin across the path, m, of flights at the distances `away`."""
        margins = self.limits - away
        i = int(np.argmin(margins))
        if math.isinf(margins.flat[i]):
            # Here the path itself is outside, so its margin counts from the nearest edge.
            path = self.fence.nearest(self.path)
            return {**path, "margin_m": path["margin_m"] - float(away.flat[i])}
        along = float(self.along.flat[i])
        return {
            "margin_m": float(margins.flat[i]),
            "side": SIDES[i % 4],
            "edge": str(self.edges.flat[i]),
            "along_m": along,
            "stretch": self.path.stretch_at(along).words,
        }


# Kinds of files that may have a fence, and kinds in which a mission file has its own fence.
KINDS = "a plan, waypoints or a fence of Mission Planner, KML or GeoJSON with a Polygon"
FENCE_FILES, OWN = (
    (".plan", ".json", ".geojson", ".kml", ".kmz", *maps.PLANNER),
    (".plan", *maps.PLANNER),
)

# PX4's number in MAVLink's list of firmwares.
PX4 = 12

# MAVLink's fence commands: polygons to stay in and out of, corner by corner, and circles.
CORNERS, CIRCLES = {5001: True, 5002: False}, {5003: True, 5004: False}


def own_fence(mission: Path) -> tuple[Path, ...]:
    """The mission file, if its kind has a fence beside the route."""
    return (mission,) if mission.suffix.lower() in OWN else ()


def fence_tables(files: Sequence[Path], *, asked: bool = False) -> dict[str, Any]:
    """The fences of plans, KML and GeoJSON files as one GeoJSON; {} without a fence.

    Flights must stay inside all areas, and outside all with the property ``exclusion``. Of the
    volumes of a mission the contingency volume is the fence. A file that is `asked` for its fence
    must have a fence.
    """
    shapes: list[Mapping[str, Any]] = []
    single: list[dict[str, Any]] = []
    for file in files:
        before = len(shapes)
        kind, content = maps.map_file(file, FENCE_FILES, KINDS)
        with maps.reading(file, KINDS):
            if kind == "kml":
                shapes += volumes.operational(maps.kml_features(content))
            elif kind == "planner":
                shapes += _of_plan(_planner_fence(content))
            elif kind == "plan":
                areas = [*_of_plan(maps.json_part(content, "geoFence", dict))]
                firmware = maps.json_part(content, "mission", dict).get("firmwareType")
                shapes += _one_area(areas) if firmware == PX4 else areas
            else:
                areas = maps.features(content)
                shapes += (kept := volumes.operational(areas))
                single += [content] * (kept is areas)
            if asked and not any(x["geometry"]["type"] == "Polygon" for x in shapes[before:]):
                raise InputError("must have a Polygon or circle for a fence, got none.")
    if len(files) == 1 and single:
        return single[0]
    polygons = [x for x in shapes if x["geometry"]["type"] == "Polygon"]
    return {"type": "FeatureCollection", "features": polygons} if polygons else {}


def _planner_fence(text: str) -> dict[str, list[dict[str, Any]]]:
    """Polygons and circles, as in a plan, of a Mission Planner file with items or corners."""
    lines = stated_lines(text)
    if not lines or not lines[0].startswith(HEADER.split()[0]):
        # The first line is the point to which a vehicle returns.
        corners = [[float(value) for value in line.split()] for line in lines[1:]]
        return {"polygons": [{"polygon": corners}], "circles": []}
    _, items = planner_items(text)
    shapes: dict[str, list[dict[str, Any]]] = {"polygons": [], "circles": []}
    rest = iter([(item["command"], item["params"]) for item in items])
    for command, (first, *_, lat, lon, _) in rest:
        if command in CIRCLES:
            circle = {"center": [lat, lon], "radius": first}
            shapes["circles"].append({"inclusion": CIRCLES[command], "circle": circle})
        elif command in CORNERS:
            others = islice(rest, max(int(first), 1) - 1)
            corners = [[lat, lon], *(params[4:6] for kind, params in others if kind == command)]
            if len(corners) != int(first):
                raise InputError(
                    f"a polygon must have its {int(first)} corners, got {len(corners)}."
                )
            shapes["polygons"].append({"inclusion": CORNERS[command], "polygon": corners})
    return shapes


def _of_plan(stated: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Polygons and circles of a plan of QGroundControl."""
    areas = [x for key in ("polygons", "circles") for x in maps.json_part(stated, key, list)]
    if corners := maps.json_part(stated, "polygon", list):  # version 1, of plans before 2018
        areas.append({"polygon": corners})
    if len(areas) > MAX_EDGES // 3:
        raise InputError(TOO_MANY_EDGES)
    for area in areas:
        inside = maps.json_bool(area.get("inclusion", True), "`inclusion`")
        if "circle" in area:
            lat, lon = (maps.json_number(x, "`center`") for x in area["circle"]["center"][:2])
            radius = maps.json_number(area["circle"]["radius"], "`radius`")
            if not (radius > 0.0 and abs(lat) <= 90.0):  # also catches NaN
                raise InputError(f"`radius` of a circle must be positive, got {radius:g} m.")
            corners = _circle((lat, lon), radius, outside=not inside)
        else:
            corners = [[point[1], point[0]] for point in area["polygon"]]
        if len(corners) > MAX_EDGES:
            raise InputError(TOO_MANY_EDGES)
        yield maps.feature("Polygon", [[*corners, *corners[:1]]], {"exclusion": not inside})


def _one_area(shapes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Shapes with the areas to stay in joined into one: PX4 stays inside at least one area."""
    stay = [x for x in shapes if not x["properties"]["exclusion"]]
    # Longitudes count from the first corner, since a route may cross the date line.
    first = stay[0]["geometry"]["coordinates"][0][0][0] if stay else 0.0
    areas = [
        shapely.Polygon([((lon - first + 180.0) % 360.0, lat) for lon, lat in ring])
        for ring in (x["geometry"]["coordinates"][0] for x in stay)
    ]
    if len(areas) < 2 or not all(area.is_valid for area in areas):  # the reader names the fault
        return shapes
    whole: Any = shapely.union_all(areas)
    if whole.geom_type != "Polygon":
        raise InputError(
            f"the {len(areas)} areas to stay in must overlap, got areas apart: PX4 stays inside at "
            "least one, and no flight gets from one to another. Delete those that the route misses."
        )
    rings = [
        [[(lon + first) % 360.0 - 180.0, lat] for lon, lat in ring.coords]
        for ring in (whole.exterior, *whole.interiors)
    ]
    others = [x for x in shapes if x["properties"]["exclusion"]]
    return [maps.feature("Polygon", rings, {"exclusion": False}), *others]


def _circle(centre: maps.LatLon, radius: float, *, outside: bool) -> list[list[float]]:
    """Longitudes and latitudes of the corners that replace a circle, deg, clockwise from north."""
    radius /= math.cos(math.pi / CIRCLE_CORNERS) if outside else 1.0
    angles = np.arange(CIRCLE_CORNERS) * (math.tau / CIRCLE_CORNERS)
    places = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return maps.on_earth(places, centre)[:, ::-1].tolist()


def circle_of(ring: list[list[float]], *, outside: bool) -> tuple[maps.LatLon, float] | None:
    """Centre (deg) and radius (m) of the circle that a closed ring replaces, if any."""
    if len(ring) != CIRCLE_CORNERS + 1:
        return None
    north, south = ring[0][1::-1], ring[CIRCLE_CORNERS // 2][1::-1]
    half = 0.5 * maps.north_east((north[0], north[1]), (south[0], south[1]))[0]
    lat, lon = maps.on_earth(np.array([[half, 0.0]]), (south[0], south[1]))[0].tolist()
    radius = round(half * (math.cos(math.pi / CIRCLE_CORNERS) if outside else 1.0), 3)
    if radius <= 0.0:
        return None
    made = np.array(_circle((lat, lon), radius, outside=outside))
    same = np.abs(made - np.array([corner[:2] for corner in ring[:-1]])).max() < SAME_CORNER_DEG
    return ((lat, lon), radius) if same else None


def read_fence(path: Path, origin: maps.LatLon, tables: Any = None) -> Fence:
    """The fence of a file, about the start of a flight at `origin`.

    The file has Polygons in longitude and latitude. Inner rings, and Polygons with the property
    ``exclusion``, are zones not to enter. The properties ``min_up_m`` and ``max_up_m`` of a feature
    are heights above the start. `tables`: the content in GeoJSON, if it has been read.
    """
    tables = tables or fence_tables([path])
    low, high = FAR
    # Edges are straight in longitude and latitude, the shorter way round the Earth.
    rings, sags = [], []
    names: list[str] = []
    out: list[bool] = []
    numbers = {True: 0, False: 0}
    with maps.reading(path, KINDS):
        shapes = [
            x
            for x in (maps.features(tables) if tables else ())
            if x["geometry"]["type"] == "Polygon"
        ]
        if not shapes:
            raise InputError("must have a Polygon for a fence, got none.")
        for shape in shapes:
            stated = maps.json_part(shape, "properties", dict)
            low, high = _heights(stated, low, high)
            outside = maps.json_bool(stated.get("exclusion", False), "`exclusion`")
            numbers[outside] += 1
            area = "exclusion" if outside else "area"
            kind = f" of {area} {numbers[outside]}" * (len(shapes) > 1)
            first = len(rings)
            drawn: list[FloatArray] = []
            edges: list[str] = []  # edges between corners: the message names these
            for zone, points in enumerate(shape["geometry"]["coordinates"]):
                drawn.append(_ring(points, origin))
                ring, sag, corners = _edges(drawn[-1], origin, MAX_EDGES - len(names))
                part = f" of zone {zone}" if zone else ""
                edges += [f"edge {i + 1}{part}{kind}" for i in range(len(drawn[-1]))]
                names += [f"edge {i + 1}{part}{kind}" for i in corners]
                out.append(outside or zone > 0)
                rings.append(ring)
                sags.append(sag)
            lines = np.concatenate([*map(_lines, drawn)])
            for i, j in np.argwhere(shapely.crosses(lines[:, None], lines))[:1]:
                raise InputError(f"the edges must not cross, got {edges[i]} and {edges[j]}.")
            if _starts_wrong(rings[first:], outside=outside):
                raise InputError(
                    f"the start must be {'out' if outside else 'in'}side{kind or f' of the {area}'}"
                    f", got one at {origin} deg.{ALL_AREAS * (bool(kind) and not outside)}"
                )
    return Fence(
        rings=tuple(rings),
        outside=tuple(out),
        sag=np.concatenate(sags),
        names=(*names, "ceiling", "floor"),
        low=low,
        high=high,
    )


def _starts_wrong(rings: Sequence[FloatArray], *, outside: bool) -> bool:
    """Whether a flight would start outside an area to stay in, or in one of its zones."""
    start = shapely.Point(0.0, 0.0)
    area, *zones = (bool(shapely.Polygon(ring).contains(start)) for ring in rings)
    return area == outside or any(zones)


def _lines(ring: FloatArray) -> npt.NDArray[Any]:
    """The edges of a ring as lines, which may meet in corners."""
    return np.asarray(shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)))


def _heights(stated: Mapping[str, Any], low: float, high: float) -> tuple[float, float]:
    """Floor and ceiling, narrowed by the properties of a feature."""
    if unknown := [key for key in stated if key not in KNOWN and key.lower() not in OF_OTHERS]:
        raise InputError(f"`properties` may be {', '.join(KNOWN)}, got {abridged(unknown[0])}.")
    floor, ceiling = (
        maps.json_number(stated[key], f"`{key}`") if key in stated else far
        for key, far in zip(HEIGHTS, FAR, strict=True)
    )
    if stated.get("exclusion") and (floor, ceiling) != FAR:
        raise InputError("`min_up_m` and `max_up_m` must be absent of an area to stay out of.")
    if not (floor <= 0.0 <= ceiling and floor < ceiling):  # also catches NaN
        raise InputError(
            "`min_up_m` must be at most 0, the height of the start, and `max_up_m` at least 0 "
            f"and higher, got {floor:g} and {ceiling:g}."
        )
    return max(low, floor), min(high, ceiling)


def _edges(
    ring: FloatArray, origin: maps.LatLon, most: int
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.intp]]:
    """Edges of a ring, straight in m; at most `most`.

    Returns the beginning of each edge, north and east (n, 2), m, its sag, m, and the number of its
    corner. `ring`: latitudes and longitudes of the corners, deg.
    """
    if len(ring) > most:
        raise InputError(TOO_MANY_EDGES)
    middle, corners = 0.5 * (ring + np.roll(ring, -1, axis=0)), _north_east(ring, origin)
    straight = 0.5 * (corners + np.roll(corners, -1, axis=0))
    sag = np.hypot(*(_north_east(middle, origin) - straight).T)
    # The sag falls with the square of the length.
    parts = np.ceil(np.sqrt(sag / MAX_SAG)).clip(min=1.0).astype(int)
    if parts.sum() > most:
        raise InputError(TOO_MANY_EDGES)
    numbers = np.repeat(np.arange(len(ring)), parts)
    share = np.concatenate([np.arange(n) / n for n in parts])[:, None]
    placed = (1.0 - share) * ring[numbers] + share * np.roll(ring, -1, axis=0)[numbers]
    return _north_east(placed, origin), (sag / parts**2)[numbers], numbers


def _north_east(places: FloatArray, origin: maps.LatLon) -> FloatArray:
    return np.array([maps.north_east((lat, lon), origin) for lat, lon in places.tolist()])


def _ring(points: Iterable[Any], origin: maps.LatLon) -> FloatArray:
    """Latitude and longitude of the corners of a ring, deg, each once, near a place."""
    corners = [[maps.json_number(point[i], "every coordinate") for i in (1, 0)] for point in points]
    ring = np.array(corners).reshape(-1, 2)
    wrong = ~(np.abs(ring) <= (85.0, 180.0)).all(axis=1)  # also catches NaN
    if wrong.any():
        raise InputError(
            "`coordinates` must be longitudes up to 180 and latitudes up to 85 deg, got {1:g} and "
            "{0:g}.".format(*ring[wrong][0])
        )
    ring = ring[(ring != np.roll(ring, -1, axis=0)).any(axis=1)]
    if len(ring) < 3:
        raise InputError(f"a polygon must have at least three corners, got {len(ring)}.")
    turned = (ring[:, 1] - origin[1] + 180.0) % 360.0 - 180.0
    return np.column_stack([ring[:, 0], turned + origin[1]])


def room_along(
    fence: Fence, path: Route, windows: FloatArray, *, widest: float, overlap: float
) -> Room:
    """Distance from a path up to which flights are certainly inside a fence.

    `windows` (shape (windows + 1,), m) are edges of windows of distance along the path. `widest` is
    the largest distance to the side of the judged flights. `overlap` (m) extends the path of a
    window beyond both edges.
    """
    s = SCAN_STEP * np.arange(int((path.length + overlap) / SCAN_STEP) + 2, dtype=np.float64)
    north, east, up, course = path.at(s)
    # Let e be a distance to the right of the path and k its largest curvature. Then a place is at
    # most ``SCAN_STEP / 2 (1 + k e)`` from the place with the same e at the nearest point of the
    # table. Edges are therefore widened by this at ``e = widest``. If the line across the path at
    # each point meets no widened edge up to the distance of the flights, then the surface that
    # these lines sweep meets no edge, and it lies inside like the start.
    wide = 0.5 * SCAN_STEP * (1.0 + np.abs(path.curvature).max() * widest)
    steep = 0.5 * SCAN_STEP * np.abs(path.slope).max()
    free = np.full((len(s), 2, 2), np.inf)
    free[:, 1] = np.column_stack([fence.high - up, up - fence.low]) - steep
    edges = np.zeros(free.shape, dtype=np.intp) + len(fence.start) + np.arange(2)
    places, aside = np.stack([[north, east], [-np.sin(course), np.cos(course)]]).swapaxes(1, 2)
    for edge, ends in enumerate(zip(fence.start, fence.end, strict=True)):
        low, high = _met(places, aside, *ends, wide + fence.sag[edge])
        for side, (near, far) in enumerate(((-high, -low), (low, high))):
            nearest = np.where(near > 0.0, near, -np.inf)
            nearer = (low <= high) & (far >= 0.0) & (nearest < free[:, 0, side])
            free[nearer, 0, side], edges[nearer, 0, side] = nearest[nearer], edge
    first = np.floor((windows[:-1] - overlap) / SCAN_STEP).clip(min=0.0).astype(int)
    last = np.ceil((windows[1:] + overlap) / SCAN_STEP).astype(int) + 1
    tightest = np.array([i + free[i:j].argmin(axis=0) for i, j in zip(first, last, strict=True)])
    limits, edge = (np.take_along_axis(values, tightest, axis=0) for values in (free, edges))
    along = np.minimum(s[tightest], path.length)
    return Room(limits, along, np.array(fence.names)[edge], path, fence)


def _met(
    places: FloatArray, aside: FloatArray, start: FloatArray, end: FloatArray, wide: float
) -> tuple[FloatArray, FloatArray]:
    """Interval of each line through `places` in the widened edge, m; low > high if it misses."""
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    low, high = np.full(len(places), -np.inf), np.full(len(places), np.inf)
    for axis, half in ((along, 0.5 * length + wide), (along[::-1] * (-1.0, 1.0), wide)):
        offset, speed = (places - 0.5 * (start + end)) @ axis, aside @ axis
        speed[np.abs(speed) < TINY] = TINY
        ends = (-half - offset) / speed, (half - offset) / speed
        low, high = np.maximum(low, np.minimum(*ends)), np.minimum(high, np.maximum(*ends))
    return low, high
