"""Windows of flights, their extremes, and the shape of a band learned from them."""

from collections.abc import Iterator
from itertools import product
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.budget import ARRAYS

# Maximum number of windows of a flight, and of numbers kept of all counted flights, in four bytes
# each: a file has room for the rest of its count too.
MAX_WINDOWS, MAX_NUMBERS = 200, ARRAYS.unpacked // 4 - 2**22

# Maximum number of windows of residual signals, which a tube adds up over time. While a command
# moves they cross zero within some samples, and a longer window has their extremes at all of its
# times. For the c172p, in 30 s, the boxes of 200 windows add up to 1.5 (course) and 1.8 times (path
# angle) as much as the boxes of 1000. Not known: the best number. With 500 the file of 1640 flights
# has 26 MB before compression.
MAX_RESIDUAL_WINDOWS = 500

# Minimum number of completed learning flights.
MIN_LEARNED = 10

# Trial shapes: the share of learning flights inside at each time before scaling; the number of
# neighbouring windows that a window includes; and a constant added to every half-width, as a share
# of the largest. Without a constant the band is narrow where flights agree; with a large constant
# it is equally wide at all times.
INSIDE = (0.98, 0.99, 0.995, 1.0)
WINDOWS = (3, 1)
ADDED = (0.0, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)

# Folds of the learning flights; a shape is learned from all folds but one, and scaled by this one.
FOLDS = 5

# Minimum half-width, as a share of the signal's largest, and absolute, because flights may agree to
# the last digit.
LEAST_SHARE, LEAST = 1e-3, 1e-9

# Number of flights looked at together, since the largest count does not fit into memory as doubles.
PART = 1024

# Lowest and highest value of each signal in each window in single precision, shape (N, windows,
# signals, 2) for N flights. A flight that was not completed, or whose distances from a route are
# invalid, has -inf and inf.
Extremes: TypeAlias = npt.NDArray[np.floating]


