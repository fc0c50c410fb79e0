"""Exact peak errors of disturbed loops ``s' = A s + E v``, ``||v|| <= 1``, for many loops.

The largest value of ``c s`` that any such v can cause is the integral over all time of the norm of
the impulse response ``c exp(At) E``: the worst v points along it at every instant. The response is
tabulated at nodes of panels that are as wide as the remaining modes allow. Its norm has a kink at
each zero, and the response of a decoupled loop has zeros again and again. Panels are therefore
halved until their highest Legendre coefficients vanish.
"""

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, square_matrices
from flighttune.base.errors import ShapeError
from flighttune.control.theory.lyapunov import solution_of_checked

# Real, or with an imaginary part that is small beyond rounding
Numbers: TypeAlias = Any

# Nodes of a panel, and its width times the fastest remaining eigenvalue: the polynomial through the
# nodes then follows the response to about 1e-12.
NODES, PHASE = 16, 4.0

# Below this phase the width of a panel doubles: half of PHASE, with room for rounding.
WIDER = 0.501 * PHASE

# A panel is halved while one of its two highest Legendre coefficients is above this share of the
# largest panel's integral. The integral of a smooth panel is exact to more than twice their degree.
DOUBT = 5e-11

# The same for slopes, which jump at a kink.
SLOPE_DOUBT = 1e-7

# The table ends when the remaining share is smaller.
TAIL = 1e-10

# A mode smaller than the slowest mode by this logarithm no longer limits the width of panels.
DEAD = math.log(1e-18)

# Terms of the exponential series of a matrix of norm one
TERMS = 20

# Maximum number of panels: a loop that needs more, with a damping ratio below 3e-4, has no result.
MAX_PANELS = 1 << 15

# Loops computed together, and panels of each: initial number, which doubles each time, and maximum.
# More would not fit a processor's cache. Panels, and so the bits, do not depend on the stack.
CHUNK_LOOPS, FIRST_PANELS, LAST_PANELS = 64, 16, 256

# Rows of a block that BLAS multiplies at once
ROWS = 64

# Share of the first state below which the table stops waiting for an output that stays zero
VANISHED = 1e-30

# Imaginary step of the gains, whose square vanishes beside any number of the loop
STEP = 1e-40


def largest_errors(A_K: npt.ArrayLike, *, errors: int) -> FloatArray:
    """Largest ``|e_i|`` that a disturbance with ``||d'|| <= 1`` can cause, s^2, shape (..., p).

    `A_K` (shape (..., n + p, n + p), 1/s) are closed loops in velocity form, ``s = (x', e)``, with
    p `errors`. The result is infinite for a loop that is not stable, or too lightly damped to
    compute. E_K is its maximum.

    Notes
    -----
    The integral of ``||row i of exp(A_K t) E||_2`` from 0 to infinity, to 1e-9 of the largest;
    S. Boyd and C. Barratt, *Linear Controller Design*, section 5.2.4. The disturbance enters the
    rates of the states that C measures, ``E = [I; 0]`` if ``C = I``: lags and delays behind a model
    have no disturbance of their own.
    """
    A_K = square_matrices("A_K", A_K)
    N = A_K.shape[-1]
    if not 0 < errors < N:
        raise ShapeError(f"`A_K` must have more than {errors} states, got shape {A_K.shape}.")
    loops = A_K.reshape(-1, N, N)
    reached = largest_outputs(loops, *_entry_and_errors(loops, errors))
    return reached.reshape(*A_K.shape[:-2], errors)


def error_slopes(
    A_K: FloatArray, in_k: FloatArray, *, errors: int
) -> tuple[FloatArray, FloatArray]:
    """`largest_errors` of one loop and their slopes to about 1e-6, shapes (p,) and (p, f).

    `in_k` (shape (f, n + p, n + p)): slopes of `A_K` in f parameters.
    """
    E, C = _entry_and_errors(A_K[None], errors)
    # The integral is analytic in the parameters except at zeros of the response. A complex step
    # gives the slope as the imaginary part, without a difference.
    reached = largest_outputs(A_K + 1j * STEP * in_k, E, C)
    return reached[0].real, reached.imag.T / STEP


def largest_outputs(A: Numbers, E: FloatArray, C: FloatArray) -> Numbers:
    """Integral of the norm of each row of ``C exp(At) E``, shape (N, p); inf if not stable."""
    reached = np.full((len(A), len(C)), np.inf, dtype=A.dtype)
    for start in range(0, len(A), CHUNK_LOOPS):
        part = A[start : start + CHUNK_LOOPS]
        eigenvalues = np.linalg.eigvals(part.real)
        (stable,) = np.nonzero(eigenvalues.real.max(axis=1) < 0.0)
        spectrum = _lyapunov_spectra(part.real[stable])
        proven = (spectrum[:, 0] > 0.0) & np.isfinite(spectrum[:, -1])
        stable, spectrum = stable[proven], spectrum[proven]
        # V = s'Qs falls at the rate |s|^2 >= |s| sqrt(V / lambda_max(Q))
        per_norm = 2.0 * spectrum[:, -1]
        reached[start + stable] = _integrals(part[stable], eigenvalues[stable], per_norm, E, C)
    return reached


