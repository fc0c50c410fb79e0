"""Bang-bang disturbances, which switch where the sensitivity of an error changes its sign."""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray

Indices = npt.NDArray[np.intp]

# Intervals of a flight in each of which a sensitivity is measured.
INTERVALS = 45

# Times at which the disturbances of a round push an error.
TARGETS = 25


def search_bang_bang(
    values: Callable[[Sequence[FloatArray]], FloatArray],
    errors: Callable[[Sequence[FloatArray]], Sequence[FloatArray | None]],
    samples: int,
    *,
    budget: int,
    pushed: Sequence[int] = (0, 1),
) -> None:
    """Push each error at some times as far as a disturbance can.

    A flight is an array of signs, shape (1 + samples, 2): of the deviations of the start, then of
    the disturbances from each sample to the next.

    Parameters
    ----------
    values : callable
        Objective of flights, larger is worse.
    errors : callable
        Errors of flights, shape (samples + 1, 2), rad; None for a flight that ends early.
    budget : int
        Maximum number of flights. Without enough for a round nothing is flown.
    pushed : sequence of int
        Errors that are pushed, 0 of course and 1 of path angle.

    Notes
    -----
    For a linear loop the disturbance ``d_k = D sign(de(T)/dd_k)`` is the worst there is for the
    error at time T. The first derivatives are about a disturbance that alternates, which hardly
    moves the flight; limits bend the loop, so that those of later rounds are about the worst flight
    so far.
    """
    blocks = [np.array([0]), *np.array_split(np.arange(1, samples + 1), min(INTERVALS, samples))]
    targets = np.unique(np.linspace(1, samples, TARGETS).round().astype(np.intp))
    about, worst = np.ones((1 + samples, 2)), -np.inf
    for block in blocks[::2]:
        about[block] = -1.0
    # A round flies the middle, a change of each channel in each block, and both senses per target.
    cost = 1 + 2 * len(blocks) + 2 * len(targets) * len(pushed)
    while budget >= cost:
        budget -= cost
        flown = errors([about, *(_other(about, *changed) for changed in product(blocks, (0, 1)))])
        slopes = _slopes(about, blocks, flown, targets, pushed)
        tried = [
            np.where(slope == 0.0, about, sign * np.sign(slope))
            for slope, sign in product(slopes, (1.0, -1.0))
        ]
        reached = values(tried)
        if reached.max() <= worst:
            break
        about, worst = tried[int(reached.argmax())], reached.max()


def _other(signs: FloatArray, block: Indices, channel: int) -> FloatArray:
    """The flight with one channel of a block set to the sign that is rarer in it."""
    other = signs.copy()
    other[block, channel] = -1.0 if signs[block, channel].sum() >= 0.0 else 1.0
    return other


def _slopes(
    about: FloatArray,
    blocks: Sequence[Indices],
    flown: Sequence[FloatArray | None],
    targets: Indices,
    pushed: Sequence[int],
) -> list[FloatArray]:
    """Derivatives of errors at each target by every sign, shape (1 + samples, 2) each."""
    first, *others = flown
    slope = np.zeros((len(blocks), 2, len(targets), 2))
    for (i, channel), errors in zip(product(range(len(blocks)), (0, 1)), others, strict=True):
        if first is not None and errors is not None:
            changed = (_other(about, blocks[i], channel) - about)[blocks[i], channel].sum()
            slope[i, channel] = (errors - first)[targets] / changed
    rows = np.arange(len(about))
    centres = [block.mean() for block in blocks[1:]]
    slopes = []
    for target, error in product(range(len(targets)), pushed):
        columns = [np.interp(rows, centres, slope[1:, i, target, error]) for i in (0, 1)]
        slopes.append(np.stack(columns, axis=1))
        slopes[-1][0] = slope[0, :, target, error]
    return slopes
