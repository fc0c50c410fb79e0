"""Areas of a fence with as few vertices as vehicles take, that hold what they must hold."""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from flighttune.references.fence import circle_of
from flighttune.references.maps import LatLon, north_east, on_earth
from flighttune.references.path import Path as Route

# A closed ring of longitudes and latitudes, deg, and whether it is to stay out of.
Area: TypeAlias = tuple[list[list[float]], bool]

# Vertices of a fence that every vehicle takes, each circle as one.
MOST, VEHICLES = 64, "PX4 takes at most 64 and ArduPilot 70"

# Sizes of the details that are left out, m; the first is the rounding of places in a file.
SIZES = (0.01, *np.geomspace(0.1, 2000.0, 40).tolist())

# Steps in which the distance between two areas is found.
HALVINGS = 14


def fewer_vertices(
    areas: Sequence[Area], windows: Sequence[list[list[float]]], path: Route, origin: LatLon
) -> tuple[list[Area], str]:
    """Areas that hold the windows of a corridor, or a path, with at most `MOST` vertices.

    The corridor takes the place of the areas to stay in, and is cut off at those that hold it.
    Circles stay circles. Areas to stay in become smaller, those to stay out of larger. The sentence
    has the distance that this costs; it is empty where nothing changes.
    """
    import shapely

    circles = [
        area for area in areas if circle_of(area[0], outside=area[1]) and (area[1] or not windows)
    ]
    polygons = [area for area in areas if area not in circles]
    room = MOST - len(circles)
    if not windows and sum(len(ring) - 1 for ring, _ in polygons) <= room:
        return [*areas], ""
    core: Any = shapely.LineString(path.beside(path.points(10.0))[:, :2])
    if windows:
        core = shapely.union_all([_polygon(ring, origin) for ring in windows])
    stated = [(_polygon(*area[:1], origin), area[1]) for area in polygons]
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
        fits = sum(len(ring) - 1 for ring, _ in rings) <= room and all(
            shape.geom_type == "Polygon" and (out or shape.covers(core)) for shape, out in shapes
        )
        apart = all(x[0].disjoint(core) for x, free in zip(kept, clear, strict=True) if free)
        if fits and apart:
            break
    else:
        rings = [*((ring, False) for ring in windows), *((*zone,) for zone in polygons)]
        count = len(circles) + sum(len(ring) - 1 for ring, _ in rings)
        return [*rings, *circles], f"has {count} vertices and circles, of which {VEHICLES}"
    pairs = [(core, wide[0][0])] if windows else []
    pairs += [(a, b) if out else (b, a) for (a, out), (b, _) in zip(zones, kept, strict=True)]
    lost = max(_beyond(*pair) for pair in pairs)
    count = len(circles) + sum(len(ring) - 1 for ring, _ in rings)
    cost = "goes up to {:.1f} m beyond the corridor" if windows else "is up to {:.1f} m narrower"
    said = f"has {count} vertices and circles, as {VEHICLES}, and {cost.format(lost)}"
    return [*rings, *circles], said


def _polygon(ring: list[list[float]], origin: LatLon) -> Any:
    """A closed ring as a polygon north and east of a place, m."""
    import shapely

    return shapely.Polygon([north_east((lat, lon), origin) for lon, lat, *_ in ring]).buffer(0.0)


def _rings(shape: Any, outside: bool, origin: LatLon) -> list[Area]:
    """The rings of a polygon, whose holes are areas to stay out of."""
    parts = [] if shape.is_empty else getattr(shape, "geoms", [shape])
    return [
        (on_earth(np.array(ring.coords), origin)[:, ::-1].round(8).tolist(), outside or number > 0)
        for part in parts
        for number, ring in enumerate([part.exterior, *part.interiors])
    ]


def _changed(area: Any, outside: bool, size: float) -> Any:
    """An area without its details of a size: larger if it is to stay out of, else smaller."""
    return area.buffer(size if outside else -size, join_style="mitre").simplify(size)


def _beyond(inner: Any, outer: Any) -> float:
    """How far the places of an area are from another one, at most, m."""
    low, high = 0.0, math.dist(*np.reshape(outer.bounds, (2, 2)))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if inner.buffer(middle).covers(outer) else (middle, high)
    return high
