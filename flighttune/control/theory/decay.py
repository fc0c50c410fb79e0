"""The exact decay of a linear loop: the largest rate that a quadratic norm proves, and its price.

R_K of the paper is the rate of one quadratic form, the solution of ``A' Q + Q A + I = 0``, and
behind a lag it is a fraction of the true rate. For every rate a below the true rate some norm
``sqrt(s' Q s)`` decays at a: ``A' Q + Q A + 2 a Q < 0`` has positive solutions (Lyapunov's theorem
for A + a I). The program takes the solution with the smallest condition number, because ``growth``,
the factor by which an error may grow before it decays, is its square root. The solution of the
Lyapunov equation is no substitute: at 0.999 of the true rate of `tuned_identified` its growth is
3694, against 9 by the program.
"""

import itertools
import math
import warnings
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, check_positive, square_matrices
from flighttune.base.errors import InputError
from flighttune.control.theory.exact import (
    Check,
    Rationals,
    exact,
    integers,
    margin_check,
    matrix_check,
)
from flighttune.control.theory.lmi import largest, solve, unknown
from flighttune.control.theory.lyapunov import lyapunov_solution

# Shares of the true rate that are tried, largest first: at the true rate itself a norm need not
# exist, and just below it Q may be too thin for its inequality to survive rounding.
SHARES = (0.999, 0.998, 0.995, 0.99, 0.98, 0.95, 0.9, 0.7, 0.5)

# Factors on the inequality in turn, until the solver has an answer.
STRETCHES = (1.0, 0.1, 10.0)

# Down to this share, programs are tried before any Lyapunov equation.
ROUND_ENOUGH = 0.99

# Q is sought at a rate that is faster by this share of the distance to the true rate. The
# inequality then holds strictly, with room for the solver's error and for rounding.
AHEAD = 0.5


def decay(loop: npt.ArrayLike, *, dt: float | None = None) -> tuple[float, FloatArray] | None:
    """The largest proven rate of ``s' = A s``, or with `dt` (s) of ``s[k+1] = M s[k]``, and its Q.

    ``sqrt(s' Q s)`` falls at least as fast as ``exp(-rate t)``, rate in 1/s, at the samples of a
    sampled loop; the largest eigenvalue of Q is one. The condition number of Q depends on the units
    of s; the rate does not. None for a loop that is not proven to be stable.
    """
    loop = square_matrices("loop", loop, 2)
    check_positive(dt=dt)
    limit = true_rate(loop, dt)
    if not limit > 0.0:
        return None
    matrix = exact(loop)
    # A rounder norm at 0.99 of the rate is more useful than a norm at 0.999 that grows 2000-fold.
    # If the semidefinite program fails, the Lyapunov equation of the loop, shifted by the rate,
    # gives Q. The search takes 0.1 to 0.6 s for 12 to 20 states.
    tries = sorted(
        itertools.product((roundest_norm, _lyapunov), SHARES),
        key=lambda attempt: (attempt[1] < ROUND_ENOUGH, attempt[0] is _lyapunov),
    )
    for search, share in tries:
        Q, rate = search(loop, (share + AHEAD * (1.0 - share)) * limit, dt), share * limit
        if Q is None:
            continue
        if all(check.exact for check in decay_checks(matrix, Q, rate=rate, dt=dt)):
            return rate, Q
    return None


def true_rate(loop: FloatArray, dt: float | None = None) -> float:
    """Slowest rate among the eigenvalues of a loop, 1/s, with the arguments of `decay`."""
    values = np.linalg.eigvals(loop)
    if dt is None:
        return -float(values.real.max())
    # A deadbeat loop has no slowest rate: this rate is above any useful rate.
    return -math.log(max(float(np.abs(values).max()), math.exp(-1.0))) / dt


def _faster(loop: FloatArray, rate: float, dt: float | None) -> FloatArray:
    """The loop whose stability is the decay of `loop` at `rate`."""
    return loop + rate * np.eye(loop.shape[-1]) if dt is None else loop * math.exp(rate * dt)


