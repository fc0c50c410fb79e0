r"""Peak gains of a linear loop, enclosed: the largest output for any bounded input.

For ``s' = A s + b n`` and ``y = c s`` with ``|n| <= N`` at all times, ``|y| <= N ||h||_1`` where
``||h||_1`` is the integral of ``|c exp(A t) b|`` over t, and no smaller factor holds for every such
n (Dahleh and Pearson, IEEE Trans. Automatic Control 32 (1987) 314-322). Between two steps the
impulse response is a Taylor polynomial in integers. Its Bernstein coefficients tell its sign, and
its integral is exact where the sign stays; where the sign changes, the step is halved. What the
polynomials leave out is bounded by the norm ``sqrt(s' Q s)``, which a proven rate makes fall.
"""

import math
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.theory.exact import Rationals, exact, integers, positive_definite

# Bits behind the point of the states and coefficients.
BITS = 160
UNIT = 1 << BITS

# Degree of the polynomial of a step, and terms of the series of the step's map.
DEGREE, TERMS = 20, 90

# Halvings of a step in which the response changes its sign.
HALVINGS = 12

# The response is followed until what is left of it is at most this part of what was seen.
LEFT = 1e-6

# Steps after which a loop counts as too slow to be followed.
MAX_STEPS = 60_000

# Steps between two looks at what is left.
LOOK = 64

# Factors on a computed bound of a row, smallest first, until it is proven.
WIDENINGS = (1.0 + 1e-6, 1.0 + 1e-3, 1.1, 10.0)

# Relative widening of the bounds, whose own rounding is below a thousandth of it.
OUTWARD = 1e-9


class PeakGains(NamedTuple):
    """Bounds of the peak gains, shape (rows, columns); the truth lies between them."""

    lower: FloatArray
    upper: FloatArray


class _Step(NamedTuple):
    """What a step needs, in units of 2^-BITS: its map and the rows of the coefficients."""

    dt: float
    forward: Rationals  # (n, n): exp(A dt)
    coefficients: Rationals  # (p, DEGREE + 1, n): Bernstein coefficients of c exp(A dt x), x 0..1
    map_error: float  # largest error of an entry of `forward`
    left_out: FloatArray  # (p,): what the polynomial leaves out, for a state of norm 1


def peak_gains(
    loop: Rationals, entry: Rationals, rows: Rationals, Q: FloatArray, *, rate: float
) -> PeakGains:
    """Enclose the peak gains from each column of `entry` to each row of `rows`.

    `loop` (n, n) is A, of which ``A' Q + Q A + I <= 0`` and ``rate Q <= I`` have been proven, rate
    in 1/s; `entry` has shape (n, q) and `rows` (p, n). InputError if the loop is too slow.
    """
    n, q = entry.shape
    row_sizes = _row_sizes(rows, Q)
    step = _step(loop, rows, Q)
    states = _rounded(entry)
    # Every norm is at most the one of the start, as the norm falls.
    form, form_unit = integers(exact(Q))
    start = _norms(states, form, form_unit)
    rounding = math.sqrt(n / rate)  # norm of a vector whose entries are 1 in size, at most
    seen = np.zeros((2, len(rows), q))  # lower and upper
    astray = np.full(q, rounding / UNIT)  # norm of the error of `states`
    for k in range(MAX_STEPS):
        if k % LOOK == 0:
            sizes = _norms(states, form, form_unit) + astray
            tail = np.outer(row_sizes, sizes) * 2.0 / rate * (1.0 + OUTWARD)
            if (tail <= LEFT * seen[0].max()).all():
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
    """The step of a loop: its fastest mode turns by at most one in it."""
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
        raise InputError("the loop must not have entries far above its rates to have peak gains.")
    # The terms fall by more than half each beyond the last.
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
    """A proven bound of each row over the states of norm 1: ``c' c <= size^2 Q``."""
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
            raise InputError("`Q` is too thin to bound the outputs of the loop.")
    return np.array(sizes)


def _norms(states: Rationals, form: Rationals, form_unit: int) -> FloatArray:
    """The norm of each column."""
    squares = (states * (form @ states)).sum(axis=0)
    scale = form_unit * UNIT * UNIT
    return np.array([math.sqrt(Fraction(x, scale)) for x in squares]) * (1.0 + OUTWARD)


def _rounded(values: Rationals) -> Rationals:
    """Rationals in units of 2^-BITS."""
    return np.vectorize(lambda x: round(x * UNIT), otypes=[object])(values)


def _shifted(products: Rationals) -> Rationals:
    """Products of two numbers in units of 2^-BITS, in these units again."""
    return products >> BITS


def _integral(coefficients: list[int], halvings: int = HALVINGS) -> tuple[float, float]:
    """Bounds of the integral over 0..1 of the size of a polynomial in Bernstein's form."""
    if min(coefficients) >= 0 or max(coefficients) <= 0:
        whole = abs(sum(coefficients)) / (len(coefficients) * UNIT * UNIT)
        return whole, whole
    if halvings == 0:
        return 0.0, max(map(abs, coefficients)) / (UNIT * UNIT)
    left, right = _halves(coefficients)
    (low, high), (low_2, high_2) = _integral(left, halvings - 1), _integral(right, halvings - 1)
    return (low + low_2) / 2.0, (high + high_2) / 2.0


def _halves(coefficients: list[int]) -> tuple[list[int], list[int]]:
    """The coefficients over the first and the second half (de Casteljau), to a unit each."""
    left, right, row = [], [], coefficients
    while row:
        left.append(row[0])
        right.append(row[-1])
        row = [(a + b) >> 1 for a, b in pairwise(row)]
    return left, right[::-1]
