"""The sampled loop against the continuous one, and against the controller flown by samples."""

import numpy as np
import pytest
from figures.sampling import sampled_eigenvalues, sampled_response

import flighttune as ft
from flighttune.control.inner_loop import with_inner_loop, with_input_delay
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


@pytest.mark.parametrize("gains", [ft.PAPER_GAINS, GAINS], ids=["paper", "own"])
def test_fast_sampling_is_the_continuous_loop(gains):
    continuous = np.sort_complex(np.linalg.eigvals(ft.closed_loop(MODEL, gains)))

    sampled = np.sort_complex(sampled_eigenvalues(MODEL, gains, 1e-5))

    assert sampled == pytest.approx(continuous, abs=1e-3)


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


def test_half_a_sample_of_delay_tells_the_loss_of_damping():
    dt = 0.02
    late = np.linalg.eigvals(ft.closed_loop(with_input_delay(MODEL, 0.5 * dt), ft.PAPER_GAINS))
    sampled = sampled_eigenvalues(MODEL, ft.PAPER_GAINS, dt)
    continuous = np.linalg.eigvals(ft.closed_loop(MODEL, ft.PAPER_GAINS))

    lost = max(sampled.real) - max(continuous.real)

    assert lost > 0.0
    assert max(late.real) - max(continuous.real) == pytest.approx(lost, rel=0.1)


def test_slow_sampling_destabilises_the_papers_gains_behind_a_lag():
    assert max(sampled_eigenvalues(MODEL, ft.PAPER_GAINS, 0.01).real) < 0.0
    assert max(sampled_eigenvalues(MODEL, ft.PAPER_GAINS, 0.5).real) > 0.0
