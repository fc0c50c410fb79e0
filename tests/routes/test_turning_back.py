"""Scenarios of a flight that turns back at a place of its route, against closed forms."""

import math

import numpy as np
import pytest
from made_up import scenario_tables
from scipy.integrate import quad

import flighttune as ft

G, V, DEG = 9.81, 25.0, math.pi / 180.0
CLIMB = 5.0  # deg


def place(along, **changes):
    level = {"along_m": along, "north_m": along, "east_m": 0.0, "chi_deg": 0.0, "gamma_deg": 0.0}
    flown = {"h_m": 500.0, "V_a_mps": V, "rate_dps": 0.0, "back_dps": 10.0}
    return {**level, **flown, **changes}


def flight(*places, reference=None, **turn_back):
    """The scenario of a flight that turns back 600 m along a route of these places."""
    tables = scenario_tables(flight={"h_m": 500.0}, limits={"n_x": [-0.3, 0.3]})
    turning = {"at_m": 600.0, "bank_deg": 30.0, "roll_rate_dps": 20.0, "place": [*places]}
    tables |= {"reference": reference, "turn_back": turning | turn_back}
    return ft.scenario_from({key: x for key, x in tables.items() if x is not None})


LEVEL = place(0.0), place(1000.0)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("roll_rate", "roll_in"), [(20.0, None), (60.0, 1.0)])
def test_a_flight_turns_back_after_its_reaction_and_flies_on(side, roll_rate, roll_in):
    made = flight(*LEVEL, side=side, roll_rate_dps=roll_rate, turn_deg=200.0, reaction_s=2.0)
    load = 10.0 * DEG * V / G  # tangent of the roll of the turn, in rad of roll
    roll_in = roll_in or 1.2 * load / (20.0 * DEG)

    assert made.flight.duration_s == pytest.approx(10.0 + 2.0 + 200.0 / 10.0 + 8.0)
    assert (made.flight.chi_deg, made.flight.gamma_deg, made.flight.h_m) == (0.0, 0.0, 500.0)
    reference, begun = made.stated_reference, 12.0
    t = np.array([0.0, begun, begun + 0.5 * roll_in, begun + roll_in, made.flight.duration_s])
    rates = reference.rates(t)[0] / DEG
    assert rates == pytest.approx(side * np.array([0.0, 0.0, 5.0, 10.0, 0.0]), abs=1e-9)
    chi = reference.sampled(t)[0] / DEG
    # a roll-in turns half as far as the turn does in its time
    assert chi == pytest.approx(
        side * np.array([0.0, 0.0, 1.25 * roll_in, 5.0 * roll_in, 200.0]), abs=1e-6
    )


@pytest.mark.parametrize("gamma", [CLIMB, -CLIMB, 2.0 * CLIMB])
def test_a_flight_of_a_turning_climb_is_where_the_route_is_when_it_detects(gamma):
    """At 600 m the course is 12 deg and turns at 2 deg/s; the ground lies far below."""
    there = {"gamma_deg": gamma, "rate_dps": 2.0}
    made = flight(place(0.0, h_m=300.0, **there), place(1000.0, chi_deg=20.0, **there))
    reference, level_s = made.stated_reference, 2.0 * abs(gamma) / CLIMB
    t = np.linspace(0.0, made.flight.duration_s, 4001)
    chi, slope = reference.sampled(t)

    assert np.interp(10.0, t, chi) / DEG % 360.0 == pytest.approx(12.0, abs=1e-6)
    assert np.interp([0.0, 9.0], t, reference.rates(t)[0]) / DEG == pytest.approx([0.0, 2.0])
    climbed, _ = quad(lambda s: V * math.sin(np.interp(s, t, slope)), 0.0, 10.0)
    assert made.flight.h_m + climbed == pytest.approx(max(420.0, 300.0 + climbed), abs=1e-6)
    # the climb ends evenly about the middle of the time that it takes from the roll-in on
    roll_in = 1.2 * (2.0 + 10.0) * V / G / 20.0
    middle = 10.0 + 1.0 + 0.5 * roll_in + 0.5 * level_s
    found = np.interp(
        [0.0, middle - 0.5 * level_s - 0.5, middle, middle + 0.5 * level_s + 0.5], t, slope
    )
    assert found / DEG == pytest.approx(gamma * np.array([1.0, 1.0, 0.5, 0.0]), abs=1e-4)


