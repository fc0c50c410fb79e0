"""Turn-arounds against Dubins' words, and through every waypoint of a survey with narrow rows."""

import math
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.references.path import Ability, Waypoint, plan

DEG = math.pi / 180.0
ABILITY = Ability(
    V_a=25.0,
    wind=8.0,
    phi=36.0 * DEG,
    phi_rate=24.0 * DEG,
    gamma=(-10.0 * DEG, 10.0 * DEG),
    g=9.81,
    turnaround=math.inf,
)
RADIUS = 33.0**2 / (9.81 * math.tan(36.0 * DEG))

# Rolls in within 5 cm, so that turns are circles to this distance.
NIMBLE = replace(ABILITY, phi_rate=2e4)
NEARLY_CIRCLES_M = 0.5


def survey(rows, spacing, length=700.0, beyond=60.0):
    """Waypoints of rows as ground stations have them: with a turn-around beyond both ends."""
    line = [-beyond, 0.0, length, length + beyond]
    return [
        Waypoint(north=north, east=row * spacing)
        for row in range(rows)
        for north in (line if row % 2 == 0 else reversed(line))
    ]


def around(path):
    return [stretch for stretch in path.stretches if stretch.kind == "turn-around"]


@pytest.mark.parametrize("spacing", [60.0, 150.0, 260.0])
def test_a_narrow_turn_around_is_the_bulb_of_three_circles(spacing):
    """R (pi + 4 phi) with cos(phi) = (R + w / 2) / 2 R: Jin and Tang (2010), eq. (3)."""
    (bulb,) = around(plan(survey(2, spacing), NIMBLE))
    phi = math.acos((RADIUS + 0.5 * spacing) / (2.0 * RADIUS))

    assert bulb.length == pytest.approx(RADIUS * (math.pi + 4.0 * phi), abs=NEARLY_CIRCLES_M)


def test_a_wide_turn_around_is_a_half_circle_with_a_straight():
    (turn,) = around(plan(survey(2, 3.0 * RADIUS), NIMBLE))

    assert turn.length == pytest.approx(RADIUS * (math.pi + 1.0), abs=NEARLY_CIRCLES_M)
    assert turn.aside == pytest.approx(RADIUS, abs=NEARLY_CIRCLES_M)


def test_eight_rows_of_60_m_are_flown_at_25_mps_through_every_waypoint():
    rows = survey(8, 60.0)
    path = plan(rows, ABILITY)
    places = np.column_stack([path.north, path.east])
    apart = [np.hypot(*(places - (x.north, x.east)).T) for x in rows]

    assert len(around(path)) == 7
    assert max(distance.min() for distance in apart) <= 0.5  # half a step of the table
    for row, first in enumerate(rows[1::4]):  # rows themselves are straight
        inside = (path.north > 0.0) & (path.north < 700.0) & (np.abs(path.curvature) < 1e-12)
        near = inside & (np.abs(path.east - first.east) < 0.05)
        assert np.count_nonzero(near) >= 690, row


def test_roll_and_its_rate_are_within_the_ability_in_turn_arounds():
    path = plan(survey(4, 60.0), ABILITY)
    roll = np.arctan(path.curvature * ABILITY.speed**2 / ABILITY.g)

    assert np.abs(roll).max() <= ABILITY.phi * (1 + 1e-9)
    rate = np.abs(np.diff(roll)).max() * ABILITY.speed
    assert rate <= ABILITY.phi_rate * math.tan(ABILITY.phi) / ABILITY.phi * 1.001
    assert np.diff(path.course) == pytest.approx(path.curvature[:-1], abs=1e-4)


def test_a_corner_that_turns_back_is_flown_through_its_waypoint():
    path = plan([Waypoint(north=n, east=e) for n, e in ((0, 0), (900, 0), (0, 10))], ABILITY)
    (back,) = around(path)

    at = np.searchsorted(path.s, [back.start, back.start + back.length])
    assert path.north[at] == pytest.approx(900.0, abs=1.0)
    assert path.east[at] == pytest.approx(0.0, abs=1.0)


def test_a_circle_around_the_place_before_is_reached_by_a_turn_around():
    points = [Waypoint(north=0, east=0), Waypoint(north=900, east=0)]
    circle = Waypoint(north=950, east=20, turns=-1.0, radius=200.0)
    path = plan([*points, circle, Waypoint(north=900, east=2000)], ABILITY)
    loiter = next(x for x in path.stretches if x.kind == "loiter")

    inside = (path.s > loiter.start + 60) & (path.s < loiter.start + loiter.length - 60)
    apart = np.hypot(path.north - 950, path.east - 20)[inside]
    assert apart == pytest.approx(200.0, abs=0.05)


def test_every_way_out_of_a_refusal_is_one():
    rows = survey(3, 420.0, beyond=120.0)
    narrow = replace(ABILITY, turnaround=120.0)
    with pytest.raises(ft.InputError, match="waypoint") as refusal:
        plan(rows, narrow)

    words = str(refusal.value).rstrip(".").split("`")
    keys = {"V_a_mps": "V_a", "turnaround_m": "turnaround", "wind_mps": "wind"}
    offered = str(refusal.value).partition("flown with")[2]
    ways = {
        key: float(offered.split(f"`{key}` of ")[1].split()[0].rstrip("."))
        for key in keys
        if f"`{key}`" in offered
    }
    assert {"V_a_mps", "turnaround_m"} <= set(ways), words
    for key, value in ways.items():
        plan(rows, replace(narrow, **{keys[key]: value}))


def test_circles_that_take_the_height_go_down_by_five_degrees_at_most():
    circle = Waypoint(north=1500, east=0, up=-200.0, turns=1.0, radius=200.0, spiral=True)
    path = plan([Waypoint(north=0, east=0), circle, Waypoint(north=0, east=900, up=-200)], ABILITY)
    leg, down, _ = path.stretches

    assert (leg.gamma, down.gamma) == (0.0, pytest.approx(-5.0 * DEG, rel=0.4))
    assert -5.0 * DEG <= down.gamma
    assert down.length >= 200.0 / math.tan(5.0 * DEG)
    assert down.length <= 200.0 / math.tan(5.0 * DEG) + 1.2 * math.tau * 200.0


def test_a_circle_by_time_takes_it_and_less_than_a_turn_more():
    circle = Waypoint(north=1500, east=0, turns=1.0, radius=200.0, hold=120.0)
    path = plan([Waypoint(north=0, east=0), circle, Waypoint(north=0, east=900)], ABILITY)

    time = path.stretches[1].length / ABILITY.V_a
    assert 120.0 <= time <= 120.0 + (math.tau * 200.0 + 60.0) / ABILITY.V_a
