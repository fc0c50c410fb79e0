"""The sampled loop of a figure against the controller flown by samples."""

import numpy as np
import pytest
from figures.sampling import sampled_response

import flighttune as ft
from flighttune.control.inner_loop import with_inner_loop
from flighttune.simulate.loop import simulate

LAW = ft.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
LAGS = (
    ft.InnerLag(order=1, natural_frequency=4.0),
    ft.InnerLag(order=2, natural_frequency=8.0, damping=0.7),
)
MODEL = with_inner_loop(LAW, LAGS)
GAINS = ft.PIGains(K_P=np.diag([3.0, 3.0]), K_I=np.diag([1.0, 1.0]))

SMALL = 1e-4
"""Step of the references, rad: small enough for the plant to be linear."""
OF_THE_STEP = 1e-3
"""Largest difference from the plant, over the step."""


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_the_response_is_that_of_the_controller_on_the_plant(rate):
    signals, _ = simulate(
        ft.PointMassPlant(LAGS),
        ft.MimoPI(GAINS, dt=1.0 / rate, feed_forward=True),
        ft.Reference(chi=SMALL, gamma=SMALL),
        condition=ft.FlightCondition(V_a=25.0),
        duration=6.0,
    )
    flown = signals[["chi_err", "gamma_err"]].to_numpy() / SMALL

    response = sampled_response(MODEL, GAINS, 1.0 / rate, e_0=[1.0, 1.0], samples=len(flown))

    assert response == pytest.approx(flown, abs=OF_THE_STEP)
