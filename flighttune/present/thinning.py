"""Long flights in few points: what a screen can show of them, with every peak."""

import numpy as np

from flighttune.arrays import FloatArray

# Samples up to which a line is drawn as it is: four minutes at 50 Hz.
MOST = 12_000

# Points of a line in a chart.
MAX_DRAWN = 600


def peaks(values: FloatArray, *, most: int = MOST) -> np.ndarray:
    """Samples to draw of a long flight: the lowest and the highest of every stretch.

    The lines `values`, shape (n, k) or (n,), are over the same time; of each stretch with a gap
    (NaN) one sample of the gap is kept too. The indices increase, from the first to the last.
    """
    n = len(values)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    width = int(np.diff(edges).max())
    inside = np.minimum(edges[:-1, None] + np.arange(width), (edges[1:] - 1)[:, None])
    samples = [np.array([0, n - 1])]
    for line in values.reshape(n, -1).T:
        stretches = line[inside]
        gap = np.isnan(stretches)
        for extreme, missing in ((np.argmin, np.inf), (np.argmax, -np.inf)):
            filled = np.where(gap, missing, stretches)
            samples.append(inside[np.arange(len(inside)), extreme(filled, axis=1)])
        # Without one missing sample the line would be drawn straight across a short gap.
        broken = np.flatnonzero(gap.any(axis=1))
        samples.append(inside[broken, gap[broken].argmax(axis=1)])
    return np.unique(np.concatenate(samples))


def thinned(x: FloatArray, y: FloatArray, most: int = MAX_DRAWN) -> tuple[FloatArray, FloatArray]:
    """At most about `most` points of a line that keep every peak and every gap."""
    if len(x) <= most:
        return x, y
    samples = peaks(y, most=most)
    return x[samples], y[samples]


def evenly(n: int, *, most: int = MOST) -> np.ndarray:
    """Samples to draw of `n` where peaks do not matter: every one, or evenly spaced ones."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))
