"""The barrier and its exact derivatives, and starts from which the way to the optimum is hard."""

import numpy as np
import pytest

from flighttune.control.inner_loop import with_input_lag
from flighttune.tuning.gradient import searches
from flighttune.tuning.problem import TuningProblem, decoupled, search_space
from flighttune.tuning.program import Program
from flighttune.tuning.starts import stabilising_starts

STEP = 1e-5
TRUNCATION = 1e-6
"""Of central differences, relative to the largest entry."""
SAME = 1e-6


@pytest.mark.parametrize("objective", ["R_K", "I_K", "factor", "trace"])
@pytest.mark.parametrize("inside", [True, False])
def test_slope_and_curvature_are_those_of_central_differences(printed, model, objective, inside):
    K_fixed = np.full((2, 4), np.nan)
    K_fixed[0, 1] = 0.1
    several = [
        TuningProblem(
            model=one, I_star=9.0, limits=printed.limits, x_0=printed.x_0, K_fixed=K_fixed
        )
        for one in (model, with_input_lag(model, (4.0, 8.0)))
    ]
    relaxable = np.ones(len(search_space(several[0]).names), dtype=bool)
    task = Program(several, objective, relaxable=relaxable, min_R_K=0.01)
    k = [2.5, 0.8, 0.3, -0.2, 2.7, 0.1, 0.9]
    z = np.array([[*k, 4.0, -3.0, -2.0, 3.0, 2.2, 15.0]])
    weight, at = np.array([0.2]), np.array([inside])

    slope, _, curvature, _ = task.derivatives(z, weight, at)

    moves = STEP * np.eye(z.shape[1])
    merits = [task.merit(z + h, weight, at) - task.merit(z - h, weight, at) for h in moves]
    slopes = [
        task.derivatives(z + h, weight, at)[0] - task.derivatives(z - h, weight, at)[0]
        for h in moves
    ]
    for exact, differences in ((slope[0], np.ravel(merits)), (curvature[0], np.vstack(slopes))):
        size = TRUNCATION * np.abs(exact).max()
        assert exact == pytest.approx(differences / (2.0 * STEP), abs=size)


@pytest.mark.parametrize("seed", range(2))
def test_every_start_leaves_the_saddle_of_decoupled_gains(model, seed):
    lagged = with_input_lag(model, (4.0, 8.0))
    problem = TuningProblem(model=lagged, seed=seed)
    own = TuningProblem(model=lagged, K_fixed=decoupled(lagged), seed=seed)
    starts = [stabilising_starts(one, search_space(one), 4) for one in (problem, own)]

    coupled = [one.R_K for one in searches(problem, starts[0], "R_K")]
    apart = [one.R_K for one in searches(own, starts[1], "R_K")]

    assert np.ptp(apart) < SAME * min(apart)
    assert np.ptp(coupled) < SAME * min(coupled)
    assert min(coupled) > max(apart) * (1.0 + 50.0 * SAME)  # by 1e-4 with SLSQP


def test_starts_outside_the_limits_end_inside_where_there_is_room(printed):
    problem = printed.relaxed(7.0, 7.0)
    space = search_space(problem)
    k = stabilising_starts(problem, space, 12)
    outside = k[space.slack(k).min(axis=1) < 0.0]

    found = searches(problem, outside, "R_K")

    assert len(outside) > 2
    assert all(one.within_limits and one.I_K <= problem.I_star for one in found)
    assert [one.R_K for one in found] == pytest.approx([0.526] * len(found), abs=5e-4)
