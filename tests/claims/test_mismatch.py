"""The mismatch of flights whose disturbance is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune import load_scenario
from flighttune.flight.fly import fly_once
from flighttune.gaps.residual import mismatch
from flighttune.simulate.disturbance import Sinusoid

V_A, G = 25.0, 9.81
NOTHING = 1e-5
"""What the mean of cos(gamma) over an interval may be off by, rad/s."""
EXACT = 1e-9
SINUSOID = Sinusoid(chi_amplitude=0.03, chi_omega=0.8, gamma_amplitude=0.02, gamma_omega=0.8)


def flown(plant):
    return fly_once(
        load_scenario("paper"), plant, ft.PAPER_GAINS, plant_label=plant.kind, gains_name="paper"
    )


@pytest.fixture(scope="module")
def undisturbed():
    return flown(ft.loop.PointMassPlant(turn="paper"))


@pytest.mark.parametrize("turned", [0.0, math.pi])  # courses run on through south
def test_the_kinematic_law_has_no_mismatch_with_itself(undisturbed, turned):
    signals = undisturbed.signals.assign(chi=undisturbed.signals["chi"] + turned)

    found = mismatch(replace(undisturbed, signals=signals))

    assert found.bound < NOTHING
    assert np.abs(found.d[:, 0]).max() < EXACT


def test_the_mismatch_of_a_disturbed_law_is_the_mean_of_its_disturbance():
    found = mismatch(flown(ft.loop.PointMassPlant(turn="paper", disturbance=SINUSOID)))

    ends = np.append(found.t, 20.0)
    chi = -0.03 / 0.8 * np.diff(np.cos(0.8 * ends)) / 0.02
    gamma = 0.02 / 0.8 * np.diff(np.sin(0.8 * ends)) / 0.02
    assert found.d[:, 0] == pytest.approx(chi, abs=EXACT)
    assert found.d[:, 1] == pytest.approx(gamma, abs=NOTHING)
    settled = found.d_dot[100:]
    assert np.linalg.norm(settled, axis=1).max() == pytest.approx(SINUSOID.rate_bound, rel=2e-3)


def test_the_mismatch_of_the_point_mass_is_lift_that_the_law_does_not_know():
    run = flown(ft.loop.PointMassPlant())
    found = mismatch(run)

    phi, n_z = (run.signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    gamma = run.signals["gamma"].to_numpy()
    middle = 0.5 * (gamma[1:] + gamma[:-1])
    expected = G / V_A * (n_z * np.sin(phi) / np.cos(middle) - np.tan(phi))
    assert found.d[:, 0] == pytest.approx(expected, abs=2e-4)
    assert np.abs(found.d[:, 1]).max() < NOTHING


def test_a_flight_of_three_samples_is_too_short(undisturbed):
    with pytest.raises(ft.InputError, match=r"`run`.* 4 .* 3"):
        mismatch(replace(undisturbed, signals=undisturbed.signals.iloc[:3]))
