"""Routes that are left to turn back, circle or glide, against closed forms."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.routes.ending_keys import BACK_S, CIRCLES
from flighttune.routes.path import STEP

# The table of a path has a point each metre, and its end lies between two points.
ONE_POINT = STEP

# Rounding of angles and distances that are integrated over some km in steps of 1/8 m.
INTEGRATED = 1e-3


def ended(kind, at_m, side=1):
    waypoints = [(0.0, 0.0), (2000.0, 0.0), (2000.0, 2000.0)]
    changes = {
        "route.waypoint": [{"north_m": n, "east_m": e} for n, e in waypoints],
        "route.ending": {"kind": kind, "side": side, "at_m": at_m},
    }
    return ft.route("circuit", changes=changes)


def smallest_radius(planned):
    """Radius of a level turn at the largest planned roll, with the wind of the plan behind."""
    return min(x["radius_m"] for x in planned.stretches if x["radius_m"])


@pytest.fixture(scope="module")
def whole():
    waypoints = [(0.0, 0.0), (2000.0, 0.0), (2000.0, 2000.0)]
    changes = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in waypoints]}
    return ft.route("circuit", changes=changes)


@pytest.mark.parametrize("kind", ["turn_back", "circle", "straight"])
@pytest.mark.parametrize("at_m", [700.0, 1900.0])  # on a leg, and in a turn
def test_the_route_is_unchanged_up_to_its_end_and_goes_on_without_a_jump(whole, kind, at_m):
    path = ended(kind, at_m).reference.path
    i = int(at_m / STEP)
    for name in ("north", "east", "up", "course", "curvature", "slope"):
        before, after = getattr(whole.reference.path, name)[:i], getattr(path, name)
        assert after[:i].tolist() == before.tolist()
    steps = np.hypot(np.diff(path.north), np.diff(path.east))
    assert steps == pytest.approx(STEP, rel=INTEGRATED)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_flight_turns_back_by_half_a_turn_and_flies_straight(whole, side):
    path = ended("turn_back", 700.0, side).reference.path
    last = math.floor(path.length)
    assert path.course[last] == pytest.approx(side * math.pi, abs=INTEGRATED)
    straight = (whole.reference.V_a + whole.wind) * BACK_S
    assert np.abs(path.curvature[last - int(straight) + 1 : last]).max() == 0.0
    # It is then beside the route by about two radii.
    assert side * path.east[last] > 2.0 * smallest_radius(whole)


def test_a_flight_circles_with_the_radius_of_the_turns_of_its_route(whole):
    path = ended("circle", 700.0).reference.path
    radius = smallest_radius(whole)
    assert 1.0 / path.curvature.max() == pytest.approx(radius, rel=INTEGRATED)
    round_again = CIRCLES * math.tau * radius
    rolled_in = path.length - round_again
    points = np.arange(math.ceil(rolled_in), math.floor(path.length))
    north, east = path.north[points], path.east[points]
    across = np.hypot(north - north.mean(), east - east.mean())
    assert across == pytest.approx(radius, abs=ONE_POINT)


def test_a_flight_that_glides_goes_straight_on_from_a_turn(whole):
    path = ended("straight", 1900.0).reference.path
    beyond = path.course[2100:]
    assert np.ptp(beyond) == pytest.approx(0.0, abs=INTEGRATED)
    assert path.course[1900] != pytest.approx(whole.reference.path.course[1500], abs=0.01)
