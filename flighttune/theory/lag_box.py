r"""Rates of a channel behind a lag and a delay that are only known to lie in ranges.

A channel of a decoupled loop, with the law's own entries a and b, gains K_P and K_I, an inner
feedback k, a first-order lag and the Pade section of a delay is

    e' = a e - b y,           xi' = e,     u = (1 + k) (K_P e + K_I xi) - k y,
    lag y' = 2 z - u - y,     (delay / 2) z' = u - z,

or ``lag y' = u - y`` without a delay. Two rates are proven over a box of (lag, delay, a, b):

- of the loop for every constant point of the box. Its characteristic polynomial, with s - rate for
  s, has its roots in the left half-plane by the criterion of Lienard and Chipart: four polynomials
  in the numbers of the box, of degree three in each at most, are positive. They are where all their
  Bernstein coefficients are; a box on which these do not decide is halved.
- of a norm, for every change inside the box in time. The loop is affine in (1/lag, 1/delay, a, b)
  and so lies in the hull of the corners, at which one Q satisfies ``A' Q + Q A + 2 rate Q < 0``.

J. Garloff, *Application of Bernstein expansion to the solution of control problems*, Reliable
Computing 6 (2000); S. Boyd et al., *Linear Matrix Inequalities in System and Control Theory*,
section 5.1.
"""

import itertools
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.theory.decay import decay_checks, roundest_norm, true_rate
from flighttune.theory.exact import Check, Rationals, exact

# Smallest and largest of (lag in s, delay in s, a in 1/s, b in the unit of e' over that of y)
Box: TypeAlias = Sequence[tuple[float, float]]

# K_P, K_I and k of a channel
ChannelGains: TypeAlias = tuple[float, float, float]

# Bernstein coefficients of a cubic on [0, 1] from its values at these.
NODES: Rationals = np.array([Fraction(i, 3) for i in range(4)])
TO_BERNSTEIN: Rationals = exact([[6, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6]]) / 6

# Parts of a box that are looked at before a proof is given up.
MAX_PARTS = 200

# Relative accuracy of the rate for constant numbers, and of that for any change.
ACCURACY, NORM_ACCURACY = 1e-6, 1e-3

# A norm is searched at a rate that is faster by this part of it: room for the solver's error.
AHEAD = 2e-4


def _conditions(gains: ChannelGains, rate: Fraction, point: Sequence[Any]) -> Rationals:
    """What must be positive at points (lag, delay, a, b), broadcast: shape (4, ...)."""
    K_P, K_I, k = map(Fraction, gains)
    lag, delay, a, b = point
    h, g = delay / 2, b * (1 + k)
    linear = lag + h * (1 - k)
    # from the highest power of s on
    p = [
        lag * h,
        linear - a * lag * h,
        1 + k - a * linear - g * h * K_P,
        g * (K_P - h * K_I) - a * (1 + k),
        g * K_I,
    ]
    for last in range(4, 0, -1):  # Horner's scheme, which moves s to s - rate
        for i in range(last):
            p[i + 1] = p[i + 1] - rate * p[i]
    q4, q3, q2, q1, q0 = p
    return np.array(np.broadcast_arrays(q3, q1, q0, q1 * (q2 * q3 - q1 * q4) - q0 * q3**2))


def constant_rate_proven(gains: ChannelGains, box: Box, rate: float) -> bool:
    """Whether the loop is proven to decay faster than `rate` at every constant point of a box."""
    parts = [[(Fraction(low), Fraction(high)) for low, high in box]]
    for _ in range(MAX_PARTS):
        if not parts:
            return True
        part = parts.pop()
        axes = [low + (high - low) * (NODES if low < high else NODES[:1]) for low, high in part]
        values = _conditions(gains, Fraction(rate), np.ix_(*axes))
        if (values <= 0).any():
            return False
        for axis, nodes in enumerate(axes, start=1):
            if len(nodes) > 1:
                along = np.tensordot(TO_BERNSTEIN, values, (1, axis))
                values = np.moveaxis(along, 0, axis)
        if (values > 0).all():
            continue
        # across the side that is longest beside that of the whole box
        sides = [
            float(high - low) / (end - start) if start < end else 0.0
            for (low, high), (start, end) in zip(part, box, strict=True)
        ]
        widest = int(np.argmax(sides))
        (low, high), rest = part[widest], part.copy()
        for half in ((low, (low + high) / 2), ((low + high) / 2, high)):
            rest[widest] = half
            parts.append(rest.copy())
    return False


