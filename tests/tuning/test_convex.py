"""The convex start against the random ones: two formulations, one optimum."""

import numpy as np
import pytest

from flighttune.control.inner_loop import with_input_lag
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.theory.indicators import indicators, indicators_batch
from flighttune.tuning.diagnosis import relaxed
from flighttune.tuning.problem import TuningProblem, decoupled
from flighttune.tuning.tune import convex_starts, state_feedback, tune
from tests.tuning.conftest import ALL_LIMITS

SAME_OPTIMUM = 1e-6
SOLVER = 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("factor", [None, 7.0])
def test_the_convex_start_leads_to_the_optimum_of_the_random_ones(model, printed, factor):
    problem = TuningProblem(model=model, I_star=5.0)
    if factor is not None:
        problem = relaxed(printed, ALL_LIMITS, factor)

    convex, drawn = tune(problem, "convex"), tune(problem)

    assert (convex.status, convex.method) == ("optimal", "convex")
    assert convex.R_K == pytest.approx(drawn.R_K, rel=SAME_OPTIMUM)


def test_the_convex_start_finds_the_printed_problem_infeasible_too(printed):
    found = tune(printed, "convex")

    assert found.status == "infeasible"
    assert found.smallest_I_K == pytest.approx(67.15, abs=5e-3)


def test_no_smaller_gains_reach_the_rate_of_the_convex_optimum(model):
    scaling = np.array([1.0, 1.0, 0.8, 1.2])
    size = 2.0
    best = state_feedback(model, scaling, size)
    R_K = indicators(closed_loops(model, best), scaling=scaling).R_K
    rng = np.random.default_rng(1)
    spread = 10.0 ** rng.uniform(-3.0, 0.5, (4000, 1, 1))
    K = best + spread * rng.standard_normal((4000, 2, 4))
    others = indicators_batch(closed_loops(model, K), scaling=scaling)

    faster = K[others.R_K > R_K * (1.0 + SOLVER)]

    # R_K > R with Q proves that W = Q^-1 is feasible, so its gains must break the bound
    assert len(faster)
    for gain in faster[:: len(faster) // 20 + 1]:
        Q = indicators(closed_loops(model, gain), scaling=scaling).Q
        used = (gain * scaling) @ np.linalg.inv(Q) @ (gain * scaling).T
        assert np.linalg.eigvalsh(used)[-1] > size**2 * (1.0 - 1e-3)


def test_lag_and_structure_are_respected(model):
    lagged = with_input_lag(model, (4.0, 8.0))
    problem = TuningProblem(model=lagged, K_fixed=decoupled(lagged))

    found = tune(problem, "convex")

    assert found.R_K == pytest.approx(tune(problem).R_K, rel=1e-4)
    assert (convex_starts(problem)[:, [0, 1], [1, 0]] == 0.0).all()


def test_a_plant_without_control_has_no_convex_start():
    model = LinearModel(
        A=np.eye(1), B=np.zeros((1, 1)), C=np.eye(1), states=("x",), inputs=("u",), errors=("x",)
    )

    found = tune(TuningProblem(model=model), "convex")

    assert (found.status, found.gains) == ("failed", None)
