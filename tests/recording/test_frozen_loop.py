"""The loop linearised along a flight, against the Jacobians at single instants."""

import numpy as np
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import closed_loop, kinematic_model
from flighttune.recording.eigenvalue_tab import frozen_loop
from flighttune.theory.indicators import indicators
from flighttune.units import G_PAPER

from .conftest import V_A, fly


def test_frozen_eigenvalues_are_those_of_the_jacobian_at_the_flight_condition():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=4.0)

    found = frozen_loop(run)

    for k in (0, 77, 150):
        at = run.signals.iloc[k]
        model = kinematic_model(V_a=V_A, gamma=at.gamma, phi=at.phi, n_z=at.n_z, g=G_PAPER)
        wanted = np.linalg.eigvals(closed_loop(model, PAPER_GAINS))
        assert np.sort_complex(found.eigenvalues[k]) == pytest.approx(np.sort_complex(wanted))
        assert found.abscissa[k] == pytest.approx(wanted.real.max())
        assert found.damping[k] == pytest.approx((-wanted.real / np.abs(wanted)).min())


def test_the_loop_at_the_trim_is_that_of_the_indicators():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    model = kinematic_model(V_a=V_A, gamma=np.deg2rad(30.0), g=G_PAPER)
    wanted = indicators(closed_loop(model, PAPER_GAINS)).eigenvalues

    assert np.sort_complex(frozen_loop(run).trim) == pytest.approx(np.sort_complex(wanted))
