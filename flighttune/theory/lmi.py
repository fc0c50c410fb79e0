"""Small semidefinite programs: the one door to cvxpy and Clarabel.

A linear matrix inequality comes in as plain arrays and a status of ours goes out. Nothing here says
that an answer is right: the modules that pose the problems check every answer by eigenvalues
before they use it.
"""

import importlib.metadata
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
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
    "optimal": "",
    "optimal_inaccurate": "the solver stopped short of its tolerance",
    "infeasible": "the solver found the inequalities infeasible",
    "infeasible_inaccurate": "the solver thinks the inequalities infeasible, but is not sure",
    "unbounded": "the solver found the objective unbounded",
    "unbounded_inaccurate": "the solver thinks the objective unbounded, but is not sure",
    "user_limit": "the solver ran out of iterations or time",
    "solver_error": "the solver failed numerically",
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
    size = len(objective)
    rows = rows or Rows(constant=np.empty(0), coefficients=np.empty((0, size)))
    lengths = [*(len(cone.coefficients) for cone in cones), rows.coefficients.shape[1]]
    if any(length != size for length in lengths):
        raise ShapeError(f"`cones` and `rows` must have {size} coefficients, got {lengths}.")
    shapes = tuple(len(cone.constant) for cone in cones)
    compiled = _compiled(size, shapes, len(rows.constant))
    compiled.objective.value = objective
    if compiled.rows is not None:
        compiled.rows[0].value, compiled.rows[1].value = rows.constant, rows.coefficients
    for parameters, cone in zip(compiled.cones, cones, strict=True):
        constant, coefficients = parameters
        constant.value = cone.constant.ravel()
        coefficients.value = cone.coefficients.reshape(size, -1).T
    return _solution(compiled)


def symmetric_basis(n: int) -> FloatArray:
    """The unit symmetric matrices, shape (n (n + 1)/2, n, n)."""
    rows, columns = np.triu_indices(n)
    basis = np.zeros((len(rows), n, n))
    basis[np.arange(len(rows)), rows, columns] = 1.0
    basis[np.arange(len(rows)), columns, rows] = 1.0
    return basis


def solver_versions() -> dict[str, str]:
    """Versions of the solver and of what drives it, for the record."""
    return {name: importlib.metadata.version(name) for name in ("cvxpy", "clarabel")}


@dataclass(frozen=True, slots=True)
class _Compiled:
    problem: Any
    x: Any
    objective: Any
    cones: tuple[tuple[Any, Any], ...]
    rows: tuple[Any, Any] | None


@cache
def _compiled(unknowns: int, sizes: tuple[int, ...], rows: int) -> _Compiled:
    """The problem of these sizes, compiled once; every number in it is a parameter."""
    import cvxpy as cp

    x = cp.Variable(unknowns)
    objective = cp.Parameter(unknowns)
    parameters, constraints = [], []
    for size in sizes:
        constant = cp.Parameter(size * size)
        coefficients = cp.Parameter((size * size, unknowns))
        matrix = cp.reshape(constant + coefficients @ x, (size, size), order="C")
        constraints.append((matrix + matrix.T) / 2 >> 0)
        parameters.append((constant, coefficients))
    plain = None
    if rows:
        plain = cp.Parameter(rows), cp.Parameter((rows, unknowns))
        constraints.append(plain[0] + plain[1] @ x >= 0)
    problem = cp.Problem(cp.Minimize(objective @ x), constraints)
    return _Compiled(problem, x, objective, tuple(parameters), plain)


def _solution(compiled: _Compiled) -> LmiSolution:
    from cvxpy.error import SolverError

    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            compiled.problem.solve(solver="CLARABEL", **SOLVER_OPTIONS)
    except SolverError:
        return LmiSolution(status="failed", reason=REASONS["solver_error"], x=None, duals=())
    said = compiled.problem.status
    reason = REASONS.get(said, f"the solver said {said!r}")
    if said == "infeasible":
        return LmiSolution(status="infeasible", reason=reason, x=None, duals=())
    x = compiled.x.value
    matrices = compiled.problem.constraints[: len(compiled.cones)]
    duals = [constraint.dual_value for constraint in matrices]
    if said not in ("optimal", "optimal_inaccurate") or x is None or not np.isfinite(x).all():
        return LmiSolution(status="failed", reason=reason, x=None, duals=())
    return LmiSolution(
        status="optimal" if said == "optimal" else "inaccurate",
        reason=reason,
        x=np.array(x),
        duals=tuple(np.atleast_2d((dual + dual.T) / 2.0) for dual in duals),
    )
