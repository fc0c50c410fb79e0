r"""Rates of channels behind a lag and a delay that are only known to lie in ranges.

A channel of a decoupled loop, with the law's own entries a and b, gains K_P and K_I, an inner
feedback k, a first-order lag and the Pade section of a delay is

    e' = a e - b y,           xi' = e,     u = (1 + k) (K_P e + K_I xi) - k y,
    lag y' = 2 z - u - y,     (delay / 2) z' = u - z,

or ``lag y' = u - y`` without a delay. Two rates are proven over a box of (lag, delay, a, b):

- the rate of the loop for every constant point of the box. Its characteristic polynomial, with s -
rate for s, has its roots in the left half-plane by the criterion of Lienard and Chipart if four
polynomials are positive. They have at most degree three in each number of the box. They are
positive if all their Bernstein coefficients are; a box is halved if the coefficients do not decide.
- the rate of a norm, for every change inside the box in time. The loop is affine in (1/lag,
1/delay, a, b) and so lies in the hull of the corners, at which one Q satisfies ``A' Q + Q A + 2
rate Q < 0``.

J. Garloff, *Application of Bernstein expansion to the solution of control problems*, Reliable
Computing 6 (2000); S. Boyd et al., *Linear Matrix Inequalities in System and Control Theory*,
section 5.1.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, check_positive, set_read_only
from flighttune.base.errors import InputError
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, Range
from flighttune.control.theory.decay import decay_checks, roundest_norm, true_rate
from flighttune.control.theory.exact import Check, Rationals, exact

# Ranges of (lag in s, delay in s, a in 1/s, b in the unit of e' over the unit of y)
Box: TypeAlias = Sequence[tuple[float, float]]

# K_P, K_I and k of a channel
ChannelGains: TypeAlias = tuple[float, float, float]

# The entries a and b of every channel
Entries: TypeAlias = tuple[FloatArray, FloatArray]

# Points from whose values the Bernstein coefficients of a cubic on [0, 1] follow.
NODES: Rationals = np.array([Fraction(i, 3) for i in range(4)])
TO_BERNSTEIN: Rationals = exact([[6, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6]]) / 6

# Maximum number of parts of a box before a proof is given up.
MAX_PARTS = 200

# Relative accuracy of the rate for constant numbers, and of the rate for any change.
ACCURACY, NORM_ACCURACY = 1e-6, 1e-3

# A norm is sought at a rate that is faster by this share: room for the solver's error.
AHEAD = 2e-4

# Relative tolerance for entries of a model inside a box.
SAME_ENTRIES = 1e-12

# Minimum and maximum of the numbers of a box; a number beyond has the wrong unit.
BOUNDS = {"lag": (1e-4, 60.0), "delay": (0.0, 60.0), "a": (-60.0, 60.0), "b": (1e-6, 1e6)}


NOT_ENCLOSED = (
    "A box has a lag of first order, and a delay as a first-order Pade section. It does not "
    "enclose the difference between these and an identified lag of higher order, nor that between "
    "model and aircraft, which the residual boxes of a tube bound where they were counted."
)


@dataclass(frozen=True, slots=True, eq=False)
class LagBox:
    """Proven rates of one channel over a box of its lag, delay and entries.

    Attributes
    ----------
    lag, delay : (float, float), s
        Ranges; a range of delays is above 0, or 0 alone.
    a, b : (float, float), 1/s and unit of the error per unit of the input and second
        Ranges of the entries of the law, ``e' = a e - b y``.
    rate : float, 1/s
        The error decays faster than this for every point of the box that stays constant.
    norm_rate : float, 1/s, or None
        A norm of the channel decays at this rate while the point moves in any way inside the box.
    Q : ndarray, shape (3, 3) or (4, 4), or None
        The norm is ``sqrt(x' Q x)``, with x as in `corner_loops`.
    """

    lag: Range
    delay: Range
    a: Range
    b: Range
    rate: float
    norm_rate: float | None = None
    Q: FloatArray | None = None

    def __post_init__(self) -> None:
        for name, (least, most) in BOUNDS.items():
            low, high = getattr(self, name)
            if not least <= low <= high <= most:
                raise InputError(
                    f"`{name}` must be a range inside {least:g}:{most:g}, its low end first, got "
                    f"{low:g}:{high:g}."
                )
        if self.delay[0] == 0.0 < self.delay[1]:
            raise InputError(f"`delay` must be above 0 or 0 alone, got 0:{self.delay[1]:g}.")
        check_positive(rate=self.rate, norm_rate=self.norm_rate)
        if (self.norm_rate is None) != (self.Q is None):
            raise InputError("`norm_rate` and `Q` must be given together.")
        set_read_only(self, Q=(3 + (self.delay[1] > 0.0),) * 2)

    @property
    def ranges(self) -> Box:
        """The box: lag, delay, a, b."""
        return self.lag, self.delay, self.a, self.b

    @property
    def growth(self) -> float | None:
        """Largest factor by which the norm of x may grow before it decays; None without Q."""
        return None if self.Q is None else math.sqrt(float(np.linalg.cond(self.Q)))

    def checks(self, gains: PIGains, i: int) -> list[Check]:
        """The polynomials and inequalities that prove the rates of channel i of gains."""
        channel = channel_gains(gains, i)
        slowest = min(true_rate_at(channel, x) for x in itertools.product(*self.ranges))
        proven = constant_rate_proven(channel, self.ranges, self.rate)
        name = "polynomials of the rate are positive"
        checks = [Check(name=name, margin=slowest - self.rate, exact=proven)]
        if self.Q is not None and self.norm_rate is not None:
            checks += norm_checks(channel, self.ranges, self.Q, self.norm_rate)
        place = f" (box of {gains.errors[i]})"
        return [replace(check, name=check.name + place) for check in checks]

    def values(self, error: str) -> dict[str, Any]:
        """Ranges and rates, for a table and a command."""
        return {
            "error": error,
            "lag_s": list(self.lag),
            "delay_s": list(self.delay),
            "a": list(self.a),
            "b": list(self.b),
            "lag": span(self.lag),
            "delay": span(self.delay),
            "rate": self.rate,
            "norm_rate": self.norm_rate,
            "growth": self.growth,
        }

    @property
    def place(self) -> str:
        """The ranges for which the rates hold, in words."""
        delay = f" and a delay of {span(self.delay)} s" if self.delay[1] else ""
        fixed = self.a[0] == self.a[1] and self.b[0] == self.b[1]
        law = "" if fixed else f", in e' = a e - b y with a {span(self.a)} and b {span(self.b)}"
        return f"behind a first-order lag of {span(self.lag)} s{delay}{law}"

    def sentence(self, error: str) -> str:
        """The claim in words."""
        words = f"{error} {self.place} decays at {self.rate:.6g} 1/s if that is constant, "
        if self.norm_rate is None or self.growth is None:
            return f"{words}and at no proven rate if it changes"
        return (
            f"{words}and in a norm at {self.norm_rate:.6g} 1/s, with a growth of at most "
            f"{self.growth:.3g}, if it changes in these ranges at will"
        )


def span(ends: Range) -> str:
    """A range in words."""
    return f"{ends[0]:.4g}" + f"..{ends[1]:.4g}" * (ends[0] < ends[1])


def _uncoupled(models: Sequence[LinearModel], gains: PIGains) -> list[Entries] | None:
    """The entries a and b of each model; None if its law or the gains couple the channels."""
    if not all(np.array_equal(K, np.diag(np.diag(K))) for K in (gains.K_P, gains.K_I)):
        return None
    entries = []
    for model in models:
        n, m, p = model.shape
        if m != p or not np.array_equal(model.C, np.eye(p, n)):
            return None
        A, B = model.A[:p, :p], model.B[:p]
        if n > p:
            inside = model.A[p:, p:]
            if not np.linalg.eigvals(inside).real.max() < 0.0:
                return None
            # Lags and delays between law and command are removed; their static gain is one.
            B = B - model.A[:p, p:] @ np.linalg.solve(inside, model.B[p:])
        if any(np.abs(x - np.diag(np.diag(x))).max() > SAME_ENTRIES for x in (A, B)):
            return None
        entries.append((np.diag(A), -np.diag(B)))
    return entries


def channel_gains(gains: PIGains, i: int) -> ChannelGains:
    """K_P, K_I and inner feedback of a channel."""
    k = gains.feedback[i] if i < len(gains.feedback) else 0.0
    return float(gains.K_P[i, i]), float(gains.K_I[i, i]), float(k)


def lag_boxes(
    models: Sequence[LinearModel], gains: PIGains, lag: npt.ArrayLike, delay: npt.ArrayLike
) -> tuple[tuple[LagBox, ...], str]:
    """The proven boxes of every channel; if they cannot be proven, none and the reason.

    `models` have the entries of the law that the boxes contain; `lag` and `delay` (s) are the
    ranges, shape (2,), or one for each channel, (p, 2).
    """
    entries, p = _uncoupled(models, gains), len(gains.errors)
    if entries is None:
        return (), "no rate over lags and delays: the gains or the law couple the channels."
    a, b = np.stack([np.min(entries, axis=0), np.max(entries, axis=0)], axis=-1)
    b[:, 1] = np.where(np.ptp(b, axis=1) <= SAME_ENTRIES * b[:, 0], b[:, 0], b[:, 1])
    try:
        ranges = [np.broadcast_to(ends, (p, 2)) for ends in (lag, delay, a, b)]
    except ValueError as error:
        raise InputError(f"`lag` must be one range, or {p}, one a channel, got {lag}.") from error
    boxes = []
    for i, ends in enumerate(np.stack(ranges, axis=1).tolist()):
        box, channel = LagBox(*map(tuple, ends), rate=1.0), channel_gains(gains, i)
        if not (rate := constant_rate(channel, box.ranges)):
            return (), f"{gains.errors[i]}: its loop is not proven to be stable {box.place}."
        norm, Q = norm_rate(channel, box.ranges, rate) or (None, None)
        boxes.append(replace(box, rate=rate, norm_rate=norm, Q=Q))
    return tuple(boxes), ""


def boxes_checks(
    boxes: Sequence[LagBox], models: Sequence[LinearModel], gains: PIGains
) -> list[Check]:
    """Check the boxes of every channel, and that they contain the law of the models."""
    each = _uncoupled(models, gains)
    holds = len(boxes) == len(gains.errors) and each is not None
    for entries in each or ():
        for a, b, box in zip(*entries, boxes, strict=False):
            for entry, (low, high) in ((a, box.a), (b, box.b)):
                slack = SAME_ENTRIES * max(abs(low), abs(high))
                holds &= bool(low - slack <= entry <= high + slack)
    name = "the channels are uncoupled, and their law is in the boxes"
    checks = [Check(name=name, margin=0.0 if holds else -math.inf, exact=holds)]
    for i, box in enumerate(boxes if holds else ()):
        checks += box.checks(gains, i)
    return checks


def _conditions(gains: ChannelGains, rate: Fraction, point: Sequence[Any]) -> Rationals:
    """The polynomials that must be positive, at points (lag, delay, a, b): shape (4, ...)."""
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
                values = np.moveaxis(np.tensordot(TO_BERNSTEIN, values, (1, axis)), 0, axis)
        if (values > 0).all():
            continue
        # across the longest side, relative to the whole box
        sides = [
            float(high - low) / (end - start) if start < end else 0.0
            for (low, high), (start, end) in zip(part, box, strict=True)
        ]
        widest = int(np.argmax(sides))
        low, high = part[widest]
        middle = (low + high) / 2
        parts += [
            [*part[:widest], half, *part[widest + 1 :]] for half in ((low, middle), (middle, high))
        ]
    return False


def constant_rate(gains: ChannelGains, box: Box) -> float:
    """The largest rate, 1/s, proven for every constant point of a box; 0 without a proof."""
    axes = [np.linspace(*ends, 7) if ends[0] < ends[1] else ends[:1] for ends in box]
    slowest = min(true_rate_at(gains, point) for point in itertools.product(*axes))
    if not slowest > 0.0:
        return 0.0
    # A grid nearly contains the slowest loop, so the search for the true rate goes down from there.
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
    """Loops at the corners of (1/lag, 1/delay, a, b), of states (e, xi, y, z) without rounding."""
    corners = itertools.product(*(dict.fromkeys(map(Fraction, ends)) for ends in box))
    exact_gains = [Fraction(gain) for gain in gains]
    # The units of y and z make the largest b one; without a delay there is no z.
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
    # All checks but the last concern Q alone and are equal at every corner.
    first, *others = (decay_checks(loop, Q, rate=rate) for loop in corner_loops(gains, box))
    return [*first, *(checks[-1] for checks in others)]


def norm_rate(gains: ChannelGains, box: Box, most: float) -> tuple[float, FloatArray] | None:
    """The largest rate up to `most` of one norm for every change inside a box, and its Q."""
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
