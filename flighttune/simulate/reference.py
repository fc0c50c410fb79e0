"""References for the outer loop to follow: constants, steps, ramps and doublets."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flighttune.arrays import FloatArray, read_only_vector

SAME_INSTANT = 1e-9
"""Times that differ by less are one, s."""


class Segment(Protocol):
    """A change that adds to a reference over time."""

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`, in the unit of the channel."""
        ...

    def slope(self, t: FloatArray) -> FloatArray:
        """Return its slope from times `t` on, in that unit per second; a jump has none."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A jump by `change` at `start` (s)."""

    start: float
    change: float

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`."""
        return np.where(t >= self.start, self.change, 0.0)

    def slope(self, t: FloatArray) -> FloatArray:
        """Return zeros: a jump has no rate."""
        return np.zeros_like(t)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """A change at `rate` per second from `start` for `duration` (s), kept afterwards."""

    start: float
    duration: float
    rate: float

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`."""
        return self.rate * np.clip(t - self.start, 0.0, self.duration)

    def slope(self, t: FloatArray) -> FloatArray:
        """Return `rate` while the change lasts, 0 before and after."""
        # What rounding makes of a sample time shall not decide whether a sample is inside.
        since = t - self.start + SAME_INSTANT
        return np.where((since >= 0.0) & (since < self.duration), self.rate, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Doublet:
    """`amplitude` for `width` seconds from `start`, its opposite for as long, then nothing."""

    start: float
    width: float
    amplitude: float

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`."""
        since = t - self.start
        up = (since >= 0.0) & (since < self.width)
        down = (since >= self.width) & (since < 2.0 * self.width)
        return self.amplitude * (up.astype(float) - down)

    def slope(self, t: FloatArray) -> FloatArray:
        """Return zeros: its jumps have no rate."""
        return np.zeros_like(t)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Course and flight-path angle over time: a start value and the segments that add to it.

    Attributes
    ----------
    chi, gamma : float, rad
        Values before any segment.
    chi_segments, gamma_segments : tuple of Segment
        Changes in rad.
    """

    chi: float
    gamma: float
    chi_segments: tuple[Segment, ...] = ()
    gamma_segments: tuple[Segment, ...] = ()

    @property
    def initial(self) -> tuple[float, float]:
        """Chi and gamma (rad) at t = 0, segments that start there included."""
        chi, gamma = self.sampled(np.zeros(1))
        return float(chi[0]), float(gamma[0])

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return chi and gamma (rad) at times `t` (s), each of the shape of `t`."""
        t = read_only_vector("t", t)
        chi = self.chi + sum((s(t) for s in self.chi_segments), np.zeros_like(t))
        gamma = self.gamma + sum((s(t) for s in self.gamma_segments), np.zeros_like(t))
        return chi, gamma

    def rates(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the rates of chi and gamma (rad/s) from times `t` (s) on, of the shape of `t`."""
        t = read_only_vector("t", t)
        chi = sum((s.slope(t) for s in self.chi_segments), np.zeros_like(t))
        gamma = sum((s.slope(t) for s in self.gamma_segments), np.zeros_like(t))
        return chi, gamma
