"""The tables of weather: units, directions, and what they refuse."""

import math

import pytest
from made_up import made_up_scenario

from flighttune.flight.conditions import weather_of

AIRCRAFT = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
LAW = [{"kind": "kinematic"}]
PAPERS_SINUSOID = {
    "chi_amplitude": 0.1, "chi_omega_rad_s": 0.15,
    "gamma_amplitude": 0.1, "gamma_omega_rad_s": 0.15,
}  # fmt: skip


def scenario(plants=AIRCRAFT, **tables):
    return made_up_scenario(**{"plant": plants, **tables})


@pytest.mark.parametrize(
    ("from_deg", "north", "east"), [(0.0, -8.0, 0.0), (90.0, 0.0, -8.0), (225.0, 5.657, 5.657)]
)
def test_wind_is_named_by_where_it_comes_from(from_deg, north, east):
    weather = weather_of(scenario(wind={"speed_mps": 8.0, "from_deg": from_deg, "down_mps": -1.0}))

    assert weather.deterministic(0.0, 0.0) == pytest.approx((north, east, -1.0), abs=1e-3)


def test_levels_make_a_shear():
    level = [
        {"h_m": 0.0, "speed_mps": 0.0, "from_deg": 0.0},
        {"h_m": 100.0, "speed_mps": 10.0, "from_deg": 180.0},
    ]
    weather = weather_of(scenario(wind={"level": level}))

    assert weather.wind.at(30.0) == pytest.approx((3.0, 0.0, 0.0))
    assert weather.changes


def test_a_gust_is_flown_through_at_the_airspeed():
    gust = {"axis": "right", "peak_mps": 5.0, "start_s": 4.0, "length_m": 120.0, "hold_s": 1.0}

    found = weather_of(scenario(gust=gust)).gust

    assert (found.rise, found.hold, found.start, found.peak) == (120.0 / 25.0, 1.0, 4.0, 5.0)


@pytest.mark.parametrize(
    ("word", "severity", "knots"), [("light", 3, 15.0), ("moderate", 4, 30.0), ("severe", 6, 45.0)]
)
def test_words_of_turbulence_are_those_of_the_standard(word, severity, knots):
    # Section 3.7.3.4 of MIL-F-8785C: wind at 20 ft of 15, 30 and 45 knots.
    found = weather_of(scenario(turbulence={"intensity": word})).turbulence

    assert found.severity == severity
    assert found.wind_20ft == pytest.approx(knots * 0.514444, abs=0.1)


def test_the_papers_sinusoid_takes_a_wind_of_seventeen_meters_a_second():
    weather = weather_of(scenario(disturbance={**PAPERS_SINUSOID, "as_wind": True}))

    across, normal = weather.oscillation.cosine, weather.oscillation.sine
    assert math.hypot(*across) == pytest.approx(25.0 * 0.1 / 0.15)
    assert math.hypot(*normal) == pytest.approx(25.0 * 0.1 / 0.15)


def test_still_air_is_no_weather():
    assert weather_of(scenario()) is None
    assert weather_of(scenario(LAW, disturbance=PAPERS_SINUSOID)) is None
