"""The check of a tube: every inclusion again, without the search that found it."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.simulate.run import Bounds
from flighttune.theory.exact import Check, Verification
from flighttune.tubes.exact import enclosure_of
from flighttune.tubes.forms import Form, Indices, Pieces
from flighttune.tubes.hand_over import HandOver, continued, for_ever, hull, inside, return_map
from flighttune.tubes.interval import Interval, Unbounded
from flighttune.tubes.problem import QUANTITIES, TubeProblem
from flighttune.tubes.sample import Channel, Cut, SampledLoop

# Most numbers in the arrays of a set: four times those of a search; a split at most doubles them
MAX_NUMBERS = 2**23


class Replay:
    """A `Plan` that reads what a search chose.

    `chosen` (shape (n,)) must be finite.
    """

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
        if side not in channels[int(i)].excesses or not is_row.all():
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


# A number too large for floats is inf or NaN in the set, which no bound holds.
@np.errstate(over="ignore", invalid="ignore")
def replay(
    problem: TubeProblem,
    starts: Pieces,
    chosen: npt.NDArray[np.float32],
    bounds: Bounds,
    can_limit: npt.NDArray[np.bool_],
    ever: HandOver | None,
) -> Verification:
    """Prove every sample of a tube again from the choices of the search that found it.

    The tube is valid if at every sample the set proven is inside the bounds; else the reason names
    the sample and the inequality. The arguments are those of a `Tube`, and the pieces of its
    starts.
    """
    # Every sample is enclosed by the code that the search used, with a `Replay` in place of its
    # `Search`: choices (where to split, which symbols to merge, which multipliers) decide how wide
    # the set becomes, never whether it encloses. A wrong choice can therefore only lose the claim,
    # and none is trusted. Without looking for choices it is about five times as fast (0.7 s of
    # 3.4 s for 5 s of `paper`).
    loop = problem.loop if ever is None else continued(problem.loop, ever.samples)
    enclosure = enclosure_of(loop, starts, Replay(chosen))
    margins, claimed = np.full(len(QUANTITIES), np.inf), bounds.pairs
    after_end = []
    for k in range(len(loop.reference)):
        t = k / problem.scenario.controller.rate_hz
        when = f"sample {k} ({t:.2f} s)"
        try:
            ranges, limited = enclosure.sample(k)
        except (Unbounded, IndexError, InputError) as error:
            return _refused(f"{when}: {error}")
        if k >= len(claimed):
            after_end.append(ranges)
            continue
        if broken := _broken(ranges, claimed[k]):
            return _refused(f"{when}: {broken}")
        unproven = np.flatnonzero(limited & ~can_limit[k])
        if len(unproven):
            name = QUANTITIES[2:][unproven[0]]
            return _refused(f"{when}: that no limit holds {name} is not proven")
        room = (ranges - claimed[k]) * [1.0, -1.0]
        margins = np.minimum(margins, room.min(axis=1))
        if ever is not None and k + 1 == ever.sample:
            reached = hull(enclosure.pieces, ever.W)
            if not inside(reached, ever.centre, ever.size):
                return _refused(f"sample {k + 1}: the set that is kept is not proven to be reached")
    if ever is not None and (broken := _not_kept(problem.loop, ever, np.array(after_end))):
        return _refused(f"after {ever.samples} samples from sample {ever.sample} on: {broken}")
    inside_bounds = f"inside its bounds at {len(problem.t)} samples"
    return Verification.of(
        [
            Check(name=f"{name} {inside_bounds}", margin=margin, exact=True)
            for name, margin in zip(QUANTITIES, margins, strict=True)
        ]
    )


def _not_kept(loop: SampledLoop, ever: HandOver, after_end: FloatArray) -> str:
    """Reason why flights may leave the set of a hand-over; empty if they never do."""
    try:
        plan = Replay(ever.chosen)
        after, passed = return_map(loop, ever.W, ever.centre, ever.size, ever.samples, plan)
    except (Unbounded, IndexError, InputError, np.linalg.LinAlgError) as error:
        return str(error)
    if not inside(after, ever.centre, ever.size):
        return "the set is not proven to be kept"
    return _broken(for_ever(after_end, passed), ever.bounds)


def _broken(proven: FloatArray, claimed: FloatArray) -> str:
    for name, (low, high), (least, most) in zip(QUANTITIES, proven, claimed, strict=True):
        if not least <= low:
            return f"{name} >= {least:.9g} is not proven, but {name} >= {low:.9g}"
        if not high <= most:
            return f"{name} <= {most:.9g} is not proven, but {name} <= {high:.9g}"
    return ""


def _refused(reason: str) -> Verification:
    return Verification(valid=False, reason=reason, checks=())
