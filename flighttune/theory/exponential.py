"""The matrix exponential by NumPy: `scipy.linalg` takes longer to import than commands to work."""

import math

import numpy as np

from flighttune.arrays import FloatArray

SCALED = 0.5
"""Largest norm of the scaled matrix."""

TERMS = 14
"""Of the Taylor series there: the first one left out is below 1e-16."""


def exponential(A: FloatArray) -> FloatArray:
    """``exp(A)`` of one small matrix, or of a stack of them.

    Parameters
    ----------
    A : ndarray, shape (..., n, n), 1
        Finite.

    Returns
    -------
    ndarray, shape (..., n, n), 1

    Notes
    -----
    Scaling and squaring; C. Moler and C. Van Loan, *Nineteen dubious ways to compute the
    exponential of a matrix*, SIAM Review 45(1), 2003, method 3.
    """
    norm = float(np.abs(A).sum(axis=-2).max())
    squarings = max(0, math.ceil(math.log2(norm / SCALED))) if norm else 0
    X = A / 2.0**squarings
    term = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    total = term
    for k in range(1, TERMS + 1):
        term = term @ X / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