def _lyapunov(loop: FloatArray, rate: float, dt: float | None) -> FloatArray | None:
    """Q of the Lyapunov equation with right-hand side -I, largest eigenvalue one."""
    from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov

    faster = _faster(loop, rate, dt)
    try:
        # The caller proves the result in rationals, or drops it.
        with warnings.catch_warnings(action="ignore", category=LinAlgWarning):
            if dt is None:
                Q = lyapunov_solution(faster)
            else:
                Q = solve_discrete_lyapunov(faster.T, np.eye(len(loop)))
    except (InputError, np.linalg.LinAlgError):
        return None
    return _of_norm_one(Q)


def roundest_norm(loop: FloatArray, rate: float, dt: float | None = None) -> FloatArray | None:
    """Q of the smallest condition number that proves `rate` for one or several loops, if any."""
    loops = loop.reshape(-1, *loop.shape[-2:])
    faster, identity = _faster(loops, rate, dt), np.eye(loops.shape[-1])
    Q, k = unknown(*identity.shape, symmetric=True), unknown()
    fastest = float(np.linalg.norm(faster, 2, axis=(-2, -1)).max())
    unit = 1.0 if dt is not None else math.sqrt(rate * fastest)
    # A problem that the solver solves in one scaling often fails in another, by rounding.
    for stretch in STRETCHES:
        if dt is None:
            falling = [A.T @ Q + Q @ A << 0 for A in faster / (unit * stretch)]
        else:
            falling = [stretch * (A.T @ Q @ A - Q) << 0 for A in faster]
        if not solve(largest(-k, [*falling, Q >> identity, Q << k * identity]), equilibrate=True):
            return _of_norm_one(Q.value)
    return None


def _of_norm_one(Q: FloatArray) -> FloatArray:
    symmetric = (Q + Q.T) / 2.0
    return symmetric / np.linalg.norm(symmetric, 2)


def decay_checks(
    loop: Rationals, Q: FloatArray, *, rate: float, dt: float | None = None
) -> list[Check]:
    """The inequalities of a rate of decay (1/s) of a loop, A in 1/s or with `dt` (s) its map."""
    form, form_unit = integers(exact(Q))
    matrix, matrix_unit = integers(loop)
    checks = [margin_check("rate > 0", Fraction(rate)), matrix_check("Q > 0", form, form_unit)]
    if dt is None:
        # Both sides are multiplied by the denominators of A and of the rate, so that all numbers
        # are integers.
        whole = Fraction(rate)
        flow = (matrix.T @ form + form @ matrix) * whole.denominator
        flow += form * (2 * whole.numerator * matrix_unit)
        name, unit = "A' Q + Q A + 2 rate Q < 0", form_unit * matrix_unit * whole.denominator
        return [*checks, matrix_check(name, -flow, unit)]
    # ``M' Q M < r^2 Q`` is proven for a rational r that is at most ``exp(-rate dt)``, because
    # ``exp(x) < 1/(1 - x + x^2/2 - ...)`` up to any odd power for x > 0.
    share = exponential_below(Fraction(rate) * Fraction(dt)) ** 2
    left = form * (share.numerator * matrix_unit**2)
    right = (matrix.T @ form @ matrix) * share.denominator
    name, unit = "M' Q M < exp(-2 rate dt) Q", form_unit * matrix_unit**2 * share.denominator
    return [*checks, matrix_check(name, left - right, unit)]


# Terms of the series of exp(-x), an even number: its partial sum is then below exp(-x), by less
# than x^12/12!, which is 1e-19 of a decay by a tenth a sample.
TERMS = 12


def exponential_below(x: Fraction) -> Fraction:
    """A rational number at most exp(-x), for 0 <= x <= 1; 0 above."""
    if x > 1:
        return Fraction(0)
    term = total = Fraction(1)
    for k in range(1, TERMS):
        term *= -x / k
        total += term
    # Rounded down to a binary fraction of 80 bits: the exact sum has thousands.
    return Fraction(math.floor(total * 2**80), 2**80)
