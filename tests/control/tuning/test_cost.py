"""The quadratic cost against its integral, and the least cost against values computed elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from printed import lagged
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_are

import flighttune as ft

INTEGRATED = 1e-6
LAST_DIGIT = 0.005
PERCENT = 0.01
FREE = np.inf


def cost_of(problem, K):
    """Gains that are all fixed are only assessed."""
    return ft.tune(replace(problem, K_fixed=K), starts=1).cost


@pytest.fixture(scope="module")
def problem(model):
    weights = np.ones(2), np.full(2, 0.1)
    return ft.loop.TuningProblem(
        model=model, x_0=np.array([-np.pi / 3.0, -np.pi / 6.0]), weights=weights
    )


@pytest.mark.parametrize("lag", [False, True])
def test_the_cost_is_the_integral_over_the_transient(problem, lag):
    if lag:
        problem = replace(problem, model=lagged(4.0, 6.0), scaling=None)
    model, K = problem.model, ft.PAPER_GAINS.K
    n = len(model.states)
    A = ft.loop.closed_loop(model, ft.PAPER_GAINS)

    def flow(_, z):
        error = model.C @ z[:n]
        command = K @ np.concatenate([error, z[n:-1]])
        return np.append(A @ z[:-1], error @ error + 0.1 * command @ command)

    start = np.zeros(n + 3)
    start[:2] = problem.x_0
    end = solve_ivp(flow, (0.0, 80.0), start, rtol=1e-9, atol=1e-12).y[-1, -1]

    assert cost_of(problem, K) == pytest.approx(end, rel=INTEGRATED)


@pytest.mark.soak
@pytest.mark.parametrize(("I_star", "R_min", "J"), [(5.0, 0.0, 1.96), (FREE, 0.53, 1.38)])
def test_the_least_cost_is_that_of_another_program(problem, I_star, R_min, J):
    found = ft.tune(replace(problem, I_star=I_star, R_min=R_min), starts=2)

    assert found.status == "optimal"
    assert found.cost == pytest.approx(J, rel=PERCENT)
    assert found.R_K >= R_min
    assert found.I_K <= I_star
    assert found.cost < cost_of(problem, ft.PAPER_GAINS.K)


@pytest.mark.slow
def test_a_regulator_of_the_same_rate_is_not_better(problem):
    weights = np.diag([1.0, 1.0, 0.5, 0.5])
    X = solve_continuous_are(*integrating(problem.model), weights, 0.1 * np.eye(2))
    K = -10.0 * integrating(problem.model)[1].T @ X
    rate = ft.tune(replace(problem, weights=None, K_min=K - 1e-6, K_max=K + 1e-6), starts=2).R_K

    found = ft.tune(replace(problem, R_min=0.55), starts=2)

    assert rate == pytest.approx(0.55, abs=0.001)
    assert found.cost < cost_of(problem, K)
    assert cost_of(problem, K) == pytest.approx(1.42, abs=LAST_DIGIT)
    assert found.agreeing == found.starts == 3  # from the gains of the largest R_K too


def integrating(model):
    """A and B of (x, int e)."""
    A = np.block([[model.A, np.zeros((2, 2))], [model.C, np.zeros((2, 2))]])
    return A, np.vstack([model.B, np.zeros((2, 2))])


@pytest.mark.counts
def test_a_bound_on_the_largest_error_costs_more_and_holds(problem):
    found = ft.tune(replace(problem, R_min=0.3, E_star=0.8), starts=1)

    assert found.status == "optimal"
    assert found.E_K <= 0.8
    assert "E_K" in found.active
    assert found.cost > 1.25  # the least without the bound


@pytest.mark.slow
def test_a_rate_above_what_exists_is_refused_with_the_largest(problem):
    found = ft.tune(replace(problem, I_star=5.0, R_min=0.6), starts=2)

    assert found.status == "infeasible"
    assert found.reason.startswith("`R_min` must be at most 0.53976")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": (np.ones(2), np.zeros(2))}, "`weights` must be positive"),
        ({"x_0": None}, "`x_0` must be given"),
        ({"R_min": -1.0}, "`R_min` must not be negative"),
        ({"weights": None, "R_min": 0.3}, "`R_min` must be 0"),
    ],
)
def test_a_cost_that_means_nothing_is_refused(problem, changes, message):
    with pytest.raises(ft.InputError, match=message):
        replace(problem, **changes)


def test_weights_that_are_left_out_are_those_of_the_page():
    stated = {"tuning.error_weights": [2.0, 3.0], "tuning.command_weights": [4.0, 5.0]}
    cost = {"tuning.objective": "cost"}
    weights = [
        [part.tolist() for part in ft.load_scenario("paper", changes=cost | more).tuning.weights]
        for more in ({}, stated)
    ]

    assert weights == [[[1.0, 1.0], [0.1, 0.1]], [[2.0, 3.0], [4.0, 5.0]]]
    assert ft.load_scenario("paper").tuning.weights is None
