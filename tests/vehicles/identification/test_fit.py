"""Fitted lags against responses that are known in closed form."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.vehicles.identification.fit import fitted_lag, lag_response

DT = 0.02
T = np.arange(600) * DT
RECOVERED = 1e-4
"""Relative difference of a fitted parameter from the one that made the data."""


def commands(seed=2):
    """Steps of random height every 0.7 s."""
    heights = np.random.default_rng(seed).normal(size=20)
    return heights[(T / 0.7).astype(int)]


@pytest.mark.parametrize(
    "lag",
    [
        ft.loop.InnerLag(order=1, natural_frequency=6.0, delay=0.07),
        ft.loop.InnerLag(order=2, natural_frequency=9.0, damping=0.5, delay=0.033),
    ],
    ids=["first order", "second order"],
)
def test_the_lag_that_made_the_data_is_found(lag):
    commanded = commands()

    found, share = fitted_lag(T, commanded, lag_response(lag, DT, commanded, commanded[0]))

    assert found.order == lag.order
    assert found.natural_frequency == pytest.approx(lag.natural_frequency, rel=RECOVERED)
    assert found.delay == pytest.approx(lag.delay, rel=RECOVERED)
    if lag.order == 2:
        assert found.damping == pytest.approx(lag.damping, rel=RECOVERED)
    assert share == pytest.approx(100.0, abs=1e-6)


def test_noise_is_not_told_by_a_lag():
    lag, commanded = ft.loop.InnerLag(order=1, natural_frequency=6.0), commands()
    clean = lag_response(lag, DT, commanded, commanded[0])
    noise = np.random.default_rng(3).normal(scale=0.5 * np.std(clean), size=len(T))

    _, share = fitted_lag(T, commanded, clean + noise - noise[0], lag=lag)

    told = 100.0 * (1.0 - np.mean((noise - noise[0]) ** 2) / np.var(clean + noise))
    assert share == pytest.approx(told, abs=5.0)


def test_a_channel_that_was_not_commanded_shows_no_lag():
    still = np.ones(len(T))

    lag, share = fitted_lag(T, still, still)

    assert math.isnan(share)
    assert math.isnan(fitted_lag(T, still, still, lag=lag)[1])
