"""Exact arithmetic: floats are rationals, and what holds between rationals can be proven.

Matrices are arrays of `fractions.Fraction`; sums and products of them are exact. The sine and the
cosine come as intervals with rational ends.
"""

import math
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.errors import InputError

# An array of `Fraction`.
Rationals: TypeAlias = npt.NDArray[Any]

Interval: TypeAlias = tuple[Fraction, Fraction]

# Less than pi/2, by 2e-17.
HALF_PI_BELOW = Fraction(15707963267948966, 10**16)

# Terms of a Taylor series inside +-pi/2: the next one is below 1e-23.
TERMS = 14


def exact(values: npt.ArrayLike) -> Rationals:
    """`values` as rationals, without rounding.

    Raises
    ------
    InputError
        If one is not finite.
    """
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InputError(f"`values` must be finite, got {array.tolist()}.")
    rationals = [Fraction(value) for value in array.ravel().tolist()]
    return np.array(rationals, dtype=object).reshape(array.shape)


def identity(n: int) -> Rationals:
    """The unit matrix in rationals, shape (n, n)."""
    return exact(np.eye(n))


def integers(matrix: Rationals) -> tuple[Rationals, int]:
    """`matrix` times a common denominator, as integers, and that denominator.

    Products and sums of integers take a fifth of the time of those of `Fraction`, which are reduced
    one by one.
    """
    denominator = math.lcm(*(entry.denominator for entry in matrix.flat))
    return np.vectorize(int, otypes=[object])(matrix * denominator), denominator


def positive_definite(matrix: Rationals) -> bool:
    """Whether a rational matrix is symmetric with only positive eigenvalues: a proof, not a test.

    Parameters
    ----------
    matrix : ndarray of Fraction or int, shape (n, n)

    Notes
    -----
    The leading minors of a matrix of integers (the same one times a common denominator) by
    Bareiss's elimination, in which every division comes out even; Sylvester's criterion.
    """
    if not np.array_equal(matrix, matrix.T):
        return False
    rows = integers(matrix)[0].tolist()
    previous = 1
    for k in range(len(rows)):
        pivot = rows[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, len(rows)):
            for j in range(k + 1, len(rows)):
                rows[i][j] = (rows[i][j] * pivot - rows[i][k] * rows[k][j]) // previous
        previous = pivot
    return True


def sine(angle: float) -> Interval:
    """An interval that contains the sine of a float inside +-pi/2 (rad).

    Raises
    ------
    InputError
        If the angle is not inside +-pi/2.
    """
    x = _inside(angle)
    low, high = _series(abs(x), 1)
    return (low, high) if x >= 0 else (-high, -low)


def cosine(angle: float) -> Interval:
    """An interval that contains the cosine of a float inside +-pi/2 (rad).

    Raises
    ------
    InputError
        If the angle is not inside +-pi/2.
    """
    return _series(abs(_inside(angle)), 0)


def product(first: Interval, second: Interval) -> Interval:
    """The products of the numbers of two intervals."""
    products = [a * b for a in first for b in second]
    return min(products), max(products)


def _inside(angle: float) -> Fraction:
    if not abs(angle) <= HALF_PI_BELOW:
        raise InputError(f"`angle` must lie inside +-pi/2, got {angle} rad.")
    return Fraction(angle)


def _series(x: Fraction, power: int) -> Interval:
    """Two consecutive partial sums of an alternating series with falling terms."""
    term = x**power
    total = Fraction(0)
    for k in range(TERMS):
        total += term
        term = -term * x * x / ((2 * k + power + 1) * (2 * k + power + 2))
    return min(total, total + term), max(total, total + term)
