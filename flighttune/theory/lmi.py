"""Small semidefinite programs: the one door to Clarabel.

A linear matrix inequality comes in as plain arrays and a status of ours goes out. Nothing here says
that an answer is right: the modules that pose the problems check every answer by eigenvalues
before they use it.
"""

import importlib.metadata
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import ShapeError

TOLERANCE = 1e-9
"""Gap and feasibility asked of the solver, for problems scaled to order one."""

SOLVER_OPTIONS = {
    "tol_gap_abs": TOLERANCE,
    "tol_gap_rel": TOLERANCE,
    "tol_feas": TOLERANCE,
    # the problems come scaled; scaled once more by the solver they lose some digits
    "equilibrate_enable": False,
}

REASONS = {
    "Solved": "",
    "AlmostSolved": "the solver stopped short of its tolerance",
    "PrimalInfeasible": "the solver found the inequalities infeasible",
    "AlmostPrimalInfeasible": "the solver thinks the inequalities infeasible, but is not sure",
    "DualInfeasible": "the solver found the objective unbounded",
    "AlmostDualInfeasible": "the solver thinks the objective unbounded, but is not sure",
    "MaxIterations": "the solver ran out of iterations",
    "MaxTime": "the solver ran out of time",
    "NumericalError": "the solver failed numerically",
    "InsufficientProgress": "the solver failed numerically",
}

LmiStatus = Literal["optimal", "inaccurate", "infeasible", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cone:
    """One inequality ``constant + sum_i x_i coefficients[i] >= 0``.

    Attributes
    ----------
    constant : ndarray, shape (k, k)
        Symmetric.
    coefficients : ndarray, shape (d, k, k)
        Symmetric, one for each unknown.
    """

    constant: FloatArray
    coefficients: FloatArray

    def __post_init__(self) -> None:
        k = len(self.constant)
        if self.constant.shape != (k, k) or self.coefficients.shape[1:] != (k, k):
            raise ShapeError(
                "`constant` and `coefficients` must have shapes (k, k) and (d, k, k), "
                f"got {self.constant.shape} and {self.coefficients.shape}."
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Inequalities ``constant + coefficients @ x >= 0`` between numbers.

    Attributes
    ----------
    constant : ndarray, shape (r,)
    coefficients : ndarray, shape (r, d)
    """

    constant: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LmiSolution:
    """What the solver said, unchecked.

    Attributes
    ----------
    status : "optimal", "inaccurate", "infeasible" or "failed"
    reason : str
        Why it is not optimal; empty otherwise.
    x : ndarray, shape (d,), or None
        The unknowns, where there is an answer.
    duals : tuple of ndarray
        Multiplier of each matrix inequality, symmetric; empty where there is no answer.
    """

    status: LmiStatus
    reason: str
    x: FloatArray | None
    duals: tuple[FloatArray, ...]


def minimise(
    objective: FloatArray,
    cones: Sequence[Cone],
    rows: Rows | None = None,
) -> LmiSolution:
    """Minimise ``objective @ x`` subject to linear matrix inequalities, and plain ones.

    Parameters
    ----------
    objective : ndarray, shape (d,)
        Scaled, like the cones, so that the answer is of order one.
    cones : sequence of Cone
        Each with d coefficients.
    rows : Rows, optional
        Inequalities between numbers.

    Returns
    -------
    LmiSolution
        Solver failures and infeasibility are statuses with a reason.

    Raises
    ------
    ShapeError
        If a cone or the rows do not have d coefficients.
    """
    import clarabel
    from scipy.sparse import csc_array

    solver: Any = clarabel  # its stubs are empty
    size = len(objective)
    rows = rows or Rows(constant=np.empty(0), coefficients=np.empty((0, size)))
    lengths = [*(len(cone.coefficients) for cone in cones), rows.coefficients.shape[1]]
    if any(length != size for length in lengths):
        raise ShapeError(f"`cones` and `rows` must have {size} coefficients, got {lengths}.")
    # Clarabel's form: the slack b - A x lies in a product of cones, numbers before matrices.
    sides = [_triangle(cone.constant) for cone in cones]
    slopes = [_triangle(cone.coefficients).T for cone in cones]
    A = np.vstack([rows.coefficients, *slopes])
    # Zeros are kept as entries: the order of elimination, and with it the last digits of an answer,
    # then depends on the sizes alone.
    starts = len(A) * np.arange(size + 1)
    product: list[Any] = [solver.PSDTriangleConeT(len(cone.constant)) for cone in cones]
    if len(rows.constant):
        product.insert(0, solver.NonnegativeConeT(len(rows.constant)))
    settings = solver.DefaultSettings()
    settings.verbose = False
    for name, value in SOLVER_OPTIONS.items():
        setattr(settings, name, value)
    found = solver.DefaultSolver(
        csc_array((size, size)),
        objective,
        csc_array((-A.T.ravel(), np.tile(np.arange(len(A)), size), starts), shape=A.shape),
        np.concatenate([rows.constant, *sides]),
        product,
        settings,
    ).solve()
    return _solution(found, cones)


def symmetric_basis(n: int) -> FloatArray:
    """The unit symmetric matrices, shape (n (n + 1)/2, n, n)."""
    rows, columns = np.triu_indices(n)
    basis = np.zeros((len(rows), n, n))
    basis[np.arange(len(rows)), rows, columns] = 1.0
    basis[np.arange(len(rows)), columns, rows] = 1.0
    return basis


def solver_versions() -> dict[str, str]:
    """Version of the solver, for the record."""
    return {"clarabel": importlib.metadata.version("clarabel")}


def _triangle(matrices: FloatArray) -> FloatArray:
    """Upper triangles, column by column, of symmetric matrices, shape (..., k (k + 1)/2).

    What lies off the diagonal comes times sqrt(2): the products of vectors are then those of the
    matrices.
    """
    columns, rows = np.tril_indices(matrices.shape[-1])
    return matrices[..., rows, columns] * np.where(rows == columns, 1.0, math.sqrt(2.0))


def _matrix(triangle: FloatArray, k: int) -> FloatArray:
    """The symmetric matrix, shape (k, k), of its upper triangle."""
    columns, rows = np.tril_indices(k)
    matrix = np.zeros((k, k))
    matrix[rows, columns] = triangle / np.where(rows == columns, 1.0, math.sqrt(2.0))
    matrix[columns, rows] = matrix[rows, columns]
    return matrix


def _solution(found: Any, cones: Sequence[Cone]) -> LmiSolution:
    """What Clarabel's answer says; its multipliers end with those of the matrices."""
    said, x = str(found.status), np.array(found.x)
    reason = REASONS.get(said, f"the solver said {said!r}")
    if said not in ("Solved", "AlmostSolved") or not np.isfinite(x).all():
        infeasible = said == "PrimalInfeasible"
        status = "infeasible" if infeasible else "failed"
        return LmiSolution(status=status, reason=reason, x=None, duals=())
    sizes = [len(cone.constant) for cone in cones]
    ends = np.cumsum([k * (k + 1) // 2 for k in sizes])
    duals = np.split(np.array(found.z)[len(found.z) - ends[-1] :], ends[:-1])
    return LmiSolution(
        status="optimal" if said == "Solved" else "inaccurate",
        reason=reason,
        x=x,
        duals=tuple(_matrix(dual, k) for dual, k in zip(duals, sizes, strict=True)),
    )
