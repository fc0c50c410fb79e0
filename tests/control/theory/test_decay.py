"""Exact rates of decay of loops that are hard to prove, and of those that have none."""

import decimal
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flighttune.control.theory.decay import decay, exponential_below

TARGET = 0.99  # share of the true rate that has to be proven


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
