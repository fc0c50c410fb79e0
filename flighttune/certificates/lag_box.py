"""Rates of the channels of a certificate where lag and delay are only known to lie in ranges."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_positive, set_read_only
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, Range
from flighttune.errors import InputError
from flighttune.present.answer import Column
from flighttune.theory.exact import Check
from flighttune.theory.lag_box import (
    Box,
    ChannelGains,
    constant_rate,
    constant_rate_proven,
    norm_checks,
    norm_rate,
    true_rate_at,
)

# Relative difference between the entries of a model and those of a box that contains them.
SAME_ENTRIES = 1e-12

# Least and most of the numbers of a box; one beyond is a slip of the unit.
BOUNDS = {"lag": (1e-4, 60.0), "delay": (0.0, 60.0), "a": (-60.0, 60.0), "b": (1e-6, 1e6)}

BOX_COLUMNS = [
    Column("error", "channel"),
    Column("lag", "lag [s]"),
    Column("delay", "delay [s]"),
    Column("rate", "rate if constant", "1/s", "z.6g"),
    Column("norm_rate", "rate if changing", "1/s", "z.6g"),
    Column("growth", "largest growth of the norm"),
]

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
        Ranges; a delay is nowhere 0 or everywhere.
    a, b : (float, float), 1/s and unit of the error over that of the input and second
        Ranges of the entries of the law, ``e' = a e - b y``.
    rate : float, 1/s
        The error decays faster than this for every point of the box that stays constant.
    norm_rate : float, 1/s, or None
        A norm of the channel decays at this rate while the point moves inside the box as it likes.
    Q : ndarray, shape (3, 3) or (4, 4), or None
        That norm is ``sqrt(x' Q x)``, x as in `flighttune.theory.lag_box.corner_loops`.
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

    def checks(self, gains: ChannelGains, error: str) -> list[Check]:
        """The polynomials and inequalities that prove the rates of a channel of gains."""
        margin = min(true_rate_at(gains, x) for x in itertools.product(*self.ranges)) - self.rate
        proven = constant_rate_proven(gains, self.ranges, self.rate)
        checks = [Check(name="polynomials of the rate are positive", margin=margin, exact=proven)]
        if self.Q is not None and self.norm_rate is not None:
            checks += norm_checks(gains, self.ranges, self.Q, self.norm_rate)
        return [replace(check, name=f"{check.name} (box of {error})") for check in checks]

    def values(self, error: str) -> dict[str, Any]:
        """Ranges and rates, for a table and a command."""
        growth = None if self.Q is None else self.growth
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
            "growth": growth,
        }

    @property
    def place(self) -> str:
        """Where its rates hold, in words."""
        delay = f" and a delay of {span(self.delay)} s" if self.delay[1] else ""
        fixed = self.a[0] == self.a[1] and self.b[0] == self.b[1]
        law = "" if fixed else f", in e' = a e - b y with a {span(self.a)} and b {span(self.b)}"
        return f"behind a first-order lag of {span(self.lag)} s{delay}{law}"

    def sentence(self, error: str) -> str:
        """The claim in words."""
        words = f"{error} {self.place} decays at {self.rate:.6g} 1/s if that is constant, "
        if self.norm_rate is None:
            return f"{words}and at no proven rate if it changes"
        return (
            f"{words}and in a norm at {self.norm_rate:.6g} 1/s, with a growth of at most "
            f"{self.growth:.3g}, if it changes in these ranges at will"
        )

    @property
    def growth(self) -> float:
        """Largest factor by which the norm of x may grow before it decays; infinite without Q."""
        return math.inf if self.Q is None else math.sqrt(float(np.linalg.cond(self.Q)))


# The entries a and b of every channel
Entries: TypeAlias = tuple[FloatArray, FloatArray]


def span(ends: Range) -> str:
    """A range in words."""
    return f"{ends[0]:.4g}" + f"..{ends[1]:.4g}" * (ends[0] < ends[1])


def law_entries(model: LinearModel) -> Entries | None:
    """The entries a and b of each channel of a law, in ``e' = a e - b y``; None where they couple.

    Lags and delays between law and command, whose static gain is one, are taken out.
    """
    n, m, p = model.shape
    if m != p or not np.array_equal(model.C, np.eye(p, n)):
        return None
    A, B = model.A[:p, :p], model.B[:p]
    if n > p:
        inside = model.A[p:, p:]
        if not np.linalg.eigvals(inside).real.max() < 0.0:
            return None
        B = B - model.A[:p, p:] @ np.linalg.solve(inside, model.B[p:])
    if any(np.abs(x - np.diag(np.diag(x))).max() > SAME_ENTRIES for x in (A, B)):
        return None
    return np.diag(A), -np.diag(B)


def channel_gains(gains: PIGains, i: int) -> ChannelGains:
    """K_P, K_I and inner feedback of a channel."""
    k = gains.feedback[i] if i < len(gains.feedback) else 0.0
    return float(gains.K_P[i, i]), float(gains.K_I[i, i]), float(k)


def _uncoupled(models: Sequence[LinearModel], gains: PIGains) -> list[Entries] | None:
    """The entries of each model where its law and the gains leave each channel to itself."""
    alone = [np.diag(np.diag(K)) for K in (gains.K_P, gains.K_I)]
    entries = [entry for model in models if (entry := law_entries(model)) is not None]
    same = len(entries) == len(models) and np.array_equal(alone, [gains.K_P, gains.K_I])
    return entries if same else None


def lag_boxes(
    models: Sequence[LinearModel], gains: PIGains, lag: npt.ArrayLike, delay: npt.ArrayLike
) -> tuple[tuple[LagBox, ...], str]:
    """The proven boxes of every channel; none, and the reason, where they cannot be proven.

    `models` have the entries of the law that the boxes contain; `lag` and `delay` (s) are the
    ranges, shape (2,) or one a channel, (p, 2). Raises InputError if a range is none.
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
    """Check the boxes of every channel, and that they hold the law of the models."""
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
        checks += box.checks(channel_gains(gains, i), gains.errors[i])
    return checks
