"""Latitude and longitude to north and east of a start and back, along geodesics of WGS 84."""

import math
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from geographiclib.geodesic import Geodesic

from flighttune.arrays import FloatArray
from flighttune.units import DEG

# Latitude and longitude, deg.
LatLon: TypeAlias = tuple[float, float]


@lru_cache(maxsize=4096)  # the flights of a campaign have the same waypoints
def north_east(place: LatLon, origin: LatLon) -> tuple[float, float]:
    """North and east, m, of a place: its distance from `origin` along a geodesic, and its azimuth.

    Longitudes count modulo 360.
    """
    wanted = Geodesic.DISTANCE | Geodesic.AZIMUTH
    line = Geodesic.WGS84.Inverse(*origin, *place, wanted)
    distance, azimuth = line["s12"], line["azi1"] * DEG
    return distance * math.cos(azimuth), distance * math.sin(azimuth)


def on_earth(points: FloatArray, origin: LatLon) -> FloatArray:
    """Latitude and longitude, deg, of points north and east of `origin`, m; shape (n, 2)."""
    lines = (
        Geodesic.WGS84.Direct(*origin, math.atan2(east, north) / DEG, math.hypot(north, east))
        for north, east, *_ in points.tolist()
    )
    return np.array([(line["lat2"], line["lon2"]) for line in lines])
