"""The map of the sampled loop over a sample is what the plant flies, with its lags and delays."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.inner_loop import sampled_loop

V_a, DT = 25.0, 0.02

# Errors so small that the point mass is linear to 1e-5 of them, and its pieces to 1e-3.
SMALL, NEAR = 1e-4, 2e-3

LAGS = (
    ft.loop.InnerLag(order=2, natural_frequency=6.0, damping=0.7, delay=0.025),
    ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.6, lag=0.05, delay=0.0),
)
LATE = (
    ft.loop.InnerLag(order=1, natural_frequency=4.0, delay=0.06),
    ft.loop.InnerLag(order=1, natural_frequency=5.0, delay=0.013),
)


def flown(law, lags, steps):
    """Errors of course and path angle at the samples of a flight of the point mass behind lags."""
    plant = ft.loop.LaggedPlant(ft.loop.PointMassPlant(), lags)
    start = ft.loop.FlightCondition(V_a=V_a)
    plant.start(start)
    law.start(start)
    names = list(plant.signals)
    errors = []
    for k in range(steps):
        seen = dict(zip(names, plant.observe(), strict=True))
        errors.append((SMALL - seen["chi"], -2.0 * SMALL - seen["gamma"]))
        state = ft.loop.Measured(
            seen["chi"], seen["gamma"], V_a, seen["phi"], seen["n_z"], 1000.0, (0.0, 0.0, 0.0), None
        )
        reference = ft.loop.ReferenceSample(chi=SMALL, gamma=-2.0 * SMALL)
        phi, n_z, *_ = law.step(state, reference, k * DT)
        plant.advance(phi, n_z, DT)
    return np.array(errors)


def mapped(loop, steps, first):
    state = np.zeros(len(loop))
    state[:2] = SMALL, -2.0 * SMALL
    state[-2:] = first * state[:2]
    errors = []
    for _ in range(steps):
        errors.append(state[:2])
        state = loop @ state
    return np.array(errors)


@pytest.mark.parametrize("lags", [LAGS, LATE])
def test_the_paper_s_law_flies_the_map_of_its_loop(lags):
    gains = ft.PIGains(K_P=[[2.0, 0.0], [0.0, 2.5]], K_I=[[1.0, 0.0], [0.0, 1.5]])
    model = ft.loop.kinematic_model(V_a=V_a, gamma=0.0, g=9.81)
    law = ft.loop.MimoPI(gains, dt=DT, feed_forward=True)

    loop, _ = sampled_loop(model, lags, gains, dt=DT)

    # The law integrates nothing over its first sample: as after an error of the other sign.
    flight = flown(law, lags, 150)
    assert np.abs(flight - mapped(loop, 150, -1.0)).max() < NEAR * SMALL


@pytest.mark.parametrize("feedback", [(0.0, 0.0), (0.5, 0.3)])
@pytest.mark.parametrize("lags", [LAGS, LATE])
def test_the_exact_law_flies_the_map_of_its_loop(lags, feedback):
    gains = replace(ft.loop.rate_gains(ft.PAPER_GAINS, V_a=V_a), feedback=feedback)
    law = ft.loop.ExactLaw(gains, dt=DT, g=9.81, braking=None)

    loop, _ = sampled_loop(law.linear()[0], lags, gains, dt=DT, trapezoidal=False)

    flight = flown(law, lags, 150)
    assert np.abs(flight - mapped(loop, 150, 0.0)).max() < NEAR * SMALL
