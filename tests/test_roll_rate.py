"""Gains inside what the rate limits of the commands can follow: an airliner settles."""

import math
from pathlib import Path

import pytest

import flighttune as ft

FOLDER = Path(__file__).parent / "adopted" / "B747"
HALF_A_DEGREE = math.radians(0.5)


def turn(folder=FOLDER, **rates):
    scenario = ft.load_scenario(folder / "turn.toml")
    tuning = scenario.tuning.model_copy(update=rates)
    return scenario.model_copy(update={"tuning": tuning, "gains": ["tuned_identified"]})


def late_by(folder, channel):
    lag = ft.loop.load_identified(folder).conditions[0].lags[channel]
    return lag.whole + 0.01  # half a sample at 50 Hz


def measured(scenario, channel):
    return ft.fly(scenario).metrics.xs(channel, level=1).iloc[0]


@pytest.mark.soak
def test_the_gain_is_that_of_a_roll_taken_out_in_time():
    scenario = turn(roll_rate=True)
    gains = ft.tune(scenario, model="identified").gains
    lag = late_by(FOLDER, 0)
    phi, rate = math.radians(45.0), math.radians(scenario.limits.phi_rate_dps)
    late = phi / (2.0 * rate) + lag

    assert gains.K_P[0, 0] <= scenario.flight.V_a_mps / 9.81 / late * (1.0 + 1e-6)
    assert gains.K_I[0, 0] <= gains.K_P[0, 0] / (4.0 * late) * 1.5
    free = ft.tune(turn(roll_rate=False), model="identified").gains
    assert free.K_P[0, 0] > 2.0 * gains.K_P[0, 0]


@pytest.mark.soak
def test_the_course_of_a_slow_roller_settles_and_cycles_without():
    bounded, free = (measured(turn(roll_rate=roll), "chi") for roll in (True, False))

    assert bounded["ITAE"] < 35.0
    assert bounded["ST_rad"] < HALF_A_DEGREE < free["ST_rad"]
    assert free["ITAE"] > 2.0 * bounded["ITAE"]


@pytest.mark.soak
def test_the_path_angle_of_a_slow_load_factor_settles_and_swings_without():
    folder = FOLDER.with_name("MD11")
    bounded, free = (turn(folder, lift_rate=lift) for lift in (True, False))
    lag = late_by(folder, 1)
    first, V_over_g = math.radians(3.0), bounded.flight.V_a_mps / 9.81

    gains = ft.tune(bounded, model="identified").gains
    K_P, K_I = gains.K_P[1, 1], gains.K_I[1, 1]

    late = K_P * first / (2.0 * bounded.limits.n_z_rate_per_s) + lag
    assert K_P <= V_over_g / late * (1.0 + 1e-6)
    assert K_I <= K_P / (4.0 * late) * 1.5
    settled, swings = (measured(scenario, "gamma") for scenario in (bounded, free))
    assert settled["ITAE"] < 0.75 * swings["ITAE"]
    assert settled["ST_rad"] < 0.4 * swings["ST_rad"]
