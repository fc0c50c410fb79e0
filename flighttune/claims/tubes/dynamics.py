r"""The exact point mass and its inner loop over one sample, for a whole set of flights.

The rates ``(g/V) n_z sin(phi)/cos(gamma)`` and ``(g/V)(n_z cos(phi) - cos(gamma))`` are linear in
(phi, n_z, gamma) about the middle of all values of the sample, plus a remainder of second order.
The linear part needs the means of the three over the sample. The means of roll and load factor are
known. The mean of gamma is ``gamma + (h/2) G + e``, with G the mean of its rate and ``|e|`` at most
h/4 times the width of the rate's range, because e is the integral of ``(h/2 - t)/h`` times the rate
minus its mean. The inner loop is linear, and its matrices over a sample are exact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.claims.tubes.forms import UP, Form, Quantity, combined
from flighttune.claims.tubes.interval import Interval, Unbounded, sine_and_cosine, within
from flighttune.control.inner_loop import InnerLag
from flighttune.control.theory.exact import Rationals, exact, identity

LEAST_TERMS = 12

# Boxes tried for the values within a sample
PICARD = 30

# Exceeds the rounding of a sum of a dozen products, relative to the sum of their sizes
ROUNDING = 1e-13

# Share of its width by which a box grows before the next try
WIDER = 0.05

# Number of steps within a sample, per sample time and norm of A
SHORT = 3.0

# Sum of a geometric series of 1/`SHORT`
FURTHER = 1.0 / (1.0 - 1.0 / SHORT)

# Widening of a trial box without width
SLACK = 1e-9

# Bound on the truncated part of the exponential series
REMAINDER = Fraction(1, 10**22)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledLag:
    """A lag with delay from one sample to the next, with n states and m commands in force."""

    # `A` and `B` (shapes (n, n) and (n,)): matrices of the lag; its first state is the response
    A: FloatArray
    B: FloatArray
    # shape (n, n + 2): state after the sample, of state, older and newer command
    # All entries are exact up to one rounding.
    transition: FloatArray
    mean: FloatArray  # shape (n + 2,): mean of the response over the sample, from the same
    # Delay in whole samples: the newer command in force was given this number of samples before,
    # and the older command one sample earlier.
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
        """All values of the response over a sample of `h` seconds; Unbounded on failure.

        `state`: at the start; `end`: the response at the end; `command`: in force within the
        sample. The response leaves the straight line from start to end by at most h/4 times the
        width of its rate's range. A box Y of states with ``y + [0, t] (A Y + B u)`` inside Y bounds
        the rate: Picard's operator maps the curves in it into itself. Such a box exists if t times
        the norm of A is well below 1, so a sample is divided into steps.
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
        return state[0].hull(end) + Interval(-margin, margin)

    def _box(self, start: FloatArray, pushed: FloatArray, t: float) -> FloatArray:
        """A box of all states up to `t` (s) from an initial box: lower ends, then upper ends."""
        n, sizes = self.order, np.abs(self.A)
        outwards = np.repeat([-1.0, 1.0], n)[:, np.newaxis]
        # The first box uses the rates at the start, the rates that these cause, and a geometric
        # bound on the rest. It usually works at once.
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
        """Values of ``A Y + B u``, like Y: lower ends, then upper ends."""
        n, sizes = self.order, np.abs(box)
        up, down = np.maximum(self.A, 0.0), np.minimum(self.A, 0.0)
        rounding = ROUNDING * (np.abs(self.A) @ np.maximum(sizes[:n], sizes[n:]))
        rates = np.block([[up, down], [down, up]]) @ box + pushed
        return rates + np.concatenate([-rounding, rounding])

    @property
    def order(self) -> int:
        """States of the lag."""
        return len(self.B)


def _exponential(M: Rationals, t: Fraction) -> Rationals:
    """``exp(M t)`` with an error below `REMAINDER` per entry."""
    size = max(sum(abs(entry) for entry in row) for row in M) * t
    total = term = identity(len(M))
    # Entries are rounded to 1e-40, because their length would grow with every product.
    shortened = np.vectorize(lambda x: Fraction(round(x * 10**40), 10**40), otypes=[object])
    # The bound on the truncated terms holds once n + 1 is above the norm.
    # These are below ``x^n/n! / (1 - x/(n+1))``, with x the norm of ``M t``.
    n, remainder = 0, Fraction(1)
    while n < LEAST_TERMS or size >= n or remainder / (1 - size / (n + 1)) > REMAINDER:
        n += 1
        term = shortened(term @ M * t / n)
        total = total + term
        remainder = remainder * size / n
    return total


