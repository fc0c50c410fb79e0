"""Outward rounding against exact rationals."""

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from flighttune.theory import exact
from flighttune.tubes.interval import LARGEST_ANGLE, Interval, cosine, sine_and_cosine

NUMBER = st.floats(-1e3, 1e3)
SMALLEST_DIVISOR = 1e-300
"""A quotient of `NUMBER` by less may be larger than any float."""

ANGLE = st.floats(-LARGEST_ANGLE, LARGEST_ANGLE)


def holds(interval, number):
    return Fraction(float(interval.low)) <= number <= Fraction(float(interval.high))


@given(a=NUMBER, b=NUMBER)
def test_sums_and_products_contain_the_exact_ones(a, b):
    one, other = Interval.point(a), Interval.point(b)

    assert holds(one + other, Fraction(a) + Fraction(b))
    assert holds(one - other, Fraction(a) - Fraction(b))
    assert holds(one * other, Fraction(a) * Fraction(b))
    if b > SMALLEST_DIVISOR:
        assert holds(one / other, Fraction(a) / Fraction(b))


def sine(angle):
    return sine_and_cosine(angle)[0]


@given(angle=ANGLE)
def test_sine_and_cosine_contain_the_exact_ones(angle):
    for ours, theirs in ((sine, exact.sine), (cosine, exact.cosine)):
        found, (low, high) = ours(Interval.point(angle)), theirs(angle)

        assert holds(found, low)
        assert holds(found, high)


@given(a=ANGLE, b=ANGLE, part=st.floats(0.0, 1.0))
def test_ranges_of_angles_contain_every_value(a, b, part):
    low, high = min(a, b), max(a, b)
    angle = min(max(low + part * (high - low), low), high)
    whole = Interval(np.asarray(low), np.asarray(high))

    assert all(holds(sine(whole), end) for end in exact.sine(angle))
    assert all(holds(cosine(whole), end) for end in exact.cosine(angle))
