"""Plans of QGroundControl, terrains, and routes through points, to be planned."""

import json
import math
from typing import NamedTuple

import numpy as np
from geographiclib.geodesic import Geodesic

import flighttune as ft

HOME = (47.4, 8.5, 480.0)


def item(command, *params, frame=3):
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def waypoint(lat, lon, height, frame=3):
    return item(16, 0, 0, 0, None, lat, lon, height, frame=frame)


def plan_file(path, *items, home=HOME, **tables):
    mission = {"plannedHomePosition": home and list(home), "items": list(items)}
    path.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission, **tables}))
    return path


PATROL = (
    waypoint(47.4, 8.5, 60),
    waypoint(47.41, 8.5, 60),
    item(18, 2, 0, -180, 1, 47.41, 8.52, 90),
    waypoint(47.4, 8.52, 570, frame=0),
)

# Slope of the ground to the north, m for a degree of latitude, which interpolation has exactly.
SLOPE = 5000.0


def ground(lat):
    return HOME[2] + SLOPE * (lat - HOME[0])


def terrain(path, *, lost=None, value=-9999.0, units=None, **profile):
    """A plane that rises to the north, with posts every 0.001 deg; `lost` has no height, or one."""
    import rasterio  # an extra

    north, west, step, size = 47.43, 8.48, 0.001, (50, 60)
    heights = np.tile(ground(north - step * (np.arange(size[0])[:, None] + 0.5)), (1, size[1]))
    if lost is not None:
        heights[lost] = value
    made = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": "EPSG:4326", "nodata": -9999}
    made |= {"height": size[0], "width": size[1], **profile}
    made["transform"] = rasterio.Affine(step, 0.0, west, 0.0, -step, north)
    with rasterio.open(path, "w", **made) as file:
        file.write(heights, 1)
        file.units = (units,) * file.count
    return path


class Waypoint(NamedTuple):
    """A point of a route in m and rad, from its start."""

    north: float
    east: float
    up: float = 0.0
    turns: float = 0.0
    radius: float | None = None
    climb: float | None = None
    hold: float = 0.0
    spiral: bool = False
    name: str = ""
    V: float | None = None

    @property
    def keys(self):
        """It as a table of [[route.waypoint]]."""
        stated = {"north_m": self.north, "east_m": self.east, "up_m": self.up, "turns": self.turns}
        stated |= {"radius_m": self.radius, "hold_s": self.hold, "spiral": self.spiral}
        climb = None if self.climb is None else math.degrees(self.climb)
        stated |= {"climb_deg": climb, "name": self.name, "V_mps": self.V}
        return {key: x for key, x in stated.items() if x is not None and x is not False and x != ""}


ABILITY = {
    "V_a": 25.0, "wind": 8.0, "phi": math.radians(36.0), "phi_rate": math.radians(24.0),
    "gamma": (math.radians(-10.0), math.radians(10.0)), "turnaround": 0.0, "duration": 10_000.0,
}  # fmt: skip
AROUND = ABILITY | {"turnaround": 1e5}


def route_of(points, able=ABILITY, **route):
    """The planned route of a law through points, for speed and limits in m/s and rad."""
    tables = ft.load_scenario("circuit").as_dict()
    for key in ("expect", "verifies", "source"):
        del tables[key]
    tables["plant"] = [{"kind": "kinematic"}]
    tables["flight"] |= {"V_a_mps": able["V_a"], "duration_s": able["duration"]}
    roll, rate = (math.degrees(able[key]) / 0.8 for key in ("phi", "phi_rate"))
    tables["limits"] |= {"phi_deg": [-roll, roll], "phi_rate_dps": rate}
    tables["route"] = {
        "waypoint": [point.keys for point in points],
        "wind_mps": able["wind"],
        "gamma_deg": [math.degrees(x) for x in able["gamma"]],
        "turnaround_m": able["turnaround"],
        "widen": able.get("widen", False),
    } | route
    if route.get("holds_airspeed"):
        tables["limits"] |= {"n_x": [-0.3, 0.3], "n_x_rate_per_s": 1.0}
    return ft.route(ft.scenario_from(tables))


def plan(points, able=ABILITY, **route):
    """The path of such a route."""
    return route_of(points, able, **route).reference.path


def metres(lat, lon, origin=HOME):
    """North and east of a place, m, by distance and azimuth of its geodesic."""
    line = Geodesic.WGS84.Inverse(*origin[:2], lat, lon)
    azimuth = math.radians(line["azi1"])
    return line["s12"] * math.cos(azimuth), line["s12"] * math.sin(azimuth)
