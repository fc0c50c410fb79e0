"""Intervals of floats, one per entry of an array, rounded outwards."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray, Floats

LARGEST_ANGLE = 1.56
"""Largest angle of `sine` and `cosine`, rad: 89.4 deg."""

SERIES_ERROR = 1e-13
"""More than the error of a partial sum below: its remainder is under 1e-22 and each of its fewer
than 100 roundings under ``2^-53 cosh(1.56)``."""

SERIES_TERMS = 14


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """All numbers from `low` to `high`, entry by entry.

    A sum, product or quotient contains those of all members: it is computed to the nearest float
    (IEEE 754) and moved outwards by one.
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def point(cls, value: Floats) -> "Interval":
        """The interval that holds one number."""
        at = np.asarray(value, dtype=float)
        return cls(at, at)

    def __add__(self, other: "Interval | Floats") -> "Interval":
        other = _interval(other)
        return _outward(self.low + other.low, self.high + other.high)

    def __neg__(self) -> "Interval":
        return Interval(-self.high, -self.low)

    def __sub__(self, other: "Interval | Floats") -> "Interval":
        return self + -_interval(other)

    def __mul__(self, other: "Interval | Floats") -> "Interval":
        other = _interval(other)
        products = [one * end for one in (self.low, self.high) for end in (other.low, other.high)]
        return _outward(np.minimum.reduce(products), np.maximum.reduce(products))

    def __truediv__(self, other: "Interval") -> "Interval":
        """The quotients; `other` must be positive."""
        quotients = [one / end for one in (self.low, self.high) for end in (other.low, other.high)]
        return _outward(np.minimum.reduce(quotients), np.maximum.reduce(quotients))

    def hull(self, other: "Interval") -> "Interval":
        """The smallest interval that contains both."""
        return Interval(np.minimum(self.low, other.low), np.maximum(self.high, other.high))

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


def sine(angle: Interval) -> Interval:
    """Contains the sines of angles inside +-`LARGEST_ANGLE`."""
    low, high = _series(angle, 1)
    return Interval(np.maximum(low - SERIES_ERROR, -1.0), np.minimum(high + SERIES_ERROR, 1.0))


def cosine(angle: Interval) -> Interval:
    """Contains the cosines of angles inside +-`LARGEST_ANGLE`."""
    ends = _series(angle, 0)
    level = (angle.low <= 0.0) & (angle.high >= 0.0)
    high = np.where(level, 1.0, np.maximum(*ends) + SERIES_ERROR)
    return Interval(np.minimum(*ends) - SERIES_ERROR, np.minimum(high, 1.0))


def _series(angle: Interval, power: int) -> FloatArray:
    """Taylor polynomial of sine (`power` 1) or cosine (0) at both ends, by Horner's rule."""
    ends = np.stack([angle.low, angle.high])
    square, total = ends * ends, np.ones_like(ends)
    for k in range(SERIES_TERMS, 0, -1):
        total *= square
        total /= (2 * k + power - 1) * (2 * k + power)
        np.subtract(1.0, total, out=total)
    return total * ends if power else total


def _interval(value: "Interval | Floats") -> Interval:
    return value if isinstance(value, Interval) else Interval.point(value)


def _outward(low: FloatArray, high: FloatArray) -> Interval:
    return Interval(np.nextafter(low, -math.inf), np.nextafter(high, math.inf))
