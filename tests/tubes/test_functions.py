"""Enclosures of functions, and the interval arithmetic below them."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flighttune.theory import exact
from flighttune.tubes import forms, hand_over
from flighttune.tubes.forms import Pieces, Quantity, combined
from flighttune.tubes.interval import LARGEST_ANGLE, Interval, cosine, sine_and_cosine

ROUNDING = 1e-12
"""Of the members, which are computed in floating point."""

PIECES, ROWS, SYMBOLS, MEMBERS = 3, 3, 12, 200


@pytest.fixture
def pieces():
    rng = np.random.default_rng(7)
    made = Pieces(rng.uniform(-0.4, 0.4, (PIECES, ROWS)), constraints=1, capacity=SYMBOLS + 8)
    made.make_room(SYMBOLS + 8)
    made.values[:, :ROWS, 1 : 1 + SYMBOLS] = rng.uniform(-0.03, 0.03, (PIECES, ROWS, SYMBOLS))
    made.used = SYMBOLS
    made.kind[:SYMBOLS] = np.arange(SYMBOLS) % 3
    return made


def members(form, symbols):
    """Values of a form for rows of symbols, shape (P, members)."""
    return form.coefficients[:, :1] + form.coefficients[:, 1:] @ symbols


def inside(form, symbols, values):
    return np.all(np.abs(members(form, symbols) - values) <= form.err[:, np.newaxis] + ROUNDING)


@pytest.fixture
def symbols(pieces):
    rng = np.random.default_rng(8)
    return rng.choice([-1.0, 1.0], (pieces.capacity, MEMBERS)) * rng.choice([1.0, 0.3], MEMBERS)


def ranged(pieces, form):
    return Quantity(form, pieces.plain_range(form))


@pytest.mark.parametrize(
    ("enclosure", "function"),
    [
        (lambda angle: (forms.tangent(angle), None), np.tan),
        (forms.cosine_of, np.cos),
        (forms.secant, lambda x: 1.0 / np.cos(x)),
    ],
)
def test_a_function_of_an_angle_is_enclosed(pieces, symbols, enclosure, function):
    angle = pieces.forms()[0]
    exactly = function(members(angle, symbols))

    form, values = enclosure(ranged(pieces, angle))

    assert inside(form, symbols, exactly)
    if values is not None:
        assert (values.low <= exactly.min(axis=1) + ROUNDING).all()
        assert (values.high >= exactly.max(axis=1) - ROUNDING).all()


def test_product_and_change_of_secant_are_enclosed(pieces, symbols):
    a, b = (ranged(pieces, form) for form in pieces.forms()[:2])
    x, y = (members(quantity.form, symbols) for quantity in (a, b))

    assert inside(forms.product(a, b), symbols, x * y)
    change = forms.secant_change(a, b)
    assert inside(change, symbols, 1.0 / np.cos(x) - 1.0 / np.cos(x + y))


@pytest.mark.parametrize("scale", [0.1, 1.0, 3.0])
def test_arctangent_of_a_quotient_is_enclosed(pieces, symbols, scale):
    a, c, _ = pieces.forms()
    a, b = combined((scale, a)), combined((1.0, c), shift=1.0)

    found = forms.arctangent(ranged(pieces, a), ranged(pieces, b))

    assert inside(found, symbols, np.arctan2(members(a, symbols), members(b, symbols)))


@pytest.mark.parametrize("slope", [0.0, 0.37, 1.0])
def test_a_kink_is_enclosed_whatever_the_slope(pieces, symbols, slope):
    form = pieces.forms()[0]

    found = forms.positive_part(ranged(pieces, form), slope)

    assert inside(found, symbols, np.maximum(members(form, symbols), 0.0))


def test_fewer_symbols_make_no_range_smaller(pieces):
    weights = np.random.default_rng(9).uniform(-1.0, 1.0, (20, ROWS))
    before = [pieces.plain_range(combined(*zip(w, pieces.forms(), strict=True))) for w in weights]

    pieces.reduce(np.array([[0, 3], [1, 4], [2, -1], [5, -1], [6, 9]]))

    assert pieces.used == SYMBOLS - 5 + ROWS + 1
    for w, was in zip(weights, before, strict=True):
        now = pieces.plain_range(combined(*zip(w, pieces.forms(), strict=True)))
        assert np.all(now.low <= was.low + ROUNDING)
        assert np.all(now.high >= was.high - ROUNDING)


def test_a_constraint_cuts_the_range_to_what_it_says(pieces):
    form = pieces.forms()[0]
    whole = pieces.plain_range(form)
    half = Interval(whole.low, whole.middle)
    every = np.arange(PIECES)

    pieces.constrain(every, np.zeros(PIECES, dtype=int), form, half)
    found = pieces.constrained_range(form, half.radius[:, np.newaxis])

    assert found.high == pytest.approx(half.high, abs=ROUNDING)
    assert np.all(found.high >= half.high)


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


def test_a_radius_reaches_both_ends_from_the_middle():
    """Over 1000 intervals whose middles and differences are not floats, in rational numbers."""
    ends = np.sort(np.random.default_rng(5).normal(size=(2, 1000)), axis=0)
    interval = Interval(*ends)

    for low, high, middle, radius in zip(*ends, interval.middle, interval.radius, strict=True):
        assert Fraction(middle) + Fraction(radius) >= Fraction(high)
        assert Fraction(middle) - Fraction(radius) <= Fraction(low)


# The nearest float to the sum of the floats 0.1 and 0.2, which is above the sum.
END = 0.1 + 0.2


def test_a_set_refuses_a_point_just_outside():
    centre, size = np.array([0.1, -0.1]), np.array([0.2, 0.2])
    assert Fraction(END) > Fraction(0.1) + Fraction(0.2)

    for row, point in ((0, END), (1, -END)):
        ranges = np.column_stack([centre, centre])
        assert hand_over.inside(ranges, centre, size)
        ranges[row] = point
        assert not hand_over.inside(ranges, centre, size)


def test_a_parallelotope_contains_the_corners_of_its_set_exactly():
    """In 60 digits, for rows so nearly dependent that their inverse has only six right ones."""
    n = 8
    W = np.array([[1.0 / (i + j + 1.0) for j in range(n)] for i in range(n)])
    rng = np.random.default_rng(3)
    centre, size = rng.normal(size=n), rng.uniform(0.1, 1.0, n)

    box = hand_over.parallelotope(W, centre, size)

    with mpmath.workdps(60):
        middle, generators, err = (
            mpmath.matrix(values.tolist())
            for values in (box.values[0, :, 0], box.values[0, :, 1 : 1 + n], box.err[0])
        )
        for signs in rng.choice([-1.0, 1.0], (20, n)):
            q = mpmath.matrix([mpmath.mpf(c) + s * mpmath.mpf(h) for c, s, h in
                               zip(centre, signs, size, strict=True)])  # fmt: skip
            z = mpmath.lu_solve(mpmath.matrix(W.tolist()), q)
            symbols = mpmath.lu_solve(generators, z - middle)
            clipped = mpmath.matrix([max(-1, min(1, x)) for x in symbols])
            rest = z - middle - generators * clipped
            assert all(abs(x) <= e for x, e in zip(rest, err, strict=True))


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
