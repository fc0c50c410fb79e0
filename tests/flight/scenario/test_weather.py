"""The tables of weather: units, directions, and what they refuse."""

import math

import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight.conditions import weather_of
from flighttune.vehicles import navigation_keys, plant_keys, weather_keys

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


def test_tables_of_errors_and_gusts_are_those_in_si():
    sensors = weather_keys.SensorsTable(
        chi_bias_deg=2.0, gamma_bias_deg=-1.0, V_a_bias_mps=0.5, chi_noise_sd_deg=0.3,
        gamma_noise_sd_deg=0.4, V_a_noise_sd_mps=0.6, noise_time_constant_s=7.0,
    ).sensors(5)  # fmt: skip
    fault = {"from_s": 9.0, "course_deg": 90.0, "jump_m": 30.0, "drift_mps": 2.0}
    navigation = navigation_keys.NavigationTable(grade="poor", fault=fault, inner_loop=True)
    failed, healthy = navigation.navigation(3), navigation_keys.NavigationTable().navigation(4)
    gust = weather_keys.GustTable(axis="down", peak_mps=-3.0, start_s=2.0, length_m=50.0).gust(20.0)

    assert sensors.bias == pytest.approx((math.radians(2.0), math.radians(-1.0), 0.5))
    assert sensors.noise_sd == pytest.approx((math.radians(0.3), math.radians(0.4), 0.6))
    assert (sensors.time_constant, sensors.seed) == (7.0, 5)
    assert weather_keys.SensorsTable().sensors(0) == ft.loop.Sensors()
    of = failed.fault
    assert (of.start, of.course, of.jump, of.drift) == (9.0, pytest.approx(math.pi / 2), 30.0, 2.0)
    assert (failed.inner_loop, failed.seed, healthy.fault, healthy.seed) == (True, 3, None, 4)
    assert not healthy.inner_loop
    assert (gust.axis, gust.peak, gust.start, gust.rise, gust.hold) == ("down", -3.0, 2.0, 2.5, 0.0)
    both = weather_keys.TurbulenceTable(
        severity=5, wind_20ft_mps=12.0, model="milspec"
    ).turbulence()
    assert (both.severity, both.wind_20ft, both.model) == (5, 12.0, "milspec")


def test_lags_of_a_plant_are_of_second_order_with_a_damping_and_else_of_first():
    plant = plant_keys.PlantTable(
        kind="point_mass_lag", roll_lag_rad_s=5.0, roll_damping=0.6, n_z_lag_rad_s=8.0,
        n_z_delay_s=0.05, n_x_lag_rad_s=2.0, n_x_delay_s=0.1,
    )  # fmt: skip
    roll, lift = plant.lags()

    made = ft.loop.InnerLag
    assert roll == made(order=2, natural_frequency=5.0, damping=0.6)
    assert lift == made(order=1, natural_frequency=8.0, delay=0.05)
    assert plant.thrust_lag() == made(order=1, natural_frequency=2.0, delay=0.1)
    assert plant_keys.PlantTable(kind="kinematic").lags() is None
    bare = plant_keys.PlantTable(kind="point_mass_lag", roll_lag_rad_s=5.0, n_z_lag_rad_s=8.0)
    with pytest.raises(ft.InputError, match="`n_x_lag_rad_s` must be given"):
        bare.thrust_lag()
    of_file = plant_keys.PlantTable(kind="point_mass_lag", identified="aerosonde")
    assert of_file.lags() == ft.loop.load_identified("aerosonde").conditions[0].lags
