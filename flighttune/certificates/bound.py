"""An upper bound on R_K over all gains, proven once and checked without a solver."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from flighttune.arrays import FloatArray, check_positive, set_read_only
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError
from flighttune.files.table import STRICT, read, write
from flighttune.present.answer import Answer, Answering, Column, Table, pick
from flighttune.theory.exact import Verification
from flighttune.theory.indicators import scaled
from flighttune.theory.rate_bound import NUMBERS, bound_checks, no_faster_gains, optimal_channel

# The bound is above the optimum by this share of R_K (1 - R_K): by 1 % at I* = 5.
GAP = 0.02


BOUND_COLUMNS = [
    Column("I_star", "largest I_K", "s²", "z.6g"),
    Column("R_bound", "bound on R_K", "1/s", "z.6g"),
]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateBound(Answering):
    r"""For every A_K = [[F, G], [I, 0]] of any size with I_K <= I_star: R_K <= R_bound.

    Attributes
    ----------
    I_star : float, s^2
    R_bound : float, 1/s
        At most ``1 / I_star``: no gains meet `I_star` at all.
    boxes, multipliers : ndarray, shapes (N, 4) and (N, 19)
        Of each box the smallest and largest R_K, then those of sigma_min(A_K); the lower triangles
        of three matrices of order 2 and one of order 4, which refute the box.

    Notes
    -----
    With the smallest feasible Q, ``W = Q^-1`` and ``T = A_K^-1 W``, the Lyapunov equation says that
    ``T + I`` is orthogonal, so that ``T' T = -(T + T')``; the upper blocks of T are the lower ones
    of W. Let R <= R_K, sigma <= sigma_min(A_K) and w >= I_star R_K^2 sigma_min(A_K). Then
    I_K <= I_star implies

    .. math::

        W \ge R I, \quad W \le w I, \quad
        (R + w) W - R w I + \sigma^2 (T + T^T) \ge 0, \quad
        \begin{pmatrix} -(T + T^T) & T^T \\ T & I \end{pmatrix} \ge 0 .

    The third holds because ``(W - R I)(w I - W) >= 0`` makes its left side at least
    ``W^2 - sigma^2 T' T = T' (A_K' A_K - sigma^2 I) T``. The mean of the diagonal of each n x n
    block turns all four into the same inequalities for a W and a T of order 2: five numbers are
    left whatever n is. R_K and sigma_min(A_K) are between 0 and 1. Their square above R_bound is
    divided into boxes, in each of which the inequalities at its corners contradict each other:
    the multipliers are positive, and their sum is negative for all five numbers.

    Examples
    --------
    >>> bound = ft.tune("paper", prove=True).bound
    >>> round(bound.R_bound, 3), bound.verify().valid
    (0.545, True)
    """

    I_star: float
    R_bound: float
    boxes: FloatArray
    multipliers: FloatArray

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune rate bound 1"
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

    def answer(self) -> Answer:
        """The bound and its sentence."""
        values = pick(self, "sentence I_star R_bound")
        return Answer(values=values, tables=[Table(BOUND_COLUMNS, [values])], verdict=self.sentence)

    def save(self, path: str | Path) -> None:
        """Write the claim with its proof (.json)."""
        write(self, path)

    def verify(self) -> Verification:
        """Check the bound exactly, from its numbers alone."""
        checks = bound_checks(self.I_star, self.R_bound, self.boxes, self.multipliers)
        return Verification.of(checks)


def bound_rate(
    model: LinearModel, I_star: float, scaling: FloatArray | None = None
) -> RateBound | None:
    """A verified bound on R_K for gains on `model`; None where the proof takes too many boxes."""
    n, _, p = model.shape
    output = np.ones(n + p) if scaling is None else np.asarray(scaling)
    lower = np.vstack([np.zeros((n, n + p)), np.hstack([model.C, np.zeros((p, p))])])
    if n != p or not np.array_equal(scaled(lower, output)[n:, :n], np.eye(n)):
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


def load_bound(path: str | Path) -> RateBound:
    """Read a bound; nothing in it is trusted before `verify` has checked it."""
    return read(path, RateBound)
