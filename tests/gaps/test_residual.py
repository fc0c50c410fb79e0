"""Residuals of flights whose disturbance is known, and the mismatch of the exact law."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario
from small_claims import residual

import flighttune as ft

MICRO = 1e-6
"""Rates agree to this, rad/s: both sides integrate by the classical Runge-Kutta rule."""

SCENARIO = made_up_scenario(
    flight={"gamma_deg": 30.0, "phi_deg": 5.0, "duration_s": 2.0},
    reference={"chi_deg": 20.0, "gamma_deg": 20.0},
    limits={"phi_deg": [-30.0, 30.0], "phi_rate_dps": 40.0, "n_z_rate_per_s": 1.0},
    controller={"feed_forward": True},
)
LAGS = {
    "first order, no delay": ft.loop.InnerLag(order=1, natural_frequency=6.0),
    "second order, delay within a sample": ft.loop.InnerLag(
        order=2, natural_frequency=9.0, damping=0.7, delay=0.013
    ),
    "third order, delay of samples and a part": ft.loop.InnerLag(
        order=3, natural_frequency=12.0, damping=0.8, lag=0.1, delay=0.047
    ),
}


@pytest.fixture(scope="module")
def counted():
    """What a count of residual signals measures, to be changed."""
    return ft.load(residual()).measured


def flown(lags, disturbance=None):
    plant = ft.loop.PointMassPlant(lags, disturbance=disturbance, g=SCENARIO.flight.g_mps2)
    return ft.fly(SCENARIO, "paper", plants={"own": lambda: plant})["own / paper"]


def residuals(counted, run, lags):
    model = replace(counted.model, V_a=25.0, g=SCENARIO.flight.g_mps2, lags=lags)
    return replace(counted, model=model).values(run, SCENARIO)


@pytest.mark.parametrize(("roll", "load"), [*zip(LAGS, [*LAGS][::-1], strict=True)])
def test_a_constant_disturbance_comes_back(counted, roll, load):
    lags = LAGS[roll], LAGS[load]
    run = flown(lags, lambda t: (0.01, -0.02))
    expected = pytest.approx(np.tile([0.01, -0.02, 0.0, 0.0], (100, 1)), abs=MICRO)

    assert residuals(counted, run, lags) == expected
    # a course may pass north
    turned = run.signals["chi"] + np.where(run.t > 1.0, math.tau, 0.0)
    passed = replace(run, signals=run.signals.assign(chi=turned))
    assert residuals(counted, passed, lags) == expected


def test_a_disturbance_that_swings_comes_back_as_its_mean_over_each_sample(counted):
    lags = LAGS["second order, delay within a sample"], LAGS["first order, no delay"]
    found = residuals(counted, flown(lags, lambda t: (0.03 * np.sin(2.0 * t), 0.0)), lags)

    t = 0.02 * np.arange(101)
    means = np.diff(-0.015 * np.cos(2.0 * t)) / 0.02
    assert found[:, 0] == pytest.approx(means, abs=MICRO)
    assert found[:, 1] == pytest.approx(0.0, abs=MICRO)


def test_the_roll_of_another_lag_is_off_by_how_the_two_differ(counted):
    slow, fast = (ft.loop.InnerLag(order=1, natural_frequency=w) for w in (4.0, 6.0))
    load = LAGS["first order, no delay"]
    run = flown((slow, load))

    found = residuals(counted, run, (fast, load))

    # Both first-order lags, step by step.
    commands = run.signals["phi_cmd"].to_numpy()
    rolls = np.full((2, len(commands)), math.radians(5.0))
    for k in range(len(commands) - 1):
        left = np.exp(-0.02 * np.array([4.0, 6.0]))
        rolls[:, k + 1] = left * rolls[:, k] + (1.0 - left) * commands[k]
    beyond = rolls[0] - rolls[1]
    assert found[:, 2] == pytest.approx(beyond[:-1], abs=MICRO)
    assert found[:, 3] == pytest.approx(np.diff(beyond), abs=MICRO)
    assert np.abs(beyond).max() > 0.01


def test_a_model_without_speed_or_gravity_is_refused(counted):
    for name in ("V_a", "g"):
        with pytest.raises(ft.InputError, match=f"`{name}` must be positive"):
            replace(counted.model, **{name: 0.0})
