"""Common Q and ellipsoids: single loops, and polytopes whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from printed import A_K, L_D, E

import flighttune as ft
from flighttune.control.theory import lyapunov

SOLVER = 1e-6
EIGENVALUE_ROUNDING = 1e-9

STABLE_APART = np.array([[[-1.0, 8.0], [0.0, -1.0]], [[-1.0, 0.0], [8.0, -1.0]]])
"""Each stable, their mean is not: no common Q."""


def largest_violation(loops, Q):
    return np.linalg.eigvalsh(loops.mT @ Q + Q @ loops + np.eye(len(Q)))[:, -1].max()


def test_the_common_Q_of_one_loop_has_the_rate_of_the_closed_form():
    found = lyapunov.common_Q(A_K[None])

    assert found.status == "optimal"
    assert found.R == pytest.approx(ft.loop.indicators(A_K).R_K, rel=SOLVER)


@pytest.mark.parametrize("faster", [1.0, 20.0, 0.01])
def test_the_common_rate_of_decays_is_that_of_the_slowest(faster):
    """diag(-k): R = 2 k, with Q = I / (2 k) for the smallest k of any vertex and direction."""
    decays = np.array([[1.0, 5.0], [3.0, 0.4], [2.0, 2.0]])

    found = lyapunov.common_Q([-faster * np.diag(each) for each in decays])

    assert (found.status, found.reason) == ("optimal", "")
    assert found.R == pytest.approx(2.0 * 0.4 * faster, rel=SOLVER)
    assert found.R_bound == pytest.approx(2.0 * 0.4 * faster, rel=1e-3)


def test_loops_whose_mean_is_unstable_have_no_common_Q_and_the_bound_says_so():
    found = lyapunov.common_Q(STABLE_APART)

    assert found.status == "none"
    assert found.Q is None
    assert found.R == 0.0
    assert found.R_bound < SOLVER
    assert "no common Q was found" in found.reason


def test_the_rate_is_lowered_by_every_vertex_and_held_by_every_matrix_between():
    spread = np.array([[0.0, 1.0, 0.0, 0.0], *np.zeros((3, 4))])
    loops = np.array([A_K, A_K + 0.2 * spread, A_K - 0.2 * spread.T])
    found = lyapunov.common_Q(loops)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), size=200)

    between = np.einsum("ik,kab->iab", weights, loops)

    assert found.R <= min(ft.loop.indicators(A).R_K for A in loops) * (1.0 + SOLVER)
    assert largest_violation(loops, found.Q) < EIGENVALUE_ROUNDING
    assert largest_violation(between, found.Q) < EIGENVALUE_ROUNDING


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 2**32))
def test_rate_and_bound_enclose_each_other_on_random_polytopes(seed):
    rng = np.random.default_rng(seed)
    centre = rng.normal(size=(3, 3))
    centre -= (np.linalg.eigvals(centre).real.max() + 0.5) * np.eye(3)
    found = lyapunov.common_Q(centre + 0.15 * rng.normal(size=(4, 3, 3)))

    assert found.R <= found.R_bound
    assert found.status in ("optimal", "none")


def test_the_common_ellipsoid_of_one_loop_is_the_closed_form():
    single, _ = lyapunov.common_ellipsoid(A_K[None], E, L_d=L_D)

    assert single.radius == pytest.approx(
        lyapunov.invariant_ellipsoid(A_K, E, L_d=L_D).radius, rel=1e-4
    )


def test_the_common_ellipsoid_is_invariant_at_every_vertex():
    loops = np.array([A_K, 1.1 * A_K, A_K - 0.1 * np.eye(4)])
    found, _ = lyapunov.common_ellipsoid(loops, E, L_d=L_D)
    W, a = found.W, found.multiplier

    flow = loops @ W + W @ loops.mT + a * W + L_D**2 / a * E @ E.T

    assert np.linalg.eigvalsh(flow)[:, -1].max() < 0.0
    assert found.radius == pytest.approx(np.sqrt(np.linalg.eigvalsh(W)[-1]))
    assert found.radius > lyapunov.invariant_ellipsoid(A_K, E, L_d=L_D).radius


def test_loops_without_a_common_ellipsoid_are_a_result_with_a_reason():
    unstable = [-np.eye(2), np.eye(2)]

    none, reason = lyapunov.common_ellipsoid(STABLE_APART, np.eye(2), L_d=1.0)

    assert none is None
    assert reason
    assert lyapunov.common_ellipsoid(unstable, np.eye(2), L_d=1.0) == (
        None,
        "a vertex is not stable",
    )
    assert lyapunov.common_Q(unstable).status == "none"


def test_a_solver_that_lies_is_not_believed(monkeypatch):
    def liar(problem):
        for variable in problem.variables():
            variable.value = np.ones(variable.shape)
        for constraint in problem.constraints:
            constraint.save_dual_value(np.eye(4))
        return ""

    monkeypatch.setattr(lyapunov, "solve", liar)
    found = lyapunov.common_Q(np.array([A_K, A_K]))

    assert found.status != "optimal"
    assert found.R <= ft.loop.indicators(A_K).R_K
    assert lyapunov.common_ellipsoid(A_K[None], E, L_d=1.0)[0] is None


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: lyapunov.common_Q(A_K), "`vertices` must have 3 axes"),
        (lambda: lyapunov.common_ellipsoid(A_K[None], np.eye(2), L_d=1.0), "`E` must have 4 rows"),
        (lambda: lyapunov.common_ellipsoid(A_K[None], E, L_d=0.0), r"`L_d`.*0"),
    ],
    ids=["one matrix", "rows", "disturbance"],
)
def test_vertices_must_be_a_stack_of_matrices(made, words):
    with pytest.raises(ft.InputError, match=words):
        made()
