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
PICARD = 60
"""Boxes tried for the values within a sample."""

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

    def values_within(self, state: list[Interval], command: Interval, h: float) -> Interval | None:
        """All values of the response over a sample; None if they cannot be told.

        A box Y that contains ``y + [0, h] (A Y + B u)`` contains the states of the whole sample:
        Picard's operator maps the curves in it into itself.
        """
        time = Interval(np.zeros_like(command.low), np.full_like(command.low, h))
        box = state
        for _ in range(PICARD):
            moved = []
            for own, row, b in zip(state, self.A.tolist(), self.B.tolist(), strict=True):
                rate = command * b
                for a, other in zip(row, box, strict=True):
                    rate = rate + other * a
                moved.append(own + time * rate)
            if all(_inside(one, other) for one, other in zip(moved, box, strict=True)):
                return moved[0]
            box = [_wider(one.hull(other)) for one, other in zip(moved, box, strict=True)]
        return None

    @property
    def order(self) -> int:
        """States of the lag."""
        return len(self.B)


def _inside(inner: Interval, outer: Interval) -> bool:
    return bool(((inner.low >= outer.low) & (inner.high <= outer.high)).all())


def _wider(values: Interval) -> Interval:
    margin = 0.02 * (values.high - values.low) + 1e-9
    return Interval(values.low - margin, values.high + margin)


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
