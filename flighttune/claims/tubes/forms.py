r"""Affine forms with shared symbols, batched over pieces of a set, with every rounding bounded.

A form is a quantity of a flight as ``c + sum_j g_j xi_j + r`` with symbols ``|xi_j| <= 1`` that all
forms of a piece share and ``|r| <= err``. Forms are computed in floating point; `err` takes up the
rounding: a sum of n products has an error of at most ``n 2^-53 / (1 - n 2^-53)`` times the sum of
their absolute values (N. J. Higham, *Accuracy and Stability of Numerical Algorithms*, SIAM 2002,
section 3.1), and a form with rounded coefficients differs from the exact form by at most the sum of
the coefficients' errors.

A function that is not affine becomes a form with a proven error: any slope gives an enclosure, and
a good slope gives a narrow enclosure.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.errors import InputError
from flighttune.claims.tubes.interval import (
    Interval,
    check_inside,
    cosine,
    outward,
    sine_and_cosine,
    within,
)

ULP = 2.0**-52

# Extra roundings besides the sum: of a coefficient and of a quotient of constants
MORE_ROUNDINGS = 8

# Factor that exceeds the rounding of up to a hundred sums of positive numbers
UP = 1.0 + 2.0**-44

# Exceeds the underflow of a sum
TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """One quantity in every piece."""

    coefficients: FloatArray  # shape (P, 1 + M): centre, then the coefficient of every symbol
    err: FloatArray  # shape (P,): bound on the part without coefficients
    # shape (P,): at least the sum of the absolute values of coefficients and `err`
    size: FloatArray

    def part(self, which: "Indices") -> "Form":
        """The form in some of the pieces."""
        return Form(self.coefficients[which], self.err[which], self.size[which])

    def widened(self, radius: Floats) -> "Form":
        """The form plus a number of absolute value up to `radius`."""
        return Form(
            self.coefficients, (self.err + radius) * UP + TINY, (self.size + radius) * UP + TINY
        )


class Quantity(NamedTuple):
    """A form together with an interval that contains all its values."""

    form: Form
    values: Interval


Term: TypeAlias = tuple[Floats, Form]
Forms: TypeAlias = Sequence[Form]
Indices: TypeAlias = npt.NDArray[np.intp]
Flags: TypeAlias = npt.NDArray[np.bool_]


def combined(*terms: Term, shift: Floats | Interval = 0.0) -> Form:
    """``shift + sum_k a_k F_k`` for numbers ``a_k``, common to all pieces or one for each."""
    if isinstance(shift, Interval):
        # The form encloses the sum for each number in the interval.
        return combined(*terms, shift=shift.middle).widened(shift.radius)
    (a, form), *others = terms
    weight = np.abs(a)
    coefficients = _column(a) * form.coefficients
    err, size = weight * form.err, weight * form.size
    for a, form in others:
        weight = np.abs(a)
        coefficients += _column(a) * form.coefficients
        err += weight * form.err
        size += weight * form.size
    coefficients[:, 0] += shift
    size = (size + np.abs(shift)) * UP + TINY
    # The size is at least the sum of all rounded terms, so one bound covers all coefficients.
    rounding = (len(terms) + MORE_ROUNDINGS) * ULP * size
    return Form(coefficients, (err + rounding) * UP + TINY, size * UP)


def transformed(matrix: FloatArray, forms: Forms) -> list[Form]:
    """``sum_k A_ik F_k`` for each row i of a matrix."""
    weights = np.abs(matrix)
    # A library may add the products in any order; the rounding bound holds for every order.
    coefficients = np.tensordot(matrix, np.array([form.coefficients for form in forms]), axes=1)
    err = weights @ np.array([form.err for form in forms])
    size = weights @ np.array([form.size for form in forms]) * UP + TINY
    err = (err + (len(forms) + MORE_ROUNDINGS) * ULP * size) * UP + TINY
    return [Form(*row) for row in zip(coefficients, err, size * UP, strict=True)]


def absolute_sum(values: FloatArray) -> FloatArray:
    """At least the sum of absolute values over the last axis."""
    return np.abs(values).sum(axis=-1) * (1.0 + values.shape[-1] * ULP) * UP


def _column(a: Floats) -> Floats:
    return a[:, np.newaxis] if isinstance(a, np.ndarray) and a.ndim else a


class Pieces:
    """A set as a union of P pieces, each with rows (state and constraints) of forms over symbols.

    A constraint row is a quantity q of the flight that is known to be inside +-1.
    """

    def __init__(self, centres: FloatArray, constraints: int, capacity: int) -> None:
        P, self.rows = centres.shape
        self.capacity = capacity  # maximum number of symbols
        # Coefficients, (P, rows + constraints, 1 + M), with room for M symbols, and errors of forms
        self.values = np.zeros((P, self.rows + constraints, 1 + self.rows))
        self.values[:, : self.rows, 0] = centres
        self.err = np.zeros(self.values.shape[:2])
        # Whether each row has a constraint of any piece
        self.constrained = np.zeros(constraints, dtype=bool)
        # Symbols in use, and their origin; symbols of a kind are in order of time
        self.used, self.kind = 0, np.zeros(capacity, dtype=int)

    def __len__(self) -> int:
        return len(self.values)

    def make_room(self, count: int) -> None:
        """Make room for exactly `count` more symbols, since all forms have this width."""
        wide = np.zeros((*self.values.shape[:2], 1 + self.used + count))
        wide[:, :, : 1 + self.used] = self.values[:, :, : 1 + self.used]
        self.values = wide

    def forms(self) -> list[Form]:
        """The rows of the state."""
        sizes = (np.abs(self.values[:, :, 0]) + absolute_sum(self.values[:, :, 1:])) * UP + self.err
        return [Form(self.values[:, i], self.err[:, i], sizes[:, i] * UP) for i in range(self.rows)]

    def put(self, state: Forms) -> None:
        """Replace the rows of the state."""
        self.values[:, : self.rows] = np.stack([form.coefficients for form in state], axis=1)
        self.err[:, : self.rows] = np.stack([form.err for form in state], axis=1)

    def fresh(self, form: Form, kind: int) -> Form:
        """`form` with a symbol of its own for its error."""
        coefficients = form.coefficients.copy()
        coefficients[:, 1 + self.used] = form.err
        # The size does not change: the coefficient of the symbol equals the replaced error.
        self.kind[self.used] = kind
        self.used += 1
        return Form(coefficients, np.zeros_like(form.err), form.size)

    def plain_range(self, form: Form) -> Interval:
        """The values of a form without the constraints."""
        radius = (absolute_sum(form.coefficients[:, 1:]) + form.err) * UP + TINY
        return outward(form.coefficients[:, 0] - radius, form.coefficients[:, 0] + radius)

    def constrained_range(self, form: Form, multipliers: FloatArray) -> Interval:
        """The values of a form under all constraints q.

        The `multipliers` mu (shape (P, c)) are any numbers, for the rows of `constrained`:
        ``F = (F - mu q) + mu q``, and q is inside +-1.
        """
        rows = self.rows + np.flatnonzero(self.constrained)
        q, q_err = self.values[:, rows], self.err[:, rows]
        residual = form.coefficients - (multipliers[:, np.newaxis] @ q)[:, 0]
        weights = np.abs(multipliers)
        # q is also a form with rounding errors: mu q is inside |mu| (1 + q_err).
        q_size = (absolute_sum(q) + q_err) * UP
        size = (form.size + (weights * q_size).sum(axis=1)) * UP
        radius = (
            absolute_sum(residual[:, 1:])
            + form.err
            + (weights * (1.0 + q_err)).sum(axis=1)
            + (weights.shape[1] + MORE_ROUNDINGS) * ULP * size
        ) * UP + TINY
        return outward(residual[:, 0] - radius, residual[:, 0] + radius)

    def constrain(self, which: Indices, row: Indices, form: Form, to: Interval) -> None:
        """Add the constraint that `form` is in `to`, in row `row` of the pieces `which`."""
        self.constrained[row] = True
        scale = 1.0 / to.radius
        q = combined((scale, form), shift=-to.middle * scale)
        self.values[which, self.rows + row] = q.coefficients
        # The scale is rounded, which moves a q inside +-1 by less than this.
        self.err[which, self.rows + row] = q.err + 4.0 * ULP

    def split(self, indices: Indices) -> None:
        """Append a copy of the pieces `indices`."""
        self.values = np.concatenate([self.values, self.values[indices]])
        self.err = np.concatenate([self.err, self.err[indices]])

    def keep(self, flags: Flags) -> None:
        """Drop all pieces for which `flags` is false."""
        self.values, self.err = self.values[flags], self.err[flags]

    def reduce(self, pairs: Indices) -> None:
        """Merge or drop the noise symbols `pairs`, shape (n, 2)."""
        named = pairs[pairs >= 0]
        repeated = len(np.unique(named)) < len(named)
        if repeated or (pairs[:, 0] < 0).any() or (named >= self.used).any():
            raise InputError("`pairs` must name each symbol in use at most once.")
        g = self.values[:, :, 1 : 1 + self.used]
        alone, pair = pairs[pairs[:, 1] < 0, 0], pairs[pairs[:, 1] >= 0]
        first, second = g[:, :, pair[:, 0]], g[:, :, pair[:, 1]]
        # xi_a and xi_b are in +-1, and so are half their sum and half their difference, which may
        # therefore be symbols. ``g_a xi_a + g_b xi_b`` is the sum of ``(g_a + g_b) (xi_a +
        # xi_b)/2`` and ``(g_a - g_b) (xi_a - xi_b)/2``, or the other way round if that is smaller.
        # The first becomes one symbol, and the second joins a box. With b negative only a joins the
        # box. The box, an interval for each row, takes one symbol per row.
        difference, total = first - second, first + second
        flip = np.abs(difference).sum(axis=(0, 1)) > np.abs(total).sum(axis=(0, 1))
        joined = np.where(flip, difference, total)
        box = absolute_sum(g[:, :, alone]) + absolute_sum(np.where(flip, total, difference))
        # Both the sum and the difference are rounded: twice half an ulp of their sizes.
        box = (
            box + 2.0 * ULP * (absolute_sum(first) + absolute_sum(second)) + self.err
        ) * UP + TINY
        g = g.copy()
        g[:, :, pair[:, 1]] = joined
        gone = np.zeros(self.used, dtype=bool)
        gone[pairs[:, 0]] = True
        columns = np.flatnonzero(~gone)
        count, height = len(columns), self.values.shape[1]
        centres = self.values[:, :, :1]
        self.values = np.zeros((len(self), height, 1 + count + height))
        self.values[:, :, :1] = centres
        self.values[:, :, 1 : 1 + count] = g[:, :, columns]
        self.kind[:count] = self.kind[columns]
        row = np.arange(height)
        self.values[:, row, 1 + count + row] = box
        self.kind[count : count + height] = -1 - row
        self.err[:] = 0.0
        self.used = count + height


def tangent(angle: Quantity) -> Form:
    """``tan F`` of an angle, rad; ``tan'' = 2 sin/cos^3``."""
    s, c = sine_and_cosine(Interval.point(angle.values.middle))
    steep, level = sine_and_cosine(angle.values)
    return _taylor(angle, s / c, 1.0 / (c * c), steep * 2.0 / (level * level * level))


def cosine_of(angle: Quantity) -> Quantity:
    """``cos F`` of an angle, rad."""
    s, c = sine_and_cosine(Interval.point(angle.values.middle))
    values = cosine(angle.values)
    return Quantity(_taylor(angle, c, -s, -values), values)


def secant(angle: Quantity) -> Quantity:
    """``1/cos F`` of an angle, rad."""
    middle = Interval.point(angle.values.middle)
    curvature = _secant_curvature(angle.values)
    form = _taylor(angle, 1.0 / cosine(middle), _secant_slope(middle), curvature)
    return Quantity(form, 1.0 / cosine(angle.values))


def secant_change(roll: Quantity, change: Quantity) -> Form:
    """``1/cos F - 1/cos(F + D)`` for a change D, by the mean-value theorem in F and D."""
    before, by = roll.values, change.values
    after = before + by
    check_inside(after, "roll")
    # Two separately enclosed secants would be as wide as both together. The slope in D is ``-sec'(F
    # + D)``; in F it is ``sec'(F) - sec'(F + D)``: minus D times ``sec''`` in between.
    in_roll, in_change = -(_secant_curvature(before.hull(after)) * by), -_secant_slope(after)
    x_0, moved = before.middle, by.middle
    value = 1.0 / cosine(Interval.point(x_0)) - 1.0 / cosine(Interval.point(x_0) + moved)
    terms, rest = _linear(value, (roll, in_roll), (change, in_change))
    return combined(*terms, shift=rest)


def arctangent(first: Quantity, second: Quantity) -> Form:
    """``atan(F/G)``, G positive."""
    a, b = first.values, second.values
    a_0, b_0 = Interval.point(a.middle), Interval.point(b.middle)
    square = _square(a_0) + _square(b_0)
    angle = Interval.point(np.arctan2(a_0.low, b_0.low))
    # Error of the library's angle: the sine of the error, divided by the distance.
    s, c = sine_and_cosine(angle)
    off = (a_0 * c - b_0 * s).largest / np.sqrt(square.low)
    angle = angle + within(2.0 * off)  # an arcsine is at most pi/2 times its sine
    terms, rest = _linear(angle, (first, b_0 / square), (second, -(a_0 / square)))
    # Half the second derivatives of atan(a/b): -ab/r^4 and ab/r^4, and (a^2 - b^2)/r^4 mixed, where
    # r^2 = a^2 + b^2.
    da, db = (a - a.middle).largest, (b - b.middle).largest
    across = _square(a) + _square(b)
    bend, mixed = a * b / (across * across), (_square(a) - _square(b)) / (across * across)
    rest = rest - bend * up_to(da * da) + bend * up_to(db * db)
    return combined(*terms, shift=rest + mixed * within(da) * within(db))


def up_to(size: FloatArray) -> Interval:
    """The interval from 0 to `size`, which was rounded once."""
    return Interval(np.zeros_like(size), np.nextafter(size, np.inf))


def _square(values: Interval) -> Interval:
    product = values * values
    # The product of an interval with itself ignores that both factors are equal.
    return Interval(np.maximum(product.low, 0.0), product.high)


def product(first: Quantity, second: Quantity) -> Form:
    """``F G``, with ``(F - f)(G - g)`` about their middles as the error."""
    a, b = first.values, second.values
    f, g = a.middle, b.middle
    # F G = g F + f G - f g + (F - f) (G - g)
    remainder = within((a - f).largest) * within((b - g).largest) - Interval.point(f) * g
    return combined((g, first.form), (f, second.form), shift=remainder)


def positive_part(quantity: Quantity, slope: Floats) -> Form:
    """``max(F, 0)``, whose error is extreme at the ends of the values and at 0."""
    low, high = quantity.values.low, quantity.values.high
    errors = [
        Interval.point(np.maximum(point, 0.0)) - Interval.point(point) * slope
        for point in (low, high, np.clip(0.0, low, high))
    ]
    return combined((slope, quantity.form), shift=errors[0].hull(errors[1]).hull(errors[2]))


def _taylor(angle: Quantity, value: Interval, slope: Interval, curvature: Interval) -> Form:
    """``f(m) + f'(m) (F - m) + f''(...) (F - m)^2 / 2`` about the middle m of the values."""
    terms, rest = _linear(value, (angle, slope))
    radius = (angle.values - angle.values.middle).largest
    return combined(*terms, shift=rest + curvature * up_to(0.5 * radius * radius))


