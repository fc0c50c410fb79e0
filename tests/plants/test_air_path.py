"""The path through the air, and the weather of a point mass."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.plants.base import AirPathPlant
from flighttune.plants.weather import Weather, WindProfile

DEG = math.pi / 180.0
SAME = 1e-6


def in_a_wind_from(degrees, speed, **condition):
    towards = (-speed * math.cos(degrees * DEG), -speed * math.sin(degrees * DEG), 0.0)
    wind = WindProfile(levels=((0.0, towards),))
    plant = AirPathPlant(ft.loop.JSBSimPlant(weather=Weather(wind=wind)))
    plant.start(ft.loop.FlightCondition(**{"V_a": 25.0} | condition))
    return plant


def now(plant):
    return dict(zip(plant.signals, plant.observe(), strict=True))


def test_in_a_crosswind_the_air_path_is_the_nose_and_the_ground_path_drifts():
    seen = now(in_a_wind_from(270.0, 5.0, chi=0.0, gamma=0.0))

    assert seen["chi"] == pytest.approx(0.0, abs=SAME)
    assert seen["chi_ground"] == pytest.approx(math.atan2(5.0, 25.0), abs=SAME)


def test_a_headwind_steepens_the_climb_over_ground_alone():
    gamma = 10.0 * DEG

    seen = now(in_a_wind_from(0.0, 10.0, gamma=gamma))

    rise, along = 25.0 * math.sin(gamma), 25.0 * math.cos(gamma) - 10.0
    assert seen["gamma"] == pytest.approx(gamma, abs=SAME)
    assert seen["gamma_ground"] == pytest.approx(math.atan2(rise, along), abs=SAME)


def test_the_course_through_the_air_is_continuous_beyond_half_a_turn():
    plant = in_a_wind_from(90.0, 8.0, chi=170.0 * DEG)

    courses = [now(plant)["chi"]]
    for _ in range(200):
        plant.advance(30.0 * DEG, 1.0 / math.cos(30.0 * DEG), 0.05)
        courses.append(now(plant)["chi"])

    assert courses[0] == pytest.approx(170.0 * DEG, abs=SAME)
    assert courses[-1] > 270.0 * DEG
    assert np.abs(np.diff(courses)).max() < 5.0 * DEG


def test_wind_is_linear_between_levels_and_constant_beyond():
    heights, low, high = (0.0, 100.0, 150.0, 300.0, 900.0), (0.0, 2.0, 0.0), (10.0, -2.0, 1.0)

    winds = [WindProfile(((100.0, low), (300.0, high))).at(h) for h in heights]

    assert winds[2] == pytest.approx((2.5, 1.0, 0.25))
    assert [winds[i] for i in (0, 1, 3, 4)] == [low, low, high, high]
