"""Exact arithmetic against floats, identities, and cases that floats get wrong."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flighttune as ft
from flighttune.theory.exact import cosine, exact, positive_definite, product, sine

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


def test_a_matrix_that_is_definite_by_one_bit_is_told_from_one_that_is_not():
    one_bit = 2.0**-52
    above = exact([[1.0 + one_bit, 1.0], [1.0, 1.0]])
    below = exact([[1.0 - one_bit, 1.0], [1.0, 1.0]])

    assert positive_definite(above)
    assert not positive_definite(below)
    assert not positive_definite(exact([[1.0, 1.0], [1.0, 1.0]]))


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


def test_a_matrix_that_is_not_symmetric_is_not_called_definite():
    assert not positive_definite(exact([[2.0, 1.0], [0.0, 2.0]]))


@pytest.mark.slow
@given(angles)
def test_sine_and_cosine_lie_in_narrow_intervals_whose_squares_add_up_to_one(angle):
    low, high = sine(angle)
    low_cosine, high_cosine = cosine(angle)
    squares = [product(ends, ends) for ends in (sine(angle), cosine(angle))]

    assert low - Fraction(1, 10**15) <= Fraction(math.sin(angle)) <= high + Fraction(1, 10**15)
    assert abs(Fraction(math.cos(angle)) - low_cosine) < Fraction(1, 10**15)
    assert 0 <= high - low < WIDTH
    assert 0 <= high_cosine - low_cosine < WIDTH
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


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_is_the_rational_it_says(value):
    assert exact([value])[0] == Fraction(value)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_no_rational(value):
    with pytest.raises(ft.InputError, match="`values` must be finite"):
        exact([value])
