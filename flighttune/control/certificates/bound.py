"""An upper bound on R_K over all gains, proven once and checked without a solver.

For C = I and plain units the channels of the optimum are equal. Each has two numbers in closed form
but for one root, which docs/optimal.md derives. The proof covers all gains, coupled or not: a
solver proposes it, and `RateBound.verify` decides.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_positive, set_read_only
from flighttune.base.errors import InputError
from flighttune.base.files.claim import read, write
from flighttune.base.files.table import STRICT
from flighttune.control.linear_model import LinearModel
from flighttune.control.theory.exact import Check, Verification, as_float, exact, positive_definite
from flighttune.control.theory.lmi import blocks, largest, parameter, solve, unknown

# The bound is above the optimum by this share of R_K (1 - R_K): by 1 % at I* = 5.
GAP = 0.02

# Lower triangles of the four multipliers of a box, of order 2, 2, 2 and 4
TRIANGLES = [np.tril_indices(order) for order in (2, 2, 2, 4)]
NUMBERS = sum(len(rows) for rows, _ in TRIANGLES)

# Added to the diagonals of the solver's multipliers, which are singular: the check is strict.
LIFT = 1e-9

# Digits of the multipliers in a file; further digits do not change a margin.
DIGITS = 10

MAX_BOXES = 5000

# A box is halved along R_K if that side is longer than this share of the other side.
WIDE = 0.7


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateBound(Answering):
    r"""For every A_K = [[F, G], [I, 0]] of any size with I_K <= I_star: R_K <= R_bound.

    Attributes
    ----------
    I_star : float, s^2
    R_bound : float, 1/s
        At most ``1 / I_star``: no gains meet `I_star` at all.
    boxes, multipliers : ndarray, shapes (N, 4) and (N, 19)
        Smallest and largest R_K and sigma_min(A_K) of each box; lower triangles of three matrices
        of order 2 and one of order 4, which refute the box.

    Notes
    -----
    With the smallest feasible Q, ``W = Q^-1`` and ``T = A_K^-1 W``, the Lyapunov equation says that
    ``T + I`` is orthogonal, so that ``T' T = -(T + T')``; the upper blocks of T are the lower
    blocks of W. Let R <= R_K, sigma <= sigma_min(A_K) and w >= I_star R_K^2 sigma_min(A_K). Then
    I_K <= I_star implies

    .. math::

        W \ge R I, \quad W \le w I, \quad
        (R + w) W - R w I + \sigma^2 (T + T^T) \ge 0, \quad
        \begin{pmatrix} -(T + T^T) & T^T \\ T & I \end{pmatrix} \ge 0 .

    The third holds because ``(W - R I)(w I - W) >= 0`` makes its left side at least
    ``W^2 - sigma^2 T' T = T' (A_K' A_K - sigma^2 I) T``. The mean of the diagonal of each n x n
    block turns all four into the same inequalities for a W and a T of order 2: five numbers remain
    for every n. R_K and sigma_min(A_K) are between 0 and 1. Their square above R_bound is divided
    into boxes. In each box the inequalities at its corners contradict each other: the multipliers
    are positive, and the weighted sum is negative for all five numbers.

    Examples
    --------
    >>> bound = ft.tune("paper", changes={"tuning.I_star": 20.0}, prove=True).bound
    >>> round(bound.R_bound, 3), bound.verify().valid
    (0.926, True)
    """

    I_star: float
    R_bound: float
    boxes: FloatArray
    multipliers: FloatArray

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune rate bound 2"
    UNSEALED: ClassVar[str] = "flighttune rate bound 1"
    UNITS: ClassVar[Mapping[str, str]] = {
        "I_star": "s^2",
        "R_bound": "1/s",
        "boxes": "smallest and largest R_K (1/s), smallest and largest sigma_min(A_K)",
    }

    def __post_init__(self) -> None:
        check_positive(I_star=self.I_star, R_bound=self.R_bound)
        count = max(np.size(self.boxes) // 4, 1)
        set_read_only(self, boxes=(count, 4), multipliers=(count, NUMBERS))

    kind: ClassVar[Literal["proven"]] = "proven"

    @property
    def sentence(self) -> str:
        """The claim in words."""
        none = Fraction(self.R_bound) * Fraction(self.I_star) <= 1
        what = "none exist" if none else f"R_K <= {self.R_bound:.6g} 1/s"
        return (
            "for every linear model whose states are its errors, of any aircraft, and all gains "
            f"with I_K <= {self.I_star:g} s², coupled or not: {what}"
        )

    def save(self, path: str | Path) -> None:
        """Write the claim with its proof (.json)."""
        write(self, path)

    def verify(self) -> Verification:
        """Check the bound exactly, from its numbers alone."""
        # Between two edges every sigma meets the same boxes, so one check along R_K covers them
        # all.
        edges = np.unique(self.boxes[:, 2:])
        gap = float(max(edges[0], 1.0 - edges[-1]))
        for low, high in itertools.pairwise(edges):
            strip = self.boxes[(self.boxes[:, 2] <= low) & (high <= self.boxes[:, 3])]
            strip = strip[np.argsort(strip[:, 0])]
            reached = np.maximum.accumulate([self.R_bound, *strip[:, 1]])
            gap = max(gap, float(np.max([*strip[:, 0], 1.0] - reached)))
        least = min(
            _box_margin(box, numbers, self.I_star)
            for box, numbers in zip(self.boxes.tolist(), self.multipliers, strict=True)
        )
        covered = f"boxes cover {self.R_bound:.6g} <= R_K <= 1"
        refuted = f"no gains in any of {len(self.boxes)} boxes"
        return Verification.of(
            [
                Check(name=covered, margin=-gap, exact=gap <= 0.0),
                Check(name=refuted, margin=as_float(least), exact=least > 0),
            ]
        )


def load_bound(path: str | Path) -> RateBound:
    """Read a bound; nothing in it is trusted before `verify` has checked it."""
    return read(path, RateBound)


def bound_rate(
    model: LinearModel, I_star: float, scaling: FloatArray | None = None
) -> RateBound | None:
    """A verified bound on R_K for gains on `model`; None if the proof takes too many boxes."""
    n, _, p = model.shape
    units = np.ones(n + p) if scaling is None else np.asarray(scaling)
    if not np.array_equal(model.C * (units[:n] / units[n:, None]), np.eye(n)):
        raise InputError(
            "`model` must have the errors as its states, in plain units, for a bound on R_K over "
            f"all gains, got the states {', '.join(model.states)}."
        )
    if not math.isfinite(I_star):
        raise InputError(f"`I_star` must be finite for a bound on R_K below 1, got {I_star}.")
    best = optimal_channel(I_star)
    if best is None:  # R_K I_K >= 1 for any gains; rounded, the quotient may be above 1 / I_star
        R_bound = math.nextafter(1.0 / I_star, 0.0)
    else:
        R_bound = best.R_K * (1.0 + GAP * (1.0 - best.R_K))
    if (proof := no_faster_gains(I_star, R_bound)) is None:
        return None
    bound = RateBound(I_star=I_star, R_bound=R_bound, boxes=proof[0], multipliers=proof[1])
    return bound if bound.verify().valid else None


def no_faster_gains(I_star: float, R_bound: float) -> tuple[FloatArray, FloatArray] | None:
    """Boxes, halved until each is refuted, and multipliers of a `RateBound`; None if too many."""
    boxes: list[Sequence[float]] = []
    multipliers: list[FloatArray] = []
    pending = [(R_bound, 1.0, 0.0, 1.0)]
    # A proof with N boxes also tries N - 1 boxes that it halves.
    for _ in range(2 * MAX_BOXES):
        if not pending:
            return np.array(boxes), np.array(multipliers)
        box = pending.pop()
        refutation = _refutation(box, I_star)
        if refutation is not None and _box_margin(box, refutation, I_star) > 0:
            boxes.append(box)
            multipliers.append(refutation)
            continue
        R_low, R_high, sigma_low, sigma_high = box
        R, sigma = (R_low + R_high) / 2.0, (sigma_low + sigma_high) / 2.0
        # Across the longer side, relative to its upper end
        if 1.0 - R_low / R_high > WIDE * (1.0 - sigma_low / sigma_high):
            pending += [(R_low, R, sigma_low, sigma_high), (R, R_high, sigma_low, sigma_high)]
        else:
            pending += [(R_low, R_high, sigma_low, sigma), (R_low, R_high, sigma, sigma_high)]
    return None


def _box_margin(box: Sequence[float], multipliers: npt.ArrayLike, I_star: float) -> Fraction:
    """Distance of the sum of a box below zero for all W and T; -1 without a proof."""
    # The linear terms cancel up to rounding, and ``|W_ij| <= w``, ``|T_ij| <= 2`` bounds the rest.
    low, R_high, sigma_low, sigma_high = map(Fraction, box)
    w, s = Fraction(I_star) * R_high**2 * sigma_high, max(sigma_low, Fraction(0)) ** 2
    entries, X = iter(exact(multipliers)), []
    for rows, columns in TRIANGLES:
        matrix = exact(np.zeros((rows[-1] + 1, rows[-1] + 1)))
        matrix[rows, columns] = matrix[columns, rows] = list(itertools.islice(entries, len(rows)))
        X.append(matrix)
    if w <= 0 or not all(map(positive_definite, X)):
        return Fraction(-1)
    above, below, square, contraction = X
    P, M, N = contraction[:2, :2], contraction[2:, :2], contraction[2:, 2:]
    in_W = above - below / w + (1 + low / w) * square
    in_T = 2 * (s / w * square - P + M)
    # The upper row of T is the lower row of W.
    slopes = abs(in_W[0, 0]), abs(2 * in_W[0, 1] + in_T[0, 0]), abs(in_W[1, 1] + in_T[0, 1])
    spread = w * sum(slopes) + 2 * (abs(in_T[1, 0]) + abs(in_T[1, 1]))
    constant = below.trace() - low * (above + square).trace() + N.trace()
    return -constant - spread


@cache
def _box_program() -> tuple[Any, ...]:
    """The largest t with which every inequality of `RateBound` holds with slack t."""
    W, bottom, t, eye = unknown(2, 2, symmetric=True), unknown(2), unknown(), np.eye(2)
    T = blocks([[W[1, 0], W[1, 1]], [bottom[0], bottom[1]]])
    low, inverse, total, s = (parameter() for _ in range(4))
    inequalities = [
        W - low * eye >> t * eye,
        eye - inverse * W >> t * eye,
        total * W - low * eye + s * (T + T.T) >> t * eye,
        blocks([[-(T + T.T), T.T], [T, eye]]) >> t * np.eye(4),
    ]
    return largest(t, inequalities), inequalities, (low, inverse, total, s)


def _refutation(box: Sequence[float], I_star: float) -> FloatArray | None:
    """`NUMBERS` numbers that may refute a box; None if the solver has no answer."""
    R_low, R_high, sigma_low, sigma_high = box
    problem, inequalities, parameters = _box_program()
    w = I_star * R_high**2 * sigma_high
    # The second and the third inequality of `RateBound` are divided by w.
    values = R_low, 1.0 / w, 1.0 + R_low / w, sigma_low**2 / w
    for number, value in zip(parameters, values, strict=True):
        number.value = value
    if solve(problem):
        return None
    triangles = [
        (inequality.dual_value + LIFT * np.eye(len(inequality.dual_value)))[triangle]
        for inequality, triangle in zip(inequalities, TRIANGLES, strict=True)
    ]
    return np.concatenate(triangles).round(DIGITS)


class Channel(NamedTuple):
    """One channel ``A_K = [[-p, -q], [1, 0]]`` and its indicators."""

    R_K: float
    I_K: float
    p: float
    q: float


def least_radius(R_K: float) -> Channel:
    """The channel with this R_K, between 0 and 1, that has the smallest I_K."""

    def parts(theta: float) -> tuple[float, float]:
        h = 2.0 * math.sin(theta / 2.0)
        return h, math.sin(theta) + h**4 / (4.0 * (math.sin(theta) - R_K))

    ends = math.asin(R_K), math.pi - math.asin(R_K)
    # With ``W = Q^-1`` and an angle theta, ``A = W (U - I)^-1`` for the rotation U by theta, so
    # that ``W = [[a, cos(theta) - 1], [cos(theta) - 1, sin(theta)]]`` and
    # ``sigma_min(A) = R_K / h`` with ``h = 2 sin(theta / 2)``. The eigenvalues of W are R_K and
    # ``w = sin(theta) + h^4 / (4 (sin(theta) - R_K))``; ``I_K = w h / R_K^3``,
    # ``p = (R_K + w) / 2`` and ``q = R_K w / h^2``.
    h, w = parts(_least(lambda theta: math.prod(parts(theta)), ends, 1e-10))
    return Channel(R_K, w * h / R_K**3, (R_K + w) / 2.0, R_K * w / h**2)


@cache
def slowest_channel() -> Channel:
    """The channel with the smallest I_K of all: no smaller `I_star` can be met."""
    return least_radius(_least(lambda R_K: least_radius(R_K).I_K, (0.2, 0.8), 1e-9))


def _least(function: Callable[[float], float], ends: tuple[float, float], within: float) -> float:
    from scipy.optimize import minimize_scalar

    least = minimize_scalar(function, bounds=ends, method="bounded", options={"xatol": within})
    return float(least.x)


def optimal_channel(I_star: float) -> Channel | None:
    """The channel with the largest R_K under ``I_K <= I_star``; None if no gains meet it."""
    from scipy.optimize import brentq

    check_positive(I_star=I_star)
    least = slowest_channel()
    if I_star < least.I_K:
        return None
    # I_K grows without bound towards R_K = 1: as (1 - R_K)^-1, so that the bracket is wide enough.
    fastest = 1.0 - 0.1 / max(I_star, 1.0)
    rate = brentq(
        lambda R_K: math.log(least_radius(R_K).I_K / I_star), least.R_K, fastest, xtol=1e-13
    )
    return least_radius(float(rate))