class Point(NamedTuple):
    """Load factor, sine and cosine of the roll, sine and cosine of the flight-path angle."""

    n_z: Interval
    s: Interval
    c: Interval
    up: Interval
    level: Interval

    @classmethod
    def of(cls, phi: Interval, n_z: Interval, gamma: Interval) -> "Point":
        """The point with its sines and cosines."""
        return cls(n_z, *sine_and_cosine(phi), *sine_and_cosine(gamma))

    @property
    def turn(self) -> Interval:
        """Rate of the course divided by g/V."""
        return self.n_z * self.s / self.level

    @property
    def climb(self) -> Interval:
        """Rate of the flight-path angle divided by g/V."""
        return self.n_z * self.c - self.level


def point_mass_sample(
    chi: Form,
    gamma: Quantity,
    phi: Quantity,
    n_z: Quantity,
    d: Interval,
    *,
    h: float,
    g_over_v: float,
) -> tuple[Form, Form, FloatArray]:
    """Course and flight-path angle one sample of `h` seconds later, under the disturbances `d`.

    `phi` and `n_z` have the form of the mean over the sample, and all values in it. Also returns
    the largest difference of a rate within the sample, shape (2,), rad/s.
    """
    d_chi, d_gamma = (Interval(d.low[j], d.high[j]) for j in (0, 1))
    start_rate = Point.of(phi.values, n_z.values, gamma.values).climb * g_over_v + d_gamma
    # The rate's slope in gamma is at most g/V, so it changes by less than 2 h g/V of itself in a
    # sample.
    path = gamma.values + within(h * start_rate.largest * (1.0 + 2.0 * h * g_over_v) * UP)
    ranges = phi.values, n_z.values, path
    middles = [each.middle for each in ranges]
    radii = [(each - m).largest for each, m in zip(ranges, middles, strict=True)]
    p, middle = Point.of(*ranges), Point.of(*map(Interval.point, middles))
    a, b, e = radii

    def mean_rate(
        rate: Interval, slopes: Sequence[Interval], remainder: Interval
    ) -> tuple[Form, FloatArray]:
        """The mean rate, linear in the three forms, with gamma as at the start; its slope in gamma.

        `rate` and `slopes` are taken at the middles, and `remainder` encloses the terms of second
        order; all three are divided by g/V.
        """
        rest, terms = rate * g_over_v + remainder * g_over_v, []
        for slope, form, m, radius in zip(
            slopes, (phi.form, n_z.form, gamma.form), middles, radii, strict=True
        ):
            # Any float near the slope works, because `rest` has the rest of the slope times the
            # radius.
            scaled = slope * g_over_v
            number = scaled.middle
            rest = rest - Interval.point(number) * m + (scaled - number) * within(radius)
            terms.append((number, form))
        return combined(*terms, shift=rest), terms[-1][0]

    # Second order: half the second derivatives times squares, mixed derivatives times products.
    # Both rates are linear in n_z, so n_z has no square.
    lift = middle.n_z / middle.level
    turning, turn_bend = mean_rate(
        middle.turn,
        (lift * middle.c, middle.s / middle.level, lift * middle.s * middle.up / middle.level),
        -(p.n_z * p.s / p.level) * _half_square(a)
        + p.n_z * p.s * (p.up * p.up + 1.0) / (p.level * p.level * p.level) * _half_square(e)
        + (p.c / p.level) * within(a * b * UP)
        + (p.n_z * p.c * p.up / (p.level * p.level)) * within(a * e * UP)
        + (p.s * p.up / (p.level * p.level)) * within(b * e * UP),
    )
    climbing, bend = mean_rate(
        middle.climb,
        (-(middle.n_z * middle.s), middle.c, middle.up),
        -(p.n_z * p.c) * _half_square(a) + p.level * _half_square(e) + p.s * within(a * b * UP),
    )
    turn, rate = p.turn * g_over_v + d_chi, p.climb * g_over_v + d_gamma
    # h/4 times the width of the rate, which is twice its radius.
    apart = h * 0.5 * rate.radius * UP
    climbing = combined((1.0, climbing), shift=d_gamma.middle)
    climbing = climbing.widened(d_gamma.radius + np.abs(bend) * apart * UP)
    # The mean of gamma contains (h/2) G, so the equation is solved for its mean rate G.
    climbing = combined((1.0 / (1.0 - 0.5 * h * bend), climbing))
    turning = combined((1.0, turning), (0.5 * h * turn_bend, climbing), shift=d_chi.middle)
    turning = turning.widened(d_chi.radius + np.abs(turn_bend) * apart * UP)
    spread = 2.0 * np.array([turn.radius.max(), rate.radius.max()])
    return combined((1.0, chi), (h, turning)), combined((1.0, gamma.form), (h, climbing)), spread


def _half_square(radius: FloatArray) -> Interval:
    return Interval(np.zeros_like(radius), 0.5 * radius * radius * UP)
