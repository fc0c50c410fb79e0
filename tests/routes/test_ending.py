"""Routes that are left to turn back, circle or glide, against closed forms."""

import math

import numpy as np
import pytest
from plans import item, plan_file, waypoint

import flighttune as ft

# The table of a path has a point each metre, and its end lies between two points.
ONE_POINT = STEP = 1.0

CIRCLES = 2.0

# Rounding of angles and distances that are integrated over some km in steps of 1/8 m.
INTEGRATED = 1e-3


GLIDE = {"kind": "straight", "side": 1, "at_m": 700.0}
CORNER = (0.0, 0.0), (2000.0, 0.0), (2000.0, 2000.0)


def flown(waypoints=CORNER, **ending):
    changes = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in waypoints], **ending}
    return ft.route("circuit", changes=changes)


def ended(kind, at_m, side=1, waypoints=CORNER):
    ending = {"kind": kind, "side": side, "at_m": at_m}
    return flown(waypoints, **{"route.ending": ending})


def smallest_radius(planned):
    """Radius of a level turn at the largest planned roll, with the wind of the plan behind."""
    return min(x["radius_m"] for x in planned.stretches if x["radius_m"])


@pytest.fixture(scope="module")
def whole():
    return flown()


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
@pytest.mark.parametrize("at_m", [700.0, 1900.0, 3500.0])  # on both legs, and in the turn
def test_a_flight_that_turns_back_goes_straight_to_the_start_of_its_route(whole, side, at_m):
    path = ended("turn_back", at_m, side).reference.path
    last = math.floor(path.length)
    assert np.hypot(path.north[last], path.east[last]) <= 1.5 * ONE_POINT
    turning = np.flatnonzero(path.curvature[int(at_m) :])
    out = int(at_m) + turning[-1] + 2
    assert (side * path.curvature[out - 20 : out - 2] >= 0.0).all()
    # From the roll-out on it flies on the bearing of the start, and it has turned to one side.
    bearing = np.arctan2(-path.east[out], -path.north[out])
    assert math.cos(path.course[out] - bearing) == pytest.approx(1.0, abs=INTEGRATED**2)
    turned = side * (path.course[last] - path.course[int(at_m)])
    assert 0.0 < turned < math.tau
    assert np.abs(path.curvature).max() == pytest.approx(1.0 / smallest_radius(whole), rel=1e-2)


def test_a_flight_whose_turn_goes_around_home_circles_there(whole):
    # It comes back beside its start, which lies to its right at the distance of a radius.
    radius = smallest_radius(whole)
    places = (0.0, 0.0), (2000.0, 0.0), (2000.0, radius), (-2000.0, radius)
    path = flown(places).reference.path
    at_m = 1000.0 + np.hypot(path.north, path.east)[1000:-1000].argmin()
    back, circled = (
        ended(kind, at_m, waypoints=places).reference.path.north for kind in ("turn_back", "circle")
    )
    assert back.tolist() == circled.tolist()


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


def test_a_glide_is_as_long_as_thirty_heights_over_the_ground_of_its_mission():
    planned = flown(**{"flight.h_m": 500.0, "flight.ground_m": 400.0, "route.ending": GLIDE})
    path = planned.reference.path
    # of its start: the route is level, and its leg needs no roll-out before the glide
    assert path.up == pytest.approx(0.0, abs=INTEGRATED)
    assert path.length == pytest.approx(700.0 + 30.0 * 100.0, abs=ONE_POINT)


def test_a_flight_that_turns_back_keeps_the_airspeed_of_the_place_where_it_leaves(tmp_path):
    slower = item(178, 0, 20.0, -1, None, None, None, None, frame=2)
    places = (47.4, 8.5), (47.41, 8.51), (47.41, 8.55)
    first, *others = (waypoint(lat, lon, 60) for lat, lon in places)
    plan = plan_file(tmp_path / "m.plan", first, others[0], slower, others[1])
    leaving = {"route.ending": {"kind": "turn_back", "at_m": 3000.0}}
    reference = ft.route(plan, changes=leaving).reference

    assert reference.airspeeds.shape == reference.path.north.shape
    assert reference.airspeeds[0] == 25.0  # at which the Aerosonde is identified
    assert reference.airspeeds[3000:] == pytest.approx(20.0)