def _linear(value: Interval, *parts: tuple[Quantity, Interval]) -> tuple[list[Term], Interval]:
    """``value + sum_k f_k (F_k - m_k)``, with middles m, as terms and a remainder."""
    rest = value
    for quantity, slope in parts:
        rest = rest - Interval.point(slope.middle) * quantity.values.middle
    for (_, values), slope in parts:
        rest = rest + (slope - slope.middle) * within((values - values.middle).largest)
    # A term uses one float as a slope f; the remainder encloses the error of the slope.
    return [(slope.middle, quantity.form) for quantity, slope in parts], rest


def _secant_slope(angle: Interval) -> Interval:
    """``sin/cos^2``, which grows with the angle."""
    ends = (sine_and_cosine(Interval.point(end)) for end in (angle.low, angle.high))
    low, high = (s / (c * c) for s, c in ends)
    return Interval(low.low, high.high)


def _secant_curvature(angle: Interval) -> Interval:
    """``(1 + sin^2)/cos^3``, even, and growing with the absolute value of the angle."""
    s, c = sine_and_cosine(angle)
    largest = Interval.point(s.largest)
    smallest = Interval.point(np.maximum(np.maximum(s.low, -s.high), 0.0))
    low, high = (
        (sine * sine + 1.0) / (Interval.point(level) * level * level)
        for sine, level in ((smallest, c.high), (largest, c.low))
    )
    return Interval(low.low, high.high)