def _lyapunov_spectra(A: FloatArray) -> FloatArray:
    """Spectra of the Lyapunov solutions, shape (N, n); NaN if rounding leaves no solution."""
    try:
        Q = solution_of_checked(A, np.broadcast_to(np.eye(A.shape[-1]), A.shape))
        return np.asarray(np.linalg.eigvalsh(Q), dtype=float)
    except np.linalg.LinAlgError:
        if len(A) == 1:
            return np.full(A.shape[:2], np.nan)
        return np.concatenate([_lyapunov_spectra(A[:1]), _lyapunov_spectra(A[1:])])


def _integrals(
    A: Numbers, eigenvalues: Numbers, per_norm: Numbers, E: FloatArray, C: FloatArray
) -> Numbers:
    """`largest_outputs` of stable loops; `per_norm`: tail of the integral per norm of the state."""
    totals = np.zeros((len(A), len(C)), dtype=A.dtype)
    if not len(A):
        return totals
    width, within, across = _propagators(A, np.abs(eigenvalues).max(axis=1))
    X = np.broadcast_to(E, (len(A), *E.shape)).astype(A.dtype)
    t, largest = np.zeros((2, len(A)))
    used, alive = np.zeros(len(A), dtype=int), np.arange(len(A))
    panels, nothing = FIRST_PANELS, VANISHED * np.linalg.norm(E)
    while len(alive):
        rates = eigenvalues.real - eigenvalues.real.max(axis=1, keepdims=True)
        fastest = np.where(rates * t[:, None] > DEAD, np.abs(eigenvalues), 0.0).max(axis=1)
        wider = np.flatnonzero(width * fastest < WIDER)
        while len(wider):
            width[wider] *= 2.0
            within[wider] = within[wider] @ within[wider]
            across[wider] = across[wider] @ across[wider]
            wider = wider[width[wider] * fastest[wider] < WIDER]
        # States at the starts of the panels, (loops, n, panels m), a power of two of them
        starts, over = X, across
        while starts.shape[-1] < panels * X.shape[-1]:
            starts = np.concatenate([starts, over @ starts], axis=-1)
            over = over @ over
        X = over @ X
        # (loops, nodes, p, n) times (loops, n, panels m)
        values = (C @ within).reshape(len(alive), -1, len(E)) @ starts
        values = values.reshape(len(alive), NODES, len(C), -1, E.shape[1])
        values = values.transpose(4, 0, 2, 3, 1)
        reached, largest = _norm_integrals(values, width, largest)
        totals[alive] += reached
        t, used = t + panels * width, used + panels
        norms = np.linalg.norm(X, axis=(1, 2))
        more = per_norm * norms > TAIL * totals[alive].real.max(axis=1)
        more &= norms > nothing
        totals[alive[more & (used >= MAX_PANELS)]] = np.inf
        more &= used < MAX_PANELS
        alive, X, t, used, width = alive[more], X[more], t[more], used[more], width[more]
        within, across, per_norm = within[more], across[more], per_norm[more]
        eigenvalues, largest = eigenvalues[more], largest[more]
        panels = min(2 * panels, LAST_PANELS)
    return totals


def _propagators(A: Numbers, fastest: FloatArray) -> tuple[FloatArray, Numbers, Numbers]:
    """First widths (N,), exponentials at the nodes of a panel (N, NODES, n, n) and across it."""
    fourth = np.linalg.matrix_power(A, 4)
    sizes = [np.linalg.norm(fourth, 1, axis=(1, 2)) ** (1 / 4)]
    sizes.append(np.linalg.norm(fourth @ A, 1, axis=(1, 2)) ** (1 / 5))
    # close to the fastest eigenvalue, while the norm of A may be far above
    size = np.maximum(np.max(sizes, axis=0), 1e-3 * np.linalg.norm(A, 1, axis=(1, 2)))
    # `fastest`, shape (N,), has the sizes of the largest eigenvalues. Doubling a width squares the
    # exponentials.
    width = PHASE / fastest
    width = np.ldexp(width, -np.maximum(np.ceil(np.log2(size * width)), 0.0).astype(int))
    step, term = A * width[:, None, None], np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    series = [term]
    for k in range(1, TERMS):
        term = term @ step / k
        series.append(term)
    powers = np.stack(series, axis=1).reshape(len(A), TERMS, -1)
    values = (np.vander(np.append(_NODES, 1.0), TERMS, increasing=True) @ powers).reshape(
        -1, NODES + 1, *A.shape[1:]
    )
    return width, values[:, :-1], values[:, -1]


