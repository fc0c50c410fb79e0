"""The optimisation model of arXiv 2411.13140 with the numbers of its section 4."""

import numpy as np
import pytest

import flighttune as ft

ALL_LIMITS = ("phi", "n_z", "phi_rate", "n_z_rate")


@pytest.fixture(scope="session")
def model():
    return ft.loop.kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)


@pytest.fixture(scope="session")
def printed(model):
    """With every input limit of the paper, and I* = 5 (which it never prints)."""
    limits = ft.loop.Limits(
        lower=np.array([-np.pi / 4.0, -2.1]),
        upper=np.array([np.pi / 4.0, 2.1]),
        rate_lower=np.array([-np.pi / 6.0, -1.0]),
        rate_upper=np.array([np.pi / 6.0, 1.0]),
    )
    x_0 = np.array([-np.pi / 3.0, -np.pi / 6.0])
    return ft.loop.TuningProblem(model=model, I_star=5.0, limits=limits, x_0=x_0)
