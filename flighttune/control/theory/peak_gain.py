r"""Bounds of the peak gains of a linear loop: the largest output for any bounded input.

For ``s' = A s + b n`` and ``y = c s`` with ``|n| <= N`` at all times, ``|y| <= N ||h||_1`` where
``||h||_1`` is the integral of ``|c exp(A t) b|`` over t. No smaller factor holds for every such n
(Dahleh and Pearson, IEEE Trans. Automatic Control 32 (1987) 314-322). Within a step the impulse
response is a Taylor polynomial with integer coefficients, whose Bernstein form gives its sign. The
integral is exact where the sign is constant; where it changes, the step is halved. The norm
``sqrt(s' Q s)``, which falls at a proven rate, bounds the remainder.
"""

import math
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.theory.exact import Rationals, exact, integers, positive_definite

# Bits after the binary point of states and coefficients.
BITS = 160
UNIT = 1 << BITS

# Degree of the polynomial of a step, and number of terms in the series of exp(A dt).
DEGREE, TERMS = 20, 90

# Maximum number of halvings of a step in which the response changes sign.
HALVINGS = 12

# The integration stops when the tail is at most this part of the integral so far.
TAIL = 1e-6

# Number of steps after which a loop counts as too slow.
MAX_STEPS = 60_000

# Steps between two bounds of the tail.
TAIL_EVERY = 64

# Factors on a computed bound of a row, tried from the smallest until one is proven.
WIDENINGS = (1.0 + 1e-6, 1.0 + 1e-3, 1.1, 10.0)

# Relative widening of the bounds; their own rounding is below a thousandth of it.
OUTWARD = 1e-9


class PeakGains(NamedTuple):
    """Lower and upper bounds of the peak gains, shape (rows, columns)."""

    lower: FloatArray
    upper: FloatArray


class _Step(NamedTuple):
    """Map and polynomials of a step, in units of 2^-BITS."""

    dt: float
    forward: Rationals  # (n, n): exp(A dt)
    coefficients: Rationals  # (p, DEGREE + 1, n): Bernstein coefficients of c exp(A dt x), x 0..1
    map_error: float  # largest error of an entry of `forward`
    left_out: FloatArray  # (p,): remainder of the polynomial for a state of norm 1


def peak_gains(
    loop: Rationals, entry: Rationals, rows: Rationals, Q: FloatArray, *, rate: float
) -> PeakGains:
    """Enclose the peak gains from each column of `entry` to each row of `rows`.

    `loop` (n, n) is A, for which ``A' Q + Q A + I <= 0`` and ``rate Q <= I`` (rate in 1/s) have
    been proven; `entry` has shape (n, q) and `rows` (p, n). InputError if the loop is too slow.
    """
    n, q = entry.shape
    row_sizes = _row_sizes(rows, Q)
    step = _step(loop, rows, Q)
    states = _rounded(entry)
    # The norm falls, so the norm at the start bounds all later ones.
    form, form_unit = integers(exact(Q))
    start = _norms(states, form, form_unit)
    rounding = math.sqrt(n / rate)  # norm of a vector whose entries are 1 in size, at most
    seen = np.zeros((2, len(rows), q))  # lower and upper
    astray = np.full(q, rounding / UNIT)  # norm of the error of `states`
    for k in range(MAX_STEPS):
        if k % TAIL_EVERY == 0:
            sizes = _norms(states, form, form_unit) + astray
            tail = np.outer(row_sizes, sizes) * 2.0 / rate * (1.0 + OUTWARD)
            if (tail <= TAIL * seen[0].max()).all():
                return PeakGains(seen[0] * (1.0 - OUTWARD), (seen[1] + tail) * (1.0 + OUTWARD))
        largest = np.abs(states).max(axis=0).astype(float) / UNIT
        between = step.left_out[:, None] * start + np.outer(row_sizes, astray)
        between += 2.0 * (n + 1) / UNIT * (largest + 1.0)
        parts = step.coefficients @ states
        for i, j in np.ndindex(len(rows), q):
            low, high = _integral(parts[i, :, j].tolist())
            seen[0, i, j] += max(low - between[i, j], 0.0) * step.dt
            seen[1, i, j] += (high + between[i, j]) * step.dt
        states = _shifted(step.forward @ states)
        astray = astray + rounding * (n * step.map_error * largest + 1.0 / UNIT)
    raise InputError(
        f"the slowest mode of the loop must decay within {MAX_STEPS} steps of its fastest one, "
        f"which are {MAX_STEPS * step.dt:.3g} s, for peak gains."
    )


