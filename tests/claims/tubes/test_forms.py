"""Forms and sets with errors of their own: what is computed from them holds every member."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from flighttune.claims.tubes import forms, interval

ROUNDING = 1e-12

LITTLE_MORE = 1e-9
"""Share by which roundings may widen what is known in closed form."""


def form_of(centre, *coefficients, err=0.0):
    """A form in one piece, whose size is stated to the nearest float above."""
    row = np.array([[centre, *coefficients]], dtype=float)
    size = (np.abs(row).sum(axis=1) + err) * forms.UP
    return forms.Form(row, np.array([err], dtype=float), size)


def exactly(form):
    """The coefficients, the error and the size of a form in one piece."""
    rows = [Fraction(x) for x in form.coefficients[0].tolist()]
    return rows, Fraction(form.err.item()), Fraction(form.size.item())


WEIGHTS = [-3.0, 0.1, 7.3]
ERRORS = [0.5, 0.25, 0.125]


@pytest.mark.parametrize("shift", [-0.7, 0.3, interval.Interval(np.array([-2.0]), np.array([0.5]))])
@pytest.mark.parametrize("of", ["combined", "transformed"])
def test_a_sum_of_forms_has_the_errors_of_all_and_at_least_the_size_of_what_is_added(of, shift):
    terms = [form_of(0.3 * i - 0.2, 0.7, -0.11, err=err) for i, err in enumerate(ERRORS, 1)]
    weighted = [*zip(map(Fraction, WEIGHTS), map(exactly, terms), strict=True)]
    middle, radius = Fraction(0), Fraction(0)
    if of == "combined":
        if isinstance(shift, interval.Interval):
            middle, radius = Fraction(-3, 4), Fraction(5, 4)
        else:
            middle = Fraction(shift)
        found = forms.combined(*zip(WEIGHTS, terms, strict=True), shift=shift)
    else:
        (found,) = forms.transformed(np.array([WEIGHTS]), terms)

    sums = [sum(a * rows[j] for a, (rows, _, _) in weighted) for j in range(3)]
    sums[0] += middle
    least = sum(abs(a) * err for a, (_, err, _) in weighted) + radius
    rows, err, size = exactly(found)
    rounded = sum(abs(a - b) for a, b in zip(rows, sums, strict=True))
    assert least + rounded <= err <= least * (1 + Fraction(LITTLE_MORE))
    added = sum(abs(a) * size for a, (_, _, size) in weighted) + abs(middle) + radius
    assert added <= size <= added * (1 + Fraction(LITTLE_MORE))


@pytest.mark.parametrize("scale", [1.0, 2.0**40])
def test_the_rounding_of_a_sum_grows_with_its_terms_and_their_size(scale):
    """Each term is just below half of the last digit of the first, and is lost."""
    lost = scale * np.nextafter(2.0**-53, 0.0)
    terms = [(1.0, form_of(scale))] + 60 * [(1.0, form_of(lost))]

    (value,), err, _ = exactly(forms.combined(*terms))

    assert abs(value - Fraction(scale) - 60 * Fraction(lost)) <= err


def test_a_sum_of_absolute_values_is_not_rounded_down():
    values = np.full(100, 2.0**-53)
    values[0], values[1::2] = -1.0, -(2.0**-53)
    least = 1 + 99 * Fraction(2.0**-53)
    assert Fraction(float(np.abs(values).sum())) < least

    assert Fraction(float(forms.absolute_sum(values))) >= least


@pytest.fixture
def pieces():
    """Two pieces of two rows with errors, over four of seven symbols."""
    made = forms.Pieces(np.array([[1.0, -2.0], [3.0, 5.0]]), constraints=2, capacity=7)
    made.make_room(7)
    made.values[:, :2, 1:5] = [
        [[0.1, -0.2, 0.3, 0.0], [0.5, 0.1, 0.2, -0.1]],
        [[0.4, 0.3, -0.1, 0.2], [-0.3, 0.4, 0.6, 0.1]],
    ]
    made.err[:, :2] = [[0.25, 0.5], [0.125, 0.75]]
    made.used = 4
    made.kind[:4] = [3, 1, 4, 1]
    return made


def ends(values):
    return np.column_stack([values.low, values.high])


def test_the_range_of_a_row_is_all_that_its_symbols_and_its_error_reach(pieces):
    radii = np.array([[0.6 + 0.25, 0.9 + 0.5], [1.0 + 0.125, 1.4 + 0.75]])
    centres = np.array([[1.0, -2.0], [3.0, 5.0]])

    for i, form in enumerate(pieces.forms()):
        low, high = ends(pieces.plain_range(form)).T
        assert low == pytest.approx(centres[:, i] - radii[:, i])
        assert high == pytest.approx(centres[:, i] + radii[:, i])
        size = np.abs(centres[:, i]) + radii[:, i]
        assert form.size == pytest.approx(size)
        assert (form.size >= size).all()


def test_a_range_is_rounded_outwards():
    """The centres have so many digits that few of the ends are floats."""
    piece = forms.Pieces(np.zeros((1, 1)), constraints=0, capacity=1)
    for centre in np.random.default_rng(2).normal(size=50) * 1e6:
        values = piece.plain_range(form_of(centre, 0.3))

        assert Fraction(values.low.item()) <= Fraction(centre) - Fraction(0.3)
        assert Fraction(values.high.item()) >= Fraction(centre) + Fraction(0.3)


@pytest.mark.parametrize("multipliers", [(-0.5, 0.3), (0.0, 0.0), (0.7, -0.2)])
def test_the_range_under_constraints_takes_the_error_of_each(pieces, multipliers):
    """The second row is in -3..1 in the first piece, in 4..5 in the second; the first in -1..2."""
    first, second = pieces.forms()
    every = np.arange(2)
    limits = [(second, [-3.0, 4.0], [1.0, 5.0]), (first, [-1.0, -1.0], [2.0, 2.0])]

    for row, (form, low, high) in enumerate(limits):
        to = interval.Interval(np.array(low), np.array(high))
        pieces.constrain(every, np.full(2, row), form, to)
    found = pieces.constrained_range(first, np.tile(multipliers, (2, 1)))

    # F = (F - mu q) + mu q, with q = (form - middle) / radius of size 1 and its error
    rest, half = first.coefficients, first.err
    for mu, (form, low, high) in zip(multipliers, limits, strict=True):
        middle, radius = np.mean([low, high], axis=0), 0.5 * np.subtract(high, low)
        q = (form.coefficients - np.outer(middle, np.eye(8)[0])) / radius[:, None]
        rest, half = rest - mu * q, half + abs(mu) * (1.0 + form.err / radius)
    half = half + np.abs(rest[:, 1:]).sum(axis=1)
    assert ends(found) == pytest.approx(np.column_stack([rest[:, 0] - half, rest[:, 0] + half]))
    assert pieces.constrained.all()


def test_a_range_under_a_constraint_contains_what_is_left_of_it_exactly():
    """Rows of large numbers that nearly cancel: what is left has the roundings of both."""
    rng, mu = np.random.default_rng(11), 1e-3
    for constraint in rng.normal(size=(50, 3)) * 1e6:
        piece = forms.Pieces(np.zeros((1, 1)), constraints=1, capacity=2)
        piece.make_room(2)
        piece.used, piece.constrained[0] = 2, True
        piece.values[0] = [mu * constraint + rng.normal(size=3) * 1e-6, constraint]
        (form,) = piece.forms()

        found = piece.constrained_range(form, np.array([[mu]]))

        row, q = ([Fraction(x) for x in values] for values in piece.values[0].tolist())
        centre, *rest = (a - Fraction(mu) * b for a, b in zip(row, q, strict=True))
        radius = sum(map(abs, rest)) + Fraction(mu)
        assert Fraction(found.low.item()) <= centre - radius
        assert Fraction(found.high.item()) >= centre + radius


def test_removed_symbols_and_errors_are_in_the_box_of_each_row(pieces):
    """Symbols 0 and 2 are joined, 1 is dropped: ranges of sums of rows are known by hand."""
    before = pieces.values[:, :2, 1:5].copy()
    errors = pieces.err[:, :2].copy()

    pieces.reduce(np.array([[0, 2], [1, -1]]))

    assert pieces.used == 2 + 4
    assert pieces.kind[:6].tolist() == [4, 1, -1, -2, -3, -4]
    assert (pieces.err == 0.0).all()
    g, h = before[..., 0], before[..., 2]
    flip = np.abs(g - h).sum() > np.abs(g + h).sum()
    joined, other = (g - h, g + h) if flip else (g + h, g - h)
    assert pieces.values[:, :2, 1] == pytest.approx(joined)
    assert pieces.values[:, :2, 2] == pytest.approx(before[..., 3])
    box = np.abs(before[..., 1]) + np.abs(other) + errors
    assert pieces.values[:, [0, 1], [3, 4]] == pytest.approx(box)


def test_joined_symbols_contain_the_exact_ones():
    """Sum and difference of coefficients of different sizes are rounded."""
    rng = np.random.default_rng(6)
    piece = forms.Pieces(np.zeros((1, 1)), constraints=0, capacity=40)
    piece.make_room(40)
    piece.used = 40
    piece.values[0, 0, 1:] = rng.normal(size=40) * 10.0 ** rng.uniform(-12.0, 0.0, 40)
    least = sum(abs(Fraction(x)) for x in piece.values[0, 0, 1:].tolist())

    piece.reduce(np.arange(40).reshape(20, 2))

    values = [Fraction(x) for x in piece.values[0, 0, 1:].tolist()]
    assert sum(map(abs, values)) >= least


TIGHT = 1.7
"""Widths of the enclosures of small ranges, over what their corners reach."""

THIRD_ORDER = 1e-6
"""The cube of the larger radius of small ranges."""

WIDE = {"more bank", "less bank"}
"""Functions whose slopes in both forms are enclosed apart, which is wider."""


def secant_change(a, b):
    return 1.0 / np.cos(a) - 1.0 / np.cos(a + b)


# Function, its enclosure, and centres of the two forms
ENCLOSED = {
    "tangent": (lambda a, _: np.tan(a), lambda a, _: forms.tangent(a), (1.1, 0.0)),
    "cosine": (lambda a, _: np.cos(a), lambda a, _: forms.cosine_of(a).form, (-0.9, 0.0)),
    "secant": (lambda a, _: 1.0 / np.cos(a), lambda a, _: forms.secant(a).form, (1.2, 0.0)),
    "secant at 0": (lambda a, _: 1.0 / np.cos(a), lambda a, _: forms.secant(a).form, (0.001, 0.0)),
    "product": (np.multiply, forms.product, (-3.0, 2.0)),
    "more bank": (secant_change, forms.secant_change, (0.2, 0.8)),
    "less bank": (secant_change, forms.secant_change, (-1.2, 0.7)),
    "quotient": (np.arctan2, forms.arctangent, (0.7, 1.1)),
    "opposite": (np.arctan2, forms.arctangent, (-0.7, 1.1)),
    "upright": (np.arctan2, forms.arctangent, (0.0, 1.1)),
    "steep": (np.arctan2, forms.arctangent, (2.0, 0.5)),
}


@pytest.mark.parametrize("name", ENCLOSED)
@pytest.mark.parametrize("radii", [(0.01, 1e-5), (1e-5, 0.01), (0.01, 0.01), (0.15, 0.1)])
@pytest.mark.parametrize("part", [0.0, 0.1])
def test_an_enclosure_holds_its_function_at_each_pair_of_values(name, radii, part):
    """One symbol and an error each, which is a part of the radius."""
    function, enclosure, centres = ENCLOSED[name]
    row = forms.Pieces(np.zeros((1, 1)), constraints=0, capacity=2)
    both = [
        form_of(centre, *((1.0 - part) * radius * np.eye(2)[i]), err=part * radius)
        for i, (centre, radius) in enumerate(zip(centres, radii, strict=True))
    ]
    quantities = [forms.Quantity(form, row.plain_range(form)) for form in both]

    found = enclosure(*quantities)

    share = np.linspace(-1.0, 1.0, 21)
    symbols = np.array([*product(share, share, [-1.0, 1.0], [-1.0, 1.0])])
    xi, off = symbols[:, :2], symbols[:, 2:]
    a, b = (centres + radii * ((1.0 - part) * xi + part * off)).T
    left = function(a, b) - found.coefficients[0, 0] - xi @ found.coefficients[0, 1:]
    assert np.abs(left).max() <= found.err[0] + ROUNDING
    if max(radii) <= 0.01 and name not in WIDE:
        assert found.err[0] <= 0.5 * TIGHT * np.ptp(left) + THIRD_ORDER


@pytest.mark.parametrize("ends", [(-1.0, 2.0), (0.5, 2.0), (-2.0, -0.5)])
@pytest.mark.parametrize("slope", [-0.5, 0.0, 0.37, 1.0, 1.6])
def test_a_kink_is_enclosed_by_a_line_of_any_slope_and_no_wider_than_its_ends(ends, slope):
    low, high = ends
    radius = 0.5 * (high - low)
    form = form_of(0.5 * (low + high), 0.75 * radius, err=0.25 * radius)
    values = interval.Interval(*np.array(ends)[:, np.newaxis])

    found = forms.positive_part(forms.Quantity(form, values), slope)

    x = np.array([low, high, min(max(low, 0.0), high)])
    needed = 0.5 * np.ptp(np.maximum(x, 0.0) - slope * x) + abs(slope) * 0.25 * radius
    assert found.err.item() == pytest.approx(needed)
    xi, off = np.meshgrid(np.linspace(-1.0, 1.0, 41), [-1.0, 1.0])
    x = 0.5 * (low + high) + radius * (0.75 * xi + 0.25 * off)
    line = found.coefficients[0, 0] + found.coefficients[0, 1] * xi
    assert np.abs(np.maximum(x, 0.0) - line).max() <= found.err.item() + ROUNDING
