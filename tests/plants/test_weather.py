"""Weather as a value: wind between levels, and its change in flight."""

import math

import pytest

from flighttune.plants.weather import OscillatingWind, Weather, WindProfile

LEVELS = ((100.0, (0.0, 2.0, 0.0)), (300.0, (10.0, -2.0, 1.0)))
SWING = OscillatingWind(cosine=(1.0, 0.0, 0.0), cosine_omega=1.0, sine=(0, 2.0, 0), sine_omega=2.0)


@pytest.mark.parametrize(
    ("h", "wind"),
    [
        (0.0, (0.0, 2.0, 0.0)),
        (100.0, (0.0, 2.0, 0.0)),
        (150.0, (2.5, 1.0, 0.25)),
        (300.0, (10.0, -2.0, 1.0)),
        (900.0, (10.0, -2.0, 1.0)),
    ],
)
def test_wind_is_linear_between_levels_and_constant_beyond(h, wind):
    assert WindProfile(LEVELS).at(h) == pytest.approx(wind)


def test_parts_of_the_weather_add_up():
    weather = Weather(wind=WindProfile(LEVELS), oscillation=SWING)

    t = math.pi / 4.0
    assert weather.deterministic(t, 0.0) == pytest.approx((math.cos(t), 4.0, 0.0))


@pytest.mark.parametrize(
    ("weather", "changes"),
    [
        (Weather(), False),
        (Weather(wind=WindProfile(((0.0, (5.0, 0.0, 0.0)),))), False),
        (Weather(wind=WindProfile(LEVELS)), True),
        (Weather(oscillation=SWING), True),
    ],
)
def test_only_shear_and_oscillation_change_the_wind_in_flight(weather, changes):
    assert weather.changes is changes
