"""An inner loop over one sample of the controller, as exact matrices."""

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.theory.exact import Rationals, exact, identity
from flighttune.tubes.interval import Interval, Unbounded

LEAST_TERMS = 12

# Boxes tried for the values within a sample
PICARD = 30

# Outdoes the rounding of a sum of a dozen products, relative to the sum of their sizes
ROUNDING = 1e-13

# Part of its width by which a box is widened before it is tried again
WIDER = 0.05

# Steps within a sample, times the sample time and the norm of A
SHORT = 3.0

# Sum of a geometric series of 1/`SHORT`
FURTHER = 1.0 / (1.0 - 1.0 / SHORT)

# Widening of a box that is tried, for one that has no width
SLACK = 1e-9

# Bound on what the exponential series leaves out
REMAINDER = Fraction(1, 10**22)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledLag:
    """A lag with delay from one sample to the next, n states and m commands in force.

    Notes
    -----
    All entries are the exact ones, rounded once.
    """

    # `A` and `B` (shapes (n, n) and (n,)): matrices of the lag; its first state is the response
    A: FloatArray
    B: FloatArray
    # shape (n, n + 2): state after the sample, of state, older and newer command
    transition: FloatArray
    mean: FloatArray  # shape (n + 2,): mean of the response over the sample, of the same
    # Delay in whole samples: the newer command in force was given so many samples before, the older
    # command one sample earlier.
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
        middle = first.copy()
        middle[n], middle[:, n + 1] = Fraction(0), Fraction(0)
        middle[n, n + 1] = Fraction(1)
        whole = second @ middle
        transition, mean = whole[:n].astype(float), (whole[n + 1] / h).astype(float)
        return cls(A=A, B=B, transition=transition, mean=mean, older=older)

    @property
    def rest(self) -> FloatArray:
        """State at rest under the command 1."""
        return np.asarray(-np.linalg.solve(self.A, self.B), dtype=float)

    def values_within(
        self, state: list[Interval], end: Interval, command: Interval, h: float
    ) -> Interval:
        """All values of the response over a sample of `h` seconds.

        Raises Unbounded if they cannot be enclosed. `state` is that at the start, `end` the
        response at the end, `command` what is in force within.

        Notes
        -----
        The response leaves the straight line from start to end by at most h/4 times how far apart
        its rate can be. The rate is bounded by a box Y of states with ``y + [0, t] (A Y + B u)``
        inside Y: Picard's operator maps the curves in it into itself. There is such a box where t
        times the norm of A is well below 1, so a sample is taken in some steps.
        """
        n = self.order
        box = np.stack([getattr(interval, end) for end in ("low", "high") for interval in state])
        # Values of ``B u``, widened by the rounding of its products.
        B = self.B[:, np.newaxis]
        ends, rounding = (B * command.low, B * command.high), ROUNDING * np.abs(B) * command.largest
        pushed = np.concatenate([np.minimum(*ends) - rounding, np.maximum(*ends) + rounding])
        steps = math.ceil(SHORT * h * float(np.abs(self.A).sum(axis=1).max()))
        t = h / steps * (1.0 + ROUNDING)
        slowest, fastest = (np.full(box.shape[1], end) for end in (np.inf, -np.inf))
        for _ in range(steps):
            box = self._box(box, pushed, t)
            rates = self._rates(box, pushed)
            slowest, fastest = np.minimum(slowest, rates[0]), np.maximum(fastest, rates[n])
        margin = 0.25 * h * (fastest - slowest) * (1.0 + ROUNDING)
        hull = state[0].hull(end)
        return hull + Interval(-margin, margin)

    def _box(self, start: FloatArray, pushed: FloatArray, t: float) -> FloatArray:
        """A box of all states up to `t` (s) from a box of them: lower ends, then upper ones."""
        n, sizes = self.order, np.abs(self.A)
        outwards = np.repeat([-1.0, 1.0], n)[:, np.newaxis]
        # The first box: the rates at the start, the rates these cause, and a geometric bound on the
        # rest. Mostly it holds at once.
        by = t * self._rates(start, pushed)
        further = t * (sizes @ np.maximum(np.abs(by[:n]), np.abs(by[n:])))
        further += FURTHER * t * (sizes @ further) + SLACK
        box = start + outwards * (np.maximum(outwards * by, 0.0) + np.tile(further, (2, 1)))
        for _ in range(PICARD):
            by = t * self._rates(box, pushed)
            rounding = ROUNDING * (np.abs(start) + np.abs(by))
            moved = start + outwards * (np.maximum(outwards * by, 0.0) + rounding)
            beyond = outwards * (moved - box)
            if (beyond <= 0.0).all():
                return moved
            margin = WIDER * (moved[n:] - moved[:n]) + SLACK
            box = box + outwards * (np.maximum(beyond, 0.0) + np.concatenate([margin, margin]))
        raise Unbounded("a lag moves too far in a sample to be enclosed")

    def _rates(self, box: FloatArray, pushed: FloatArray) -> FloatArray:
        """Values of ``A Y + B u``, as those of Y: lower ends, then upper ones."""
        n = self.order
        sizes = np.abs(box)
        rounding = ROUNDING * (np.abs(self.A) @ np.maximum(sizes[:n], sizes[n:]))
        rates = self._signed @ box + pushed
        rates[:n] -= rounding
        rates[n:] += rounding
        return rates

    @cached_property
    def _signed(self) -> FloatArray:
        up, down = np.maximum(self.A, 0.0), np.minimum(self.A, 0.0)
        return np.block([[up, down], [down, up]])

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
    n, remainder = 0, Fraction(1)
    while n < LEAST_TERMS or size >= n or remainder / (1 - size / (n + 1)) > REMAINDER:
        n += 1
        term = _shortened(term @ M * t / n)
        total = total + term
        remainder = remainder * size / n
    return total


def _shortened(term: Rationals) -> Rationals:
    """Entries to 1e-40: their length would grow with every product."""
    return np.vectorize(lambda x: Fraction(round(x * 10**40), 10**40), otypes=[object])(term)
