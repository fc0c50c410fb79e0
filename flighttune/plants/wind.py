"""Wind over time, and what it makes of a velocity through the air."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, read_only_vector
from flighttune.errors import InputError, ShapeError

NED: TypeAlias = tuple[float, float, float]

CALM: NED = (0.0, 0.0, 0.0)

WIND = ("wind_north", "wind_east", "wind_down")
"""Signals of the wind that a plant met, m/s."""


@dataclass(frozen=True, slots=True)
class WindPiece:
    """Wind that changes at a constant rate: ``w_0 + rate (t - t_0)``."""

    t_0: float  # s
    w_0: NED  # m/s: north, east and down at `t_0`
    rate: NED  # m/s^2

    def at(self, t: float) -> NED:
        """Wind at time `t` (s), m/s, north, east and down."""
        dt = t - self.t_0
        (n, e, d), (n_dot, e_dot, d_dot) = self.w_0, self.rate
        return n + n_dot * dt, e + e_dot * dt, d + d_dot * dt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindRecord:
    """Wind met on a flight: linear between its samples, constant before and after them.

    Positive components are air that moves north, east and down.
    """

    t: FloatArray  # shape (n,), s: times of the samples, rising
    # `north`, `east` and `down` (shape (n,), m/s)
    north: FloatArray
    east: FloatArray
    down: FloatArray
    _times: list[float] = field(init=False, repr=False)
    _pieces: tuple[WindPiece, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("t", "north", "east", "down"):
            values = read_only_vector(name, getattr(self, name))
            if not 0 < len(values) == len(self.t):
                raise ShapeError(
                    f"`{name}` must have as many values as `t`, at least 1, "
                    f"got {len(values)} and {len(self.t)}."
                )
            object.__setattr__(self, name, values)
        if not (np.diff(self.t) > 0.0).all():
            raise InputError("`t` of a wind record must rise from sample to sample.")
        times = self.t.tolist()
        samples = np.column_stack([self.north, self.east, self.down])
        rates = np.zeros_like(samples)
        rates[:-1] = np.diff(samples, axis=0) / np.diff(self.t)[:, None]
        pieces = [WindPiece(times[0], _triple(samples[0]), CALM)]
        pieces += [
            WindPiece(t, _triple(w), _triple(rate))
            for t, w, rate in zip(times, samples, rates, strict=True)
        ]
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_pieces", tuple(pieces))

    @classmethod
    def steady(cls, *, north: float = 0.0, east: float = 0.0, down: float = 0.0) -> "WindRecord":
        """The same wind throughout, m/s."""
        return cls(
            t=np.zeros(1), north=np.array([north]), east=np.array([east]), down=np.array([down])
        )

    def piece(self, t: float) -> WindPiece:
        """The linear piece in force from time `t` (s) on."""
        return self._pieces[bisect_right(self._times, t)]

    def knots(self, start: float, end: float) -> list[float]:
        """Times of samples strictly between `start` and `end`, s."""
        times = self._times
        first, last = bisect_right(times, start), bisect_right(times, end)
        return [t for t in times[first:last] if t < end]


def course_of(velocity: NED) -> tuple[float, float]:
    """Course and flight-path angle of a velocity in north, east, down.

    `chi`, `gamma` (rad): course clockwise from north in (-pi, pi]; angle above the horizon, climb
    positive.
    """
    north, east, down = velocity
    return math.atan2(east, north), math.atan2(-down, math.hypot(north, east))


def velocity_along(V: float, chi: float, gamma: float) -> NED:
    """Velocity (north, east, down, unit of `V`) of speed `V` along course and path angle (rad)."""
    level = V * math.cos(gamma)
    return level * math.cos(chi), level * math.sin(chi), -V * math.sin(gamma)


def _triple(values: npt.ArrayLike) -> NED:
    north, east, down = np.asarray(values, dtype=float).tolist()
    return north, east, down
