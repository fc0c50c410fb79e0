"""A root strictly inside bounds, in as few evaluations as it takes."""

from collections.abc import Callable

import numpy as np

from flighttune.arrays import FloatArray

_GAIN, _FAST = 0.5, 0.1
"""A step must gain the one share; be down to the other for the slopes to serve on."""

_ROOM_USED = 0.9
"""Share of the way to a bound that a step takes which would pass it."""

_CLOSE = 1e-9
"""Residual below which a step that gains nothing more has met rounding."""

_HALVINGS = 3
"""How often a step that gains too little is taken half as long."""

_MOST_STEPS = 12


def interior_root(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    widths: FloatArray,
    enough: float = 0.0,
) -> FloatArray | None:
    """Return the root that Newton's method finds from `start`.

    Parameters
    ----------
    residuals : callable
        From n unknowns to n residuals, all of order 1.
    start : ndarray, shape (n,)
        Strictly inside the bounds.
    bounds : tuple of two ndarrays, shape (n,)
        Lowest and highest value of each unknown.
    widths : ndarray, shape (n,)
        Differences of the unknowns that slopes are taken over.
    enough : float
        Residual at which the search ends; by default it goes down to rounding.

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
        here, fresh = float(np.abs(r).max()), slopes is None
        if slopes is None:
            slopes = _differences(residuals, x, r, np.where(x + widths < upper, widths, -widths))
        try:
            step = np.linalg.solve(slopes, -r)
        except np.linalg.LinAlgError:
            return None
        with np.errstate(divide="ignore"):
            room = float(np.min(np.where(step > 0.0, upper - x, x - lower) / np.abs(step)))
        part = 1.0 if room > 1.0 else _ROOM_USED * room
        for _ in range(1 + _HALVINGS * (fresh and here > _CLOSE)):
            moved = part * step
            there = residuals(x + moved)
            now = float(np.abs(there).max())
            if now < (1.0 - _GAIN * part) * here:
                break
            part *= 0.5
        else:
            if here < _CLOSE or fresh:
                return x if here < _CLOSE else None
            slopes = None
            continue
        slopes = slopes + np.outer(there, moved) / (moved @ moved) if now < _FAST * here else None
        x, r = x + moved, there
        if now < enough:
            return x
    return None


def _differences(
    residuals: Callable[[FloatArray], FloatArray], x: FloatArray, r: FloatArray, widths: FloatArray
) -> FloatArray:
    columns = []
    for i, width in enumerate(widths.tolist()):
        moved = x.copy()
        moved[i] += width
        columns.append((residuals(moved) - r) / (moved[i] - x[i]))
    return np.array(columns).T
