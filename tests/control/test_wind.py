"""Paths over ground and through the air, against the wind triangle of vectors."""

import math

import numpy as np
import pytest

from flighttune.control import wind as winds

# Of two ways to compute the same in doubles.
ROUNDING = 1e-12


def flights():
    """Velocities through the air and winds (m/s) whose course over ground the air can hold."""
    rng = np.random.default_rng(82)
    for _ in range(500):
        V_a, chi, gamma = rng.uniform([10.0, -3.0, -0.9], [60.0, 3.0, 0.9])
        level = V_a * math.cos(gamma)
        air = np.array([level * math.cos(chi), level * math.sin(chi), -V_a * math.sin(gamma)])
        yield float(V_a), air, rng.uniform(-0.3, 0.3, 3) * V_a


def course_and_path(velocity):
    north, east, down = velocity.tolist()
    return math.atan2(east, north), math.atan2(-down, math.hypot(north, east))


def test_thrust_bears_the_climb_through_the_air_of_a_path_over_ground():
    """Expected: the vertical part of the velocity through the air, over the airspeed."""
    for V_a, air, wind in flights():
        chi, gamma = course_and_path(air + wind)

        sine = winds.climb_through_air(chi, gamma, V_a, wind)

        assert sine == pytest.approx(-air[2] / V_a, abs=ROUNDING)
        assert winds.path_over_ground(chi, sine, V_a, wind) == pytest.approx(gamma, abs=ROUNDING)


def test_the_level_speed_on_a_course_is_that_of_the_sum_of_air_and_wind():
    for V_a, air, wind in flights():
        north, east, _ = (air + wind).tolist()
        climb = math.asin(-air[2] / V_a)

        speed = winds.level_speed(math.atan2(east, north), climb, V_a, wind)

        assert speed == pytest.approx(math.hypot(north, east), rel=ROUNDING)


@pytest.mark.parametrize("gamma", [-0.5, -0.0, 0.1, 1.5])
def test_still_air_changes_no_bit_of_a_path(gamma):
    calm = (0.0, 0.0, 0.0)

    assert winds.climb_through_air(0.3, gamma, 25.0, calm) == math.sin(gamma)
    assert winds.path_over_ground(0.3, math.sin(gamma), 25.0, calm) == math.asin(math.sin(gamma))
    assert winds.speed_in_wind(0.3, gamma, 25.0, calm) == 25.0


@pytest.mark.parametrize("wind", [(0.0, 40.0, 0.0), (-60.0, 0.0, 0.0), (0.0, 0.0, 45.0)])
def test_a_wind_that_no_heading_holds_a_course_in_leaves_angles_that_can_be_flown(wind):
    for sine in (-0.5, 0.0, 1.0):
        assert abs(winds.path_over_ground(0.0, sine, 25.0, wind)) <= math.pi
    assert math.isfinite(winds.climb_through_air(0.0, 0.1, 25.0, wind))


def test_the_wind_that_an_aircraft_knows_lags_behind_the_one_there_is():
    """Expected: the step response of a lag of first order, which holds still at the start."""
    dt = 0.02
    estimate = winds.WindEstimate(dt)
    assert estimate(None) is None
    assert estimate((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)

    for _ in range(round(winds.WIND_ESTIMATE_S / dt)):
        known = estimate((2.0, 2.0, 0.0))

    left = math.exp(-1.0)
    assert known == pytest.approx((2.0 - left, 2.0, 3.0 * left), abs=dt / winds.WIND_ESTIMATE_S)


def test_a_path_against_the_wind_is_flown_at_a_fifth_of_the_airspeed_at_least():
    """North at 25 m/s in 20 m/s against it and 15 m/s across: over ground it would stand still."""
    sine, wind = 0.1, (-20.0, 15.0, 0.0)

    # lift turns the velocity over ground, 5 m/s, by its part across it: 20 of 25 m/s are along it
    assert winds.speed_in_wind(0.0, 0.0, 25.0, wind) == pytest.approx(5.0 * 25.0 / 20.0)
    climb = winds.climb_through_air(0.0, math.asin(sine), 25.0, (-24.0, 0.0, 0.0))
    assert climb == pytest.approx(sine * 5.0 / 25.0)
    level = 25.0 * math.sqrt(1.0 - sine**2)
    gamma = winds.path_over_ground(0.0, sine, 25.0, (-level, 0.0, 0.0))
    assert gamma == pytest.approx(math.atan2(25.0 * sine, 0.2 * level))


def test_where_no_heading_holds_a_course_the_airspeed_is_taken_as_in_still_air():
    across = (3.0, 30.0, 1.0)

    assert winds.speed_in_wind(0.0, 0.1, 25.0, across) == 25.0
    assert winds.climb_through_air(0.0, 0.1, 25.0, across) == pytest.approx(math.sin(0.1))
    assert winds.level_speed(0.0, 0.1, 25.0, across) == pytest.approx(3.0)


def test_an_estimate_of_long_samples_is_the_wind_itself():
    estimate = winds.WindEstimate(2.0 * winds.WIND_ESTIMATE_S)
    estimate((1.0, 2.0, 3.0))

    assert estimate((5.0, -2.0, 0.0)) == pytest.approx((5.0, -2.0, 0.0))
