"""The inner loop as flown: a lag with delay, fitted to what was commanded and what came of it."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import InputError
from flighttune.plants.lagged_channel import rest, transition

STARTS = (4.0, 12.0)
"""Natural frequencies from which the search begins, rad/s."""

FASTEST, SLOWEST = 200.0, 0.2
"""Natural frequencies the fit may take, rad/s."""

LONGEST_DELAY = 0.2
"""s"""

LEAST_DAMPING, MOST_DAMPING = 0.05, 5.0

WORTH = 0.95
"""The second order is taken where it leaves less than this part of the first order's error."""

SILENT = 1e-6
"""Range of a command, rad or 1, up to which the channel counts as not commanded."""

UNSEEN = InnerLag(order=1, natural_frequency=10.0)
"""Lag of a channel that was not commanded: nothing shows it and nothing depends on it."""

Order = Literal[1, 2]


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLag:
    """A lag and how well it tells what was flown.

    Attributes
    ----------
    lag : InnerLag
    fit_percent : float
        Part of the variance of the flown signal that the lag accounts for, times 100; NaN where
        the channel was not commanded.
    """

    lag: InnerLag
    fit_percent: float


def fitted_lag(t: FloatArray, commanded: FloatArray, flown: FloatArray) -> FittedLag:
    """The lag whose response to `commanded` is nearest to `flown` in the least squares.

    Parameters
    ----------
    t : ndarray, shape (n,), s
        Evenly spaced, n > 10.
    commanded : ndarray, shape (n,), unit of the channel
        Held from each sample to the next.
    flown : ndarray, shape (n,), unit of the channel
        Seen at the samples; the first value is taken as at rest.

    Returns
    -------
    FittedLag
        Of first or second order, whichever the data are worth; `UNSEEN` where nothing was
        commanded.

    Raises
    ------
    InputError
        If there are too few samples.
    """
    if not len(t) > 10:
        raise InputError(f"`t` must have more than 10 samples, got {len(t)}.")
    if np.ptp(commanded) <= SILENT:
        return FittedLag(lag=UNSEEN, fit_percent=math.nan)
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    first, second = (_best(order, dt, commanded, flown) for order in (1, 2))
    _, lag = second if second[0] < WORTH * first[0] else first
    return judged_lag(lag, t, commanded, flown)


def judged_lag(lag: InnerLag, t: FloatArray, commanded: FloatArray, flown: FloatArray) -> FittedLag:
    """A lag that came from elsewhere, and how well it tells what was flown; as `fitted_lag`."""
    if np.ptp(commanded) <= SILENT:
        return FittedLag(lag=lag, fit_percent=math.nan)
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    misses = lag_response(lag, dt, commanded, float(flown[0])) - flown
    return FittedLag(
        lag=lag, fit_percent=100.0 * (1.0 - float(np.mean(misses**2)) / float(np.var(flown)))
    )


def lag_response(lag: InnerLag, dt: float, commanded: FloatArray, start: float) -> FloatArray:
    """What a lag makes of commands that are held over samples of `dt` seconds.

    Parameters
    ----------
    lag : InnerLag
    dt : float, s
    commanded : ndarray, shape (n,), unit of the channel
    start : float
        Value flown and commanded before the first sample.

    Returns
    -------
    ndarray, shape (n,)
        At the samples; exact.
    """
    n, whole = lag.order, math.floor(lag.delay / dt)
    late = lag.delay - whole * dt
    whole_step, after = transition(lag, dt), transition(lag, dt - late)
    at_rest = rest(lag)
    new = at_rest - after @ at_rest
    old = after @ (at_rest - transition(lag, late) @ at_rest)
    denominator = np.asarray(np.poly(whole_step), dtype=float)
    numerator = np.zeros(n + 2)
    for entry, b in ((0, new), (1, old)):
        markov = [(np.linalg.matrix_power(whole_step, i) @ b)[0] for i in range(n)]
        numerator[entry + 1 : entry + 1 + n] += np.convolve(denominator, markov)[:n]
    change = np.concatenate([np.zeros(whole), commanded - start])[: len(commanded)]
    driven = np.convolve(numerator, change)[: len(change)]
    return start + _recursion(denominator, driven)


def _recursion(denominator: FloatArray, driven: FloatArray) -> FloatArray:
    """Solve ``y[k] + a_1 y[k-1] + ... = driven[k]`` from rest, order 1 to 3."""
    a_1, a_2, a_3 = np.concatenate([denominator[1:], np.zeros(3)])[:3].tolist()
    y_1 = y_2 = y_3 = 0.0
    flown = []
    for value in driven.tolist():
        y_1, y_2, y_3 = value - a_1 * y_1 - a_2 * y_2 - a_3 * y_3, y_1, y_2
        flown.append(y_1)
    return np.array(flown)


def _best(
    order: Order, dt: float, commanded: FloatArray, flown: FloatArray
) -> tuple[float, InnerLag]:
    def lag_of(x: FloatArray) -> InnerLag:
        damping = math.exp(x[2]) if order == 2 else 1.0
        return InnerLag(
            order=order, natural_frequency=math.exp(x[0]), delay=float(x[1]), damping=damping
        )

    def misses(x: FloatArray) -> FloatArray:
        return lag_response(lag_of(x), dt, commanded, float(flown[0])) - flown

    lower = [math.log(SLOWEST), 0.0, math.log(LEAST_DAMPING)][: order + 1]
    upper = [math.log(FASTEST), LONGEST_DELAY, math.log(MOST_DAMPING)][: order + 1]
    found: list[Any] = [
        least_squares(misses, [math.log(w), 0.5 * dt, 0.0][: order + 1], bounds=(lower, upper))
        for w in STARTS
    ]
    best = min(found, key=lambda solution: solution.cost)
    return 2.0 * float(best.cost) / len(flown), lag_of(best.x)