def _step(loop: Rationals, rows: Rationals, Q: FloatArray) -> _Step:
    """The step of a loop: at most the time constant of its fastest mode."""
    n = len(loop)
    fastest = float(np.abs(np.linalg.eigvals(loop.astype(float))).max())
    halvings = max(math.ceil(math.log2(fastest)), 0)
    scaled = loop / 2**halvings
    power = exact(np.eye(n))
    forward, coefficients, beyond = power, [rows], np.zeros(len(rows))
    for j in range(1, TERMS + 1):
        power = power @ scaled / j
        forward = forward + power
        if j <= DEGREE:
            coefficients.append(rows @ power)
        if j == DEGREE + 1:
            beyond = _row_sizes(rows @ power, Q)
    size = float(np.abs(scaled).sum(axis=1).max())
    if size > TERMS / 4.0:
        raise InputError("entries of the loop must not be far above its rates, for peak gains.")
    # Beyond the last term each term is less than half the one before.
    rest = 2.0 * math.exp((TERMS + 1) * math.log(size) - math.lgamma(TERMS + 2))
    bernstein = [
        sum(Fraction(math.comb(i, j), math.comb(DEGREE, j)) * coefficients[j] for j in range(i + 1))
        for i in range(DEGREE + 1)
    ]
    return _Step(
        dt=2.0**-halvings,
        forward=_rounded(forward),
        coefficients=_rounded(np.stack(bernstein, axis=1)),
        map_error=(rest + 1.0 / UNIT) * (1.0 + OUTWARD),
        left_out=beyond * (1.0 + OUTWARD),
    )


def _row_sizes(rows: Rationals, Q: FloatArray) -> FloatArray:
    """A proven bound of each output over the states of norm 1: ``c' c <= size^2 Q``."""
    form, sizes = exact(Q), []
    for row in rows:
        largest = max(map(abs, row)) or Fraction(1)  # no entry may overflow
        direction = row / largest
        values = direction.astype(float)
        size = math.sqrt(max(float(values @ np.linalg.solve(Q, values)), 0.0)) or 1.0
        outer = np.outer(direction, direction)
        for widened in WIDENINGS:
            if positive_definite(form * Fraction(size * widened) ** 2 - outer):
                sizes.append(size * widened * float(largest) * (1.0 + OUTWARD))
                break
        else:
            raise InputError("`Q` must be better conditioned to bound the outputs of the loop.")
    return np.array(sizes)


def _norms(states: Rationals, form: Rationals, form_unit: int) -> FloatArray:
    """Norm of each column."""
    squares = (states * (form @ states)).sum(axis=0)
    scale = form_unit * UNIT * UNIT
    return np.array([math.sqrt(Fraction(x, scale)) for x in squares]) * (1.0 + OUTWARD)


def _rounded(values: Rationals) -> Rationals:
    """Rationals, rounded to integers in units of 2^-BITS."""
    return np.vectorize(lambda x: round(x * UNIT), otypes=[object])(values)


def _shifted(products: Rationals) -> Rationals:
    """Products of two numbers in units of 2^-BITS, back in these units."""
    return products >> BITS


def _integral(coefficients: list[int], halvings: int = HALVINGS) -> tuple[float, float]:
    """Bounds of the integral over 0..1 of the absolute value of a polynomial in Bernstein form."""
    if min(coefficients) >= 0 or max(coefficients) <= 0:
        whole = abs(sum(coefficients)) / (len(coefficients) * UNIT * UNIT)
        return whole, whole
    if halvings == 0:
        return 0.0, max(map(abs, coefficients)) / (UNIT * UNIT)
    left, right = _halves(coefficients)
    (low, high), (low_2, high_2) = _integral(left, halvings - 1), _integral(right, halvings - 1)
    return (low + low_2) / 2.0, (high + high_2) / 2.0


def _halves(coefficients: list[int]) -> tuple[list[int], list[int]]:
    """Coefficients over the first and the second half (de Casteljau), exact to one unit."""
    left, right, row = [], [], coefficients
    while row:
        left.append(row[0])
        right.append(row[-1])
        row = [(a + b) >> 1 for a, b in pairwise(row)]
    return left, right[::-1]
