r"""The check of a tube: every inclusion again, without the search that found it.

A tube ends with its scenario. Bounds for all later times come from a set that N samples of the
settled loop map into itself. Suppose that from some sample on the reference is constant, that every
flight is inside a set ``T = {z : |W z - c| <= s}`` (rows; z the state of the sampled loop), and
that N samples map T into itself without an active limit. Then no command is ever limited again.
Every round of N samples after the first stays within the ranges of the second, because it begins in
the image of T. In the first round T, a box, is wider than the flights, so the enclosure of the tube
itself continues there, for N samples after its end. The loop is the flown loop: nonlinear, sampled,
with its lags and delays, under every disturbance within the last bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.claims.tubes.exact import enclosure_of
from flighttune.claims.tubes.forms import (
    MORE_ROUNDINGS,
    TINY,
    ULP,
    UP,
    Form,
    Indices,
    Pieces,
    transformed,
)
from flighttune.claims.tubes.interval import Interval, Unbounded
from flighttune.claims.tubes.problem import QUANTITIES, TubeProblem
from flighttune.claims.tubes.sample import RATES, Channel, Cut, Plan, SampledLoop
from flighttune.control.theory.exact import Check, Verification
from flighttune.flight.loop.run import Bounds

# Maximum symbols of the set during the mapping
SYMBOLS = 300

# Maximum numbers in the arrays of a set: four times a search's maximum; a split at most doubles
# them
MAX_NUMBERS = 2**23


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HandOver:
    """A set that flights return to."""

    sample: int  # first sample with all flights inside
    W: FloatArray  # shape (n, n)
    # `centre` and `size` (shape (n,)): the set is ``|W z - centre| <= size`` for the state z of the
    # loop.
    centre: FloatArray
    size: FloatArray
    samples: int  # number N of samples that map the set into itself
    # shape (4, 2): lowest and highest errors (rad) and commands (rad, 1) at all times after the
    # last sample.
    bounds: FloatArray
    # shape (m,), float32: choices of the search, which the check replays
    chosen: npt.NDArray[np.float32]


def settled(loop: SampledLoop, samples: int) -> SampledLoop:
    """The loop after its last sample, with constant references and boxes."""
    return continued(replace(loop, reference=loop.reference[-1:], boxes=loop.boxes[-1:]), samples)


def continued(loop: SampledLoop, samples: int) -> SampledLoop:
    """The loop with more samples, in which references and boxes keep their last values."""
    reference, boxes = (
        np.concatenate([values, np.repeat(values[-1:], samples, axis=0)])
        for values in (loop.reference, loop.boxes)
    )
    return replace(loop, reference=reference, boxes=boxes)


def settled_from(loop: SampledLoop) -> int:
    """First sample from which the reference is constant and boxes are within the last boxes."""
    still = (loop.reference == loop.reference[-1]).all(axis=1)
    still &= (loop.reference[:, RATES] == 0.0).all(axis=1)
    still &= (loop.boxes[..., 0] >= loop.boxes[-1, :, 0]).all(axis=1)
    still &= (loop.boxes[..., 1] <= loop.boxes[-1, :, 1]).all(axis=1)
    changing = np.flatnonzero(~still)
    first = int(changing[-1]) + 1 if len(changing) else 0
    # This is the number of samples if the reference still moves at the end.
    return first if first + 1 < len(still) else len(still)


def hull(pieces: Pieces, W: FloatArray) -> FloatArray:
    """Ranges of ``W z`` over all flights of a set, shape (n, 2)."""
    ranges = [pieces.plain_range(form) for form in transformed(W, pieces.forms())]
    return np.array([(values.low.min(), values.high.max()) for values in ranges])


def inside(ranges: FloatArray, centre: FloatArray, size: FloatArray) -> bool:
    """Whether ranges of ``W z`` are in the set ``|W z - centre| <= size``."""
    # Rounded inwards, so that a range that is inside only by rounding is refused.
    low, high = np.nextafter(centre - size, np.inf), np.nextafter(centre + size, -np.inf)
    return bool(((ranges[:, 0] >= low) & (ranges[:, 1] <= high)).all())


def parallelotope(W: FloatArray, centre: FloatArray, size: FloatArray) -> Pieces:
    """All z with ``|W z - centre| <= size``, as one piece."""
    n = len(W)
    V = np.linalg.inv(W)
    rounding = (n + MORE_ROUNDINGS) * ULP
    # With V near the inverse of W, ``R = I - W V`` and ``q = W z``, z is
    # ``V (q + R (I - R)^-1 q)``.
    R = (np.abs(np.eye(n) - W @ V) + rounding * (np.abs(W) @ np.abs(V))).sum(axis=1) * UP
    if not R.max() < 0.5:
        raise Unbounded("the set of the hand-over has no inverse")
    # The norm of R is below 1/2, so that of (I - R)^-1 is at most 2.
    reach = size + 2.0 * R * (np.abs(centre) + size).max() * UP
    box = Pieces((V @ centre)[np.newaxis], 0, SYMBOLS)
    generators = V * (reach * UP)
    box.values[0, :, 1 : 1 + n] = generators
    box.err[0] = (
        rounding * (np.abs(V) @ np.abs(centre) + np.abs(generators).sum(axis=1)) * UP + TINY
    )
    box.used = n
    return box


def return_map(
    loop: SampledLoop, W: FloatArray, centre: FloatArray, size: FloatArray, samples: int, plan: Plan
) -> tuple[FloatArray, FloatArray]:
    """Propagate the set of a `HandOver` through 2 N samples; Unbounded if a limit may act.

    Returns the ranges of ``W z`` after the first round, shape (n, 2), and of errors and commands at
    every sample, (2 N, 4, 2). There is no second round if the first does not end inside the set.
    """
    enclosure = enclosure_of(settled(loop, 2 * samples), parallelotope(W, centre, size), plan)
    passed, after = [], np.zeros((len(W), 2))
    # Two rounds, because only the second and later rounds begin in the image of T.
    for k in range(1, 2 * samples + 1):
        ranges, limited = enclosure.sample(k)
        if limited.any():
            raise Unbounded("that no limit holds a command is not proven")
        passed.append(ranges)
        if k == samples:
            after = hull(enclosure.pieces, W)
            if not inside(after, centre, size):
                break
    return after, np.array(passed)


def for_ever(after_end: FloatArray, passed: FloatArray) -> FloatArray:
    """Bounds of errors and commands at all times after the last sample, shape (4, 2)."""
    # `after_end`, shape (N, 4, 2), has the ranges of the tube at the first N samples after its end,
    # when all flights are in T; `passed` comes from `return_map`.
    later = np.concatenate([after_end, passed[len(passed) // 2 :]])
    return np.stack([later[:, :, 0].min(axis=0), later[:, :, 1].max(axis=0)], axis=1)


class Replay:
    """A `Plan` that reads the choices of a search, shape (n,), finite."""

    def __init__(self, chosen: npt.NDArray[np.float32]) -> None:
        self._chosen, self._at = chosen, 0

    def multipliers(self, pieces: Pieces, form: Form) -> FloatArray:  # noqa: ARG002
        """The choice of the search."""
        return self._next(len(pieces), int(pieces.constrained.sum()))

    def slope(self, values: Interval) -> FloatArray:
        """The choice of the search."""
        return self._next(len(values.low))

    def cut(self, pieces: Pieces, channels: Sequence[Channel]) -> Cut | None:
        """The choice of the search."""
        if pieces.values.size > MAX_NUMBERS:
            raise IndexError("the choices make the set too large")
        split, i, side = self._next(3)
        if split == 0.0:
            return None
        flags, splits, row = (self._next(len(pieces)) for _ in range(3))
        is_row = (row >= 0) & (row < len(pieces.constrained))
        is_limit = 0 <= i < len(channels) and side in channels[int(i)].excesses
        if not (is_limit and is_row.all()):
            raise IndexError("a split names a limit or a constraint that is not there")
        return int(i), side, flags > 0.0, splits, row.astype(np.intp)

    def pairs(self, pieces: Pieces) -> Indices:  # noqa: ARG002
        """The choice of the search."""
        (count,) = self._next(1)
        return self._next(int(count), 2).astype(np.intp)

    def _next(self, *shape: int) -> FloatArray:
        count = int(np.prod(shape))
        values = self._chosen[self._at : self._at + count]
        if count < 0 or len(values) < count:
            raise IndexError("the choices end early")
        self._at += count
        return values.astype(float).reshape(shape)


# An overflow becomes inf or NaN in the set, which violates every bound.
@np.errstate(over="ignore", invalid="ignore")
def replay(
    problem: TubeProblem,
    starts: Pieces,
    chosen: npt.NDArray[np.float32],
    bounds: Bounds,
    can_limit: npt.NDArray[np.bool_],
    ever: HandOver | None,
) -> Verification:
    """Prove every sample of a tube again from the choices of the search that found it."""
    # The code of the search encloses every sample, with a `Replay` instead of its `Search`. Choices
    # (places of splits, merged symbols, multipliers) affect the width of the set but never its
    # validity. A wrong choice can therefore only lose the claim, and no choice is trusted. Without
    # the search this is about five times as fast (0.7 s of 3.4 s for 5 s of `paper`). The tube is
    # valid if at every sample the set proven is inside the bounds; else the reason names the sample
    # and the inequality.
    loop = problem.loop if ever is None else continued(problem.loop, ever.samples)
    enclosure = enclosure_of(loop, starts, Replay(chosen))
    margins, claimed = np.full(len(QUANTITIES), np.inf), bounds.pairs
    after_end = []
    for k in range(len(loop.reference)):
        when = f"sample {k} ({k / problem.scenario.controller.rate_hz:.2f} s)"
        try:
            ranges, limited = enclosure.sample(k)
        except (Unbounded, IndexError, InputError) as error:
            return Verification(valid=False, reason=f"{when}: {error}")
        if k >= len(claimed):
            after_end.append(ranges)
            continue
        unproven = np.flatnonzero(limited & ~can_limit[k]).tolist()
        broken = _broken(ranges, claimed[k])
        if unproven and not broken:
            broken = f"that no limit holds {QUANTITIES[2:][unproven[0]]} is not proven"
        if broken:
            return Verification(valid=False, reason=f"{when}: {broken}")
        margins = np.minimum(margins, ((ranges - claimed[k]) * [1.0, -1.0]).min(axis=1))
        if ever is not None and k + 1 == ever.sample:
            reached = hull(enclosure.pieces, ever.W)
            if not inside(reached, ever.centre, ever.size):
                reason = f"sample {k + 1}: the set that is kept is not proven to be reached"
                return Verification(valid=False, reason=reason)
    if ever is not None:
        when = f"after {ever.samples} samples from sample {ever.sample} on"
        try:
            after, passed = return_map(
                problem.loop, ever.W, ever.centre, ever.size, ever.samples, Replay(ever.chosen)
            )
        except (Unbounded, IndexError, InputError, np.linalg.LinAlgError) as error:
            return Verification(valid=False, reason=f"{when}: {error}")
        broken = "the set is not proven to be kept"
        if inside(after, ever.centre, ever.size):
            broken = _broken(for_ever(np.array(after_end), passed), ever.bounds)
        if broken:
            return Verification(valid=False, reason=f"{when}: {broken}")
    place = f"inside its bounds at {len(problem.t)} samples"
    return Verification.of(
        [
            Check(name=f"{name} {place}", margin=margin, exact=True)
            for name, margin in zip(QUANTITIES, margins, strict=True)
        ]
    )


def _broken(proven: FloatArray, claimed: FloatArray) -> str:
    """The first claimed bound that the proven ranges exceed; else empty."""
    for name, (low, high), (least, most) in zip(QUANTITIES, proven, claimed, strict=True):
        if not least <= low:
            return f"{name} >= {least:.9g} is not proven, but {name} >= {low:.9g}"
        if not high <= most:
            return f"{name} <= {most:.9g} is not proven, but {name} <= {high:.9g}"
    return ""
