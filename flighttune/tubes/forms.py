r"""Affine forms with shared symbols, batched over pieces of a set, with every rounding bounded.

A form is a quantity of a flight as ``c + sum_j g_j xi_j + r`` with symbols ``|xi_j| <= 1`` that all
forms of a piece share and ``|r| <= err``. Forms are computed in floating point; `err` takes up the
rounding: a sum of n products has an error of at most ``n 2^-53 / (1 - n 2^-53)`` times the sum of
their absolute values (N. J. Higham, *Accuracy and Stability of Numerical Algorithms*, SIAM 2002,
section 3.1), and a form of float coefficients differs from the one meant by at most the sum of
what its coefficients differ by.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, Floats
from flighttune.errors import InputError
from flighttune.tubes.interval import Interval, outward

ULP = 2.0**-52

# Roundings allowed for besides those of the sum: of a coefficient, of a quotient of constants
MORE_ROUNDINGS = 8

# Factor that outdoes the rounding of up to a hundred sums of positive numbers
UP = 1.0 + 2.0**-44

# Outdoes the underflow of a sum
TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """One quantity in every piece."""

    coefficients: FloatArray  # shape (P, 1 + M): centre, then the coefficient of every symbol
    err: FloatArray  # shape (P,): bound on what is not in the coefficients
    # shape (P,): at least the sum of the absolute values of coefficients and of `err`
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
Indices: TypeAlias = npt.NDArray[np.intp]
Flags: TypeAlias = npt.NDArray[np.bool_]


def combined(*terms: Term, shift: Floats = 0.0) -> Form:
    """``shift + sum_k a_k F_k`` for numbers ``a_k``: one for all pieces, or one each."""
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
    rounding = (len(terms) + MORE_ROUNDINGS) * ULP * size
    return Form(coefficients, (err + rounding) * UP + TINY, size * UP)


def transformed(matrix: FloatArray, forms: Sequence[Form]) -> list[Form]:
    """``sum_k A_ik F_k`` for each row i of a matrix."""
    weights = np.abs(matrix)
    stacked = np.array([form.coefficients for form in forms])
    coefficients = np.tensordot(matrix, stacked, axes=1)
    err = weights @ np.array([form.err for form in forms])
    size = weights @ np.array([form.size for form in forms]) * UP + TINY
    err = (err + (len(forms) + MORE_ROUNDINGS) * ULP * size) * UP + TINY
    return [Form(*row) for row in zip(coefficients, err, size * UP, strict=True)]


def shifted(slope: Floats, form: Form, rest: Interval) -> Form:
    """``slope F + rest``: a form that encloses a function of F."""
    return combined((slope, form), shift=rest.middle).widened(rest.radius)


def absolute_sum(values: FloatArray) -> FloatArray:
    """At least the sum of absolute values over the last axis."""
    return np.abs(values).sum(axis=-1) * (1.0 + values.shape[-1] * ULP) * UP


def _column(a: Floats) -> Floats:
    return a[:, np.newaxis] if isinstance(a, np.ndarray) and a.ndim else a


class Pieces:
    """A set as a union of P pieces: rows (state and constraints) of forms over common symbols.

    A constraint row is a quantity q of the flight that is known to be inside +-1.
    """

    def __init__(self, centres: FloatArray, constraints: int, capacity: int) -> None:
        P, self.rows = centres.shape
        self.capacity = capacity  # most symbols
        # Coefficients, (P, rows + constraints, 1 + M), with room for M symbols, and errors of forms
        self.values = np.zeros((P, self.rows + constraints, 1 + self.rows))
        self.values[:, : self.rows, 0] = centres
        self.err = np.zeros(self.values.shape[:2])
        # Which rows hold a constraint of any piece
        self.constrained = np.zeros(constraints, dtype=bool)
        # Symbols in use, and their origin: those of a kind follow each other in time
        self.used, self.kind = 0, np.zeros(capacity, dtype=int)

    def __len__(self) -> int:
        return len(self.values)

    def make_room(self, count: int) -> None:
        """Have room for `count` more symbols, and no more: all forms are as wide."""
        wide = np.zeros((*self.values.shape[:2], 1 + self.used + count))
        wide[:, :, : 1 + self.used] = self.values[:, :, : 1 + self.used]
        self.values = wide

    def forms(self) -> list[Form]:
        """The rows of the state."""
        sizes = (np.abs(self.values[:, :, 0]) + absolute_sum(self.values[:, :, 1:])) * UP + self.err
        return [Form(self.values[:, i], self.err[:, i], sizes[:, i] * UP) for i in range(self.rows)]

    def put(self, state: Sequence[Form]) -> None:
        """Replace the rows of the state."""
        self.values[:, : self.rows] = np.stack([form.coefficients for form in state], axis=1)
        self.err[:, : self.rows] = np.stack([form.err for form in state], axis=1)

    def fresh(self, form: Form, kind: int) -> Form:
        """`form` with a symbol of its own for its error."""
        coefficients = form.coefficients.copy()
        coefficients[:, 1 + self.used] = form.err
        self.kind[self.used] = kind
        self.used += 1
        return Form(coefficients, np.zeros_like(form.err), form.size)

    def plain_range(self, form: Form) -> Interval:
        """The values of a form, whatever the constraints."""
        radius = (absolute_sum(form.coefficients[:, 1:]) + form.err) * UP + TINY
        return outward(form.coefficients[:, 0] - radius, form.coefficients[:, 0] + radius)

    def constrained_range(self, form: Form, multipliers: FloatArray) -> Interval:
        """The values of a form where every constraint q holds.

        The `multipliers` mu (shape (P, c)) are any numbers, for the rows of `constrained`:
        ``F = (F - mu q) + mu q``, and q is inside +-1.
        """
        rows = self.rows + np.flatnonzero(self.constrained)
        q, q_err = self.values[:, rows], self.err[:, rows]
        residual = form.coefficients - (multipliers[:, np.newaxis] @ q)[:, 0]
        weights = np.abs(multipliers)
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
        """Take up in the pieces `which` that `form` is inside `to`, in constraint row `row`.

        Form and interval are those of the pieces `which` alone.
        """
        self.constrained[row] = True
        scale = 1.0 / to.radius
        q = combined((scale, form), shift=-to.middle * scale)
        self.values[which, self.rows + row] = q.coefficients
        self.err[which, self.rows + row] = q.err + 4.0 * ULP

    def split(self, indices: Indices) -> None:
        """Append a copy of the pieces `indices`."""
        self.values = np.concatenate([self.values, self.values[indices]])
        self.err = np.concatenate([self.err, self.err[indices]])

    def keep(self, flags: Flags) -> None:
        """Drop all pieces but those `flags` is true for."""
        self.values, self.err = self.values[flags], self.err[flags]

    def reduce(self, pairs: Indices) -> None:
        """Merge or drop the noise symbols `pairs`, shape (n, 2).

        Of a pair (a, b), ``g_a xi_a + g_b xi_b`` is the sum of ``(g_a + g_b) (xi_a + xi_b)/2`` and
        ``(g_a - g_b) (xi_a - xi_b)/2``, or the other way round where that is smaller; the first
        becomes one symbol, the second joins a box. With b negative a alone joins the box. The box,
        an interval a row, takes one symbol a row.
        """
        named = pairs[pairs >= 0]
        if (
            len(np.unique(named)) < len(named)
            or (pairs[:, 0] < 0).any()
            or (named >= self.used).any()
        ):
            raise InputError("`pairs` must name each symbol in use at most once.")
        g = self.values[:, :, 1 : 1 + self.used]
        alone, pair = pairs[pairs[:, 1] < 0, 0], pairs[pairs[:, 1] >= 0]
        first, second = g[:, :, pair[:, 0]], g[:, :, pair[:, 1]]
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
        for i in range(height):
            self.values[:, i, 1 + count + i] = box[:, i]
            self.kind[count + i] = -1 - i
        self.err[:] = 0.0
        self.used = count + height
