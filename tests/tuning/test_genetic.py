"""Differential evolution against the gradient method: two ways to one optimum."""

import pytest

import flighttune as ft
from flighttune.paper.evolution import tune_by_evolution
from flighttune.tuning.diagnosis import relaxed
from tests.tuning.conftest import ALL_LIMITS

pytestmark = pytest.mark.slow

NEVER_WORSE_BY = 1e-4


@pytest.mark.soak
def test_evolution_ends_just_below_the_gradient_method(model):
    problem = ft.TuningProblem(model=model, I_star=5.0)

    evolved, descended = tune_by_evolution(problem), ft.tune(problem)

    assert evolved.status == "optimal"
    assert evolved.I_K <= 5.0
    assert descended.R_K - 1e-3 < evolved.R_K < descended.R_K + NEVER_WORSE_BY


@pytest.mark.soak
def test_evolution_keeps_the_input_limits_too(printed):
    problem = relaxed(printed, ALL_LIMITS, 7.0)

    evolved, descended = tune_by_evolution(problem), ft.tune(problem)

    assert evolved.status == "optimal"
    assert descended.R_K - 1e-3 < evolved.R_K < descended.R_K + NEVER_WORSE_BY


def test_evolution_of_an_infeasible_problem_says_so(printed):
    evolved = tune_by_evolution(printed, generations=60)

    assert evolved.status == "infeasible"
    assert evolved.smallest_I_K is None
    assert "every constraint" in evolved.reason
