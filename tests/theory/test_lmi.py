"""Programs whose answer is known on paper, and solvers that fail."""

import cvxpy
import numpy as np
import pytest

from flighttune.theory import lmi
from flighttune.theory.lmi import largest, parameter, solve, unknown

SOLVER_ACCURACY = 1e-7
OFF_DIAGONAL = np.array([[0.0, 1.0], [1.0, 0.0]])


def above_off_diagonal(t):
    """``[[t, 1], [1, t]] >= 0``: t is at least one."""
    return t * np.eye(2) + OFF_DIAGONAL >> 0


def test_the_least_t_that_makes_a_two_by_two_matrix_positive_is_its_off_diagonal():
    t = unknown()
    inequality = above_off_diagonal(t)

    assert not solve(largest(-t, [inequality]))
    assert t.value == pytest.approx(1.0, abs=SOLVER_ACCURACY)
    assert inequality.dual_value == pytest.approx(
        np.array([[0.5, -0.5], [-0.5, 0.5]]), abs=1e3 * SOLVER_ACCURACY
    )


def test_a_problem_with_a_parameter_is_solved_again_for_each_value():
    t, off_diagonal = unknown(), parameter(2, 2, symmetric=True)
    problem = largest(-t, [t * np.eye(2) + off_diagonal >> 0])

    for size in (1.0, 3.0):
        off_diagonal.value = size * OFF_DIAGONAL
        assert not solve(problem)
        assert t.value == pytest.approx(size, abs=10.0 * SOLVER_ACCURACY)


@pytest.mark.parametrize(
    ("sign", "most", "reason"), [(-1.0, 0.0, "infeasible"), (1.0, np.inf, "unbounded")]
)
def test_a_problem_without_a_solution_is_a_reason_and_not_an_error(sign, most, reason):
    t = unknown()
    more = [t <= most] if np.isfinite(most) else []

    assert reason in solve(largest(sign * t, [above_off_diagonal(t), *more]))


def test_a_solver_that_breaks_down_is_a_failure_with_a_reason(monkeypatch):
    def breaks_down(*_, **__):
        raise cvxpy.SolverError

    problem = largest(-unknown(), [])
    monkeypatch.setattr(type(problem), "solve", breaks_down)

    assert "solver_error" in solve(problem)


def test_a_solver_stopped_early_has_no_answer(monkeypatch):
    monkeypatch.setitem(lmi.SOLVER_OPTIONS, "max_iter", 2)
    t = unknown()

    assert solve(largest(-t, [above_off_diagonal(t)]))
