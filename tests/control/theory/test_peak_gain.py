"""Peak gains: closed forms, quadratures by SciPy, and inputs that attain them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import flighttune as ft
from flighttune.control.theory.exact import exact, provable_rate
from flighttune.control.theory.lyapunov import lyapunov_solution
from flighttune.control.theory.peak_gain import peak_gains

CLOSED_FORM = 2e-6  # relative: what is left when the response is no longer followed
QUADRATURE = 1e-4  # relative, of the trapezoidal rule below


def enclosed(A, b, c):
    A = np.array(A, dtype=float)
    proven = provable_rate((exact(A),), lyapunov_solution(A))
    assert proven is not None
    Q, rate = proven
    return peak_gains(exact(A), exact(np.array(b)), exact(np.array(c)), Q, rate=rate)


def test_a_first_order_lag_never_exceeds_its_input():
    gains = enclosed([[-2.5]], [[2.5]], [[1.0]])

    assert gains.lower == pytest.approx(1.0, rel=CLOSED_FORM)
    assert gains.lower <= 1.0 <= gains.upper


def test_a_poorly_damped_loop_by_the_series_of_its_half_periods():
    """h = exp(-a t) sin(w t) has the integral w / (a^2 + w^2) coth(pi a / (2 w)) of its size."""
    a, w = 0.3, 4.0
    expected = w / (a * a + w * w) / math.tanh(math.pi * a / (2.0 * w))

    gains = enclosed([[-a, w], [-w, -a]], [[0.0], [1.0]], [[1.0, 0.0]])

    assert gains.lower <= expected <= gains.upper
    assert gains.upper == pytest.approx(expected, rel=CLOSED_FORM)


@pytest.mark.soak
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 6))
def test_the_enclosure_agrees_with_a_quadrature(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
    b, c = rng.normal(size=(n, 2)), rng.normal(size=(2, n))
    dt, states, total = 0.002, b, np.zeros((2, 2))
    over = expm(A * dt)
    for k in range(20_000):
        total = total + np.abs(c @ states) * dt * (0.5 if k == 0 else 1.0)
        states = over @ states

    lower, upper = enclosed(A, b, c)

    assert lower == pytest.approx(total, rel=QUADRATURE, abs=QUADRATURE)
    assert (lower <= upper).all()
    assert upper == pytest.approx(lower, rel=CLOSED_FORM, abs=CLOSED_FORM * total.max())


@pytest.mark.soak
def test_a_loop_whose_slowest_mode_outlasts_its_fastest_ones_steps_is_refused():
    with pytest.raises(ft.InputError, match=r"must decay within \d+ steps"):
        enclosed([[-1e-6, 0.0], [0.0, -1e4]], [[1.0], [1.0]], [[1.0, 1.0]])
