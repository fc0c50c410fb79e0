"""Programs whose answer is known on paper, and solvers that fail."""

from types import SimpleNamespace

import clarabel
import numpy as np
import pytest

from flighttune.errors import ShapeError
from flighttune.theory import lmi
from flighttune.theory.lmi import Cone, Rows, minimise, solver_versions

SOLVER_ACCURACY = 1e-7


def t_minus_one_cone():
    """``[[t, 1], [1, t]] >= 0``: t is at least one."""
    return Cone(constant=np.array([[0.0, 1.0], [1.0, 0.0]]), coefficients=np.eye(2)[None])


def test_the_least_t_that_makes_a_two_by_two_matrix_positive_is_its_off_diagonal():
    solution = minimise(np.array([1.0]), [t_minus_one_cone()])

    assert solution.status == "optimal"
    assert solution.x == pytest.approx([1.0], abs=SOLVER_ACCURACY)
    assert solution.duals[0] == pytest.approx(
        np.array([[0.5, -0.5], [-0.5, 0.5]]), abs=1e3 * SOLVER_ACCURACY
    )


def test_rows_hold_beside_the_cones():
    rows = Rows(constant=np.array([-3.0]), coefficients=np.array([[1.0]]))

    solution = minimise(np.array([1.0]), [t_minus_one_cone()], rows)

    assert solution.x == pytest.approx([3.0], abs=SOLVER_ACCURACY)
    assert len(solution.duals) == 1


def test_contradictory_inequalities_are_infeasible_and_not_an_error():
    below_zero = Cone(constant=np.zeros((1, 1)), coefficients=-np.ones((1, 1, 1)))

    solution = minimise(np.array([1.0]), [t_minus_one_cone(), below_zero])

    assert solution.status == "infeasible"
    assert "infeasible" in solution.reason
    assert solution.x is None


def test_an_objective_without_end_is_a_failure_with_a_reason():
    solution = minimise(np.array([-1.0]), [t_minus_one_cone()])

    assert solution.status == "failed"
    assert "unbounded" in solution.reason


def test_a_solver_that_breaks_down_is_a_failure_with_a_reason(monkeypatch):
    answering(monkeypatch, "NumericalError", x=[np.nan])
    solution = minimise(np.array([1.0]), [t_minus_one_cone()])

    assert solution.status == "failed"
    assert "numerically" in solution.reason


def answering(monkeypatch, status, *, x):
    """A solver that always says the same."""
    answer = SimpleNamespace(status=status, x=x, z=[0.0, 0.0, 0.0])
    solver = SimpleNamespace(solve=lambda: answer)
    monkeypatch.setattr(clarabel, "DefaultSolver", lambda *_: solver)


def test_a_solver_stopped_early_is_not_called_optimal(monkeypatch):
    monkeypatch.setitem(lmi.SOLVER_OPTIONS, "max_iter", 2)

    solution = minimise(np.array([1.0]), [t_minus_one_cone()])

    assert solution.status in ("failed", "inaccurate")
    assert solution.reason


@pytest.mark.parametrize("status", sorted(lmi.REASONS))
def test_every_status_of_the_solver_has_one_of_ours(monkeypatch, status):
    answering(monkeypatch, status, x=[1.0])
    ours = {"Solved": "optimal", "AlmostSolved": "inaccurate", "PrimalInfeasible": "infeasible"}

    solution = minimise(np.array([1.0]), [t_minus_one_cone()])

    assert solution.status == ours.get(status, "failed")
    assert (solution.x is None) == (status not in ("Solved", "AlmostSolved"))


def test_the_reasons_are_those_of_every_status_that_the_solver_can_end_with():
    statuses = {name for name in dir(clarabel.SolverStatus) if name[0].isupper()}

    assert lmi.REASONS.keys() == statuses - {"Unsolved", "CallbackTerminated"}


def test_every_cone_must_know_every_unknown():
    with pytest.raises(ShapeError, match=r"must have 2 coefficients, got \[1, 2\]"):
        minimise(np.zeros(2), [t_minus_one_cone()])


def test_the_record_names_the_solver():
    assert set(solver_versions()) == {"clarabel"}
