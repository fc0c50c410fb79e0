"""Limits on the magnitude and the rate of a command, as values and sample by sample."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import lt
from typing import Literal, TypeAlias

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, ShapeError

FREE, MAGNITUDE_LIMITED, RATE_LIMITED = 0, 1, 2

# Actions of an integrator while a limit holds the command of its channel.
AntiWindup: TypeAlias = Literal["none", "conditional", "back_calculation"]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """Ranges of m commands and of their rates; infinite without a limit.

    Attributes
    ----------
    lower, upper : ndarray, shape (m,), input unit
        Range of each command.
    rate_lower, rate_upper : ndarray, shape (m,), input unit per second
        Range of each command's rate; contains zero.

    Examples
    --------
    >>> ft.loop.JSBSimPlant("aerosonde").limits.upper.round(3).tolist()
    [0.785, 2.1]
    """

    lower: FloatArray
    upper: FloatArray
    rate_lower: FloatArray
    rate_upper: FloatArray

    def __post_init__(self) -> None:
        ends: dict[str, list[float]] = {}
        for name in ("lower", "upper", "rate_lower", "rate_upper"):
            bounds = np.array(getattr(self, name), dtype=float)
            if bounds.ndim != 1:
                raise ShapeError(f"`{name}` must have 1 axis, got shape {bounds.shape}.")
            bounds.flags.writeable = False
            object.__setattr__(self, name, bounds)
            ends[name] = bounds.tolist()  # a few numbers are compared faster than an array of them
        if len({*map(len, ends.values())}) != 1:
            raise ShapeError("`lower`, `upper` and the rates must have one length.")
        for low, high in (("lower", "upper"), ("rate_lower", "rate_upper")):
            if all(map(lt, ends[low], ends[high])):
                continue
            for name in (low, high):
                if any(map(math.isnan, ends[name])):
                    raise InputError(f"`{name}` must not be NaN, got {ends[name]}.")
            raise InputError(f"`{low}` must be below `{high}`, got {ends[low]} and {ends[high]}.")
        rates = ends["rate_lower"], ends["rate_upper"]
        if not all(low <= 0.0 <= high for low, high in zip(*rates, strict=True)):
            raise InputError(f"The rate ranges must hold zero, got {rates[0]} to {rates[1]}.")

    @classmethod
    def none(cls, m: int) -> "Limits":
        """No limit on any of `m` commands."""
        unbounded = np.full(m, np.inf)
        return cls(lower=-unbounded, upper=unbounded, rate_lower=-unbounded, rate_upper=unbounded)

    def within(self, other: "Limits") -> "Limits":
        """The limits that satisfy both these and `other`; InputError if there are none."""
        return Limits(
            lower=np.maximum(self.lower, other.lower),
            upper=np.minimum(self.upper, other.upper),
            rate_lower=np.maximum(self.rate_lower, other.rate_lower),
            rate_upper=np.minimum(self.rate_upper, other.rate_upper),
        )


def limit_command(
    command: float, before: float, lower: float, upper: float, step_down: float, step_up: float
) -> tuple[float, int]:
    """One command after its limits, and which limit holds it; Numba compiles this too."""
    # `step_down` and `step_up` are the rate limits times the sample time, from the command
    # `before`.
    # The reach of one sample, clipped to the range. If they do not meet (a start outside the
    # range), the rate limit has priority: the command returns at its rate instead of jumping.
    low, high = before + step_down, before + step_up
    low_by_rate, high_by_rate = low > lower, high < upper
    if not low_by_rate:
        low = lower if lower < high else high
    if not high_by_rate:
        high = upper if upper > low else low
    value = low if command < low else high if command > high else command
    excess = command - value
    if excess == 0.0:
        return value, FREE
    by_rate = high_by_rate if excess > 0.0 else low_by_rate
    return value, RATE_LIMITED if by_rate else MAGNITUDE_LIMITED


@checked_class
class CommandLimiter:
    """Limits applied to commands sample by sample, with the record that anti-windup needs.

    If a range and a rate limit disagree (a start outside the range), the rate limit has priority
    until the command is inside.

    Parameters
    ----------
    limits : Limits
        Limits of m commands.
    dt : float, s
        Sample time.

    Attributes
    ----------
    u, u_unsat : list of float, length m
        Commands after and before all limits; the same lists at every sample.
    limited : list of int, length m
        0 free, 1 at a magnitude limit, 2 at a rate limit.

    Examples
    --------
    >>> limits = ft.loop.Limits(lower=[-0.7], upper=[0.7], rate_lower=[-1.0], rate_upper=[1.0])
    >>> limiter = ft.loop.CommandLimiter(limits, dt=0.02)
    >>> limiter.start([0.0])
    >>> limiter.limit(0.5), limiter.limited
    ((0.02,), [2])
    """

    def __init__(self, limits: Limits, dt: float) -> None:
        rows = (limits.lower, limits.upper, limits.rate_lower * dt, limits.rate_upper * dt)
        self._bounds = list(zip(*(row.tolist() for row in rows), strict=True))
        m = len(self._bounds)
        self.u, self.u_unsat, self.limited = [0.0] * m, [0.0] * m, [FREE] * m

    def start(self, u: Sequence[float]) -> None:
        """Take `u` (length m) as the commands in force before the first sample."""
        if len(u) != len(self.u) or not all(map(math.isfinite, u)):
            raise InputError(f"`u` must be {len(self.u)} finite numbers, got {list(u)}.")
        self.u[:] = self.u_unsat[:] = [float(value) for value in u]
        self.limited[:] = [FREE] * len(self.u)

    def limit(self, *wanted: float) -> tuple[float, ...]:
        """Return `wanted` (m commands) after all limits, and take them as in force."""
        for i, (bounds, value) in enumerate(zip(self._bounds, wanted, strict=True)):
            self.u[i], self.limited[i] = limit_command(value, self.u[i], *bounds)
            self.u_unsat[i] = value
        return tuple(self.u)

    @property
    def excess(self) -> tuple[float, ...]:
        """Command before minus command after the limits; its sign is the direction of the limit."""
        return tuple(a - b for a, b in zip(self.u_unsat, self.u, strict=True))
