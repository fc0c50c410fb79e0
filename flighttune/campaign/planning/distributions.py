"""Distributions of dispersed parameters, each an inverse CDF of a point of the unit interval."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from flighttune.arrays import FloatArray

Value: TypeAlias = bool | int | float | str
"""What a key of a scenario can be set to."""

SMALLEST_POINT = 2.0**-54
"""Points of the unit interval are kept this far from 0, and `1 - LARGEST_POINT` from 1."""

LARGEST_POINT = 1.0 - 2.0**-53


class Distribution(Protocol):
    """What a member of the family does.

    Attributes
    ----------
    central : Value
        The value a campaign is checked at: the median, or of values that have none the likeliest.
    """

    @property
    def central(self) -> Value:
        """The value a campaign is checked at."""
        ...

    def at(self, u: FloatArray) -> npt.NDArray[np.generic]:
        """Values at points `u` of the open unit interval, shape as `u`."""
        ...


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal distribution; truncated where a bound is finite.

    Attributes
    ----------
    mean, sd : float
        Of the distribution before it is truncated; `sd` positive.
    lower, upper : float
        Bounds, `lower` below `upper`.
    """

    mean: float
    sd: float
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def central(self) -> float:
        """The median."""
        return float(self.at(np.array([0.5]))[0])

    def at(self, u: FloatArray) -> FloatArray:
        """Values at points `u` of the open unit interval, shape as `u`."""
        if np.isinf(self.lower) and np.isinf(self.upper):
            return self.mean + self.sd * ndtri(u)
        from scipy.stats import truncnorm

        a, b = (self.lower - self.mean) / self.sd, (self.upper - self.mean) / self.sd
        values = self.mean + self.sd * truncnorm.ppf(u, a, b)
        return np.clip(values, self.lower, self.upper)


@dataclass(frozen=True, slots=True)
class LogNormal:
    """Log-normal distribution: the logarithm is normal about that of the median.

    Attributes
    ----------
    median : float
        Positive.
    sd_log : float, 1
        Standard deviation of the natural logarithm, positive.
    """

    median: float
    sd_log: float

    @property
    def central(self) -> float:
        """The median."""
        return self.median

    def at(self, u: FloatArray) -> FloatArray:
        """Values at points `u` of the open unit interval, shape as `u`."""
        return self.median * np.exp(self.sd_log * ndtri(u))


@dataclass(frozen=True, slots=True)
class Uniform:
    """Uniform distribution from `lower` to `upper`.

    Attributes
    ----------
    lower, upper : float
        `lower` below `upper`.
    """

    lower: float
    upper: float

    @property
    def central(self) -> float:
        """The median."""
        return self.lower + 0.5 * (self.upper - self.lower)

    def at(self, u: FloatArray) -> FloatArray:
        """Values at points `u` of the open unit interval, shape as `u`."""
        return self.lower + u * (self.upper - self.lower)


@dataclass(frozen=True, slots=True)
class Choice:
    """One of some values, in proportion to their weights.

    Attributes
    ----------
    values : tuple of Value
        At least one, all numbers, all strings or all booleans.
    weights : tuple of float
        One a value, none negative, their sum positive.
    """

    values: tuple[Value, ...]
    weights: tuple[float, ...]

    @property
    def central(self) -> Value:
        """The likeliest value that is a value; the first of several."""
        known = [(v, w) for v, w in zip(self.values, self.weights, strict=True) if v == v]
        return max(known, key=lambda pair: pair[1], default=(self.values[0], 0.0))[0]

    def at(self, u: FloatArray) -> npt.NDArray[np.generic]:
        """Values at points `u` of the open unit interval, shape as `u`."""
        edges = np.cumsum(self.weights)
        return as_array(self.values)[np.searchsorted(edges, u * edges[-1], side="right")]


@dataclass(frozen=True, slots=True)
class Grid:
    """Values that are all flown, each as often as any other: no distribution of chance.

    Attributes
    ----------
    values : tuple of Value
        At least one, all numbers, all strings or all booleans.
    """

    values: tuple[Value, ...]

    @property
    def central(self) -> Value:
        """The value in the middle."""
        return self.values[(len(self.values) - 1) // 2]

    def at(self, u: FloatArray) -> npt.NDArray[np.generic]:
        """The value whose share of the unit interval `u` lies in, shape as `u`."""
        return as_array(self.values)[(u * len(self.values)).astype(np.intp)]


def as_array(values: tuple[Value, ...]) -> npt.NDArray[np.generic]:
    """Values as an array of booleans, integers, floats or (objects that are) strings."""
    strings = any(isinstance(value, str) for value in values)
    return np.array(values, dtype=object if strings else None)
