"""The gradient method: optima known from elsewhere, and those of differential evolution."""

from dataclasses import replace

import numpy as np
import pytest
from printed import lagged

import flighttune as ft
from tests.control.tuning.conftest import DECOUPLED, relaxed

FIFTH_DIGIT = 1e-5
THIRD_DIGIT = 1e-3
HALF_LAST_DIGIT = 5e-5
FLAT = 0.04  # the rate changes by 1e-4 over this much gain


@pytest.mark.slow
def test_the_optimum_for_an_i_star_of_5_is_found_from_every_start(model):
    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=5.0))

    assert found.status == "optimal"
    assert found.R_K == pytest.approx(0.53976, abs=FIFTH_DIGIT)
    assert found.I_K <= 5.0
    assert found.active == ("I_K",)
    assert found.agreeing == found.starts
    assert found.gains.K == pytest.approx(
        np.array([[2.2209, 0.0, 3.8753, 0.0], [0.0, 2.4797, 0.0, 3.8753]]), abs=THIRD_DIGIT
    )


def test_the_optimum_for_the_printed_i_k_beats_the_papers(model):
    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=4.9244))

    assert found.R_K == pytest.approx(0.51393, abs=FIFTH_DIGIT)
    assert found.R_K > 1.1 * ft.loop.indicators(ft.loop.closed_loop(model, ft.PAPER_GAINS)).R_K


@pytest.mark.soak
def test_an_i_star_below_the_smallest_i_k_is_infeasible_and_says_how_far(model):
    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=4.8), starts=1)

    assert found.status == "infeasible"
    assert found.smallest_I_K == pytest.approx(4.8503, abs=HALF_LAST_DIGIT)
    assert found.I_K == found.smallest_I_K
    assert "`I_star` must be at least 4.85027" in found.reason
    assert found.gains.K == pytest.approx(
        np.array([[1.6524, 0.0, 3.4577, 0.0], [0.0, 1.9112, 0.0, 3.4577]]), abs=THIRD_DIGIT
    )


def test_the_printed_limits_are_infeasible_and_the_binding_ones_are_named(printed):
    found = ft.tune(printed)

    assert found.status == "infeasible"
    assert found.smallest_I_K == pytest.approx(67.15, abs=5e-3)
    assert found.R_K == pytest.approx(0.220, abs=5e-4)
    assert set(found.active) == {"phi_rate_min", "n_z_min", "n_z_rate_min"}
    for name in found.active:
        assert name in found.reason


@pytest.mark.slow
def test_relaxed_limits_cost_what_they_are_known_to(printed):
    wider = relaxed(printed, 7.0)

    found = ft.tune(wider)

    assert found.status == "optimal"
    assert found.R_K == pytest.approx(0.526, abs=5e-4)
    assert found.I_K <= 5.0
    assert wider.slack(found.gains.K.ravel()).min() >= 0.0


def test_gains_tuned_for_the_lag_are_well_damped_where_the_papers_are_not():
    found = ft.tune(ft.loop.TuningProblem(model=lagged(), K_fixed=DECOUPLED))

    assert found.status == "optimal"
    assert found.R_K == pytest.approx(0.1153, abs=HALF_LAST_DIGIT)
    assert found.gains.K[1, [1, 3]] == pytest.approx([2.90, 0.92], abs=FLAT)
    assert worst_damping(ft.loop.closed_loop(lagged(), found.gains)) > 0.85
    assert worst_damping(ft.loop.closed_loop(lagged(), ft.PAPER_GAINS)) == pytest.approx(
        0.12, abs=5e-3
    )


def test_a_channel_that_the_rate_leaves_open_has_the_smallest_trace_of_q():
    """For ``e'' + p e' + q e = 0`` it is ``(2 + q + 1/q) / (2 p) + p / (2 q)``, least at ``q + 1``.

    This falls with q, up to the bound on the integral gain.
    """
    level = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    K_max = np.full((2, 4), 20.0)
    K_max[1, 3] = 4.0
    slow_course = np.array([[4.0, 0.0, 0.5, 0.0], [0.0, np.nan, 0.0, np.nan]])

    found = ft.tune(ft.loop.TuningProblem(model=level, K_fixed=slow_course, K_max=K_max), starts=1)

    per_gain = 9.81 / 25.0
    course = np.array([[-4.0 * per_gain, -0.5 * per_gain], [1.0, 0.0]])
    assert found.R_K == pytest.approx(ft.loop.indicators(course).R_K, rel=1e-9)
    assert found.gains.K[1, [1, 3]] == pytest.approx([(4.0 * per_gain + 1.0) / per_gain, 4.0], 1e-5)
    assert found.active == ("K_I[n_z,gamma]_max",)


def test_structure_and_bounds_are_kept_and_named(model):
    K_max = np.full((2, 4), 3.0)

    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=6.0, K_fixed=DECOUPLED, K_max=K_max))

    assert found.gains.K[[0, 0, 1, 1], [1, 3, 0, 2]].tolist() == [0.0] * 4
    assert found.gains.K.max() <= 3.0
    assert "K_I[phi,chi]_max" in found.active


@pytest.mark.slow
@pytest.mark.parametrize(("I_star", "status"), [(5.0, "optimal"), (4.9, "infeasible")])
def test_gains_that_are_all_fixed_are_only_assessed(model, I_star, status):
    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=I_star, K_fixed=ft.PAPER_GAINS.K))

    assert found.status == status
    assert np.array_equal(found.gains.K, ft.PAPER_GAINS.K)
    assert found.I_K == pytest.approx(4.9162, abs=HALF_LAST_DIGIT)


@pytest.mark.soak
def test_state_scaling_changes_what_is_optimal(model):
    scaling = np.array([0.5, 0.5, 1.0, 1.0])

    found = ft.tune(ft.loop.TuningProblem(model=model, I_star=8.0, scaling=scaling), starts=1)

    again = ft.loop.indicators(ft.loop.closed_loop(model, found.gains), scaling=scaling)
    assert (found.R_K, found.I_K) == (again.R_K, again.I_K)
    assert found.R_K > ft.loop.indicators(ft.loop.closed_loop(model, found.gains)).R_K


@pytest.mark.parametrize("without", ["freedom", "control"])
def test_a_loop_that_cannot_be_stabilised_is_a_failure_with_a_reason(model, without):
    problem = ft.loop.TuningProblem(model=model, K_fixed=np.ones((2, 4)))
    if without == "control":
        problem = ft.loop.TuningProblem(model=replace(model, B=np.zeros((2, 2))))

    found = ft.tune(problem)

    assert (found.status, found.gains, found.R_K) == ("failed", None, 0.0)
    assert found.reason


def worst_damping(A_K):
    eigenvalues = np.linalg.eigvals(A_K)
    return (-eigenvalues.real / np.abs(eigenvalues)).min()
