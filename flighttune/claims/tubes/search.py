"""The search for an enclosure and for an invariant set; the proof does not trust its results.

It chooses slopes, splits and symbols to remove for a narrow enclosure, then a set that the settled
loop maps into itself.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import schur, solve_discrete_lyapunov

from flighttune.base.arrays import FloatArray
from flighttune.claims.tubes import exact, interval, sample
from flighttune.claims.tubes.forms import Form, Indices, Pieces
from flighttune.claims.tubes.proof import SYMBOLS, HandOver, for_ever, inside, return_map, settled

# Symbols removed at a time
REMOVED_AT_ONCE = 70

# Cost of a wider row when symbols are removed; 1 for the other rows
WEIGHT = {sample.EXTRA_LIFT: 0.5, sample.CHI_ERR: 0.1, sample.GAMMA_ERR: 0.1}

CONSTRAINT_WEIGHT = 0.02

# Size of the set for linearising the loop
LINEARISED_SIZE = 1e-6

# Largest number N of samples that map a set into itself
MAX_SAMPLES = 800

# Contraction of the linear loop over N samples that determines N
CONTRACTION = 0.15

# Eigenvalue below which a mode has decayed within a few samples
FAST_EIGENVALUE = 0.5

# Size of the first trial set, relative to the set of the last sample
FIRST_SIZE = 2.0

GROWTH, ROUNDS = 1.3, 8

# A further round is tried only if a set shrinks to this share of its size
SMALLEST_GAIN = 0.9

# Share of the set that the search leaves free, because another machine may add up in another order
SLACK = 1e-6


class Search:
    """A `Plan` that seeks a narrow enclosure and records its choices.

    `tolerance`: pieces are split if a limit may or may not hold a command, and both sides are
    larger than twice this share of the command's step in a sample. `most`: number of pieces at
    which splitting stops; by default there is no split.
    """

    def __init__(self, loop: sample.SampledLoop, *, tolerance: float = 1.0, most: int = 0) -> None:
        scales = [
            law.step_up if np.isfinite(law.step_up) else 0.01 * min(law.upper - law.lower, 1e3)
            for law in loop.law.channels
        ]
        # A channel with feedback has two commands, one after the other.
        self._scales = np.repeat(scales, 2 if loop.law.feeds_back else 1)
        self._tolerance, self._most = tolerance, most
        self.chosen: list[npt.NDArray[np.float32]] = []

    @property
    def choices(self) -> npt.NDArray[np.float32]:
        """All choices so far, for `Replay`."""
        return np.concatenate([np.zeros(0), *self.chosen]).astype(np.float32)

    def multipliers(self, pieces: Pieces, form: Form) -> FloatArray:
        """Multipliers of the constraints that explain the form best, by least squares."""
        rows = pieces.rows + np.flatnonzero(pieces.constrained)
        q, f = pieces.values[:, rows, 1:], form.coefficients[:, 1:]
        square = np.maximum((q * q).sum(axis=2), 1e-20)
        along = (q @ f[:, :, np.newaxis])[:, :, 0]
        # Candidates, by least squares: each constraint alone, all, or none. The narrowest wins.
        single = (along / square)[:, :, np.newaxis] * np.eye(q.shape[1])
        # Regularised, because constraints of one piece may repeat each other.
        gram = q @ q.transpose(0, 2, 1) + 1e-6 * square[:, :, np.newaxis] * np.eye(q.shape[1])
        every = np.linalg.solve(gram, along[:, :, np.newaxis]).transpose(0, 2, 1)
        tried = np.concatenate([single, every, np.zeros_like(every)], axis=1)
        residual = np.abs(f[:, np.newaxis] - tried @ q).sum(axis=2) + np.abs(tried).sum(axis=2)
        return self._record(tried[np.arange(len(f)), residual.argmin(axis=1)])

    def slope(self, values: interval.Interval) -> FloatArray:
        """Slope of the chord of ``max(x, 0)`` over the values."""
        low, high = values.low, values.high
        rise = np.maximum(high, 0.0) - np.maximum(low, 0.0)
        return self._record(rise / np.maximum(high - low, 1e-300))

    def cut(self, pieces: Pieces, channels: Sequence[sample.Channel]) -> sample.Cut | None:
        """Split at the first limit that some flights of a piece clearly reach and others do not."""
        if len(pieces) < self._most:
            for i, channel in enumerate(channels):
                for side, excess in channel.excesses.items():
                    # Beyond the limit by more than the increment, the integral is held too.
                    splits = np.maximum((channel.by * side).high, 0.0)
                    values = excess.values
                    smaller = np.minimum(values.high - splits, splits - values.low)
                    flags = smaller > 2.0 * self._tolerance * self._scales[i]
                    if flags.any():
                        row = _row_to_replace(pieces, excess.form)
                        self._record(np.array([1.0, i, side]))
                        self._record(flags)
                        splits = self._record(splits)
                        self._record(row)
                        return i, side, flags, splits, row
        self._record(np.zeros(3))
        return None

    def pairs(self, pieces: Pieces) -> Indices:
        """Symbols to merge: similar neighbours in time of one kind, else small symbols."""
        height, n = pieces.values.shape[1], pieces.used
        need = n + REMOVED_AT_ONCE + height - pieces.capacity
        weights = np.full(height, CONSTRAINT_WEIGHT)
        weights[: pieces.rows] = [WEIGHT.get(row, 1.0) for row in range(pieces.rows)]
        g = pieces.values[:, :, 1 : 1 + n] * weights[np.newaxis, :, np.newaxis]
        order = np.argsort(pieces.kind[:n], kind="stable")
        same = pieces.kind[order[:-1]] == pieces.kind[order[1:]]
        first, second = order[:-1][same], order[1:][same]
        a, b = g[:, :, first], g[:, :, second]
        alone, apart, together = (np.abs(x).sum(axis=1).max(axis=0) for x in (g, a - b, a + b))
        costs = np.concatenate([alone, np.minimum(apart, together)])
        symbols = np.concatenate([np.arange(n), first]), np.concatenate([np.full(n, -1), second])
        pairs: list[tuple[int, int]] = []
        taken: set[int] = set()
        for symbol, partner in np.stack(symbols, axis=1)[np.argsort(costs, kind="stable")].tolist():
            if len(pairs) >= need:
                break
            if symbol not in taken and partner not in taken:
                taken |= {symbol, partner} - {-1}
                pairs.append((symbol, partner))
        self._record([float(len(pairs))])
        chosen = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        self._record(chosen)
        return chosen

    def _record(self, values: npt.ArrayLike) -> FloatArray:
        # Single precision, since any number is valid and a short one suffices.
        rounded = np.asarray(values, dtype=np.float32)
        self.chosen.append(rounded.ravel())
        return rounded.astype(float)


def _row_to_replace(pieces: Pieces, form: Form) -> Indices:
    """A free row of the constraints, or the row closest to the new constraint."""
    q = pieces.values[:, pieces.rows : pieces.rows + sample.SPLITS, 1:]
    g = form.coefficients[:, 1:]
    size = np.linalg.norm(q, axis=2) * np.linalg.norm(g, axis=1)[:, np.newaxis]
    alike = np.abs((q @ g[:, :, np.newaxis])[:, :, 0]) / np.maximum(size, 1e-300)
    return np.where(size == 0.0, 2.0, alike).argmax(axis=1)


def coordinates(loop: sample.SampledLoop) -> tuple[FloatArray, int] | None:
    """Rows W in which the settled loop contracts, and the number of samples; None if never."""
    steady, n = loop.steady, loop.rows
    pieces = Pieces(steady[np.newaxis], 0, SYMBOLS)
    pieces.values[0, :, 1 : 1 + n] = LINEARISED_SIZE * np.eye(n)
    pieces.used = n
    try:
        exact.enclosure_of(settled(loop, 1), pieces, Search(loop)).sample(1)
    except interval.Unbounded:
        return None
    A = pieces.values[0, :n, 1 : 1 + n] / LINEARISED_SIZE
    if not np.abs(np.linalg.eigvals(A)).max() < 1.0:
        return None
    # Any W is valid; with this W the linear loop shrinks the norm of ``W z``.
    W = np.concatenate([_contracting(A, slow=slow) for slow in (True, False)])
    step = W @ A @ np.linalg.inv(W)
    power = np.eye(n)
    for samples in range(1, MAX_SAMPLES + 1):
        power = power @ step
        if np.abs(power).sum(axis=1).max() <= CONTRACTION:
            return W, samples
    return None


def _contracting(A: FloatArray, *, slow: bool) -> FloatArray:
    """Rows of the slow or of the fast modes, in which the norm shrinks."""

    def wanted(re: float, im: float) -> bool:
        return (np.hypot(re, im) >= FAST_EIGENVALUE) == slow

    # Commands follow errors and integrals within a sample. Without separated modes the set would
    # contain commands that do not, and a rate limit would hold them.
    sorted_modes: Any = schur(A.T, sort=wanted)
    T, Q, count = sorted_modes
    if not count:
        return np.zeros((0, len(A)))
    rows, block = Q[:, :count].T, T[:count, :count].T
    slower = block / (0.5 * (1.0 + np.abs(np.linalg.eigvals(block)).max()))
    return np.linalg.cholesky(solve_discrete_lyapunov(slower.T, np.eye(count))).T @ rows


def settled_set(
    loop: sample.SampledLoop,
    W: FloatArray,
    samples: int,
    hulls: Mapping[int, FloatArray],
    after_end: FloatArray,
) -> HandOver | None:
    """Seek a small invariant set for the flights of the last samples.

    `W` (shape (n, n)). `samples`: see `coordinates`. `hulls` (shape (n, 2)): ranges of ``W z`` at
    the samples after the last change. `after_end`: see `for_ever`.
    """
    last, smallest = max(hulls), None
    end = hulls[last]
    centre, size = end.mean(axis=1), FIRST_SIZE * 0.5 * np.ptp(end, axis=1) + 1e-9
    for _ in range(ROUNDS):
        plan, tight = Search(loop), (1.0 - SLACK) * size
        try:
            after, passed = return_map(loop, W, centre, size, samples, plan)
        except interval.Unbounded:
            return smallest
        if inside(after, centre, tight):
            # Bounds of the first sample in the set lack the margin of the interval before it, so
            # this sample keeps the tube's own bounds.
            reached = [
                k for k, ranges in hulls.items() if k < last and inside(ranges, centre, tight)
            ]
            if not reached:
                return smallest
            smallest = HandOver(
                sample=min(reached),
                W=W,
                centre=centre,
                size=size,
                samples=samples,
                bounds=for_ever(after_end, passed),
                chosen=plan.choices,
            )
            # Any set between the image and the set is also mapped into itself.
            needed = np.stack([after, hulls[max(reached)]])
            low, high = needed[..., 0].min(axis=0), needed[..., 1].max(axis=0)
            centre, size = 0.5 * (low + high), (0.5 + SLACK) * (high - low) + 1e-12
            if (size > SMALLEST_GAIN * smallest.size).all():
                return smallest
        elif smallest is not None:
            return smallest
        else:
            size = GROWTH * np.maximum(size, np.maximum(centre - after[:, 0], after[:, 1] - centre))
    return smallest
