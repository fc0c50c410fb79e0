"""Room to turn back: flights that turn back at any place of a route, and the volumes around it."""

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from plans import plan_file, waypoint

import flighttune as ft


@pytest.fixture(scope="module")
def steep(tmp_path_factory):
    """A leg down by 6 deg, on which the Aerosonde gets faster at a closed throttle."""
    up = np.tan(np.deg2rad(6.0)) * 900.0
    legs = [(0.0, up), (200.0, up), (1100.0, 0.0), (1300.0, 0.0)]
    north = (Geodesic.WGS84.Direct(47.4, 8.5, 0.0, s)["lat2"] for s, _ in legs)
    rows = [waypoint(lat, 8.5, 80.0 + h) for lat, (_, h) in zip(north, legs, strict=True)]
    return plan_file(tmp_path_factory.mktemp("steep") / "down.plan", *rows)


@pytest.mark.parametrize(
    ("source", "turn_back", "says"),
    [
        ("circuit", "spiral:30", "`turn_back` must be a bank in deg, or circle:BANK"),
        ("circuit", 70, "`turn_back` must be a bank of 1 to 45 deg, got 70"),
        ("mission", 30, "`route` must be given"),
    ],
)
def test_what_cannot_turn_back_is_refused_in_one_line(source, turn_back, says):
    with pytest.raises(ft.InputError, match=says) as refusal:
        ft.mission(source, turn_back=turn_back)
    assert "\n" not in str(refusal.value)
