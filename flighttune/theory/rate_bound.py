"""The largest R_K for a bound on I_K, and a proof that no gains have a larger one.

For C = I and plain units the optimum has equal channels, each of two numbers: closed but for one
root, which docs/optimal.md derives. The proof is for all gains, coupled or not: a solver proposes
it, `bound_checks` decides. R_K and sigma_min(A_K) are between 0 and 1 for every loop; their square
is divided into boxes, and in each of them linear matrix inequalities in five numbers, which every
loop of any size satisfies, contradict each other.
"""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_positive
from flighttune.theory.exact import Check, Rationals, as_float, exact, positive_definite
from flighttune.theory.lmi import blocks, largest, parameter, solve, unknown

# Lower triangles of the four multipliers of a box, of order 2, 2, 2 and 4
TRIANGLES = [np.tril_indices(order) for order in (2, 2, 2, 4)]
NUMBERS = sum(len(rows) for rows, _ in TRIANGLES)

# Added to the diagonals of the solver's multipliers, which are singular: the check is strict.
LIFT = 1e-9

# Digits of the multipliers in a file; those after them move no margin.
DIGITS = 10

MAX_BOXES = 5000

# A box is halved along R_K where that side is longer than this share of the other one.
WIDE = 0.7


def no_faster_gains(I_star: float, R_bound: float) -> tuple[FloatArray, FloatArray] | None:
    """Boxes and multipliers that prove ``R_K <= R_bound`` for all gains with ``I_K <= I_star``.

    Boxes are halved until each is refuted. Returns arrays of shapes (N, 4) and (N, `NUMBERS`) as
    `bound_checks` takes them, or None where `MAX_BOXES` boxes are not enough.
    """
    boxes: list[Sequence[float]] = []
    multipliers: list[FloatArray] = []
    pending = [(R_bound, 1.0, 0.0, 1.0)]
    # A proof of N boxes tries N - 1 more, which it halves.
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


def bound_checks(
    I_star: float, R_bound: float, boxes: FloatArray, multipliers: FloatArray
) -> list[Check]:
    """Check exactly that no gains with ``I_K <= I_star`` have an R_K above `R_bound`.

    A row of `boxes` (shape (N, 4)) has the smallest and largest R_K, then sigma_min(A_K); one of
    `multipliers` (shape (N, `NUMBERS`)) the lower triangles of three matrices of order 2 and one of
    order 4.

    Notes
    -----
    For any A_K = [[F, G], [I, 0]], n states: ``A_K = W (U - I)^-1`` with ``W = Q^-1``, an
    orthogonal U, and ``T = U - I`` whose upper blocks are the lower ones of W. With R, sigma_min(A)
    in a box and ``w = I_star R_high^2 sigma_high``

    - ``W - R_low I >= 0`` and ``I - W / w >= 0``;
    - ``(1 + R_low / w) W - R_low I + (sigma_low^2 / w) (T + T') >= 0``, because w times the left is
      at least ``W^2 - sigma^2 T' T = T' (A' A - sigma^2 I) T``;
    - ``[[-(T + T'), T'], [T, I]] >= 0``, because ``T' T = -(T + T')``.

    The traces over n of all n x n blocks satisfy the same for a W and T of order 2: five numbers.
    Positive multipliers with which the sum is negative for all of them refute the box.
    """
    # Between two edges the same boxes are over every sigma, so that one look at R_K does for all.
    edges = np.unique(boxes[:, 2:])
    gap = float(max(edges[0], 1.0 - edges[-1]))
    for low, high in itertools.pairwise(edges):
        strip = boxes[(boxes[:, 2] <= low) & (high <= boxes[:, 3])]
        strip = strip[np.argsort(strip[:, 0])]
        reached = np.maximum.accumulate([R_bound, *strip[:, 1]])
        gap = max(gap, float(np.max([*strip[:, 0], 1.0] - reached)))
    margins = [
        _box_margin(box, numbers, I_star)
        for box, numbers in zip(boxes.tolist(), multipliers, strict=True)
    ]
    return [
        Check(name=f"boxes cover {R_bound:.6g} <= R_K <= 1", margin=-gap, exact=gap <= 0.0),
        Check(
            name=f"no gains in any of {len(margins)} boxes",
            margin=as_float(min(margins)),
            exact=min(margins) > 0,
        ),
    ]


