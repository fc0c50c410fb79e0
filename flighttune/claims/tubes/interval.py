"""Intervals of floats, one per entry of an array, rounded outwards."""

import math
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np

from flighttune.base.arrays import FloatArray, Floats

# Largest angle of `sine` and `cosine`, rad: 89.4 deg
LARGEST_ANGLE = 1.56

# Exceeds the error of a partial sum below: its remainder is under 1e-22, and each of its fewer than
# 100 roundings is under ``2^-53 cosh(1.56)``.
SERIES_ERROR = 1e-13

SERIES_TERMS = 14

# Directions for `np.nextafter`, as arrays because it would convert a float at every call
LEAST, MOST = np.array(-np.inf), np.array(np.inf)


class Unbounded(Exception):
    """The set can no longer be enclosed; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """All numbers from `low` to `high`, entry by entry.

    A sum, product or quotient contains the results for all members: it is computed to the nearest
    float (IEEE 754) and moved outwards by one float.
    """

    low: FloatArray
    high: FloatArray

    __array_ufunc__: ClassVar = None  # NumPy leaves arithmetic with an interval to this class

    @classmethod
    def point(cls, value: Floats) -> "Interval":
        """The interval of one number."""
        x = np.asarray(value, dtype=float)
        return cls(x, x)

    def __add__(self, other: "Interval | Floats") -> "Interval":
        other = _interval(other)
        return outward(self.low + other.low, self.high + other.high)

    def __neg__(self) -> "Interval":
        return Interval(-self.high, -self.low)

    def __sub__(self, other: "Interval | Floats") -> "Interval":
        other = _interval(other)
        return outward(self.low - other.high, self.high - other.low)

    def __mul__(self, other: "Interval | Floats") -> "Interval":
        other = _interval(other)
        return _hull_of(*(a * b for a in (self.low, self.high) for b in (other.low, other.high)))

    def __truediv__(self, other: "Interval") -> "Interval":
        """The quotients; `other` must be positive."""
        return _hull_of(*(a / b for a in (self.low, self.high) for b in (other.low, other.high)))

    def __rtruediv__(self, other: Floats) -> "Interval":
        return Interval.point(np.broadcast_to(other, self.low.shape)) / self

    def hull(self, other: "Interval") -> "Interval":
        """The smallest interval that contains both."""
        return Interval(np.minimum(self.low, other.low), np.maximum(self.high, other.high))

    @property
    def ordered(self) -> "Interval":
        """The interval with ordered ends; for a piece without flights any range is valid."""
        return Interval(np.minimum(self.low, self.high), np.maximum(self.low, self.high))

    @property
    def middle(self) -> FloatArray:
        """A float near the middle."""
        return 0.5 * (self.low + self.high)

    @property
    def radius(self) -> FloatArray:
        """At least the distance from `middle` to either end."""
        middle = self.middle
        return np.nextafter(np.maximum(self.high - middle, middle - self.low), np.inf)

    @property
    def largest(self) -> FloatArray:
        """The largest absolute value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))


def within(radius: Floats) -> Interval:
    """The numbers of absolute value up to `radius`."""
    radius = np.asarray(radius, dtype=float)
    return Interval(-radius, radius)


def check_inside(angle: Interval, name: str, largest: float = LARGEST_ANGLE) -> None:
    """Refuse angles outside +-`largest`: Unbounded names them."""
    if not (angle.largest < largest).all():
        raise Unbounded(f"{name} cannot be kept inside {math.degrees(largest):.3g} deg")


def cosine(angle: Interval) -> Interval:
    """Contains the cosines of angles inside +-`LARGEST_ANGLE`."""
    return sine_and_cosine(angle)[1]


def sine_and_cosine(angle: Interval) -> tuple[Interval, Interval]:
    """Intervals that contain the sines and the cosines of angles inside +-`LARGEST_ANGLE`."""
    ends = np.array([angle.low, angle.high])
    # Taylor polynomials at both ends, by Horner's rule: 1 - x^2/d_1 (1 - x^2/d_2 (1 - ...)).
    square, total = ends * ends, np.ones((2, *ends.shape))
    for divisor in _divisors(ends.ndim):
        total *= square
        total /= divisor
        np.subtract(1.0, total, out=total)
    (low, high), ends_of_cosine = total[1] * ends, total[0]
    # The sine grows up to 90 deg, so its extremes are at the ends of the angle; the cosine peaks at
    # 0.
    sines = Interval(np.maximum(low - SERIES_ERROR, -1.0), np.minimum(high + SERIES_ERROR, 1.0))
    level = (angle.low <= 0.0) & (angle.high >= 0.0)
    largest = np.where(level, 1.0, np.maximum(*ends_of_cosine) + SERIES_ERROR)
    return sines, Interval(np.minimum(*ends_of_cosine) - SERIES_ERROR, np.minimum(largest, 1.0))


@cache
def _divisors(dimensions: int) -> FloatArray:
    """Coefficients of cosine, then of sine; the last term comes first."""
    k, power = np.arange(SERIES_TERMS, 0, -1.0)[:, np.newaxis], np.array([0.0, 1.0])
    return ((2.0 * k + power - 1.0) * (2.0 * k + power)).reshape(SERIES_TERMS, 2, *[1] * dimensions)


def _interval(value: "Interval | Floats") -> Interval:
    return value if isinstance(value, Interval) else Interval.point(value)


def _hull_of(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> Interval:
    # Three calls with two arrays are faster than one array of four for `reduce`.
    return outward(
        np.minimum(np.minimum(a, b), np.minimum(c, d)),
        np.maximum(np.maximum(a, b), np.maximum(c, d)),
    )


def outward(low: FloatArray, high: FloatArray) -> Interval:
    """Intervals between ends rounded to the nearest float, each moved out by one float."""
    return Interval(np.nextafter(low, LEAST), np.nextafter(high, MOST))
