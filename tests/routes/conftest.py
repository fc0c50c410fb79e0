"""A band of flights along a leg, which several files of this room draw, count and look at."""

import pytest

import flighttune as ft

LEG = {
    "route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 150.0)],
    "route.lat_deg": 47.4,
    "route.lon_deg": 8.5,
    "flight.duration_s": 8.0,
}
FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}


@pytest.fixture(scope="session")
def band():
    """Seven flights of a leg of 150 m to the north, none of which strays by more than metres."""
    return ft.band(ft.flights("circuit", changes=LEG).starting(2.0), plant="kinematic", **FEW)


@pytest.fixture(scope="session")
def band_file(band, tmp_path_factory):
    path = tmp_path_factory.mktemp("band") / "b.npz"
    band.save(path)
    return path
