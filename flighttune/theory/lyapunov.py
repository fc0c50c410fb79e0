"""The Lyapunov equation of one closed loop, or of a million at once."""

from functools import cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, square_matrices
from flighttune.errors import InputError, ShapeError

Indices: TypeAlias = npt.NDArray[np.intp]

# Up to here one linear system in the n (n + 1)/2 entries beats a Schur form per matrix.
KRONECKER_STATES = 10

# Memory for the linear systems solved at once: about what a core's cache holds.
CHUNK_BYTES = 1 << 22


def lyapunov_solution(A: npt.ArrayLike, S: npt.ArrayLike | None = None) -> FloatArray:
    """Q of ``A' Q + Q A + S = 0``, for one stable matrix or a stack of them, symmetric to the bit.

    `A` has shape (..., n, n), 1/s; `S`, symmetric and by default the identity, broadcasts against
    it. Q is the integral of ``exp(A't) S exp(At)``. The dual equation ``A X + X A' + S = 0`` is
    that of the transposed matrices. Raises ShapeError or InputError if the matrices do not fit, `S`
    is not symmetric, or two eigenvalues of a matrix add up to zero: there is no unique solution.

    Notes
    -----
    Up to `KRONECKER_STATES` states: one linear system in the upper triangle of Q for each matrix.
    Above: the Schur form of Bartels and Stewart, by SciPy. The relative error is about 1e-16 times
    the ratio of the fastest rate to the distance from instability.
    """
    A = square_matrices("A", A)
    S = np.broadcast_to(np.eye(A.shape[-1]), A.shape) if S is None else square_matrices("S", S)
    if S.shape[-1] != A.shape[-1]:
        raise ShapeError(f"`S` must have shape (..., {A.shape[-1]}, ...), got {S.shape}.")
    if not np.array_equal(S, S.mT):
        raise InputError("`S` must be symmetric.")
    try:
        A, S = np.broadcast_arrays(A, S)
    except ValueError as error:
        raise ShapeError(f"`S` must broadcast against {A.shape}, got {S.shape}.") from error
    try:
        return solution_of_checked(A, S)
    except np.linalg.LinAlgError as error:
        raise InputError("`A` must have no two eigenvalues that add up to zero.") from error


def solution_of_checked(A: FloatArray, S: FloatArray) -> FloatArray:
    """`lyapunov_solution` of finite arrays of one shape (..., n, n), S symmetric, not checked.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is no unique solution.
    """
    n = A.shape[-1]
    solve = _kronecker if n <= KRONECKER_STATES else _bartels_stewart
    chunk = max(1, 4 * CHUNK_BYTES // (8 * n * n * (n + 1) ** 2))
    flat_A, flat_S = A.reshape(-1, n, n), S.reshape(-1, n, n)
    Q = np.empty(flat_A.shape)
    for start in range(0, len(Q), chunk):
        part = slice(start, start + chunk)
        Q[part] = solve(flat_A[part], flat_S[part])
    return Q.reshape(A.shape)


def _kronecker(A: FloatArray, S: FloatArray) -> FloatArray:
    rows, columns, sources = _upper_triangle(A.shape[-1])
    entries = np.concatenate([A.reshape(len(A), -1), np.zeros((len(A), 1))], axis=1)
    system = entries.take(sources[0], axis=1) + entries.take(sources[1], axis=1)
    solved = np.linalg.solve(system, -S[:, rows, columns, None])[..., 0]
    Q = np.empty(A.shape)
    Q[:, rows, columns] = solved
    Q[:, columns, rows] = solved
    return Q


@cache
def _upper_triangle(n: int) -> tuple[Indices, Indices, Indices]:
    """Rows and columns of the entries of Q solved for, and where the system's entries come from.

    Each entry of the system is the sum of at most two entries of A: sources has shape
    (2, n (n + 1)/2, n (n + 1)/2), into the entries of A row by row and a zero after them.
    """
    rows, columns = np.triu_indices(n)
    size, zero = len(rows), n * n
    position = np.empty((n, n), dtype=int)
    position[rows, columns] = position[columns, rows] = np.arange(size)
    terms: list[list[list[int]]] = [[[] for _ in range(size)] for _ in range(size)]
    for equation, (i, j) in enumerate(zip(rows, columns, strict=True)):
        for k in range(n):
            terms[equation][position[k, j]].append(k * n + i)
            terms[equation][position[i, k]].append(k * n + j)
    padded = [[(*term, zero, zero)[:2] for term in row] for row in terms]
    return rows, columns, np.moveaxis(np.array(padded), -1, 0)


def _bartels_stewart(A: FloatArray, S: FloatArray) -> FloatArray:
    from scipy.linalg import solve_continuous_lyapunov

    Q = np.array([solve_continuous_lyapunov(a.T, -s) for a, s in zip(A, S, strict=True)])
    return (Q + Q.mT) / 2.0