def window_edges(
    samples: int, flights: int, signals: int, *, most: int = MAX_WINDOWS
) -> npt.NDArray[np.intp]:
    """First samples of the windows of a flight, at most `most`, and the last sample of all."""
    # A large count has fewer windows, so that its extremes fit into memory.
    count = max(1, min(most, MAX_NUMBERS // (2 * flights * signals), samples - 1))
    return np.round(np.linspace(0, samples - 1, count + 1)).astype(np.intp)


def window_extremes(values: FloatArray, edges: npt.NDArray[np.intp]) -> Extremes:
    """Extremes of one flight in windows, shape (windows, signals, 2), rounded outwards."""
    # Windows include both of their edges. Without a row for the last sample, values hold from one
    # sample to the next and windows include only their first edge.
    lasting = len(values) == edges[-1]
    before = values if lasting else values[:-1]
    low, high = (
        ends if lasting else extreme(ends, values[edges[1:]])
        for extreme in (np.fmin, np.fmax)
        for ends in [extreme.reduceat(before, edges[:-1])]
    )
    # A signal without a value in a window may have had any value.
    outwards = [
        np.nextafter(np.nan_to_num(ends, nan=far).astype(np.float32), np.float32(far))
        for ends, far in ((low, -np.inf), (high, np.inf))
    ]
    return np.stack(outwards, axis=-1)


def scores_of(
    extremes: Extremes, wind: FloatArray, coefficients: FloatArray, half: FloatArray
) -> FloatArray:
    """Smallest scale at which each flight is inside at all times; infinite if not completed."""
    scores = [np.zeros(0)]
    for part in parts(len(extremes)):
        away = np.abs(extremes[part] - predicted(wind[part], coefficients)[..., None]).max(axis=-1)
        scores.append((away / half).max(axis=(1, 2)))
    return np.concatenate(scores)


def parts(flights: int) -> Iterator[slice]:
    """Some flights at a time, of all."""
    return (slice(first, first + PART) for first in range(0, flights, PART))


def learned_shape(
    extremes: Extremes, wind: FloatArray, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    """Middle and half-widths of a band, as in `About`."""
    completed = np.isfinite(extremes).all(axis=(1, 2, 3))
    extremes, wind = extremes[completed], wind[completed]
    if len(extremes) < MIN_LEARNED:
        raise InputError(
            f"`learn` must have {MIN_LEARNED} flights that are completed, got {len(extremes)}."
        )
    # The middle is fitted by least squares. Each signal takes the shape that is narrowest after
    # learning from some flights and scaling by the others, in its largest half-width and its
    # geometric mean over time. The scale excludes a share `epsilon` of the flights, so that flights
    # leave all signals about equally often.
    middles = extremes.mean(axis=-1, dtype=float)
    fit, *_ = np.linalg.lstsq(_terms(wind), middles.reshape(len(middles), -1), rcond=None)
    coefficients = fit.reshape(-1, *middles.shape[1:])
    away = extremes - predicted(wind, coefficients)[..., None]
    shapes = [_narrowest(away[:, :, i], epsilon) for i in range(away.shape[2])]
    centres, halves = (np.stack(columns, axis=1) for columns in zip(*shapes, strict=True))
    coefficients[0] += centres
    return coefficients, halves


def _narrowest(away: FloatArray, epsilon: float) -> tuple[FloatArray, FloatArray]:
    """Centre and half-width of the narrowest shape of one signal, shape (windows,) each."""
    flights, best = np.arange(len(away)), (np.inf, 0.0, 0, 0.0, 0.0)
    # Without neighbours, all flights that agree in an extreme lie exactly on the edge: their scores
    # tie, and a count then has fewer flights outside than allowed.
    agree = (np.ptp(away, axis=0) == 0.0).any()
    for inside, windows in product(INSIDE, WINDOWS[:1] if agree else WINDOWS):
        folds = [
            (away[flights % FOLDS == fold], *_hull(away[flights % FOLDS != fold], inside, windows))
            for fold in range(FOLDS)
        ]
        for added in ADDED:
            scores, logs = [], []
            for others, centre, hull in folds:
                half = _widened(hull, added)
                scores.append(np.abs(others - centre[:, None]).max(axis=-1) / half)
                logs.append(np.log(half))
            largest = np.sort(np.concatenate(scores).max(axis=1))[-1 - int(epsilon * len(away)) :]
            scale, log = np.mean(np.log(largest)), np.mean(logs, axis=0)
            # Logarithm of the largest half-width times the geometric mean, each at the scale. Not
            # known: the best mean. A tube adds half-widths up, but with their arithmetic mean,
            # alone or with the largest, the sums of residual boxes differed by some percent, and
            # not always for the better.
            width = 2.0 * scale + log.max() + log.mean()
            best = min(best, (width, inside, windows, added, scale))
    _, inside, windows, added, scale = best
    centre, hull = _hull(away, inside, windows)
    return centre, np.exp(scale) * _widened(hull, added)


def _hull(away: FloatArray, inside: float, windows: int) -> tuple[FloatArray, FloatArray]:
    """Centre and half-width with a share `inside` of flights below and above, at each time."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low = np.quantile(away[..., 0], 1.0 - inside, axis=0)
    high = np.quantile(away[..., 1], inside, axis=0)
    # With 3 windows each includes its neighbours, because the quantiles of few flights are ragged
    # in weather. In calm air this only spreads a peak to its neighbours.
    low = minimum_filter1d(low, windows, mode="nearest")
    high = maximum_filter1d(high, windows, mode="nearest")
    return 0.5 * (low + high), 0.5 * (high - low)


def _widened(half: FloatArray, added: float) -> FloatArray:
    """Half-widths plus a share of the largest half-width."""
    largest = max(half.max(), LEAST)
    return np.maximum(half, LEAST_SHARE * largest) + added * largest


def predicted(wind: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Middles of the band in these winds, shape (N, windows, signals)."""
    return np.einsum("nc,cws->nws", _terms(wind), coefficients)


def _terms(wind: FloatArray) -> FloatArray:
    """All products of at most three wind components, shape (N, 10); (N, 1) without them."""
    if not wind.shape[1]:
        return np.ones((len(wind), 1))
    north, east = wind.T
    return np.column_stack([north**i * east**j for i in range(4) for j in range(4 - i)])
