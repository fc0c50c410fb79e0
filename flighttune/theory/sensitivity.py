"""Exact gradients of the indicators with respect to the closed loop.

With ``A' Q + Q A + I = 0`` and a unit eigenvector v of Q, ``d(lambda) = <2 Q X, dA>`` where
``A X + X A' + v v' = 0``: one more Lyapunov equation an eigenvalue. Two of them give R_K and I_K.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, square_matrices
from flighttune.errors import InputError, ShapeError
from flighttune.theory.indicators import scaled, state_scaling
from flighttune.theory.lyapunov import solution_of_checked


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectra:
    """Eigenvalues of Q and singular values of A_z with their gradients in A_K.

    Attributes
    ----------
    eigenvalues : ndarray, shape (n,), s
        Of the Lyapunov solution Q, ascending.
    eigenvalue_gradients : ndarray, shape (n, n, n), s^2
        ``[k, i, j]`` is the derivative of eigenvalue k with respect to entry (i, j) of A_K.
    singular_values : ndarray, shape (n,), 1/s
        Of the scaled loop A_z, descending.
    singular_value_gradients : ndarray, shape (n, n, n), 1
        In the same layout.
    """

    eigenvalues: FloatArray
    eigenvalue_gradients: FloatArray
    singular_values: FloatArray
    singular_value_gradients: FloatArray


def spectra(A_K: npt.ArrayLike, *, scaling: npt.ArrayLike | None = None) -> Spectra | None:
    """Spectra of a closed loop with gradients, or None where it is not stable.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s
        Closed loop in velocity form.
    scaling : array_like, shape (n,), optional
        Units of the states, as in `flighttune.theory.indicators.indicators`.

    Returns
    -------
    Spectra or None

    Raises
    ------
    ShapeError, InputError
        As `flighttune.theory.indicators.indicators`.

    Notes
    -----
    Where eigenvalues meet, a gradient is that of one member of the cluster in the basis LAPACK
    returns: a generalised gradient of the largest or smallest one, not a derivative.
    """
    A_K = square_matrices("A_K", A_K)
    if A_K.ndim != 2:
        raise ShapeError(f"`A_K` must have 2 axes, got shape {A_K.shape}.")
    scale = state_scaling(scaling, len(A_K))
    found = spectra_of_checked(scaled(A_K, scale))
    if found is None:
        return None
    chain = scale / scale[:, None]
    return replace(
        found,
        eigenvalue_gradients=found.eigenvalue_gradients * chain,
        singular_value_gradients=found.singular_value_gradients * chain,
    )


def spectra_of_checked(A: FloatArray) -> Spectra | None:
    """`spectra` of a finite matrix of shape (n, n), already scaled, not checked."""
    try:
        Q = solution_of_checked(A, np.eye(len(A)))
        eigenvalues, vectors = np.linalg.eigh(Q)
        if not eigenvalues[0] > 0.0:  # Lyapunov's theorem: positive definite if and only if stable
            return None
        outer = vectors.T[:, :, None] * vectors.T[:, None, :]
        X = solution_of_checked(np.broadcast_to(A.T, outer.shape), outer)
    except np.linalg.LinAlgError:
        return None
    left, singular_values, right = np.linalg.svd(A)
    return Spectra(
        eigenvalues=eigenvalues,
        eigenvalue_gradients=2.0 * (Q @ X),
        singular_values=singular_values,
        singular_value_gradients=left.T[:, :, None] * right[:, None, :],
    )


def rate_and_radius_gradients(
    A_K: npt.ArrayLike, *, scaling: npt.ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Gradients of R_K and of I_K with respect to the closed loop.

    Parameters
    ----------
    A_K : array_like, shape (n, n), 1/s
        Stable closed loop in velocity form.
    scaling : array_like, shape (n,), optional
        Units of the states.

    Returns
    -------
    dR_K, dI_K : ndarray, shapes (n, n), 1 and s^3
        Entry (i, j): derivative with respect to entry (i, j) of `A_K`.

    Raises
    ------
    ShapeError
        As `spectra`.
    InputError
        Also if the loop is not stable: there is nothing to differentiate.
    """
    found = spectra(A_K, scaling=scaling)
    if found is None:
        raise InputError("`A_K` must be stable.")
    smallest, largest = found.eigenvalues[[0, -1]]
    d_smallest, d_largest = found.eigenvalue_gradients[[0, -1]]
    sigma, d_sigma = found.singular_values[-1], found.singular_value_gradients[-1]
    I_K = largest**2 / (smallest * sigma)
    d_log_I_K = 2.0 * d_largest / largest - d_smallest / smallest - d_sigma / sigma
    return -d_largest / largest**2, I_K * d_log_I_K
