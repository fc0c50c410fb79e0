"""Lags against their transfer functions, and a flight behind them to its end."""

import math
import re

import numpy as np
import pytest
from printed import MODEL
from scipy.integrate import quad

import flighttune as ft
from flighttune.control import inner_loop

ROUNDING = 1e-12
SLOW, FAST = (
    ft.loop.InnerLag(order=2, natural_frequency=6.0, damping=0.7),
    ft.loop.InnerLag(order=3, natural_frequency=12.0, damping=0.4, lag=0.1, delay=0.05),
)


def test_the_response_is_exact_in_the_delay():
    omega = np.array([0.5, 3.0, 9.0])
    s = 1j * omega

    expected = np.exp(-0.05 * s) * 144.0 / (s * s + 9.6 * s + 144.0) / (1.0 + 0.1 * s)

    assert FAST.response(omega) == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize(
    ("order", "damping", "bandwidth"),
    [(1, 1.0, 5.0), (2, math.sqrt(0.5), 5.0), (2, 1.0, 5.0 * math.sqrt(math.sqrt(2) - 1))],
)
def test_bandwidth_is_where_half_the_power_is_lost(order, damping, bandwidth):
    lag = ft.loop.InnerLag(order=order, natural_frequency=5.0, damping=damping, delay=0.3)

    assert lag.bandwidth == pytest.approx(bandwidth, rel=1e-9)


FIRST = ft.loop.InnerLag(order=1, natural_frequency=5.0, delay=0.3)


@pytest.mark.parametrize(
    ("lag", "seconds"), [(FIRST, 0.2 + 0.3), (SLOW, 1.4 / 6.0), (FAST, 0.8 / 12.0 + 0.1 + 0.05)]
)
def test_a_ramp_is_followed_late_by_all_lags_and_the_delay(lag, seconds):
    """That is the slope of the phase at low frequencies."""
    assert lag.whole == pytest.approx(seconds)
    assert -np.angle(lag.response(1e-4)) / 1e-4 == pytest.approx(seconds, rel=1e-6)
    assert lag.delayed(0.07).whole == pytest.approx(seconds + 0.07)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ft.loop.InnerLag(order=4, natural_frequency=1.0), "`order` must be 1, 2"),
        (lambda: inner_loop.with_inner_loop(MODEL, (SLOW,)), "`lags` must be 2"),
        (lambda: inner_loop.with_input_lag(MODEL, [4.0, 0.0]), "`bandwidths` must be positive"),
    ],
    ids=["order", "one lag", "bandwidth"],
)
def test_impossible_lags_are_refused(made, words):
    with pytest.raises(ft.InputError, match=words):
        made()


def test_a_flight_behind_lags_ends_where_its_plant_does():
    """A pull of 4 g stands vertical after ``V/g`` times the integral of ``1/(4 - cos gamma)``."""
    fast = ft.loop.InnerLag(order=1, natural_frequency=500.0)
    plant = ft.loop.LaggedPlant(ft.loop.PointMassPlant(), (fast, fast))
    plant.start(ft.loop.FlightCondition(V_a=25.0))
    upright = quad(lambda gamma: 25.0 / 9.80665 / (4.0 - math.cos(gamma)), 0.0, 0.5 * math.pi)[0]

    assert plant.advance(0.0, 4.0, 0.95 * upright) is None
    stop = plant.advance(0.0, 4.0, 1.0)

    assert stop.status == "left_envelope"
    (t,) = re.search(r"at t = ([\d.]+) s", stop.reason).groups()
    assert float(t) == pytest.approx(upright, abs=0.02)  # s: of a lag of 2 ms, in pieces of 10 ms
