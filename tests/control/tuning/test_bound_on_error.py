"""Tuning under a bound on E_K, the largest error of a disturbance, by every optimiser."""

import math
from dataclasses import replace

import pytest
from printed import lagged

import flighttune as ft
from tests.control.tuning.conftest import DECOUPLED

BINDING = 1e-5


@pytest.fixture(scope="module")
def bounded():
    """Behind a lag, where the fastest gains are not those of the smallest error."""
    return ft.loop.TuningProblem(model=lagged(4.0, 4.0), E_star=0.8, K_fixed=DECOUPLED)


@pytest.mark.slow
def test_the_bound_on_the_error_is_met(bounded):
    free = ft.tune(replace(bounded, E_star=math.inf), starts=2)

    result = ft.tune(bounded, starts=2)

    assert free.E_K > bounded.E_star
    assert result.status == "optimal"
    assert result.E_K <= bounded.E_star
    loop = ft.loop.closed_loop(bounded.model, result.gains)
    assert ft.loop.indicators(loop, errors=2).E_K == result.E_K
    assert "E_K" in result.active
    assert result.E_K == pytest.approx(bounded.E_star, rel=BINDING)


def test_an_error_that_is_not_reached_is_named(model):
    problem = ft.loop.TuningProblem(model=model, I_star=5.0, E_star=0.01, K_fixed=ft.PAPER_GAINS.K)
    paper = ft.tune(problem, starts=1)

    assert paper.status == "infeasible"
    assert "`E_star` 0.01" in paper.reason or "`E_star` must be" in paper.reason


@pytest.mark.parametrize("E_star", [0.0, -1.0, math.nan])
def test_a_bound_on_the_error_that_cannot_be_is_refused(model, E_star):
    with pytest.raises(ft.InputError, match="`E_star` must be positive"):
        ft.loop.TuningProblem(model=model, E_star=E_star)


def test_a_law_without_a_linear_model_has_no_error_to_bound(tmp_path):
    (tmp_path / "law.py").write_text("class Mine: pass")
    law = {"name": "mine", "kind": "python", "module": "law.py", "class": "Mine"}
    with pytest.raises(ft.ScenarioError, match=r"`E_star` .* mine, .* 1"):
        ft.load_scenario("paper", changes={"tuning.E_star": 1.0, "law": [law], "expect": []})