def _norm_integrals(
    values: Numbers, width: FloatArray, largest: FloatArray
) -> tuple[Numbers, FloatArray]:
    """Integrals of the norm of responses over panels, shape (N, p), and the largest of a panel.

    `values` (shape (m, N, p, panels, NODES)) are responses at the nodes, `width` (shape (N,), s)
    the width of a panel, `largest` (shape (N,)) the largest integral of an earlier panel.
    """
    m, N, p, panels, _ = values.shape
    values, width = values.reshape(m, -1, NODES), np.repeat(width, p * panels)
    row, totals = np.repeat(np.arange(N * p), panels), np.zeros(N * p, dtype=values.dtype)
    sums, doubts = _norm_sums(width, values)
    largest = np.maximum(largest, sums.real.reshape(N, -1).max(axis=1))
    steepest = np.abs(sums.imag).reshape(N, -1).max(axis=1)
    allowed: Numbers = np.repeat(DOUBT * largest + 1j * SLOPE_DOUBT * steepest, p * panels)
    while True:
        halved = (np.abs(doubts.real) > allowed.real).any(axis=0)
        if np.iscomplexobj(doubts):
            halved |= (np.abs(doubts.imag) > allowed.imag).any(axis=0)
        np.add.at(totals, row[~halved], sums[~halved])
        if not halved.any():
            return totals.reshape(N, p), largest
        values = _products(np.compress(halved, values, axis=1), _TO_HALVES).reshape(m, -1, NODES)
        row, width = np.repeat(row[halved], 2), np.repeat(width[halved] / 2.0, 2)
        allowed = np.repeat(allowed[halved], 2)
        sums, doubts = _norm_sums(width, values)


def _norm_sums(width: FloatArray, values: Numbers) -> tuple[Numbers, Numbers]:
    """Integrals of the norm of `values` (m, K, NODES) over panels, and its highest coefficients."""
    squares = values[0] * values[0]  # no conjugate, since the square root must stay analytic
    for part in values[1:]:
        squares += part * part
    integral, *coefficients = _products(np.sqrt(squares, out=squares), _RULES).T
    return width * integral, width * np.array(coefficients)


def _products(values: Numbers, matrix: FloatArray) -> Numbers:
    """Values at nodes, shape (..., NODES), times a matrix, with the same bits in any stack."""
    if np.iscomplexobj(values):
        return _products(values.real, matrix) + 1j * _products(values.imag, matrix)
    # BLAS gets blocks of one size, because its rounding depends on the number of rows. A large
    # product would also start threads that wait for each other longer than they work.
    rows = values.reshape(-1, NODES)
    blocks = np.zeros((-(-len(rows) // ROWS), ROWS, NODES))
    blocks.reshape(-1, NODES)[: len(rows)] = rows
    products = (blocks @ matrix).reshape(-1, matrix.shape[1])[: len(rows)]
    return products.reshape(*values.shape[:-1], -1)


def _entry_and_errors(A_K: FloatArray, errors: int) -> tuple[FloatArray, FloatArray]:
    """E and C of `largest_errors`; the loops (shape (N, n + p, n + p)) share the model's C."""
    n = A_K.shape[-1] - errors
    measured = (A_K[:, n:, :n] != 0.0).any(axis=(0, 1))
    return np.eye(n + errors)[:, :n][:, measured], np.eye(n + errors)[n:]


def _lobatto() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes on (0, 1); matrices from values at them to sums (NODES, 3) and halves (NODES, 32)."""
    last = np.polynomial.Legendre.basis(NODES - 1)
    # The ends of a panel are nodes, so that a kink between an end and the next node is seen.
    nodes = np.concatenate([[-1.0], last.deriv().roots().real, [1.0]])  # complex since NumPy 2.5
    weights = 2.0 / (NODES * (NODES - 1) * last(nodes) ** 2)
    basis = np.polynomial.legendre.legvander
    to_coefficients = np.linalg.inv(basis(nodes, NODES - 1))
    # These matrices give the values at the nodes of either half.
    halves = [basis((nodes + end) / 2.0, NODES - 1) @ to_coefficients for end in (-1.0, 1.0)]
    rules = np.transpose([weights / 2.0, *to_coefficients[-2:]])
    return (nodes + 1.0) / 2.0, rules, np.concatenate(halves).T


_NODES, _RULES, _TO_HALVES = _lobatto()
