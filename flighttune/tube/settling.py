"""The search for a set that the settled loop maps into itself; the proof trusts none of it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.linalg import schur, solve_discrete_lyapunov

from flighttune.arrays import FloatArray
from flighttune.tube.exact import enclosure_of
from flighttune.tube.forms import Pieces
from flighttune.tube.hand_over import SYMBOLS, HandOver, for_ever, inside, return_map, settled
from flighttune.tube.interval import Unbounded
from flighttune.tube.sample import CHI, EXTRA_LIFT, GAMMA, N_Z_INTEGRAL, PHI, ROLL, SampledLoop
from flighttune.tube.search import Search

LINEARISED_SIZE = 1e-6
"""Size of the set by which the loop is linearised."""

MAX_SAMPLES = 800
"""Largest N."""

CONTRACTION = 0.15
"""Contraction of the linear loop over N samples, by which N is chosen."""

FAST_EIGENVALUE = 0.5
"""Eigenvalue below which a mode has decayed within a few samples."""

FIRST_SIZE = 2.0
"""Size of the first set that is tried, relative to that of the last sample."""

GROWTH, ROUNDS = 1.3, 6

SLACK = 1e-6
"""Share of the set left free by the search: another machine may add up in another order."""


def coordinates(loop: SampledLoop) -> tuple[FloatArray, int] | None:
    """Rows W in which the settled loop contracts, and after how many samples; None if never.

    Any W will do; in this one the linear loop shrinks the norm of ``W z``.
    """
    at = _steady(loop)
    n = len(at)
    pieces = Pieces(at[np.newaxis], 0, SYMBOLS)
    pieces.values[0, :, 1 : 1 + n] = LINEARISED_SIZE * np.eye(n)
    pieces.used = n
    try:
        enclosure_of(settled(loop, 1), pieces, new_search(loop)).sample(1)
    except Unbounded:
        return None
    A = pieces.values[0, :n, 1 : 1 + n] / LINEARISED_SIZE
    if not np.abs(np.linalg.eigvals(A)).max() < 1.0:
        return None
    W = np.concatenate([_contracting(A, slow=slow) for slow in (True, False)])
    step = W @ A @ np.linalg.inv(W)
    power = np.eye(n)
    for samples in range(1, MAX_SAMPLES + 1):
        power = power @ step
        if np.abs(power).sum(axis=1).max() <= CONTRACTION:
            return W, samples
    return None


def _contracting(A: FloatArray, *, slow: bool) -> FloatArray:
    """Rows of the slow or of the fast modes, in which the norm shrinks.

    Commands follow errors and integrals within a sample. Where the set had room for commands that
    do not, as it has without a separation of the modes, a rate limit would hold them.
    """

    def wanted(re: float, im: float) -> bool:
        return (np.hypot(re, im) >= FAST_EIGENVALUE) == slow

    sorted_modes: Any = schur(A.T, sort=wanted)
    T, Q, count = sorted_modes
    if not count:
        return np.zeros((0, len(A)))
    rows, block = Q[:, :count].T, T[:count, :count].T
    slower = block / (0.5 * (1.0 + np.abs(np.linalg.eigvals(block)).max()))
    return np.linalg.cholesky(solve_discrete_lyapunov(slower.T, np.eye(count))).T @ rows


def _steady(loop: SampledLoop) -> FloatArray:
    """Steady flight on the last reference."""
    at = np.zeros(loop.rows)
    chi, gamma, phi, planned = loop.reference[-1, :4]
    n_z = planned or np.cos(gamma)
    extra = n_z - loop.lift(len(loop.reference) - 1)
    at[[CHI, GAMMA, PHI, EXTRA_LIFT]] = chi, gamma, phi, extra
    at[N_Z_INTEGRAL] = 0.0 if loop.inverts else extra - planned
    for own, queue, lag, value in zip(*loop.layout, loop.lags, (phi, n_z), strict=False):
        at[own], at[queue] = lag.rest * value, value
    if loop.sees_roll:
        at[-1] = loop.boxes[-1, ROLL].mean()
    return at


def new_search(loop: SampledLoop) -> Search:
    """A search for one piece that meets no limit."""
    return Search(loop, tolerance=1.0, most=0)


def hand_over(
    loop: SampledLoop, W: FloatArray, samples: int, hulls: Mapping[int, FloatArray]
) -> HandOver | None:
    """Look for a set that holds the flights of the last samples for ever.

    `W` (shape (n, n)). `samples`: see `coordinates`. `hulls` (shape (n, 2)): ranges of ``W z`` at
    samples in whose future nothing changes, up to the last.
    """
    if not hulls:
        return None
    last = max(hulls)
    end = hulls[last]
    centre, size = end.mean(axis=1), FIRST_SIZE * 0.5 * np.ptp(end, axis=1) + 1e-9
    for _ in range(ROUNDS):
        plan, tight = new_search(loop), (1.0 - SLACK) * size
        try:
            after, passed = return_map(loop, W, centre, size, samples, plan)
        except Unbounded:
            return None
        if inside(after, centre, tight):
            # Bounds of the first sample in the set lack the margin of the interval that leads to
            # it: that sample must still have the tube's own.
            reached = [
                k for k, ranges in hulls.items() if k < last and inside(ranges, centre, tight)
            ]
            if not reached:
                return None
            return HandOver(
                sample=min(reached),
                W=W,
                centre=centre,
                size=size,
                samples=samples,
                bounds=for_ever(passed, last - min(reached)),
                chosen=plan.choices,
            )
        beyond = np.maximum(centre - after[:, 0], after[:, 1] - centre)
        size = GROWTH * np.maximum(size, beyond)
    return None
