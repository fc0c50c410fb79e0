"""Limits on the magnitude and the rate of a command."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import InputError, ShapeError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """Ranges of m commands and of their rates; infinite where there is no limit.

    Attributes
    ----------
    lower, upper : ndarray, shape (m,), input unit
        Range of each command.
    rate_lower, rate_upper : ndarray, shape (m,), input unit per second
        Range of each command's rate; holds zero.
    """

    lower: FloatArray
    upper: FloatArray
    rate_lower: FloatArray
    rate_upper: FloatArray

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "rate_lower", "rate_upper"):
            object.__setattr__(self, name, _read_only_bounds(name, getattr(self, name)))
        if len({getattr(self, name).shape for name in self.__slots__}) != 1:
            raise ShapeError("`lower`, `upper` and the rates must have one length.")
        for low, high in (("lower", "upper"), ("rate_lower", "rate_upper")):
            if not np.all(getattr(self, low) < getattr(self, high)):
                raise InputError(
                    f"`{low}` must be below `{high}`, got {getattr(self, low).tolist()} "
                    f"and {getattr(self, high).tolist()}."
                )
        if not np.all((self.rate_lower <= 0.0) & (self.rate_upper >= 0.0)):
            raise InputError(
                f"The rate ranges must hold zero, got {self.rate_lower.tolist()} "
                f"to {self.rate_upper.tolist()}."
            )

    @classmethod
    def none(cls, m: int) -> "Limits":
        """No limit on any of `m` commands."""
        unbounded = np.full(m, np.inf)
        return cls(lower=-unbounded, upper=unbounded, rate_lower=-unbounded, rate_upper=unbounded)

    def within(self, other: "Limits") -> "Limits":
        """The limits that hold where both these and `other` do.

        Raises
        ------
        InputError
            If no command meets both.
        """
        return Limits(
            lower=np.maximum(self.lower, other.lower),
            upper=np.minimum(self.upper, other.upper),
            rate_lower=np.maximum(self.rate_lower, other.rate_lower),
            rate_upper=np.minimum(self.rate_upper, other.rate_upper),
        )


def _read_only_bounds(name: str, value: npt.ArrayLike) -> FloatArray:
    bounds = np.array(value, dtype=float)
    if bounds.ndim != 1:
        raise ShapeError(f"`{name}` must have 1 axis, got shape {bounds.shape}.")
    if np.isnan(bounds).any():
        raise InputError(f"`{name}` must not be NaN, got {bounds.tolist()}.")
    bounds.flags.writeable = False
    return bounds
