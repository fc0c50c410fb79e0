"""A Q of one closed loop: how problems about it are scaled, and how answers are checked."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, square_matrices
from flighttune.errors import InputError, ShapeError
from flighttune.theory.lmi import LmiSolution
from flighttune.theory.lyapunov import lyapunov_solution

EvpStatus = Literal["optimal", "inaccurate", "unstable", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvpResult:
    """A Q of one closed loop, checked by eigenvalues.

    Attributes
    ----------
    status : "optimal", "inaccurate", "unstable" or "failed"
        Inaccurate: Q holds what it says, but a better one may exist.
    reason : str
        Why it is not optimal; empty otherwise.
    Q : ndarray, shape (n, n), s, or None
        Positive, with ``A_K' Q + Q A_K + I <= 0`` up to rounding.
    R_K : float, 1/s
        ``1 / lambda_max(Q)`` of that Q; 0 without one.
    I_K : float, s^2
        ``lambda_max(Q)^2 / (lambda_min(Q) sigma_min(A_K))`` of that Q; inf without one.
    R_K_bound : float, 1/s
        No Q has a higher rate: from the solver's multiplier, made feasible. inf without one.
    """

    status: EvpStatus
    reason: str
    Q: FloatArray | None
    R_K: float
    I_K: float
    R_K_bound: float = np.inf


@dataclass(frozen=True, slots=True)
class StableLoop:
    """A stable loop with the basis its problems are scaled by.

    Attributes
    ----------
    A_K : ndarray, shape (n, n), 1/s
    L : ndarray, shape (n, n)
        Cholesky factor of the Lyapunov equation's solution.
    top : float, s
        lambda_max of that solution.
    basis : ndarray, shape (d, n, n), s
        The matrices ``L S L'`` for the unit symmetric matrices S.
    derivative : ndarray, shape (d, n, n), 1
        ``A_K' Q + Q A_K`` for each Q of the basis.
    """

    A_K: FloatArray
    L: FloatArray
    top: float
    basis: FloatArray
    derivative: FloatArray

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A_K)

    @classmethod
    def of(cls, A_K: npt.ArrayLike) -> "StableLoop | EvpResult":
        """The loop of a matrix, or the result that says why it is not stable.

        Raises
        ------
        ShapeError, InputError
            If `A_K` is not square or not finite.
        """
        A_K = square_matrices("A_K", A_K)
        if A_K.ndim != 2:
            raise ShapeError(f"`A_K` must have 2 axes, got shape {A_K.shape}.")
        eigenvalues = np.linalg.eigvals(A_K)
        rightmost = eigenvalues[eigenvalues.real.argmax()]
        if rightmost.real >= 0.0:
            return without_Q("unstable", f"The eigenvalue {rightmost:.6g} 1/s is not stable.")
        try:
            Q0 = lyapunov_solution(A_K)
            L = np.asarray(np.linalg.cholesky(Q0), dtype=float)
        except (InputError, np.linalg.LinAlgError):
            return without_Q(
                "unstable", f"The eigenvalue {rightmost:.6g} 1/s is stable only within rounding."
            )
        basis = L @ symmetric_basis(len(A_K)) @ L.T
        return cls(A_K, L, float(np.linalg.eigvalsh(Q0)[-1]), basis, A_K.T @ basis + basis @ A_K)


def symmetric_basis(n: int) -> FloatArray:
    """The unit symmetric matrices, shape (n (n + 1)/2, n, n)."""
    rows, columns = np.triu_indices(n)
    basis = np.zeros((len(rows), n, n))
    basis[np.arange(len(rows)), rows, columns] = 1.0
    basis[np.arange(len(rows)), columns, rows] = 1.0
    return basis


def scaled_to_inequality(Q: FloatArray, vertices: FloatArray) -> FloatArray | None:
    """The multiple of Q that just satisfies ``A' Q + Q A + I <= 0`` for every matrix, or None.

    Parameters
    ----------
    Q : ndarray, shape (n, n)
        Symmetric.
    vertices : ndarray, shape (k, n, n)
        The matrices A.
    """
    derivative = vertices.mT @ Q + Q @ vertices
    if not np.linalg.eigvalsh(Q)[0] > 0.0:
        return None
    slack = -np.linalg.eigvalsh(derivative)[:, -1].max()
    return Q / slack if slack > 0.0 else None


def checked_Q(loop: StableLoop, solution: LmiSolution) -> FloatArray | None:
    """The solver's Q scaled to its inequality, or None where it has none."""
    if solution.x is None:
        return None
    Q = np.tensordot(solution.x[: len(loop.basis)], loop.basis, axes=1)
    return scaled_to_inequality((Q + Q.T) / 2.0, loop.A_K[None])


def radius_indicator(loop: StableLoop, Q: FloatArray) -> float:
    """I_K of a Q: ``lambda_max(Q)^2 / (lambda_min(Q) sigma_min(A_K))``, s^2."""
    values = np.linalg.eigvalsh(Q)
    sigma_min = np.linalg.svd(loop.A_K, compute_uv=False)[-1]
    return float(values[-1] ** 2 / (values[0] * sigma_min))


def with_more_unknowns(coefficients: FloatArray, extra: int) -> FloatArray:
    """Coefficients of a cone, shape (d, k, k), with zeros for `extra` unknowns behind."""
    return np.concatenate([coefficients, np.zeros((extra, *coefficients.shape[1:]))])


def without_Q(status: EvpStatus, reason: str) -> EvpResult:
    """The result where there is no Q."""
    return EvpResult(status=status, reason=reason, Q=None, R_K=0.0, I_K=np.inf)
