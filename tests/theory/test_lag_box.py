"""Rates over boxes of lags and delays, against eigenvalues on dense grids and against flights."""

import itertools

import numpy as np
import pytest
from scipy.linalg import expm

from flighttune.theory.lag_box import constant_rate, constant_rate_proven, norm_rate

# Relative distance below the least rate over the points of a grid: four digits.
FOUR_DIGITS = 5e-5

# Relative excess over the same, by the part of the box between two points.
BETWEEN_POINTS = 1e-6

# Least share of the rate for constant lags that a norm has however they change: those of boxes
# over which R_K's gains were counted.
SHARE = 0.93

# K_P (1/s), K_I (1/s^2) and inner feedback of a channel of the exact law.
LARGEST_R_K, FASTEST, FED_BACK = (1.526, 0.861, 0.0), (2.349, 1.949, 0.0), (1.9, 1.2, 0.5)

LAW = ((0.0, 0.0), (1.0, 1.0))  # of e' = -y
LAGS = {
    "twelve conditions": ((0.13, 0.22), (0.0, 0.0), *LAW),
    "threefold": ((0.2, 0.6), (0.0, 0.0), *LAW),
    "lag and delay": ((0.13, 0.19), (0.01, 0.03), *LAW),
    "climb and airspeed": ((0.13, 0.19), (0.02, 0.02), (0.0, 0.2), (0.8, 1.1)),
}


def slowest_root(gains, lag, delay, a, b):
    """Slowest pole of e' = a e - b G u behind the inner feedback, G the lag and Pade section."""
    K_P, K_I, k = gains
    late, pole = [-delay / 2.0, 1.0], np.polymul([delay / 2.0, 1.0], [lag, 1.0])
    closed = np.polyadd(pole, k * np.array(late))  # y = (1 + k) late / closed u
    loop = np.polymul(np.polymul([1.0, -a], [1.0, 0.0]), closed)
    return -np.roots(
        np.trim_zeros(np.polyadd(loop, b * (1.0 + k) * np.polymul(late, [K_P, K_I])), "f")
    ).real.max()


def least_on_a_grid(gains, box):
    width = [ends[0] < ends[1] for ends in box]
    count = {1: 501, 2: 21, 3: 9}[sum(width)]
    axes = [np.linspace(*ends, count if wide else 1) for ends, wide in zip(box, width, strict=True)]
    return min(slowest_root(gains, *point) for point in itertools.product(*axes))


@pytest.mark.slow
@pytest.mark.parametrize("box", LAGS)
@pytest.mark.parametrize("gains", [LARGEST_R_K, FASTEST, FED_BACK])
def test_the_rate_for_constant_lags_is_the_least_of_a_dense_grid(gains, box):
    least = least_on_a_grid(gains, LAGS[box])

    rate = constant_rate(gains, LAGS[box])

    assert (1.0 - FOUR_DIGITS) * least < rate < (1.0 + BETWEEN_POINTS) * least
    assert constant_rate_proven(gains, LAGS[box], rate)
    assert not constant_rate_proven(gains, LAGS[box], (1.0 + FOUR_DIGITS) * least)


def test_a_channel_that_some_lag_makes_unstable_has_no_rate():
    # lag s^3 + s^2 + K_P s + K_I is stable up to a lag of K_P / K_I.
    gains = 1.0, 1.0, 0.0

    assert constant_rate(gains, ((0.2, 0.99), (0.0, 0.0), *LAW)) > 0.0
    assert constant_rate(gains, ((0.2, 1.01), (0.0, 0.0), *LAW)) == 0.0


def loop(gains, lag, delay, a, b):
    """States e, xi, y and what is delayed, as the equations read."""
    K_P, K_I, k = gains
    u = np.array([(1.0 + k) * K_P, (1.0 + k) * K_I, -k, 0.0])
    e, _, y, z = np.eye(4)
    return np.array([a * e - b * y, e, (2.0 * z - u - y) / lag, 2.0 * (u - z) / delay])


@pytest.mark.slow
@pytest.mark.parametrize("gains", [LARGEST_R_K, FASTEST, FED_BACK])
def test_the_norm_falls_at_its_rate_however_lag_and_delay_switch(gains):
    box = LAGS["lag and delay"]
    constant = constant_rate(gains, box)

    rate, Q = norm_rate(gains, box, constant)

    rng = np.random.default_rng(1)
    x = np.eye(4)
    for _ in range(60):
        dt = rng.uniform(0.001, 0.3)
        points = [[rng.choice(ends) for ends in box], [rng.uniform(*ends) for ends in box]]
        ends = [expm(dt * loop(gains, *point)) @ x for point in points]
        bound = np.exp(-rate * dt) * np.sqrt(np.einsum("ij,ik,kj->j", x, Q, x))
        for end in ends:
            assert (np.sqrt(np.einsum("ij,ik,kj->j", end, Q, end)) <= bound).all()
        x = ends[0] / np.linalg.norm(ends[0], axis=0)
    assert SHARE * constant < rate <= constant


def test_a_norm_that_no_change_of_the_lag_breaks_may_be_slower_than_constant_lags():
    box = LAGS["threefold"]
    constant = constant_rate(FASTEST, box)

    rate, _ = norm_rate(FASTEST, box, constant)

    assert constant == pytest.approx(1.0 / 3.0, rel=FOUR_DIGITS)
    assert 0.5 * constant < rate < SHARE * constant
