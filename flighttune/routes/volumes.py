"""Volumes around a path, with heights over ground: GeoJSON and KML of them, and their fence."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shapely import LineString

from flighttune.base.arrays import FloatArray
from flighttune.base.files.xml import node
from flighttune.routes import maps
from flighttune.routes.path import Path as Route

# The volumes of a mission, from inside out.
NAMES = GEOGRAPHY, CONTINGENCY, BUFFER = (
    "flight geography", "contingency volume", "ground risk buffer",
)  # fmt: skip

# Colours in KML of lines and areas, as opacity, blue, green, red: those of the map of a page.
STYLES = {
    "path": maps.STYLES["path"],
    "flight-geography": ("ff73790b", "5973790b"),
    "contingency-volume": ("ff0077c7", "330077c7"),
    "ground-risk-buffer": ("ffa32a9e", "1fa32a9e"),
}

# Corners in a quarter of the round end of an area.
CORNERS = 16


class Volume(NamedTuple):
    """All places within a width of a path, between two heights over ground, in m."""

    width: float  # to each side, and around both ends
    low: float
    high: float
    claim: str  # in words

    @property
    def outwards(self) -> "Volume":
        """The volume with its sizes rounded outwards to decimetres, as it is written."""
        width, high = (math.ceil(10.0 * size) / 10.0 for size in (self.width, self.high))
        return self._replace(width=width, low=math.floor(10.0 * self.low) / 10.0, high=high)

    @property
    def sizes(self) -> dict[str, float]:
        """Width and heights by the keys of a file."""
        low, high = self.low, self.high
        return {"width_m": self.width, "min_over_ground_m": low, "max_over_ground_m": high}


class VolumesMap(NamedTuple):
    """The volumes around a path by name, to write."""

    where: maps.Where
    ground: float  # height of the ground above sea level, m
    volumes: Mapping[str, Volume]

    def geojson(self) -> str:
        """The volumes as areas with their sizes, rounded outwards.

        ``min_up_m`` and ``max_up_m`` are heights above the start, as in a fence.
        """
        start, shapes = self.where[2] - self.ground, []
        for name, volume in self._written.items():
            ends = {"min_up_m": volume.low - start, "max_up_m": volume.high - start}
            sizes = {**volume.sizes, **{key: round(end, 2) for key, end in ends.items()}}
            rings = [ring.tolist() for ring in self._rings(volume)]
            stated = {"name": name, **sizes, "claim": volume.claim}
            shapes.append(maps.feature("Polygon", rings, stated))
        return json.dumps({"type": "FeatureCollection", "features": shapes}, indent=1) + "\n"

    def kml(self, title: str) -> str:
        """The path and the volumes, the widest first, at heights above sea level.

        Each volume has its floor and ceiling; the ground risk buffer lies on the ground.
        """
        (line,) = maps.coordinates(self.where, self.where[0].points(maps.APART), 0.0, 0.0)
        marks = []
        for name, volume in reversed(self._written.items()):
            said = f"Within {volume.width:g} m of the path, {volume.low:g} to {volume.high:g} m "
            data = [node("Data", node("value", f"{x:g}"), name=k) for k, x in volume.sizes.items()]
            rings = self._rings(volume)
            shape = maps.kml_area(rings, "clampToGround")
            if name != BUFFER:
                floor, ceiling = (
                    maps.kml_area([np.column_stack([x, np.full(len(x), up)]) for x in rings])
                    for up in (self.ground + volume.low, self.ground + volume.high)
                )
                shape = node("MultiGeometry", floor, ceiling)
            claim = f"{said}over ground: {volume.claim}."
            sizes = node("ExtendedData", *data)
            style = name.replace(" ", "-")
            marks.append(maps.placemark(name, style, sizes, shape, description=claim))
        marks.append(maps.placemark(title, "path", maps.kml_shape(line, "LineString")))
        return maps.kml_text(STYLES, marks)

    @property
    def _written(self) -> dict[str, Volume]:
        return {name: volume.outwards for name, volume in self.volumes.items()}

    def _rings(self, volume: Volume) -> list[FloatArray]:
        """Rings of longitudes and latitudes, deg."""
        path, origin, _ = self.where
        rings = rings_around(path, volume.width)
        return [maps.on_earth(ring, origin)[:, ::-1].round(8) for ring in rings]


def rings_around(path: Route, width: float) -> list[FloatArray]:
    """Rings of the area within `width` (m) of a path, outer ring first: north, east, (n, 2)."""
    line = LineString(path.beside(path.points(maps.APART))[:, :2])
    area = line.buffer(reach(path, width), quad_segs=CORNERS)
    return [np.array(ring.coords) for ring in (area.exterior, *area.interiors)]


def reach(path: Route, width: float) -> float:
    """Distance from a path, m, up to which the drawn rings around its `width` may go."""
    off_path = np.abs(path.curvature).max() * maps.APART**2 / 8.0  # distance of a chord, m
    # The corners lie outside the circle, so that the ring contains all places within the width.
    return float((width + off_path) / math.cos(math.pi / (4 * CORNERS)))


def are_in(file: Path) -> bool:
    """Whether a file was written from a `VolumesMap`."""
    return '"max_over_ground_m"' in file.read_text(encoding="utf-8", errors="replace")


def operational(shapes: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """The shapes of a fence; of the volumes of a mission the contingency volume alone."""
    stated = [maps.json_part(shape, "properties", dict) for shape in shapes]
    names = [own.get("name") for own in stated]
    if not {*NAMES} <= {x for x in names if isinstance(x, str)}:
        return shapes
    i = names.index(CONTINGENCY)  # in KML its floor and its ceiling have the same rings
    kept = {key: x for key, x in stated[i].items() if key in ("name", "min_up_m", "max_up_m")}
    return [maps.feature("Polygon", shapes[i]["geometry"]["coordinates"], kept)]
