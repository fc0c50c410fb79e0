"""The paper's indicators of a closed loop, R_K and I_K, and the exact largest error E_K.

The paper (arXiv 2411.13140, section 4.3) asks a semidefinite program for R_K: the smallest
lambda_max(Q) with ``A_K' Q + Q A_K + I <= 0``. No solver is needed. Every feasible Q is bounded
below, in the order of symmetric matrices, by the solution Q0 of the equation, so that ``R_K = 1 /
lambda_max(Q0)``. The minimiser need not be unique: it is for K*, and whenever the top eigenvector
of Q0 excites every mode, but not for decoupled loops. I_K depends on the choice of minimiser; the
paper's Table 2 and this module use Q0, the smallest.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray, read_only_vector, square_matrices
from flighttune.base.errors import InputError
from flighttune.control.theory import lyapunov, reachable

# Loops whose intermediate results are held in memory at once.
CHUNK_LOOPS = 8192


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Indicators(Answering):
    """Indicators of one closed loop, from its Lyapunov equation.

    Attributes
    ----------
    status : "stable" or "unstable"
    reason : str
        Why there is no guarantee, naming the offending eigenvalue; empty for a stable loop.
    R_K : float, 1/s
        Guaranteed rate of decay of ``z' Q z``; the norm decays at half of it. 0 if unstable.
    I_K : float, s^2
        Radius of the paper's ultimate ball per ``2 L_d L_f``; inf if unstable.
    E_K : float, s^2
        Largest ``|e_i|`` that a disturbance with ``||d'|| <= L_d`` can cause, per L_d, exactly; inf
        if unstable, nan if the number of errors is not known.
    spectral_abscissa : float, 1/s
        Largest real part of an eigenvalue.
    eigenvalues : ndarray of complex, shape (n,), 1/s
        Rightmost first.
    Q : ndarray, shape (n, n), s, or None
        Solution of ``A_z' Q + Q A_z + I = 0`` in the scaled state z; None if unstable.
    scaling : ndarray, shape (n,)
        Unit of each state: ``z = s / scaling``. All ones in the paper.

    Examples
    --------
    >>> loop = ft.loop.indicators([[-1.0, 0.0], [0.0, -2.0]])
    >>> loop.status, float(loop.R_K), float(loop.I_K)
    ('stable', 2.0, 1.0)
    """

    status: Literal["stable", "unstable"]
    reason: str
    R_K: float
    I_K: float
    E_K: float
    spectral_abscissa: float
    eigenvalues: npt.NDArray[np.complex128]
    Q: FloatArray | None
    scaling: FloatArray


class IndicatorArrays(NamedTuple):
    """Indicators of many loops, as in `Indicators`: every array has the shape (...) of the stack.

    R_K is 0 and I_K infinite for a loop that is not stable.
    """

    stable: npt.NDArray[np.bool_]
    R_K: FloatArray
    I_K: FloatArray
    spectral_abscissa: FloatArray


def indicators(
    A_K: npt.ArrayLike, *, scaling: npt.ArrayLike | None = None, errors: int | None = None
) -> Indicators:
    """R_K, I_K and E_K of one closed loop.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s
        Closed loop in velocity form, as `closed_loop` makes it.
    scaling : array_like, shape (n,), optional
        Units of the states, positive: ``z = s / scaling``. By default all ones, as in the paper.
    errors : int, optional
        Number of errors, the last states of `A_K`. By default half of the states if the lower right
        quarter of `A_K` is zero, as in the paper; otherwise E_K needs this number.

    Returns
    -------
    Indicators
        With status "unstable" without a guarantee, which is a result and not an error.

    Raises
    ------
    ShapeError
        If `A_K` is not square or `scaling` does not fit it.
    InputError
        If an entry is not finite or a scale is not positive.

    Notes
    -----
    Eqs. (R_K) and (I_K) of arXiv 2411.13140, section 4.3: ``R_K = 1 / lambda_max(Q)`` and
    ``I_K = cond(Q) / (R_K sigma_min(A_z))`` with ``A_z = diag(1 / scaling) A_K diag(scaling)``.
    Both depend on the unit of time and on `scaling`. Without scaling R_K stays below 1 for any
    gains if C = I, because the lower block of A_K is then the identity. E_K is an integral of the
    impulse response, exact to 1e-9, and does not depend on `scaling`: S. Boyd and C. Barratt,
    *Linear Controller Design*, section 5.2.4.

    Examples
    --------
    >>> model = ft.loop.kinematic_model(V_a=25.0, gamma=0.26, g=9.81)
    >>> loop = ft.loop.indicators(ft.loop.closed_loop(model, ft.PAPER_GAINS))
    >>> round(loop.R_K, 3), round(loop.E_K, 3)
    (0.46, 1.671)
    """
    A_K = square_matrices("A_K", A_K, 2)
    scale = state_scaling(scaling, len(A_K))
    figures = indicators_batch(A_K, scaling=scale)
    eigenvalues = np.asarray(np.linalg.eigvals(A_K), dtype=complex)
    eigenvalues = eigenvalues[np.lexsort((-np.imag(eigenvalues), -np.real(eigenvalues)))]
    stable, reason, E_K = bool(figures.stable), "", math.inf
    if stable:
        half = len(A_K) // 2
        has_errors = errors is not None or not (len(A_K) % 2 or A_K[half:, half:].any())
        count = half if errors is None else errors
        E_K = float(reachable.largest_errors(A_K, errors=count).max()) if has_errors else math.nan
    elif eigenvalues[0].real >= 0.0:
        reason = f"The eigenvalue {eigenvalues[0]:.4g} 1/s is not in the open left half plane."
    else:
        reason = (
            f"The eigenvalue {eigenvalues[0]:.6g} 1/s is so close to the imaginary axis that the "
            "Lyapunov equation has no positive solution in floating point."
        )
    return Indicators(
        status="stable" if stable else "unstable",
        reason=reason,
        R_K=float(figures.R_K),
        I_K=float(figures.I_K),
        E_K=E_K,
        spectral_abscissa=float(figures.spectral_abscissa),
        eigenvalues=eigenvalues,
        Q=lyapunov.lyapunov_solution(scaled(A_K, scale)) if stable else None,
        scaling=scale,
    )


def indicators_batch(
    A_K: npt.ArrayLike, *, scaling: npt.ArrayLike | None = None
) -> IndicatorArrays:
    """R_K, I_K and spectral abscissa of a stack of closed loops.

    Parameters
    ----------
    A_K : array_like, shape (..., n, n), 1/s
        Closed loops in velocity form, as `closed_loop` makes one.
    scaling : array_like, shape (n,), optional
        Units of the states, as in `indicators`.

    Returns
    -------
    IndicatorArrays
        R_K 0 and I_K inf for a loop that is not stable.

    Raises
    ------
    ShapeError, InputError
        As `indicators`.

    Examples
    --------
    >>> ft.loop.indicators_batch([[[-1.0]], [[-3.0]], [[1.0]]]).R_K.tolist()
    [2.0, 6.0, 0.0]
    """
    A_K = square_matrices("A_K", A_K)
    n = A_K.shape[-1]
    scale = state_scaling(scaling, n)
    flat = A_K.reshape(-1, n, n)
    R_K, I_K = np.zeros(len(flat)), np.full(len(flat), np.inf)
    abscissa = np.empty(len(flat))
    for start in range(0, len(flat), CHUNK_LOOPS):
        part = slice(start, start + CHUNK_LOOPS)
        abscissa[part] = np.real(np.linalg.eigvals(flat[part])).max(axis=-1)
        # The Lyapunov equation of an unstable loop also has a solution, but it is not a norm.
        left_half = start + np.flatnonzero(abscissa[part] < 0.0)
        R_K[left_half], I_K[left_half] = _rate_and_radius(scaled(flat[left_half], scale))
    shape = A_K.shape[:-2]
    return IndicatorArrays(
        stable=(R_K > 0.0).reshape(shape),
        R_K=R_K.reshape(shape),
        I_K=I_K.reshape(shape),
        spectral_abscissa=abscissa.reshape(shape),
    )


def state_scaling(scaling: npt.ArrayLike | None, n: int) -> FloatArray:
    """The scaling of n states, positive, as a checked read-only vector; all ones for None."""
    scale = read_only_vector("scaling", np.ones(n) if scaling is None else scaling, (n,))
    if not (scale > 0.0).all():
        raise InputError(f"`scaling` must be positive, got {scale.tolist()}.")
    return scale


def scaled(A: FloatArray, scaling: FloatArray) -> FloatArray:
    """``diag(1 / scaling) A diag(scaling)``: A in the scaled state, shape (..., n, n)."""
    return A * (scaling / scaling[:, None])


def _solutions(A: FloatArray) -> FloatArray:
    """Solutions of the Lyapunov equation of many loops; 0 for a loop that has no single one."""
    try:
        return lyapunov.lyapunov_solution(A)
    except InputError:  # within rounding two eigenvalues of a loop add up to zero
        if len(A) == 1:
            return np.zeros_like(A)
        return np.concatenate([_solutions(loop[None]) for loop in A])


def _rate_and_radius(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R_K and I_K of loops with eigenvalues in the left half plane, shape (N, n, n)."""
    if not len(A):
        return np.empty(0), np.empty(0)
    spectrum = np.linalg.eigvalsh(_solutions(A))
    smallest, largest = spectrum[:, 0], spectrum[:, -1]
    sigma_min = np.linalg.svd(A, compute_uv=False)[:, -1]
    # A Q that is not positive refutes the eigenvalues: the loop is unstable within rounding.
    proven = (smallest > 0.0) & (sigma_min > 0.0) & np.isfinite(largest)
    R_K, I_K = np.zeros(len(A)), np.full(len(A), np.inf)
    R_K[proven] = 1.0 / largest[proven]
    I_K[proven] = largest[proven] ** 2 / (smallest[proven] * sigma_min[proven])
    return R_K, I_K