@pytest.mark.parametrize("sloped_s", [20.0, 0.5])
def test_a_flight_that_begins_level_flies_the_slope_before_it_turns(sloped_s):
    """The slope begins 200 m along; its height there is reached at the detection."""
    slope = {"gamma_deg": CLIMB}
    made = flight(
        place(0.0, h_m=100.0), place(199.9), place(200.0, **slope), place(1000.0, **slope),
        sloped_s=sloped_s,
    )  # fmt: skip
    table = made.turn_back

    assert table.slope_m == pytest.approx(600.0 - 199.9)
    assert table.found_s == 10.0 + sloped_s
    assert (made.flight.gamma_deg, made.flight.duration_s) == (
        0.0,
        10.0 + sloped_s + 1.0 + 18.0 + 8.0,
    )
    climbed = 400.1 - 0.5 * 2.0 * V  # the climb begins within 2 s
    assert made.flight.h_m == pytest.approx(500.0 - climbed * math.sin(CLIMB * DEG), abs=0.01)
    begun = table.found_s - max(sloped_s, 2.0)
    t = begun + np.array([-0.5, 1.0, 2.5, 3.0])
    found = made.stated_reference.sampled(t)[1] / DEG
    assert found == pytest.approx([0.0, 0.5 * CLIMB, CLIMB, CLIMB], abs=1e-6)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (3.0, 4.0), (-24.0, 0.0), (-30.0, 5.0)])
def test_the_time_on_a_slope_is_that_in_the_wind_of_the_flight(wind):
    """At a course of 30 deg at 20 m/s, over ground at a fifth of it or more."""
    there = {"chi_deg": 30.0, "gamma_deg": -3.0, "V_a_mps": 20.0}
    table = flight(place(0.0, **there), place(5000.0, **there), at_m=2000.0).turn_back
    ahead = wind[0] * math.cos(30.0 * DEG) + wind[1] * math.sin(30.0 * DEG)

    assert table.slope_m == 60.0 * 20.0
    assert table.time_on_slope(*wind) == pytest.approx(1200.0 / max(20.0 + ahead, 4.0))


@pytest.mark.parametrize("change", [5.0, -3.0, 0.0])
def test_a_flight_with_an_airspeed_of_its_own_takes_that_of_the_place(change):
    """By a load factor of 0.05 along the path: 5 m/s in 10 s."""
    there = {"V_a_mps": V + change}
    asked = {"chi_deg": 0.0, "gamma_deg": 0.0, "V_mps": V}
    made = flight(
        place(0.0, **there), place(1000.0, **there),
        reference=asked,
    )  # fmt: skip
    t = np.array([0.0, 0.5 * abs(change) / (0.05 * G), 20.0])

    speeds, rates = made.stated_reference.airspeed(t)

    assert speeds == pytest.approx([V, V + 0.5 * change, V + change])
    assert rates[2] == 0.0
    assert made.flight.V_a_mps == V


def test_distances_and_winds_of_turns_are_those_of_level_circles():
    table = flight(place(0.0, back_dps=10.0), place(1000.0, back_dps=8.0, V_a_mps=30.0)).turn_back

    assert table.formula(V, G) == pytest.approx(V * 1.0 + V**2 / (G * math.tan(30.0 * DEG)))
    winds = [G * math.tan(30.0 * DEG) / (rate * DEG) - speed for rate, speed in ((10, V), (8, 30))]
    assert table.wind(G) == pytest.approx(min(winds))
    assert table.duration_s == 10.0 + 1.0 + 180.0 / 8.0 + 8.0
