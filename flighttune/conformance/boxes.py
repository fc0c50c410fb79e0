"""Windows of a flight, and boxes that hold its residuals and errors inside each of them."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_at_least, read_only_matrix
from flighttune.conformance.residual import COUNTED, RESIDUALS, ConformantModel, residuals_of
from flighttune.errors import InputError
from flighttune.guarantee.bounds import Bounds
from flighttune.plants.base import FlightCondition
from flighttune.simulate.run import Run

Over: TypeAlias = Literal["time", "phase"]

# Default length of a window, s.
WINDOW_S = 0.5

# Shortest window, s: a sample.
SHORTEST_S = 0.02

# Smallest half width of a box, as a share of the widest one of its quantity: without it the next
# flight would leave a window in which the training flights agree to the last digit.
LEAST_SHARE = 0.05

# Time shift allowed between training and new flights, s: each error box covers the errors within
# +-LATER_S, so that a flight that settles later stays inside.
LATER_S = 2.0

# Widening of boxes learned from too few flights to fit a tail.
MARGIN = 1.25

# Share of the scores in the tail, their maximum number, and the fewest flights for a fit.
TAIL, MAX_TAIL, MIN_FLIGHTS = 0.1, 100, 50

# Probability, by the fitted tail, that any of the fresh flights leaves the boxes.
CHANCE = 0.1

# Shape of the fitted tail, a generalised Pareto distribution. With 0, an exponential tail, four
# counts in light turbulence failed, each by one flight: in a mixture of winds the extremes have a
# heavier tail than in any one of them.
SHAPE = 0.15


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualSummary:
    """Summary of a flight: the extremes of its residuals and errors in each window."""

    model: ConformantModel
    windows: Windows

    def of_flight(self, run: Run, start: FlightCondition) -> tuple[FloatArray, FloatArray]:
        """`Windows.extremes` of the quantities `COUNTED` in a flight that began at `start`.

        An error belongs both to the window of its own sample and to that of the sample before.
        """
        signals = run.signals
        references = (signals[name].to_numpy() for name in ("chi_ref", "gamma_ref"))
        window = self.windows.of_samples(run.t, *references)
        residual = self.windows.extremes(residuals_of(self.model, run, start), window)
        errors = signals[["chi_err", "gamma_err"]].to_numpy()
        at_both = np.concatenate([errors[:-1], errors[1:]])
        error = self.windows.extremes(at_both, np.concatenate([window, window]))
        low, high = (np.hstack(ends) for ends in zip(residual, error, strict=True))
        return low, high


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateBoxes:
    """Bounds on the quantities `COUNTED` in flights, window by window."""

    windows: Windows
    # shape (count, 6), rad/s and rad; read-only
    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        shape = self.windows.count, len(COUNTED)
        for name in ("low", "high"):
            value = read_only_matrix(name, getattr(self, name), shape)
            object.__setattr__(self, name, value)
        if not (self.low <= self.high).all():
            raise InputError("`low` must not be above `high`.")

    def over(self, t: FloatArray, chi_ref: FloatArray, gamma_ref: FloatArray) -> Bounds:
        """Bounds on a flight from each sample to the next; those of the last are never used.

        `t` (shape (n,), s). `chi_ref`, `gamma_ref` (shape (n,), rad): the reference of the flight.
        """
        window = self.windows.of_samples(t, chi_ref, gamma_ref)
        window = np.append(window, window[-1])
        return Bounds(t, self.low[window], self.high[window], COUNTED)

    def hold(self, low: FloatArray, high: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether flights stay in the boxes from start to end.

        `low`, `high` (shape (..., count, 6), rad/s and rad): see `Windows.extremes`. The result has
        shape (...). A flight with NaN does not stay inside.
        """
        return np.all((low >= self.low) & (high <= self.high), axis=(-2, -1))


def fitted_boxes(
    windows: Windows, lows: FloatArray, highs: FloatArray, fresh: int
) -> tuple[RateBoxes, float]:
    """Boxes around the training flights, wide enough for fresh ones, and their widening.

    `lows`, `highs` (shape (flights, count, 6), rad/s and rad): `Windows.extremes` of each. `fresh`:
    number of flights that are to stay inside. The widening is the largest ratio of a half width to
    that of the smallest boxes around the training flights. Raises InputError if there is no flight.
    """
    if not len(lows):
        raise InputError("`flights` must reach their end to be learned from, got none that did.")
    later = round(LATER_S / windows.length)
    widened = widening(lows, highs, fresh, later)
    centre, half = _smallest(lows, highs, later)
    half = widened * half
    return RateBoxes(windows=windows, low=centre - half, high=centre + half), float(widened.max())


def widening(lows: FloatArray, highs: FloatArray, fresh: int, later: int = 0) -> FloatArray:
    """Factor by which the boxes of each quantity must be widened for fresh flights to stay inside.

    The score of a flight is the widening with which it stays in the smallest boxes around the other
    half of the flights. The upper `TAIL` of the scores is fitted by a generalised Pareto
    distribution (S. Coles, *An Introduction to Statistical Modeling of Extreme Values*, chapter 4)
    of shape `SHAPE` with the same mean. With the factors returned, the probability that any fresh
    flight is outside is at most `CHANCE`, shared by the quantities. No claim rests on this fit; it
    only decides how often a count succeeds.

    `lows`, `highs` (shape (flights, count, 6), rad/s and rad): extremes of the training flights.
    `fresh`: number of flights that are to stay inside. `later`: windows by which a flight may be
    earlier or later than another. The factors, shape (6,), are at least 1.
    """
    flights = len(lows)
    if flights < MIN_FLIGHTS:
        return np.full(lows.shape[2], MARGIN)
    scores = np.empty((flights, lows.shape[2]))
    for half, other in ((0, 1), (1, 0)):
        centre, width = _smallest(lows[other::2], highs[other::2], later)
        outermost = np.maximum(highs[half::2] - centre, centre - lows[half::2])
        scores[half::2] = (outermost / width).max(axis=1)
    scores.sort(axis=0)
    above = min(MAX_TAIL, round(TAIL * flights))
    start = scores[-above - 1]
    excess = (scores[-above:] - start).mean(axis=0)
    # Quantile of the tail, in mean excesses, for the chance shared by all flights and quantities.
    rarer = above / flights * fresh * len(start) / CHANCE
    further = (1.0 - SHAPE) / SHAPE * (rarer**SHAPE - 1.0)
    return np.maximum(1.0, start + further * excess)


def _smallest(lows: FloatArray, highs: FloatArray, later: int) -> tuple[FloatArray, FloatArray]:
    """Centres and half widths, shape (count, 6), of the smallest boxes around flights."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low, high = lows.min(axis=0), highs.max(axis=0)
    for column in range(len(RESIDUALS), low.shape[1]):
        low[:, column] = minimum_filter1d(low[:, column], 2 * later + 1, mode="nearest")
        high[:, column] = maximum_filter1d(high[:, column], 2 * later + 1, mode="nearest")
    # A window without a flight, low = inf and high = -inf, gets the hull of all the others.
    empty = low > high
    low = np.where(empty, low.min(axis=0), low)
    high = np.where(empty, high.max(axis=0), high)
    half = 0.5 * (high - low)
    return 0.5 * (low + high), np.maximum(half, LEAST_SHARE * half.max(axis=0))