def constant_rate(gains: ChannelGains, box: Box) -> float:
    """The largest rate that is proven for every constant point of a box, 1/s; 0 if there is none.

    It is below the true one by a relative `ACCURACY`.
    """
    axes = [np.linspace(*ends, 7) if ends[0] < ends[1] else ends[:1] for ends in box]
    slowest = min(true_rate_at(gains, point) for point in itertools.product(*axes))
    if not slowest > 0.0:
        return 0.0
    # A grid nearly has the slowest loop: the true rate is sought from there downwards.
    unproven, lack = slowest, ACCURACY
    while not constant_rate_proven(gains, box, rate := slowest * (1.0 - lack)):
        unproven, lack = rate, 8.0 * lack
        if lack > 1.0:
            return 0.0
    while unproven - rate > ACCURACY * slowest:
        middle = (rate + unproven) / 2.0
        if constant_rate_proven(gains, box, middle):
            rate = middle
        else:
            unproven = middle
    return rate


def true_rate_at(gains: ChannelGains, point: Sequence[float]) -> float:
    """Slowest rate among the eigenvalues at a point (lag, delay, a, b), 1/s."""
    return true_rate(_loop(gains, point, point[3]).astype(float))


def corner_loops(gains: ChannelGains, box: Box) -> list[Rationals]:
    """Loops at the corners of (1/lag, 1/delay, a, b), of states (e, xi, y, z) without rounding.

    The states y and z are in units in which the largest b is one; without a delay there is no z.
    """
    corners = itertools.product(*(dict.fromkeys(map(Fraction, ends)) for ends in box))
    exact_gains = [Fraction(gain) for gain in gains]
    return [_loop(exact_gains, corner, Fraction(box[3][1])) for corner in corners]


def _loop(gains: Sequence[Any], point: Sequence[Any], unit: Any) -> Rationals:
    """The loop at one point, in the numbers that it is given."""
    (K_P, K_I, k), (lag, delay, a, b) = gains, point
    commands = np.array([(1 + k) * unit * K_P, (1 + k) * unit * K_I, -k, 0 * k])
    loop = np.zeros((4, 4), dtype=object)
    loop[0, [0, 2]], loop[1, 0] = (a, -b / unit), 1 + 0 * a
    if not delay:
        loop[2] = commands / lag
        loop[2, 2] -= 1 / lag
        return loop[:3, :3] + 0 * a
    loop[2], loop[3] = -commands / lag, commands * 2 / delay
    loop[2, 2:] += -1 / lag, 2 / lag
    loop[3, 3] -= 2 / delay
    return loop + 0 * a


def norm_checks(gains: ChannelGains, box: Box, Q: FloatArray, rate: float) -> list[Check]:
    """The inequalities by which the norm of Q decays at `rate` for every change inside a box."""
    loops = corner_loops(gains, box)
    checks = decay_checks(loops[0], Q, rate=rate)
    for loop in loops[1:]:  # the last check alone is of the loop
        checks.append(decay_checks(loop, Q, rate=rate)[-1])
    return checks


def norm_rate(gains: ChannelGains, box: Box, most: float) -> tuple[float, FloatArray] | None:
    """The largest rate up to `most` of one norm for every change inside a box, with its Q.

    None where no norm is found that decays.
    """
    loops = np.array(corner_loops(gains, box), dtype=float)
    best, low, high = None, 0.0, most
    rate = (1.0 - NORM_ACCURACY) * most
    while high - low > NORM_ACCURACY * most:
        Q = roundest_norm(loops, (1.0 + AHEAD) * rate)
        if Q is not None and all(check.exact for check in norm_checks(gains, box, Q, rate)):
            best, low = (rate, Q), rate
        else:
            high = rate
        rate = (low + high) / 2.0
    return best
