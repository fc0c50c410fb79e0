"""Flights to the edges of what the aircraft can do: each ends, or is refused, with its reason."""

import math
import re

import numpy as np
import pytest

import flighttune as ft

DEG = math.pi / 180.0
RHO_1000 = 1.11164
WEIGHT = 11.0 * 9.80665
Q_PER_V2 = 0.5 * RHO_1000 * 0.55
GEAR_REACH = 2.0
"""Length that the gear of a Cessna 172 reaches at most below its centre of mass, m."""
WEAK = 0.25
"""Share of its thrust a weak engine gives: 30 N."""


def climbing_at(gamma):
    return lambda now: (0.0, math.cos(gamma) + 2.0 * (gamma - now["gamma"]))


def test_the_steepest_climb_of_a_weak_engine_is_that_of_its_thrust():
    C_L = WEIGHT / (Q_PER_V2 * 25.0**2)
    drag = Q_PER_V2 * 25.0**2 * (0.043 + 0.0232 * C_L**2)
    steepest = math.asin((WEAK * 120.0 - drag) / WEIGHT)

    weak = ft.loop.JSBSimPlant(throttle_max=WEAK)
    weak.start(ft.loop.FlightCondition(V_a=25.0, gamma=steepest - 0.5 * DEG))
    with pytest.raises(ft.loop.PlantError, match="too little thrust"):
        weak.start(ft.loop.FlightCondition(V_a=25.0, gamma=steepest + 0.5 * DEG))


def test_a_climb_beyond_the_thrust_ends_too_slow_and_says_at_full_throttle(fly):
    flight = fly(climbing_at(20.0 * DEG), duration=30.0, throttle_max=WEAK)

    assert flight.stop.status == "left_envelope"
    assert re.search(r"V_a must .* 15 to 45 m/s, got .* at full throttle\.", flight.stop.reason)
    assert np.max(flight["throttle"]) == pytest.approx(WEAK)
    assert np.max(flight["thrust"]) == pytest.approx(WEAK * 120.0, rel=1e-6)


def test_the_speed_integrator_does_not_wind_up_at_the_stop_of_a_weak_engine(fly):
    def command(now):
        level = now["h"] > 1060.0 or command.back
        command.back = level
        return climbing_at(0.0 if level else 18.0 * DEG)(now)

    command.back = False
    flight = fly(command, duration=40.0, throttle_max=WEAK)

    assert flight.stop is None
    assert np.min(flight["V_a"]) < 24.0, "the climb must have taken speed"
    assert flight["V_a"][-250:] == pytest.approx(25.0, abs=0.3)
    assert np.max(flight["V_a"]) < 26.5


def test_a_slow_pull_stalls_at_the_lift_peak(fly):
    # CL peaks at 1.5 (README): the load factor there, and not more, is reached.
    flight = fly((0.0, 2.1), V_a=19.0, duration=5.0)

    highest = 1.5 * Q_PER_V2 * 19.0**2 / WEIGHT
    assert flight.stop.status == "left_envelope"
    assert "alpha must stay inside" in flight.stop.reason
    assert np.max(flight["n_z"]) < 1.05 * highest
    assert np.max(flight["n_z"]) > 0.9 * highest


def test_gear_that_meets_the_ground_ends_a_flight_with_its_centre_of_mass_above(fly):
    flight = fly((0.0, 0.5), aircraft="c172p", V_a=45.0, h=20.0, duration=10.0)

    assert flight.stop.status == "ground_contact"
    assert 0.0 < flight["h"][-1] < GEAR_REACH


@pytest.mark.parametrize("throttle_max", [0.0, -1.0, 1.5, math.nan])
def test_an_upper_stop_of_the_throttle_lies_between_its_stops(throttle_max):
    with pytest.raises(ft.InputError, match="`throttle_max` must lie above 0"):
        ft.loop.JSBSimPlant(throttle_max=throttle_max)
