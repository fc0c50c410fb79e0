"""Windows of a flight, and boxes around its residuals in each of them."""

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_at_least, set_read_only
from flighttune.errors import InputError
from flighttune.gaps.residual import RESIDUALS
from flighttune.simulate.bounds import Bounds

Over: TypeAlias = Literal["time", "phase"]

# Default length of a window, s.
WINDOW_S = 0.5

# Shortest window, s: a sample.
SHORTEST_S = 0.02

# Smallest half width of a box, as a share of the widest one of its quantity: without it the next
# flight would need any scale in a window in which the training flights agree to the last digit.
LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Windows into which the samples of a flight fall."""

    # With ``time``, windows follow each other from the start. With ``phase``, window 0 holds the
    # samples while the reference moves, and the others count from its last move, or from the start.
    over: Over
    count: int  # number of windows
    length: float = WINDOW_S  # s: length of a window

    def __post_init__(self) -> None:
        if not SHORTEST_S <= self.length < math.inf:
            raise InputError(
                f"`window` must be at least {SHORTEST_S:g} s long, got {self.length:g} s."
            )
        check_at_least(2 if self.over == "phase" else 1, count=self.count)

    @classmethod
    def covering(cls, over: Over, duration: float, length: float = WINDOW_S) -> "Windows":
        """The windows of `length` (s) in flights of `duration` (s)."""
        # rounding shall not add a window to a duration of whole windows
        count = math.ceil(duration / max(SHORTEST_S, length) - 1e-9) + (over == "phase")
        return cls(over=over, count=count, length=length)

    def of_samples(
        self, t: FloatArray, chi_ref: FloatArray, gamma_ref: FloatArray
    ) -> npt.NDArray[np.intp]:
        """The window of each sample.

        `t` (shape (n,), s): times of the samples. `chi_ref`, `gamma_ref` (shape (n,), rad): the
        reference. The result, shape (n - 1,), leaves out the last sample; samples beyond all
        windows are in the last window.
        """
        since = t[:-1] - t[0]
        first = 0
        if self.over == "phase":
            moves = (np.diff(chi_ref) != 0.0) | (np.diff(gamma_ref) != 0.0)
            stopped = np.maximum.accumulate(np.where(moves, t[1:], t[0]))
            # Window 0 while the reference moves: one length before the first of the others.
            since, first = np.where(moves, -self.length, t[:-1] - stopped), 1
        window = first + np.floor(since / self.length + 1e-9).astype(np.intp)
        return np.minimum(window, self.count - 1)

    def extremes(
        self, values: FloatArray, window: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values in each window.

        `values` has shape (n, m), `window` (n,). `low` and `high` have shape (count, m), with
        ``inf`` and ``-inf`` in a window without samples.
        """
        shape = self.count, values.shape[1]
        low, high = (np.full(shape, end) for end in (np.inf, -np.inf))
        np.minimum.at(low, window, values)
        np.maximum.at(high, window, values)
        return low, high


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateBoxes:
    """Bounds on the quantities `RESIDUALS` in flights, window by window."""

    windows: Windows
    # shape (count, 4), rad/s and rad; read-only
    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        shape = self.windows.count, len(RESIDUALS)
        set_read_only(self, low=shape, high=shape)
        if not (self.low <= self.high).all():
            raise InputError("`low` must not be above `high`.")

    @classmethod
    def around(cls, windows: Windows, lows: FloatArray, highs: FloatArray) -> "RateBoxes":
        """The smallest boxes around flights, but for `LEAST_SHARE`.

        `lows`, `highs` (shape (flights, count, 4), rad/s and rad): `Windows.extremes` of each. A
        window without a flight gets the hull of all others. Raises InputError without a flight.
        """
        if not len(lows):
            raise InputError("`flights` must complete to be learned from, got none that did.")
        low, high = lows.min(axis=0), highs.max(axis=0)
        empty = low > high
        low = np.where(empty, low.min(axis=0), low)
        high = np.where(empty, high.max(axis=0), high)
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        half = np.maximum(half, LEAST_SHARE * half.max(axis=0))
        return cls(windows=windows, low=centre - half, high=centre + half)

    def scaled(self, scale: float) -> "RateBoxes":
        """Boxes `scale` times as wide about the same centres."""
        centre, half = 0.5 * (self.low + self.high), 0.5 * scale * (self.high - self.low)
        return replace(self, low=centre - half, high=centre + half)

    def score(self, low: FloatArray, high: FloatArray) -> float:
        """Smallest scale with which a flight of these `Windows.extremes` stays in the boxes."""
        centre, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        away = np.maximum(high - centre, centre - low)
        # Windows that the flight never enters have none; a box without width is left by any.
        scales = np.divide(away, half, out=np.where(away > 0.0, np.inf, 0.0), where=half > 0.0)
        return float(scales.max(initial=0.0))

    def over(self, t: FloatArray, chi_ref: FloatArray, gamma_ref: FloatArray) -> Bounds:
        """Bounds on a flight from each sample to the next; those of the last are never used.

        `t` (shape (n,), s). `chi_ref`, `gamma_ref` (shape (n,), rad): the reference of the flight.
        """
        window = self.windows.of_samples(t, chi_ref, gamma_ref)
        window = np.append(window, window[-1])
        return Bounds(t, self.low[window], self.high[window], RESIDUALS)
