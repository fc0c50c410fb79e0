"""An inner loop over one sample of the controller, as exact matrices."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.theory.exact import Rationals, exact, identity
from flighttune.tube.interval import Interval

LEAST_TERMS = 12
PICARD = 30
"""Boxes tried for the values within a sample."""

ROUNDING = 1e-13
"""Outdoes the rounding of a sum of a dozen products, relative to the sum of their sizes."""

WIDER = 0.05
"""Part of its width by which a box is widened before it is tried again."""

SHORT = 3.0
"""Steps within a sample, times the sample time and the norm of A."""

REMAINDER = Fraction(1, 10**22)
"""Bound on what the exponential series leaves out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledLag:
    """A lag with delay from one sample to the next, n states and m commands in force.

    Attributes
    ----------
    A, B : ndarray, shapes (n, n) and (n,)
        Of the lag; its first state is the response.
    transition : ndarray, shape (n, n + 2)
        State after the sample, of state, older and newer command.
    mean : ndarray, shape (n + 2,)
        Mean of the response over the sample, of the same.
    older : int
        The newer command in force in a sample is the one of so many samples before, the older one
        of one more.

    Notes
    -----
    All entries are the exact ones, rounded once.
    """

    A: FloatArray
    B: FloatArray
    transition: FloatArray
    mean: FloatArray
    older: int

    @classmethod
    def of(cls, lag: InnerLag, dt: float) -> "SampledLag":
        """The lag sampled every `dt` seconds."""
        A, B = lag.undelayed
        n, h = len(B), Fraction(dt)
        older = math.floor(Fraction(lag.delay) / h)
        late = Fraction(lag.delay) - older * h
        # States, the command, and the integral of the response.
        M = exact(np.zeros((n + 2, n + 2)))
        M[:n, :n], M[:n, n], M[n + 1, 0] = exact(A), exact(B), Fraction(1)
        first, second = _exponential(M, late), _exponential(M, h - late)
        # Rows: state and integral; columns: state, older command, newer command.
        middle = exact(np.zeros((n + 2, n + 2)))
        middle[:n, :n], middle[:n, n] = first[:n, :n], first[:n, n]
        middle[n + 1, :n], middle[n + 1, n] = first[n + 1, :n], first[n + 1, n]
        middle[n, n + 1] = Fraction(1)
        whole = second @ middle
        return cls(
            A=A,
            B=B,
            transition=_floats(whole[:n]),
            mean=_floats(whole[n + 1] / h),
            older=older,
        )

    @property
    def rest(self) -> FloatArray:
        """State at rest under the command 1."""
        return np.asarray(-np.linalg.solve(self.A, self.B), dtype=float)

    def values_within(
        self, state: list[Interval], end: Interval, command: Interval, h: float
    ) -> Interval | None:
        """All values of the response over a sample; None if they cannot be told.

        Parameters
        ----------
        state : list of Interval, length n
            At the start.
        end : Interval
            The response at the end.
        command : Interval
            Those in force within the sample.
        h : float, s

        Notes
        -----
        The response leaves the straight line from start to end by at most h/4 times how far apart
        its rate can be. The rate is bounded by a box Y of states with ``y + [0, t] (A Y + B u)``
        inside Y: Picard's operator maps the curves in it into itself. There is such a box where t
        times the norm of A is well below 1, so a sample is taken in some steps.
        """
        low, high = (np.stack([getattr(one, name) for one in state]) for name in ("low", "high"))
        steps = math.ceil(SHORT * h * float(np.abs(self.A).sum(axis=1).max()))
        t = h / steps * (1.0 + ROUNDING)
        slowest, fastest = np.full_like(low[0], np.inf), np.full_like(low[0], -np.inf)
        for _ in range(steps):
            box = self._box(low, high, command, t)
            if box is None:
                return None
            slow, fast = self._rates(*box, command)
            slowest, fastest = np.minimum(slowest, slow[0]), np.maximum(fastest, fast[0])
            low, high = box
        margin = 0.25 * h * (fastest - slowest) * (1.0 + ROUNDING)
        both = state[0].hull(end)
        return both + Interval(-margin, margin)

    def _box(
        self, low: FloatArray, high: FloatArray, command: Interval, t: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """A box of all states up to `t` (s), from a box of them."""
        box = low, high
        for _ in range(PICARD):
            slow, fast = self._rates(*box, command)
            size = ROUNDING * (np.abs(low) + np.abs(high) + t * (np.abs(slow) + np.abs(fast)))
            moved = (
                low + np.minimum(t * slow, 0.0) - size,
                high + np.maximum(t * fast, 0.0) + size,
            )
            if (moved[0] >= box[0]).all() and (moved[1] <= box[1]).all():
                return moved
            margin = WIDER * (moved[1] - moved[0]) + 1e-9
            box = np.minimum(moved[0], box[0]) - margin, np.maximum(moved[1], box[1]) + margin
        return None

    def _rates(
        self, low: FloatArray, high: FloatArray, command: Interval
    ) -> tuple[FloatArray, FloatArray]:
        """Values of ``A Y + B u``."""
        up, down = np.maximum(self.A, 0.0), np.minimum(self.A, 0.0)
        B = self.B[:, np.newaxis]
        ends = B * command.low, B * command.high
        size = np.maximum(np.abs(low), np.abs(high))
        rounding = ROUNDING * (np.abs(self.A) @ size + np.abs(B) * command.largest)
        return (
            up @ low + down @ high + np.minimum(*ends) - rounding,
            up @ high + down @ low + np.maximum(*ends) + rounding,
        )

    @property
    def order(self) -> int:
        """States of the lag."""
        return len(self.B)


def _exponential(M: Rationals, t: Fraction) -> Rationals:
    """``exp(M t)`` but for less than `REMAINDER` an entry.

    The terms left out of the series are below ``x^n/n! / (1 - x/(n+1))``, x the norm of ``M t``.
    """
    size = max(sum(abs(entry) for entry in row) for row in M) * t
    total = term = identity(len(M))
    n, left = 0, Fraction(1)
    while n < LEAST_TERMS or size >= n or left / (1 - size / (n + 1)) > REMAINDER:
        n += 1
        term = _shortened(term @ M * t / n)
        total = total + term
        left = left * size / n
    return total


def _shortened(term: Rationals) -> Rationals:
    """Entries to 1e-40: their length would grow with every product."""
    return np.vectorize(lambda x: Fraction(round(x * 10**40), 10**40), otypes=[object])(term)


def _floats(values: Rationals) -> FloatArray:
    return np.array([[float(x) for x in row] for row in np.atleast_2d(values)]).reshape(
        values.shape
    )
