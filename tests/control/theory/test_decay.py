"""Exact rates of decay: proven in rationals, and never beaten by a flight of the loop."""

import decimal
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import flighttune as ft
from flighttune.control.theory.decay import decay, decay_checks, exponential_below
from flighttune.control.theory.exact import exact

ROUNDING = 1e-9  # relative, of a norm after a hundred products of matrices
TARGET = 0.99  # share of the true rate that has to be proven


def stable_loops(seed, n):
    """A loop with its slowest eigenvalue at -0.5 1/s in coordinates that are not orthogonal."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    return A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)


@pytest.mark.soak
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), dt=st.sampled_from([None, 0.02, 0.5]))
def test_no_state_leaves_the_bound_of_the_rate_and_its_growth(seed, n, dt):
    A = stable_loops(seed, n)
    step = 0.05 if dt is None else dt
    over = expm(A * step)

    rate, Q = decay(A if dt is None else over, dt=dt)

    assert TARGET * (1.0 - ROUNDING) <= rate / 0.5 < 1.0 + ROUNDING
    product = np.eye(n)
    for k in range(1, 200):
        product = over @ product
        bound = math.sqrt(np.linalg.cond(Q)) * math.exp(-rate * k * step)
        assert np.linalg.norm(product, 2) <= bound * (1.0 + ROUNDING)


def test_a_defective_loop_has_a_rate_just_below_its_eigenvalue():
    jordan = np.eye(3, k=1) - np.eye(3)

    assert TARGET <= decay(jordan)[0] < 1.0


def test_a_loop_that_ends_after_its_delay_has_a_rate():
    shift = np.diag([1.0, 1.0], -1)

    assert decay(shift, dt=0.1)[0] > 0.0


@pytest.mark.parametrize(
    ("loop", "dt"),
    [
        ([[0.0]], None),
        ([[0.0, 1.0], [-1.0, 0.0]], None),
        ([[1e-9]], None),
        ([[1.0]], 0.02),
        ([[0.0, -1.0], [1.0, 0.0]], 0.02),
    ],
)
def test_a_loop_that_does_not_decay_has_no_rate(loop, dt):
    assert decay(loop, dt=dt) is None


@pytest.mark.parametrize(
    ("loop", "dt"), [([[1.0, 2.0]], None), ([[math.nan]], None), ([[0.5]], 0.0)]
)
def test_what_is_no_loop_is_refused(loop, dt):
    with pytest.raises(ft.InputError):
        decay(loop, dt=dt)


ONE_BIT_OFF = np.ones((4, 4))
ONE_BIT_OFF[0, 1] += 1e-15


@pytest.mark.parametrize("dt", [None, 0.02])
@pytest.mark.parametrize(
    "forgery",
    [
        {"rate": 0.501},  # the slowest eigenvalue decays at 0.5
        {"added": 0.6 * np.eye(4)},
        {"factor": np.diag([-2.0, 0.0, 0.0, 0.0]) + 1.0},
        {"factor": -1.0},
        {"factor": ONE_BIT_OFF},
    ],
    ids=["rate", "loop", "Q", "sign", "asymmetric"],
)
def test_a_forged_rate_is_not_proven(forgery, dt):
    A = stable_loops(3, 4)
    loop = A if dt is None else expm(A * dt)
    rate, Q = decay(loop, dt=dt)

    forged = exact(loop + forgery.get("added", 0.0)), Q * forgery.get("factor", 1.0)
    checks = decay_checks(*forged, rate=forgery.get("rate", rate), dt=dt)

    assert not all(check.exact for check in checks)


@given(st.fractions(0, 1))
def test_the_exponential_is_bounded_from_below(x):
    with decimal.localcontext() as context:
        context.prec = 60
        truth = (-decimal.Decimal(x.numerator) / decimal.Decimal(x.denominator)).exp()
    below = exponential_below(x)

    # Twelve terms: the next one of exp(-1) is 1/12!.
    assert Fraction(truth) - Fraction(1, math.factorial(12)) - Fraction(1, 2**79) <= below
    assert below <= Fraction(truth) + Fraction(1, 10**58)


def test_a_decay_by_more_than_e_in_a_sample_is_bounded_by_nothing():
    assert exponential_below(Fraction(1)) > 0
    assert exponential_below(1 + Fraction(1, 10**9)) == 0


def test_a_loop_of_huge_transients_has_a_proven_rate_without_a_warning():
    """Warnings are errors in tests; SciPy's solution has an ill-conditioned matrix here."""
    rate, _ = decay(np.array([[0.5, 1e8], [0.0, 0.4]]), dt=0.02)

    assert TARGET * math.log(2.0) <= 0.02 * rate <= math.log(2.0)
