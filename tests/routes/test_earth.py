"""Places on Earth against a published baseline and against coordinates fixed to the Earth."""

import math

import numpy as np
import pytest

from flighttune.routes import maps

DEG = math.pi / 180.0
WGS_84 = 6_378_137.0, 1.0 / 298.257223563  # NIMA TR8350.2: semi-major axis, m, and flattening


def degrees(d, m, s):
    return d + m / 60.0 + s / 3600.0


def test_a_published_baseline_has_its_length_and_azimuth():
    """Flinders Peak to Buninyong, GDA Technical Manual: 54 972.271 m at 306 deg 52' 05.37"."""
    flinders = -degrees(37, 57, 3.72030), degrees(144, 25, 29.52440)
    buninyong = -degrees(37, 39, 10.15610), degrees(143, 55, 35.38390)
    north, east = maps.north_east(buninyong, flinders)

    assert math.hypot(north, east) == pytest.approx(54_972.271, abs=2e-3)
    azimuth = math.atan2(east, north) / DEG % 360.0
    assert azimuth == pytest.approx(degrees(306, 52, 5.37), abs=0.01 / 3600.0)


def fixed_to_earth(lat, lon):
    """Cartesian coordinates of a place on the ellipsoid, m."""
    a, f = WGS_84
    e_2, lat, lon = f * (2.0 - f), lat * DEG, lon * DEG
    across = a / math.sqrt(1.0 - e_2 * math.sin(lat) ** 2)
    c, s = math.cos(lat), math.sin(lat)
    return across * np.array([c * math.cos(lon), c * math.sin(lon), (1.0 - e_2) * s])


@pytest.mark.parametrize("lat_0", [0.0, -30.0, 47.0, 60.0, 80.0, 84.9])
@pytest.mark.parametrize("lon_0", [8.0, 179.99, -179.95])
@pytest.mark.parametrize("azimuth", [20.0, 90.0, 200.0, 300.0])
def test_places_within_20_km_are_right_to_10_cm(lat_0, lon_0, azimuth):
    """A chord projected onto the horizon of the start, as long as an arc of the same chord."""
    points = 20_000.0 * np.array([[math.cos(azimuth * DEG), math.sin(azimuth * DEG)]])
    ((lat, lon),) = maps.on_earth(points, (lat_0, lon_0))
    chord = fixed_to_earth(lat, lon) - fixed_to_earth(lat_0, lon_0)
    c, s, c_lon, s_lon = (f(x * DEG) for x in (lat_0, lon_0) for f in (math.cos, math.sin))
    to_north = chord @ (-s * c_lon, -s * s_lon, c)
    to_east = chord @ (-s_lon, c_lon, 0.0)
    length = np.linalg.norm(chord)
    arc = length * (1.0 + (length / WGS_84[0]) ** 2 / 24.0)
    expected = np.array([to_north, to_east]) * arc / math.hypot(to_north, to_east)

    assert -180.0 <= lon <= 180.0
    assert points[0] == pytest.approx(expected, abs=0.1)
    for turns in (-360.0, 0.0, 360.0):
        there = maps.north_east((lat, lon + turns), (lat_0, lon_0))
        assert there == pytest.approx(tuple(expected), abs=0.1)
