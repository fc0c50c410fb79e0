"""Gains inside what the rate limit of roll can follow: an airliner's course settles."""

import math
from pathlib import Path

import pytest

import flighttune as ft
from flighttune.flight.models import gain_set

FOLDER = Path(__file__).parent / "adopted" / "B747"
HALF_A_DEGREE = math.radians(0.5)


def turn(*, roll_rate):
    scenario = ft.load_scenario(FOLDER / "turn.toml")
    tuning = scenario.tuning.model_copy(update={"roll_rate": roll_rate})
    return scenario.model_copy(update={"tuning": tuning, "gains": ["tuned_identified"]})


@pytest.mark.slow
def test_the_gain_is_that_of_a_roll_taken_out_in_time():
    scenario = turn(roll_rate=True)
    gains = gain_set(scenario, "tuned_identified")
    lag = ft.load_identified(FOLDER).conditions[0].lags[0].whole + 0.01  # half a sample at 50 Hz
    phi, rate = math.radians(45.0), math.radians(scenario.limits.phi_rate_dps)
    late = phi / (2.0 * rate) + lag

    assert gains.K_P[0, 0] <= scenario.flight.V_a_mps / 9.81 / late * (1.0 + 1e-6)
    assert gains.K_I[0, 0] <= gains.K_P[0, 0] / (4.0 * late) * 1.5
    assert gain_set(turn(roll_rate=False), "tuned_identified").K_P[0, 0] > 2.0 * gains.K_P[0, 0]


@pytest.mark.slow
def test_the_course_of_a_slow_roller_settles_and_cycles_without():
    bounded, free = (
        ft.fly(turn(roll_rate=roll_rate)).metrics.xs("chi", level=1).iloc[0]
        for roll_rate in (True, False)
    )

    assert bounded["ITAE"] < 35.0
    assert bounded["ST_rad"] < HALF_A_DEGREE < free["ST_rad"]
    assert free["ITAE"] > 2.0 * bounded["ITAE"]
