"""Paths through waypoints against Fresnel's integrals and circles, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import fresnel

import flighttune as ft
from flighttune.references.path import Ability, Waypoint, plan

DEG = math.pi / 180.0
ABILITY = Ability(
    V_a=25.0, wind=8.0, phi=36.0 * DEG, phi_rate=24.0 * DEG, gamma=(-10.0 * DEG, 10.0 * DEG), g=9.81
)
RADIUS = 33.0**2 / (9.81 * math.tan(36.0 * DEG))
ROLLING = 33.0 * 36.0 / 24.0


def points(*places):
    return [
        Waypoint(**dict(zip(("north", "east", "up", "turns"), p, strict=False))) for p in places
    ]


def test_a_corner_begins_where_clothoid_and_arc_say():
    """Tangent length of a right angle: Fresnel's integrals, then an arc about its centre."""
    path = plan(points((0, 0), (1000, 0), (1000, 1000)), ABILITY)
    leg, turn, _ = path.stretches

    scale = math.sqrt(math.pi * RADIUS * ROLLING)
    sine, cosine = fresnel(ROLLING / scale)
    x, y, angle = scale * cosine, scale * sine, ROLLING / (2.0 * RADIUS)
    centre = x - RADIUS * math.sin(angle), y + RADIUS * math.cos(angle)
    reach = centre[0] + centre[1] * math.tan(math.pi / 4)

    assert leg.length == pytest.approx(1000.0 - reach, abs=1e-6)
    assert turn.length == pytest.approx(RADIUS * math.pi / 2 + ROLLING, abs=1e-6)
    assert turn.radius == pytest.approx(RADIUS)
    half = np.searchsorted(path.s, turn.start + 0.5 * turn.length)
    towards = np.hypot(path.north - (1000 - reach + centre[0]), path.east - centre[1])
    assert towards[half - 20 : half + 20] == pytest.approx(RADIUS, abs=1e-3)


def test_a_path_passes_its_last_waypoint_and_circles_have_their_radius():
    route = points((0, 0), (900, 0, 20), (900, 900, 50, 2), (0, 1200, 50, -1), (-900, 500, 50))
    path = plan(route, ABILITY)
    end = round(path.length)

    assert (path.north[end], path.east[end]) == pytest.approx((-900, 500), abs=0.6)  # half a step
    assert path.up[end] == pytest.approx(50.0, abs=1e-9)
    for circles, centre in ((path.stretches[3], (900, 900)), (path.stretches[5], (0, 1200))):
        assert circles.kind == "loiter"
        inside = (path.s > circles.start + ROLLING) & (
            path.s < circles.start + circles.length - ROLLING
        )
        apart = np.hypot(path.north - centre[0], path.east - centre[1])[inside]
        assert apart == pytest.approx(RADIUS, abs=1e-3)
    assert abs(path.stretches[3].turn) >= 2 * math.tau
    assert path.stretches[5].turn <= -math.tau


def test_the_roll_of_a_path_and_its_rate_are_within_the_ability():
    path = plan(points((0, 0), (900, 0), (900, 700), (950, 1500), (-300, 300)), ABILITY)
    roll = np.arctan(path.curvature * ABILITY.speed**2 / ABILITY.g)
    rate = np.diff(roll) * ABILITY.speed

    assert np.abs(roll).max() <= ABILITY.phi * (1 + 1e-9)
    # roll grows faster than its mean where it is small: tan(36 deg) / 36 deg = 1.156
    assert np.abs(rate).max() <= ABILITY.phi_rate * math.tan(ABILITY.phi) / ABILITY.phi * 1.001
    assert np.diff(path.course) == pytest.approx(path.curvature[:-1], abs=1e-4)


def test_a_climb_of_its_own_angle_ends_before_the_waypoint():
    route = [Waypoint(north=0, east=0), Waypoint(north=2000, east=0, up=60, climb=6 * DEG)]
    path = plan(route, ABILITY)
    top = 60 / math.tan(6 * DEG)

    assert np.interp(0.5 * top, path.s, path.up) == pytest.approx(30.0, abs=1e-6)
    assert np.interp([top + 30, 2000], path.s, path.up) == pytest.approx(60.0, abs=1e-6)
    assert path.slope.max() == pytest.approx(math.tan(6 * DEG))


@pytest.mark.parametrize(
    ("route", "message"),
    [
        (points((0, 0)), "at least 2"),
        (points((0, 0), (100, 0), (100, 900)), "leg to waypoint 2"),
        (points((0, 0), (900, 0), (0, 10)), "160 deg at waypoint 2"),
        (points((0, 0), (900, 0, 300)), "height of waypoint 2"),
        (points((0, 0), (0, 0)), "waypoint 2 must"),
        (points((0, 0), (0.01, 0)), "1 m apart or more, got 0.01 m"),
        (points((0, 0, 0, 1), (900, 0)), "first waypoint"),
    ],
)
def test_what_cannot_be_flown_is_refused_by_the_number_of_its_waypoint(route, message):
    with pytest.raises(ft.InputError, match=message):
        plan(route, ABILITY)


@pytest.mark.parametrize("leg", [20_000.0, 60_000.0])
def test_a_fast_aircraft_begins_and_ends_on_the_heights_and_slopes_of_its_route(leg):
    fast = replace(ABILITY, V_a=200.0, wind=66.0, gamma=(-0.5, 0.5))
    route = [Waypoint(north=0.0, east=0.0), Waypoint(north=leg, east=0.0, up=leg / 10.0)]
    path = plan([*route, Waypoint(north=2.0 * leg, east=0.0)], fast)

    end = np.searchsorted(path.s, path.length)
    assert path.up[[0, end]] == pytest.approx([0.0, 0.0], abs=0.2)  # m: a point is up to 1 m off
    assert path.slope[[0, end]] == pytest.approx([0.1, -0.1], abs=1e-9)


def test_climbs_that_change_faster_than_the_load_factor_allows_are_refused():
    fast = replace(ABILITY, V_a=200.0, wind=66.0, gamma=(-0.5, 0.5))
    heights = zip((0.0, 3000.0, 0.0, 0.0), (0.0, 9000.0, 18_000.0, 30_000.0), strict=True)

    with pytest.raises(ft.InputError, match=r"climb must be .*9000 m"):
        plan([Waypoint(north=north, east=0.0, up=up) for up, north in heights], fast)
