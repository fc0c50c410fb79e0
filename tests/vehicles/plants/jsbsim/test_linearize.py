"""The airframe's linearisation and modes against flight mechanics on paper."""

import math

import jsbsim
import numpy as np
import pytest
from airframes import fdm_of
from scipy.linalg import block_diag

import flighttune as ft
from flighttune.vehicles.plants.jsbsim.bench import CONTROLS
from flighttune.vehicles.plants.jsbsim.linearize import STATES, linearize, modes
from flighttune.vehicles.plants.jsbsim.trim import trim

JSBSIM_STATES = ("Vt", "Alpha", "Theta", "Q", "Beta", "Phi", "P", "R")

LEVEL = ft.loop.FlightCondition(V_a=25.0)
ROLL_APPROXIMATION = 0.1
"""Relative difference of the roll mode from its one-degree-of-freedom approximation."""
SHORT_PERIOD_APPROXIMATION = 0.05
SAME_MODE = 1e-3
"""Largest difference of an eigenvalue between two programs, 1/s."""


def linearized(aircraft, condition):
    return linearize(ft.loop.JSBSimPlant(aircraft).config, condition)


@pytest.fixture(scope="module")
def level():
    return linearized("aerosonde", LEVEL)


def mode(level, name):
    A, _ = level
    (motion,) = (mode for mode in modes(A) if mode["name"] == name)
    return motion


@pytest.mark.parametrize(("name", "V_a"), [("aerosonde", 25.0), ("c172p", 50.0)])
def test_has_the_five_modes_of_an_aircraft(name, V_a):
    A, _ = linearized(name, ft.loop.FlightCondition(V_a=V_a))

    names = [motion["name"] for motion in modes(A)]
    assert names == ["short period", "phugoid", "dutch roll", "roll", "spiral"]


def test_roll_mode_is_that_of_roll_damping(level):
    q, S, b, V, J_x = 0.5 * 1.1117 * 25.0**2, 0.55, 2.8956, 25.0, 0.8244

    expected = q * S * b / J_x * -0.51 * b / (2.0 * V)

    roll = mode(level, "roll")["eigenvalue_per_s"][0]
    assert roll == pytest.approx(expected, rel=ROLL_APPROXIMATION)


def test_short_period_is_that_of_its_two_by_two_approximation(level):
    rows = [STATES.index(name) for name in ("alpha", "q")]

    (expected, _) = np.linalg.eigvals(level[0][np.ix_(rows, rows)])

    motion = mode(level, "short period")
    size = motion["natural_frequency_rad_s"]
    assert size == pytest.approx(abs(expected), rel=SHORT_PERIOD_APPROXIMATION)
    assert 0.3 < motion["damping"] < 1.0


def test_phugoid_is_slow_and_hardly_damped(level):
    lanchester = math.sqrt(2.0) * 9.80665 / 25.0

    motion = mode(level, "phugoid")

    assert motion["natural_frequency_rad_s"] == pytest.approx(lanchester, rel=0.25)
    assert abs(motion["damping"]) < 0.2


def test_motions_without_oscillation_keep_their_place_and_pairs_have_one_name():
    real = np.diag([-5.0, -3.0, -0.1, 0.02])
    pairs = np.array([[-1.0, 5.0, 0.0, 0.0], [-5.0, -1.0, 0.0, 0.0],
                      [0.0, 0.0, -0.2, 0.6], [0.0, 0.0, -0.6, -0.2]])  # fmt: skip

    names = [[motion["name"] for motion in modes(block_diag(real, A))] for A in (real, pairs)]

    longitudinal = ["short period"] * 2 + ["phugoid"] * 2
    assert names[0] == [*longitudinal, "roll", "lateral", "lateral", "spiral"]
    assert names[1] == [*longitudinal, "dutch roll", "roll-spiral"]


@pytest.mark.parametrize("gamma", [0.0, 0.3])
def test_own_differences_give_the_modes_that_jsbsim_finds(gamma):
    condition = ft.loop.FlightCondition(V_a=25.0, gamma=gamma)
    own_A, own_B = linearized("aerosonde", condition)

    fdm = fdm_of("aerosonde")
    trim(fdm, condition)
    theirs = jsbsim.FGLinearization(fdm._exec)
    rows = [theirs.x_names.index(name) for name in JSBSIM_STATES]
    A = np.array(theirs.system_matrix)[np.ix_(rows, rows)]
    own, other = (np.sort_complex(np.linalg.eigvals(matrix)) for matrix in (own_A, A))
    assert own == pytest.approx(other, abs=SAME_MODE)
    assert own_B[STATES.index("p"), CONTROLS.index("aileron")] > 0.0
    assert own_B[STATES.index("q"), CONTROLS.index("elevator")] < 0.0


def test_a_condition_without_steady_flight_is_refused():
    with pytest.raises(ft.loop.PlantError, match="throttle closed"):
        linearized("aerosonde", ft.loop.FlightCondition(V_a=25.0, gamma=-0.5))
