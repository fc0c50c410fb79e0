"""A planned path as a plan of QGroundControl, with its turns as they are flown."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from flighttune.references.earth import on_earth
from flighttune.references.fence import circle_of
from flighttune.references.items import SPEED, TAKEOFF, TURNS, WAYPOINT
from flighttune.references.maps import ROUTE_KEY, Corridor, Marks, Where, corridor_rings, with_hash
from flighttune.references.path import Stretch
from flighttune.units import DEG

# Largest change of course between two waypoints of a turn-around, rad: autopilots pass them inside.
APART = 45.0 * DEG

# Frames of heights above the home position, and of commands without a place.
ABOVE_HOME, NO_FRAME = 3, 2


def route_plan(
    where: Where,
    marks: Marks,
    V_a: float,
    ground: float,
    corridor: Corridor | None = None,
    stated: Mapping[str, Any] | None = None,
) -> str:
    """A plan of the path at the airspeed `V_a` (m/s) from a home position at `ground` (m).

    Circles have the radius and the turns that are planned, and turn-arounds are waypoints along
    their path. The corridor is areas to stay in, window by window, in place of those of the fence.
    flighttune reads the file as what is `stated`.
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
    inside = list(corridor_rings(where, corridor))
    kept = [(ring, exclusion) for ring, exclusion in marks.areas if exclusion or not inside]
    areas = [_area(*area) for area in (*((ring, False) for ring in inside), *kept)]
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


def fence_size(text: str) -> int:
    """Vertices and circles of the fence of a plan."""
    fence = json.loads(text)["geoFence"]
    return len(fence["circles"]) + sum(len(area["polygon"]) for area in fence["polygons"])


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
