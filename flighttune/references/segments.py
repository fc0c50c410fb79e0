"""References for the outer loop to follow: constants, steps, ramps and doublets."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flighttune.arrays import FloatArray, read_only_vector

# Times that differ by less are one, s.
SAME_INSTANT = 1e-9


@dataclass(frozen=True, slots=True)
class Segment:
    """A change that adds to a reference from `start` on, straight between its breaks."""

    start: float  # s
    breaks: tuple[float, ...]  # s after the start, rising
    jumps: tuple[float, ...] = ()  # at each break, in the unit of the channel
    rates: tuple[float, ...] = ()  # from each break to the next, in that unit per second

    @property
    def times(self) -> tuple[float, ...]:
        """Times (s) at which it begins and its shape changes."""
        return tuple(self.start + after for after in self.breaks)

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`, in the unit of the channel."""
        since, change = t - self.start, np.zeros_like(t)
        for after, jump in zip(self.breaks, self.jumps, strict=False):
            change += np.where(since >= after, jump, 0.0)
        for (low, high), rate in zip(pairwise(self.breaks), self.rates, strict=False):
            change += rate * np.clip(since - low, 0.0, high - low)
        return change

    def slope(self, t: FloatArray) -> FloatArray:
        """Return the slope from times `t` on, in that unit per second; a jump has none."""
        # The rounding of a sample time shall not decide whether the sample is inside.
        since, slope = t - self.start + SAME_INSTANT, np.zeros_like(t)
        for (low, high), rate in zip(pairwise(self.breaks), self.rates, strict=False):
            slope += np.where((since >= low) & (since < high), rate, 0.0)
        return slope


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Course and flight-path angle over time: a start value and the segments that add to it.

    Attributes
    ----------
    chi, gamma : float, rad
        Values before any segment.
    chi_segments, gamma_segments : tuple of Segment
        Changes in rad.

    Examples
    --------
    >>> ft.Reference(chi=0.5, gamma=0.1).initial
    (0.5, 0.1)
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
