"""Reading an enclosure's choices back."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.tube.forms import Form, Indices, Pieces
from flighttune.tube.interval import Interval
from flighttune.tube.sample import Channel, Cut

MAX_NUMBERS = 2**23
"""Most numbers in the arrays of a set: four times those of a search; a split at most doubles
them."""


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
        channel = channels[1 if i else 0]
        excess = channel.above if side > 0.0 else channel.below
        which, at, row = (self._next(len(pieces)) for _ in range(3))
        if excess is None or not ((row >= 0) & (row < len(pieces.constrained))).all():
            raise IndexError("a split names a limit or a constraint that is not there")
        return Cut(excess, which > 0.0, at, row.astype(np.intp))

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
