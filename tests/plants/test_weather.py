"""Weather as a value: wind between levels, and what it refuses."""

import math

import pytest

from flighttune.errors import InputError
from flighttune.plants.weather import Gust, OscillatingWind, Turbulence, Weather, WindProfile

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


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (WindProfile, {"levels": ()}, "`levels` must rise in height and hold at least one"),
        (WindProfile, {"levels": LEVELS[::-1]}, r"`levels` must rise .*got \[300.0, 100.0\]"),
        (WindProfile, {"levels": ((0.0, (math.nan, 0.0, 0.0)),)}, "`levels` must be finite"),
        (Gust, {"axis": "up"}, "`axis` must be ahead, right or down, got 'up'"),
        (Gust, {"rise": 0.0}, "`rise` must be positive, got 0.0 s"),
        (Gust, {"start": -1.0}, "`start` must not be negative, got -1.0 s"),
        (Gust, {"peak": math.inf}, "`peak` must be finite, got inf m/s"),
        (Turbulence, {"severity": 0}, "`severity` must lie in 1 to 7, got 0"),
        (Turbulence, {"wind_20ft": -1.0}, "`wind_20ft` must not be negative, got -1.0 m/s"),
        (Turbulence, {"model": "culp"}, "`model` must be tustin or milspec, got 'culp'"),
        (OscillatingWind, {"sine": (0.0, math.nan, 0.0)}, "`sine` must be finite"),
        (OscillatingWind, {"sine_omega": math.inf}, "`sine_omega` must be finite, got inf rad/s"),
    ],
)
def test_impossible_weather_is_refused(kind, values, message):
    good = {
        WindProfile: {},
        Gust: {"axis": "right", "peak": 5.0, "start": 1.0, "rise": 2.0},
        Turbulence: {"severity": 3, "wind_20ft": 7.7},
        OscillatingWind: {
            "cosine": (0.0, 0.0, 0.0), "cosine_omega": 1.0,
            "sine": (0.0, 0.0, 0.0), "sine_omega": 1.0,
        },
    }[kind]  # fmt: skip
    with pytest.raises(InputError, match=message):
        kind(**good | values)
