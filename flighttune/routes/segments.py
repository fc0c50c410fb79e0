"""References for the outer loop to follow: constants, steps, ramps and doublets."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, read_only_vector
from flighttune.base.units import G_PAPER

# Times that differ by less count as equal, s.
SAME_INSTANT = 1e-9


@dataclass(frozen=True, slots=True)
class Segment:
    """A change that adds to a reference from `start` on, straight between its breaks."""

    start: float  # s
    breaks: tuple[float, ...]  # s after the start, rising
    jumps: tuple[float, ...] = ()  # value at each break, in the unit of the channel
    rates: tuple[float, ...] = ()  # slope after each break, in that unit per second
    # The rate is averaged over this time, so that each change of the rate takes this time, half of
    # it before the break. The total change and the time of its middle stay the same.
    roll_in: float = 0.0  # s, at most the time between two breaks; without jumps

    @property
    def times(self) -> tuple[float, ...]:
        """Times (s) at which it begins and its shape changes."""
        sides = (-0.5 * self.roll_in, 0.5 * self.roll_in) if self.roll_in else (0.0,)
        return tuple(self.start + after + side for after in self.breaks for side in sides)

    @property
    def _parts(self) -> Iterator[tuple[float, float, float]]:
        """Begin and end of each rate, s after the start, and the rate."""
        return zip(self.breaks, self.breaks[1:], self.rates, strict=False)

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the change at times `t`, in the unit of the channel."""
        since, change = t - self.start, np.zeros_like(t)
        if width := self.roll_in:
            for low, high, rate in self._parts:
                begun = np.clip(since - low + 0.5 * width, 0.0, high - low + width)
                late = np.maximum(begun - width, 0.0), np.maximum(begun - (high - low), 0.0)
                change += rate * (begun**2 - late[0] ** 2 - late[1] ** 2) / (2.0 * width)
            return change
        for after, jump in zip(self.breaks, self.jumps, strict=False):
            change += np.where(since >= after, jump, 0.0)
        for low, high, rate in self._parts:
            change += rate * np.clip(since - low, 0.0, high - low)
        return change

    def slope(self, t: FloatArray) -> FloatArray:
        """Return the slope from times `t` on, in unit per second; a jump adds no slope."""
        since, slope, width = t - self.start, np.zeros_like(t), self.roll_in
        for low, high, rate in self._parts:
            if width:
                begun, length = since - low + 0.5 * width, high - low
                risen, fallen = (np.clip(x, 0.0, length) for x in (begun, begun - width))
                slope += rate / width * (risen - fallen)
            else:  # the result must not depend on the rounding of a sample time
                late = since + SAME_INSTANT
                slope += np.where((late >= low) & (late < high), rate, 0.0)
        return slope


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Course and flight-path angle over time: a start value and the segments that add to it.

    Attributes
    ----------
    chi, gamma : float, rad
        Values before any segment.
    chi_segments, gamma_segments : tuple of Segment
        Changes in rad.
    g : float, m/s^2
        Acceleration of gravity, for planned commands.
    V : float or None, m/s
        Airspeed before any segment; None if the plant holds its own airspeed.
    V_segments : tuple of Segment
        Changes in m/s.

    Examples
    --------
    >>> ft.loop.Reference(chi=0.5, gamma=0.1).initial
    (0.5, 0.1)
    """

    chi: float
    gamma: float
    chi_segments: tuple[Segment, ...] = ()
    gamma_segments: tuple[Segment, ...] = ()
    g: float = G_PAPER
    V: float | None = None
    V_segments: tuple[Segment, ...] = ()

    def airspeed(self, t: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the airspeed (m/s) and its rate from times `t` (s) on; None without one."""
        if self.V is None:
            return None
        V = self.V + sum((s(t) for s in self.V_segments), np.zeros_like(t))
        return V, sum((s.slope(t) for s in self.V_segments), np.zeros_like(t))

    @property
    def planned(self) -> bool:
        """Whether the reference rolls in, so that roll and lift can be planned for its rates."""
        return any(s.roll_in for s in (*self.chi_segments, *self.gamma_segments))

    @property
    def initial(self) -> tuple[float, float]:
        """Chi and gamma (rad) at t = 0, segments that start there included."""
        if not (self.chi_segments or self.gamma_segments):  # campaign rows read this often
            return self.chi, self.gamma
        chi, gamma = self.sampled(np.zeros(1))
        return float(chi[0]), float(gamma[0])

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return chi and gamma (rad) at times `t` (s), each of the shape of `t`."""
        t = read_only_vector("t", np.ravel(t)).reshape(np.shape(t))
        chi = self.chi + sum((s(t) for s in self.chi_segments), np.zeros_like(t))
        gamma = self.gamma + sum((s(t) for s in self.gamma_segments), np.zeros_like(t))
        return chi, gamma

    def rates(
        self, t: FloatArray, lead: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rates of chi and gamma (rad/s) from times `t` (s) on, of the shape of `t`.

        A planned reference returns the rates `lead` (s) later.
        """
        t = read_only_vector("t", np.ravel(t)).reshape(np.shape(t))
        ahead = lead if self.planned else (0.0, 0.0)
        chi = sum((s.slope(t + ahead[0]) for s in self.chi_segments), np.zeros_like(t))
        gamma = sum((s.slope(t + ahead[1]) for s in self.gamma_segments), np.zeros_like(t))
        return chi, gamma
