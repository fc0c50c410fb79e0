"""Exact arithmetic, and exact proofs of the inequalities of a certificate.

Floats are rationals, and relations between rationals can be proven. Matrices are arrays of
`fractions.Fraction`, whose sums and products are exact. Sine and cosine are intervals with rational
ends.

A certificate makes two claims about a family of loops ``s' = A s + E v``, A anywhere in the convex
hull of vertices:

- rate: without a disturbance ``s' Q s`` decays at `rate` or faster, because at every vertex
  ``A' Q + Q A + I <= 0``, and ``rate Q <= I``. The norm of s decays at half of this rate.
- radius: with ``||v|| <= L_d`` the loop ends up, and stays, in ``s' W^-1 s <= 1``, because at every
  vertex ``A W + W A' + a W + (L_d^2 / a) E E' <= 0``, and ``W <= radius^2 I``.

Each inequality is checked strictly, twice. The exact check is a proof about the stated numbers as
binary floats. The margin is the smallest eigenvalue in floating point.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError

# An array of `Fraction`.
Rationals: TypeAlias = npt.NDArray[Any]

Interval: TypeAlias = tuple[Fraction, Fraction]

# Less than pi/2, by 2e-17.
HALF_PI_BELOW = Fraction(15707963267948966, 10**16)

# Terms of a Taylor series inside +-pi/2: the next term is below 1e-23.
TERMS = 14

# Inflations tried, smallest first, to make a Q strictly feasible. The first is above the rounding
# of the solution (1e-16 times its condition number), and the last costs 0.1 % of the rate.
FACTORS = tuple(1.0 + 10.0**-digits for digits in (9, 8, 7, 6, 5, 4, 3))


def exact(values: npt.ArrayLike) -> Rationals:
    """`values` as rationals, without rounding; an InputError says that one is not finite."""
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InputError(f"`values` must be finite, got {array.tolist()}.")
    rationals = [Fraction(value) for value in array.ravel().tolist()]
    return np.array(rationals, dtype=object).reshape(array.shape)


def identity(n: int) -> Rationals:
    """The unit matrix in rationals, shape (n, n)."""
    return exact(np.eye(n))


def integers(matrix: Rationals) -> tuple[Rationals, int]:
    """`matrix` times a common denominator, as integers, and that denominator."""
    # Integer arithmetic takes a fifth of the time of `Fraction`, which reduces each result.
    denominator = math.lcm(*(entry.denominator for entry in matrix.flat))
    return np.vectorize(int, otypes=[object])(matrix * denominator), denominator


def positive_definite(matrix: Rationals) -> bool:
    """Prove that a rational matrix is symmetric with only positive eigenvalues, or disprove it."""
    if not np.array_equal(matrix, matrix.T):
        return False
    # Sylvester's criterion. Bareiss's elimination gives the leading minors of the matrix of
    # integers, and every division comes out even.
    reduced, previous = integers(matrix)[0], 1
    while len(reduced):
        if (pivot := reduced[0, 0]) <= 0:
            return False
        reduced = (reduced[1:, 1:] * pivot - np.outer(reduced[1:, 0], reduced[0, 1:])) // previous
        previous = pivot
    return True


def sine(angle: float) -> Interval:
    """An interval that contains the sine of a float inside +-pi/2 (rad); InputError outside."""
    return _series(angle, 1)


def cosine(angle: float) -> Interval:
    """An interval that contains the cosine of a float inside +-pi/2 (rad); InputError outside."""
    return _series(angle, 0)


def product(first: Interval, second: Interval) -> Interval:
    """The products of the numbers of two intervals."""
    products = [a * b for a in first for b in second]
    return min(products), max(products)


def _series(angle: float, power: int) -> Interval:
    """Two consecutive partial sums of an alternating series with falling terms."""
    if not abs(angle) <= HALF_PI_BELOW:
        raise InputError(f"`angle` must lie inside +-pi/2, got {angle} rad.")
    x, total = Fraction(angle), Fraction(0)
    term = x**power
    for k in range(TERMS):
        total += term
        term = -term * x * x / ((2 * k + power + 1) * (2 * k + power + 2))
    return min(total, total + term), max(total, total + term)


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One inequality of a certificate."""

    name: str
    # Margin: the smallest eigenvalue of a matrix that must be positive, or the smallest distance
    # inside a range
    margin: float
    exact: bool  # whether it is proven in rational arithmetic


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """The outcome of checking a claim."""

    valid: bool  # every check is proven
    reason: str  # the first inequality that fails, with its margin; empty for a valid claim
    checks: tuple[Check, ...] = ()
    notes: tuple[str, ...] = ()  # sentences on further checks
    checked: bool = True  # false if a check was left out, for the reason

    @classmethod
    def of(cls, checks: Sequence[Check]) -> "Verification":
        """The verdict on a list of checks."""
        failed = [check for check in checks if not check.exact]
        reason = ""
        if failed:
            worst = min(failed, key=lambda check: check.margin)
            more = f"; {len(failed) - 1} more fail" if len(failed) > 1 else ""
            verb = "does not hold" if worst.margin <= 0.0 else "is not proven"
            reason = f"{worst.name} {verb}: margin {worst.margin:.3g}{more}."
        return cls(valid=not failed, reason=reason, checks=tuple(checks))


