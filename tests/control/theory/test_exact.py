"""Exact arithmetic, and the inequalities of a certificate: valid ones proven, others refused."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov

import flighttune as ft
from flighttune.control.theory import exact as theory
from flighttune.control.theory.exact import Verification, cosine, exact, positive_definite, sine

angles = st.floats(-1.57, 1.57)
entries = st.integers(-6, 6)
WIDTH = Fraction(1, 10**20)


@given(st.lists(st.lists(entries, min_size=4, max_size=4), min_size=4, max_size=4))
def test_definiteness_is_that_of_the_eigenvalues_where_those_are_clear(rows):
    matrix = np.array(rows, dtype=float)
    matrix = matrix @ matrix.T - 8.0 * np.eye(4)
    smallest = np.linalg.eigvalsh(matrix)[0]

    if abs(smallest) > 1e-6:
        assert positive_definite(exact(matrix)) == (smallest > 0.0)


@pytest.mark.parametrize(
    ("row", "definite"),
    [
        ([1.0 + 2.0**-52, 1.0], True),
        ([1.0 - 2.0**-52, 1.0], False),
        ([1.0, 1.0], False),
        ([2.0, 0.0], False),
    ],
    ids=["by one bit", "not by one bit", "singular", "not symmetric"],
)
def test_definiteness_is_decided_to_the_last_bit(row, definite):
    assert positive_definite(exact([row, [1.0, 1.0]])) is definite


def test_the_hilbert_matrix_of_order_12_is_definite_up_to_the_last_bit_of_its_last_pivot():
    """The last entry of its inverse is 23 C(22, 11)^2; less its reciprocal it is singular."""
    hilbert = np.empty((12, 12), dtype=object)
    for i, j in np.ndindex(12, 12):
        hilbert[i, j] = Fraction(1, i + j + 1)
    pivot = Fraction(1, 23 * math.comb(22, 11) ** 2)

    assert positive_definite(hilbert)
    hilbert[11, 11] -= pivot * Fraction(999_999, 1_000_000)
    assert positive_definite(hilbert)
    hilbert[11, 11] -= pivot / 1_000_000
    assert not positive_definite(hilbert)


@settings(max_examples=15)
@given(angles)
def test_sine_and_cosine_lie_in_narrow_intervals_whose_squares_add_up_to_one(angle):
    both = sine(angle), cosine(angle)
    squares = [theory.product(ends, ends) for ends in both]

    for (low, high), value in zip(both, (math.sin(angle), math.cos(angle)), strict=True):
        assert low - Fraction(1, 10**15) <= Fraction(value) <= high + Fraction(1, 10**15)
        assert 0 <= high - low < WIDTH
    assert sum(low for low, _ in squares) <= 1 <= sum(high for _, high in squares) + WIDTH


def test_the_sine_of_thirty_degrees_is_a_half():
    """A float next to pi/6 on either side encloses it."""
    below, above = math.nextafter(math.pi / 6, 0.0), math.nextafter(math.pi / 6, 1.0)

    assert sine(below)[0] < Fraction(1, 2) < sine(above)[1]
    assert sine(-above) == tuple(-end for end in reversed(sine(above)))


@pytest.mark.parametrize("function", [sine, cosine])
def test_angles_beyond_a_right_angle_are_refused(function):
    with pytest.raises(ft.InputError, match=r"`angle` must lie inside \+-pi/2"):
        function(1.6)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_no_rational(value):
    with pytest.raises(ft.InputError, match="`values` must be finite"):
        exact([value])


A = np.array([[-1.0, 2.0], [0.0, -3.0]])
E = np.array([[1.0], [1.0]])
VERTICES = [exact(A)]
LYAPUNOV_Q = solve_continuous_lyapunov(A.T, -np.eye(2))
RATE = 1.0 / np.linalg.eigvalsh(LYAPUNOV_Q)[-1]
RATE_LOSS = 1e-8


def proves(Q, rate):
    return Verification.of(theory.rate_checks(VERTICES, Q, rate=rate)).valid


def test_the_lyapunov_solution_is_inflated_until_its_rate_is_proven():
    Q, rate = theory.provable_rate(VERTICES, LYAPUNOV_Q)

    assert proves(Q, rate)
    assert rate == pytest.approx(RATE, rel=RATE_LOSS)
    assert not proves(LYAPUNOV_Q, 0.9 * RATE)  # it only meets an equation
    assert not proves(Q + np.array([[0.0, 1e-15], [0.0, 0.0]]), rate)  # not symmetric


def test_a_Q_of_an_unstable_loop_cannot_be_inflated_into_a_proof():
    assert theory.provable_rate([exact([[0.1]])], np.array([[1.0]])) is None


def test_an_exact_number_beyond_all_floats_is_infinite_on_its_side():
    assert theory.as_float(Fraction(10) ** 400) == math.inf
    assert theory.as_float(-(Fraction(10) ** 400)) == -math.inf
    assert theory.as_float(Fraction(-1, 4)) == -0.25
