"""A root strictly inside bounds, in as few evaluations as it takes."""

from collections.abc import Callable

import numpy as np

from flighttune.arrays import FloatArray

_DIFFERENCE = 2.0**-26
"""Of an unknown, as a share of its range."""

_CLOSE = 1e-9
"""Residual below which a step that gains nothing more has met rounding."""

_GAIN, _FAST = 0.5, 0.1
"""A step must gain the one share; be down to the other for the slopes to serve on."""

_ROOM_USED = 0.9
"""Share of the way to a bound that a step takes which would pass it."""

_MOST_STEPS = 25


def interior_root(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """Return the root that Newton's method finds from `start`, down to rounding.

    Parameters
    ----------
    residuals : callable
        From n unknowns to n residuals, all of order 1.
    start : ndarray, shape (n,)
        Strictly inside the bounds.
    bounds : tuple of two ndarrays, shape (n,)
        Lowest and highest value of each unknown.

    Returns
    -------
    ndarray, shape (n,), or None
        None where a step gains too little, as it does where the root lies beyond the bounds.

    Notes
    -----
    Slopes are one-sided differences; after a step that went well they are brought up to date by
    Broyden's formula instead.
    """
    lower, upper = bounds
    x, r, slopes = start, residuals(start), None
    for _ in range(_MOST_STEPS):
        fresh = slopes is None
        if slopes is None:
            slopes = _differences(residuals, x, r, upper - lower)
        try:
            step = np.linalg.solve(slopes, -r)
        except np.linalg.LinAlgError:
            return None
        with np.errstate(divide="ignore"):
            room = float(np.min(np.where(step > 0.0, upper - x, x - lower) / np.abs(step)))
        part = 1.0 if room > 1.0 else _ROOM_USED * room
        step = part * step
        ahead = x + step
        there = residuals(ahead)
        here, now = float(np.abs(r).max()), float(np.abs(there).max())
        if not now < (1.0 - _GAIN * part) * here:
            if here < _CLOSE:
                return x
            if fresh:
                return None
            slopes = None
            continue
        slopes = slopes + np.outer(there, step) / (step @ step) if now < _FAST * here else None
        x, r = ahead, there
    return None


def _differences(
    residuals: Callable[[FloatArray], FloatArray], x: FloatArray, r: FloatArray, span: FloatArray
) -> FloatArray:
    columns = []
    for i, width in enumerate((_DIFFERENCE * span).tolist()):
        moved = x.copy()
        moved[i] += width
        columns.append((residuals(moved) - r) / (moved[i] - x[i]))
    return np.array(columns).T