def matrix_check(name: str, matrix: Rationals, denominator: int = 1) -> Check:
    """Check that a matrix, rational or of integers over `denominator`, is positive definite."""
    size = max(abs(entry) for entry in matrix.flat) or Fraction(1)  # no entry may overflow
    smallest = float(np.linalg.eigvalsh((matrix / size).astype(float))[0])
    margin = Fraction(smallest) * size / denominator
    return Check(name=name, margin=as_float(margin), exact=positive_definite(matrix))


def margin_check(name: str, margin: Fraction) -> Check:
    """Check that an exact number is not negative."""
    return Check(name=name, margin=as_float(margin), exact=margin >= 0)


def as_float(value: Fraction) -> float:
    """The nearest float; infinity beyond the range of floats."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def rate_checks(vertices: Sequence[Rationals], Q: FloatArray, *, rate: float) -> list[Check]:
    """The inequalities of the rate claim, `rate` in 1/s."""
    form, eye = exact(Q), identity(len(Q))
    checks = [
        margin_check("rate >= 0", Fraction(rate)),
        matrix_check("Q > 0", form),
        matrix_check("rate Q <= I", eye - form * Fraction(rate)),
    ]
    whole, form_scale = integers(form)
    for number, A in enumerate(vertices, start=1):
        name = f"A' Q + Q A + I <= 0 at vertex {number} of {len(vertices)}"
        loop, loop_scale = integers(A)
        unit = form_scale * loop_scale
        flow = loop.T @ whole + whole @ loop
        flow[np.diag_indices_from(flow)] += unit
        checks.append(matrix_check(name, -flow, unit))
    return checks


def radius_checks(
    vertices: Sequence[Rationals],
    E: FloatArray,
    W: FloatArray,
    *,
    multiplier: float,
    radius: float,
    L_d: float,
) -> list[Check]:
    """Inequalities of the radius claim: ellipsoid `W` (n, n), disturbance's entry `E` (n, m)."""
    positive = {"radius": radius, "multiplier": multiplier, "L_d": L_d}
    checks = [
        Check(name=f"{name} > 0", margin=value, exact=bool(value > 0.0))
        for name, value in positive.items()
    ]
    if not all(check.exact for check in checks):
        return checks
    a, eye = Fraction(multiplier), identity(len(W))
    # All margins of the claim are divided by ``radius^2``.
    unit = Fraction(radius) ** 2
    form, entry = exact(W) / unit, exact(E)
    load = (entry @ entry.T) * (Fraction(L_d) ** 2 / (a * unit))
    checks.append(matrix_check("W > 0", form))
    checks.append(matrix_check("W <= radius^2 I", eye - form))
    for number, A in enumerate(vertices, start=1):
        name = f"A W + W A' + a W + (L_d^2/a) E E' <= 0 at vertex {number} of {len(vertices)}"
        checks.append(matrix_check(name, -(A @ form + form @ A.T + form * a + load)))
    return checks


def provable_rate(vertices: Sequence[Rationals], Q: FloatArray) -> tuple[FloatArray, float] | None:
    """Q inflated until ``A' Q + Q A + I <= 0`` is provable, and the rate it proves; or None."""
    for factor in FACTORS:
        larger = factor * (Q + Q.T) / 2.0
        rate = float(1.0 / np.linalg.eigvalsh(larger)[-1]) * (2.0 - FACTORS[0])
        if all(check.exact for check in rate_checks(vertices, larger, rate=rate)):
            return larger, rate
    return None
