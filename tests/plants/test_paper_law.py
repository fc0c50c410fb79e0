"""The paper's law against flight conditions whose answer is known on paper."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flighttune.errors import InputError
from flighttune.plants.base import FlightCondition
from flighttune.plants.point_mass import PointMassPlant, turn_rates
from flighttune.simulate.disturbance import Sinusoid

MICRODEGREE_PER_S = np.deg2rad(1e-6)
INTEGRATION = 1e-9
LEVEL = FlightCondition(V_a=25.0)


@pytest.mark.parametrize("phi", np.deg2rad([-60.0, -15.0, 0.0, 30.0, 75.0]))
def test_level_turn_keeps_height_and_turns_at_g_tan_phi_over_v(phi):
    chi_dot, gamma_dot = turn_rates(45.0, gamma=0.0, phi=phi, n_z=1.0 / np.cos(phi))

    assert gamma_dot == pytest.approx(0.0, abs=MICRODEGREE_PER_S)
    assert chi_dot == pytest.approx(9.81 * np.tan(phi) / 45.0, abs=MICRODEGREE_PER_S)


def test_held_commands_and_disturbance_agree_with_high_accuracy_integration():
    sinusoid = Sinusoid(chi_amplitude=0.1, chi_omega=0.9, gamma_amplitude=0.2, gamma_omega=1.7)
    plant = PointMassPlant(turn="paper", disturbance=sinusoid)
    plant.start(FlightCondition(V_a=25.0, chi=1.0, gamma=0.5))
    phi, n_z = 0.4, 1.2

    for _ in range(100):
        plant.advance(phi, n_z, 0.1)

    def law(t, x):
        chi_dot = 9.81 * np.tan(phi) / 25.0 + 0.1 * np.sin(0.9 * t)
        gamma_dot = 9.81 * (n_z * np.cos(phi) - np.cos(x[1])) / 25.0 + 0.2 * np.cos(1.7 * t)
        return [chi_dot, gamma_dot]

    exact = solve_ivp(law, (0.0, 10.0), [1.0, 0.5], rtol=1e-12, atol=1e-12).y[:, -1]
    assert plant.observe()[:2] == pytest.approx(exact, abs=INTEGRATION)


@pytest.mark.parametrize("phi", [math.pi / 2, -1.7, math.nan])
def test_a_roll_command_without_tangent_ends_the_flight_with_a_reason(phi):
    plant = PointMassPlant(turn="paper")
    plant.start(LEVEL)

    stop = plant.advance(phi, 1.0, 0.02)

    assert stop is not None
    assert stop.status == "diverged"
    assert "t = 0.00 s" in stop.reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"V_a": -25.0}, r"`V_a` must be positive, got -25\.0 m/s"),
        ({"gamma": 1.6}, r"`gamma` must lie inside \+-pi/2, got 1\.6 rad"),
        ({"phi": math.pi}, r"`phi` must lie inside \+-pi/2"),
        ({"chi": math.inf}, r"`chi` must be finite"),
        ({"n_z": math.nan}, r"`n_z` must be finite"),
    ],
)
def test_flight_conditions_that_cannot_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        FlightCondition(**{"V_a": 25.0, **change})