def _matrices(multipliers: npt.ArrayLike) -> list[Rationals]:
    """The four symmetric matrices of a box, as rationals."""
    entries, matrices = iter(exact(multipliers)), []
    for rows, columns in TRIANGLES:
        matrix = exact(np.zeros((rows[-1] + 1, rows[-1] + 1)))
        part = list(itertools.islice(entries, len(rows)))
        matrix[rows, columns] = matrix[columns, rows] = part
        matrices.append(matrix)
    return matrices


def _box_margin(box: Sequence[float], multipliers: npt.ArrayLike, I_star: float) -> Fraction:
    """Distance of the sum of a box below zero for all W and T; -1 where it proves nothing.

    The linear terms cancel up to rounding, and ``|W_ij| <= w``, ``|T_ij| <= 2`` bounds the rest.
    """
    low, R_high, sigma_low, sigma_high = map(Fraction, box)
    w, s = Fraction(I_star) * R_high**2 * sigma_high, max(sigma_low, Fraction(0)) ** 2
    X = _matrices(multipliers)
    if w <= 0 or not all(map(positive_definite, X)):
        return Fraction(-1)
    above, below, square, contraction = X
    P, M, N = contraction[:2, :2], contraction[2:, :2], contraction[2:, 2:]
    in_W = above - below / w + (1 + low / w) * square
    in_T = 2 * (s / w * square - P + M)
    # The upper row of T is the lower one of W.
    slopes = abs(in_W[0, 0]), abs(2 * in_W[0, 1] + in_T[0, 0]), abs(in_W[1, 1] + in_T[0, 1])
    spread = w * sum(slopes) + 2 * (abs(in_T[1, 0]) + abs(in_T[1, 1]))
    constant = below.trace() - low * (above + square).trace() + N.trace()
    return -constant - spread


@cache
def _box_program() -> tuple[Any, ...]:
    """The largest t with which every inequality of `bound_checks` holds with slack t."""
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
    """`NUMBERS` numbers that may refute a box; None where the solver has no answer."""
    R_low, R_high, sigma_low, sigma_high = box
    problem, inequalities, parameters = _box_program()
    w = I_star * R_high**2 * sigma_high
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
    """The channel with the smallest I_K of all with this R_K, which is between 0 and 1.

    Notes
    -----
    With ``W = Q^-1`` and an angle theta, ``A = W (U - I)^-1`` for the rotation U by theta, so that
    ``W = [[a, cos(theta) - 1], [cos(theta) - 1, sin(theta)]]`` and ``sigma_min(A) = R_K / h`` with
    ``h = 2 sin(theta / 2)``. The eigenvalues of W are R_K and
    ``w = sin(theta) + h^4 / (4 (sin(theta) - R_K))``; ``I_K = w h / R_K^3``, ``p = (R_K + w) / 2``
    and ``q = R_K w / h^2``.
    """
    from scipy.optimize import minimize_scalar

    def parts(theta: float) -> tuple[float, float]:
        h = 2.0 * math.sin(theta / 2.0)
        return h, math.sin(theta) + h**4 / (4.0 * (math.sin(theta) - R_K))

    options = {"xatol": 1e-10}
    ends = math.asin(R_K), math.pi - math.asin(R_K)
    theta = minimize_scalar(
        lambda theta: math.prod(parts(theta)), bounds=ends, method="bounded", options=options
    ).x
    h, w = parts(theta)
    return Channel(R_K, w * h / R_K**3, (R_K + w) / 2.0, R_K * w / h**2)


@cache
def slowest_channel() -> Channel:
    """The channel with the smallest I_K of all: no smaller `I_star` can be met."""
    from scipy.optimize import minimize_scalar

    options = {"xatol": 1e-9}
    optimum = minimize_scalar(
        lambda R_K: least_radius(R_K).I_K, bounds=(0.2, 0.8), method="bounded", options=options
    )
    return least_radius(float(optimum.x))


def optimal_channel(I_star: float) -> Channel | None:
    """The channel with the largest R_K under ``I_K <= I_star``; None if no gains meet that."""
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
