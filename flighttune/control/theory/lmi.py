"""Linear matrix inequalities, written as in print: the only module that uses cvxpy and Clarabel.

A module poses its problem with `unknown`, `parameter` and the operators of cvxpy, such as
``A.T @ Q + Q @ A << 0``, and this module solves it. A problem with parameters is compiled once and
solved for many values. No answer is trusted: the modules that pose the problems check every answer
by eigenvalues before they use it.
"""

import math
import warnings
from collections.abc import Sequence
from typing import Any

TOLERANCE = 1e-9  # gap and feasibility tolerance of the solver, for problems scaled to order one

SOLVER_OPTIONS = {"tol_gap_abs": TOLERANCE, "tol_gap_rel": TOLERANCE, "tol_feas": TOLERANCE}

# Statuses of cvxpy for which the unknowns have values.
SOLVED = "optimal", "optimal_inaccurate"

# cvxpy's objects are `Any` here, because no type checker follows its operators.


def unknown(*shape: int, symmetric: bool = False) -> Any:
    """An unknown number, vector or matrix."""
    import cvxpy

    return cvxpy.Variable(shape, symmetric=symmetric)


def parameter(*shape: int, symmetric: bool = False) -> Any:
    """A number, vector or matrix whose ``value`` is set before the problem is solved."""
    import cvxpy

    return cvxpy.Parameter(shape, symmetric=symmetric)


def blocks(rows: Sequence[Sequence[Any]]) -> Any:
    """A matrix of blocks, row by row."""
    import cvxpy

    return cvxpy.bmat([list(row) for row in rows])


def combination(weights: Any, matrices: Any) -> Any:
    """``sum_i weights[i] matrices[i]``: unknown weights, and matrices of shape (d, n * n)."""
    import cvxpy

    # A parameter has at most two axes, so the matrices are flattened.
    n = math.isqrt(matrices.shape[1])
    return cvxpy.reshape(matrices.T @ weights, (n, n), order="C")


def largest(objective: Any, constraints: Sequence[Any]) -> Any:
    """The problem of maximising an objective under constraints."""
    import cvxpy

    return cvxpy.Problem(cvxpy.Maximize(objective), list(constraints))


def solve(problem: Any, *, equilibrate: bool = False) -> str:
    """Solve a problem of `largest`; why its unknowns have no values, or an empty text."""
    import cvxpy

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        try:
            # The problems are scaled already; a second scaling by the solver would lose digits.
            problem.solve(solver="CLARABEL", equilibrate_enable=equilibrate, **SOLVER_OPTIONS)
            status = problem.status
        except cvxpy.SolverError:
            status = "solver_error"
    return "" if status in SOLVED else f"the solver said {status!r}"
