"""The mismatch of flights whose disturbance is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.errors import InputError
from flighttune.flight.fly import fly_once
from flighttune.guarantee.mismatch import mismatch
from flighttune.plants.point_mass import PointMassPlant
from flighttune.scenario import load_scenario
from flighttune.simulate.disturbance import Sinusoid

V_A, G = 25.0, 9.81
NOTHING = 1e-5
"""What the mean of cos(gamma) over an interval may be off by, rad/s."""
EXACT = 1e-9
SINUSOID = Sinusoid(chi_amplitude=0.03, chi_omega=0.8, gamma_amplitude=0.02, gamma_omega=0.8)


def flown(plant):
    return fly_once(
        load_scenario("paper"), plant, PAPER_GAINS, plant_label=plant.kind, gains_name="paper"
    )


def test_the_kinematic_law_has_no_mismatch_with_itself():
    found = mismatch(flown(PointMassPlant(turn="paper")))

    assert found.bound < NOTHING
    assert np.abs(found.d[:, 0]).max() < EXACT


def test_the_mismatch_of_a_disturbed_law_is_the_mean_of_its_disturbance():
    found = mismatch(flown(PointMassPlant(turn="paper", disturbance=SINUSOID)))

    ends = np.append(found.t, 20.0)
    chi = -0.03 / 0.8 * np.diff(np.cos(0.8 * ends)) / 0.02
    gamma = 0.02 / 0.8 * np.diff(np.sin(0.8 * ends)) / 0.02
    assert found.d[:, 0] == pytest.approx(chi, abs=EXACT)
    assert found.d[:, 1] == pytest.approx(gamma, abs=NOTHING)


def test_the_bound_of_the_derivative_is_that_of_the_disturbance():
    run = flown(PointMassPlant(turn="paper", disturbance=SINUSOID))
    settled = replace(run, signals=run.signals.iloc[100:])

    found = mismatch(settled)

    assert found.L_d == pytest.approx(SINUSOID.rate_bound, rel=2e-3)


def test_the_mismatch_of_the_point_mass_is_lift_that_the_law_does_not_know():
    run = flown(PointMassPlant())
    found = mismatch(run)

    phi, n_z = (run.signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    gamma = run.signals["gamma"].to_numpy()
    middle = 0.5 * (gamma[1:] + gamma[:-1])
    expected = G / V_A * (n_z * np.sin(phi) / np.cos(middle) - np.tan(phi))
    assert found.d[:, 0] == pytest.approx(expected, abs=2e-4)
    assert np.abs(found.d[:, 1]).max() < NOTHING


def test_gravity_of_another_size_is_mismatch():
    found = mismatch(flown(PointMassPlant(turn="paper", g=9.80665)))

    run = flown(PointMassPlant(turn="paper", g=9.80665))
    phi = run.signals["phi_cmd"].to_numpy()[:-1]
    expected = (9.80665 - G) / V_A * np.tan(phi)
    assert found.d[:, 0] == pytest.approx(expected, abs=EXACT)


def test_a_flight_of_three_samples_is_too_short():
    run = flown(PointMassPlant(turn="paper"))

    with pytest.raises(InputError, match=r"`run`.* 4 .* 3"):
        mismatch(replace(run, signals=run.signals.iloc[:3]))


def test_angles_are_continuous_where_a_course_passes_south():
    run = flown(PointMassPlant(turn="paper"))
    turned = run.signals.assign(chi=run.signals["chi"] + math.pi)

    found = mismatch(replace(run, signals=turned))

    assert found.bound < NOTHING
