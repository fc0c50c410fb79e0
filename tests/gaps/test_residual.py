"""Residuals and mismatch of flights whose disturbance is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.gaps import residual

MICRO = 1e-6
"""Rates agree to this, rad/s: both sides integrate by the classical Runge-Kutta rule."""

SCENARIO = made_up_scenario(
    flight={"gamma_deg": 30.0, "phi_deg": 5.0, "duration_s": 4.0},
    reference={"chi_deg": 20.0, "gamma_deg": 20.0},
    limits={"phi_deg": [-30.0, 30.0], "phi_rate_dps": 40.0, "n_z_rate_per_s": 1.0},
    controller={"feed_forward": True},
)
START = ft.loop.FlightCondition(V_a=25.0, gamma=math.pi / 6.0, phi=math.radians(5.0), h=1000.0)
LAGS = {
    "first order, no delay": ft.loop.InnerLag(order=1, natural_frequency=6.0),
    "second order, delay within a sample": ft.loop.InnerLag(
        order=2, natural_frequency=9.0, damping=0.7, delay=0.013
    ),
    "third order, delay of samples and a part": ft.loop.InnerLag(
        order=3, natural_frequency=12.0, damping=0.8, lag=0.1, delay=0.047
    ),
}


def flown(scenario, plant):
    return ft.fly(scenario, "paper", plants={"own": lambda: plant})["own / paper"]


def residuals(lags, disturbance):
    plant = ft.loop.PointMassPlant(lags, disturbance=disturbance, g=SCENARIO.flight.g_mps2)
    run = flown(SCENARIO, plant)
    model = residual.ConformantModel(V_a=25.0, g=SCENARIO.flight.g_mps2, lags=lags)
    return residual.residuals_of(model, run.signals, START)


@pytest.mark.parametrize(("roll", "load"), [*zip(LAGS, [*LAGS][::-1], strict=True)])
def test_a_constant_disturbance_comes_back(roll, load):
    found = residuals((LAGS[roll], LAGS[load]), lambda t: (0.01, -0.02))

    assert found == pytest.approx(np.tile([0.01, -0.02, 0.0, 0.0], (200, 1)), abs=MICRO)


def test_a_disturbance_that_swings_comes_back_as_its_mean_over_each_sample():
    lags = LAGS["second order, delay within a sample"], LAGS["first order, no delay"]
    found = residuals(lags, lambda t: (0.03 * np.sin(2.0 * t), 0.0))

    t = 0.02 * np.arange(201)
    means = np.diff(-0.015 * np.cos(2.0 * t)) / 0.02
    assert found[:, 0] == pytest.approx(means, abs=MICRO)
    assert found[:, 1] == pytest.approx(0.0, abs=MICRO)


def test_the_roll_of_another_lag_is_off_by_how_the_two_differ():
    slow, fast = (ft.loop.InnerLag(order=1, natural_frequency=w) for w in (4.0, 6.0))
    load = LAGS["first order, no delay"]
    plant = ft.loop.PointMassPlant((slow, load), g=SCENARIO.flight.g_mps2)
    run = flown(SCENARIO, plant)
    model = residual.ConformantModel(V_a=25.0, g=SCENARIO.flight.g_mps2, lags=(fast, load))

    found = residual.residuals_of(model, run.signals, START)

    # Both first-order lags, step by step.
    commands = run.signals["phi_cmd"].to_numpy()
    rolls = np.full((2, len(commands)), START.phi)
    for k in range(len(commands) - 1):
        left = np.exp(-0.02 * np.array([4.0, 6.0]))
        rolls[:, k + 1] = left * rolls[:, k] + (1.0 - left) * commands[k]
    beyond = rolls[0] - rolls[1]
    assert found[:, 2] == pytest.approx(beyond[:-1], abs=MICRO)
    assert found[:, 3] == pytest.approx(np.diff(beyond), abs=MICRO)
    assert np.abs(beyond).max() > 0.01


def test_the_course_may_pass_north():
    lags = (ft.loop.InnerLag(order=1, natural_frequency=6.0),) * 2
    model = residual.ConformantModel(V_a=25.0, g=9.81, lags=lags)
    chi = np.deg2rad([359.0, 359.5, 0.0, 0.5])
    level = np.column_stack([chi, np.zeros(4)]), np.column_stack([np.zeros(4), np.ones(4)])

    found = residual.residual_rates(model, 0.02, *level, (0.0, 1.0))

    assert found[:, 0] == pytest.approx(np.deg2rad(0.5) / 0.02, abs=MICRO)


PAPER, V_A, G = ft.load_scenario("paper"), 25.0, 9.81
NOTHING = 1e-5
"""What the mean of cos(gamma) over an interval may be off by, rad/s."""
EXACT = 1e-9


@pytest.fixture(scope="module")
def undisturbed():
    return flown(PAPER, ft.loop.PointMassPlant(turn="paper"))


@pytest.mark.parametrize("turned", [0.0, math.pi])  # courses run on through south
def test_the_kinematic_law_has_no_mismatch_with_itself(undisturbed, turned):
    signals = undisturbed.signals.assign(chi=undisturbed.signals["chi"] + turned)

    found = residual.mismatch(replace(undisturbed, signals=signals))

    assert found.bound < NOTHING
    assert np.abs(found.d[:, 0]).max() < EXACT


def test_the_mismatch_of_a_disturbed_law_is_the_mean_of_its_disturbance():
    def disturbance(t):
        return 0.03 * math.sin(0.8 * t), 0.02 * math.cos(0.8 * t)

    plant = ft.loop.PointMassPlant(turn="paper", disturbance=disturbance)
    found = residual.mismatch(flown(PAPER, plant))

    ends = np.append(found.t, 20.0)
    chi = -0.03 / 0.8 * np.diff(np.cos(0.8 * ends)) / 0.02
    gamma = 0.02 / 0.8 * np.diff(np.sin(0.8 * ends)) / 0.02
    assert found.d[:, 0] == pytest.approx(chi, abs=EXACT)
    assert found.d[:, 1] == pytest.approx(gamma, abs=NOTHING)
    settled = found.d_dot[100:]
    assert np.linalg.norm(settled, axis=1).max() == pytest.approx(0.8 * 0.03, rel=2e-3)


def test_the_mismatch_of_the_point_mass_is_lift_that_the_law_does_not_know():
    run = flown(PAPER, ft.loop.PointMassPlant())
    found = residual.mismatch(run)

    phi, n_z = (run.signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    gamma = run.signals["gamma"].to_numpy()
    middle = 0.5 * (gamma[1:] + gamma[:-1])
    expected = G / V_A * (n_z * np.sin(phi) / np.cos(middle) - np.tan(phi))
    assert found.d[:, 0] == pytest.approx(expected, abs=2e-4)
    assert np.abs(found.d[:, 1]).max() < NOTHING


def test_bounds_of_a_mismatch_are_its_largest_norms():
    d = np.array([[0.0, 0.1], [0.03, -0.04], [-0.12, 0.05]])
    d_dot = np.array([[0.3, -0.4], [-0.5, -1.2]])

    found = residual.Mismatch(t=np.arange(3.0), d=d, d_dot=d_dot)

    assert found.bound == pytest.approx(0.13)
    assert found.L_d == pytest.approx(1.3)


def test_the_exact_law_has_no_mismatch_with_the_point_mass():
    scenario = ft.scenario_from(SCENARIO.as_dict() | {"law": ["exact"]})
    (run,) = ft.fly(scenario, plants={"own": lambda: ft.loop.PointMassPlant(g=9.81)}).runs[-1:]

    found = residual.mismatch(run)

    assert np.ptp(run.signals["gamma"]) > 0.1
    assert np.ptp(run.signals["phi_cmd"]) > 0.1
    assert found.bound < 2e-4
