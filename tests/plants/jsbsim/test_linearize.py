"""The airframe's linearisation and modes against flight mechanics on paper."""

import math

import jsbsim
import numpy as np
import pytest

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.errors import TrimError
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.bench import CONTROLS
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.linearize import (
    STATES,
    lateral_modes,
    linearize,
    longitudinal_modes,
)
from flighttune.plants.jsbsim.trim import trim

JSBSIM_STATES = ("Vt", "Alpha", "Theta", "Q", "Beta", "Phi", "P", "R")

LEVEL = FlightCondition(V_a=25.0)
ROLL_APPROXIMATION = 0.1
"""Relative difference of the roll mode from its one-degree-of-freedom approximation."""
SHORT_PERIOD_APPROXIMATION = 0.05
SAME_MODE = 1e-3
"""Largest difference of an eigenvalue between two programs, 1/s."""


@pytest.fixture(scope="module")
def level():
    return linearize(load_aircraft("aerosonde"), LEVEL)


def mode(model, name):
    (found,) = (m for m in model.modes if m.name == name)
    return found


def test_has_the_five_modes_of_an_aircraft(level):
    names = [m.name for m in level.modes]

    assert names == ["short period", "phugoid", "dutch roll", "roll", "spiral"]


def test_roll_mode_is_that_of_roll_damping(level):
    q, S, b, V, J_x = 0.5 * 1.1117 * 25.0**2, 0.55, 2.8956, 25.0, 0.8244

    expected = q * S * b / J_x * -0.51 * b / (2.0 * V)

    assert mode(level, "roll").eigenvalue.real == pytest.approx(expected, rel=ROLL_APPROXIMATION)


def test_short_period_is_that_of_its_two_by_two_approximation(level):
    rows = [STATES.index(name) for name in ("alpha", "q")]

    (expected, _) = np.linalg.eigvals(level.A[np.ix_(rows, rows)])

    found = mode(level, "short period")
    assert found.natural_frequency == pytest.approx(abs(expected), rel=SHORT_PERIOD_APPROXIMATION)
    assert 0.3 < found.damping < 1.0


def test_phugoid_is_slow_and_hardly_damped(level):
    lanchester = math.sqrt(2.0) * 9.80665 / 25.0

    found = mode(level, "phugoid")

    assert found.natural_frequency == pytest.approx(lanchester, rel=0.25)
    assert abs(found.damping) < 0.2


def test_modes_without_oscillation_keep_their_place():
    A = np.diag([-5.0, -3.0, -0.1, 0.02])

    assert [m.name for m in longitudinal_modes(A)] == ["short period"] * 2 + ["phugoid"] * 2
    assert [m.name for m in lateral_modes(A)] == ["roll", "lateral", "lateral", "spiral"]


def test_roll_and_spiral_that_swing_together_are_named_so():
    pairs = np.array([[-1.0, 5.0, 0.0, 0.0], [-5.0, -1.0, 0.0, 0.0],
                      [0.0, 0.0, -0.2, 0.6], [0.0, 0.0, -0.6, -0.2]])  # fmt: skip

    assert [m.name for m in lateral_modes(pairs)] == ["dutch roll", "roll-spiral"]


@pytest.mark.parametrize("gamma", [0.0, 0.3])
def test_own_differences_give_the_modes_that_jsbsim_finds(gamma):
    config, condition = load_aircraft("aerosonde"), FlightCondition(V_a=25.0, gamma=gamma)
    found = linearize(config, condition)

    fdm = Fdm(config)
    trim(fdm, condition)
    theirs = jsbsim.FGLinearization(fdm._exec)
    rows = [theirs.x_names.index(name) for name in JSBSIM_STATES]
    A = np.array(theirs.system_matrix)[np.ix_(rows, rows)]
    assert np.sort_complex(np.linalg.eigvals(found.A)) == pytest.approx(
        np.sort_complex(np.linalg.eigvals(A)), abs=SAME_MODE
    )
    assert found.B[STATES.index("p"), CONTROLS.index("aileron")] > 0.0
    assert found.B[STATES.index("q"), CONTROLS.index("elevator")] < 0.0


def test_an_engine_that_takes_its_time_is_no_obstacle():
    names = [m.name for m in linearize(load_aircraft("c172p"), FlightCondition(V_a=50.0)).modes]

    assert names == ["short period", "phugoid", "dutch roll", "roll", "spiral"]


def test_a_condition_without_steady_flight_is_refused():
    with pytest.raises(TrimError, match="throttle closed"):
        linearize(load_aircraft("aerosonde"), FlightCondition(V_a=25.0, gamma=-0.5))
