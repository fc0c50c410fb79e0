"""The problem, its polytope of gains, stable starts, and the slopes that SLSQP is given."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from tests.control.tuning.conftest import DECOUPLED

PRINTED_DIGITS = 5e-4
ROUNDING = 1e-12


def test_the_papers_gains_break_its_own_limits_by_the_amounts_known(printed):
    # K* (x_0; x_0 dt), K* (0; x_0)
    u_and_rates = {"phi": (-2.461, -3.745), "n_z": (-0.569, -1.639)}
    limits, slack = printed.limits, printed.slack(ft.PAPER_GAINS.K.ravel())
    slack = dict(zip(printed.limit_rows.names, slack, strict=True))

    for i, (channel, (u, rate)) in enumerate(u_and_rates.items()):
        below, above = (slack[f"{channel}_{end}"] for end in ("min", "rate_max"))
        assert below == pytest.approx(u - limits.lower[i], abs=PRINTED_DIGITS)
        assert above == pytest.approx(limits.rate_upper[i] - rate, abs=PRINTED_DIGITS)


def test_each_limit_has_its_own_bound(printed):
    limits = ft.loop.Limits(
        lower=(-1.0, -5.0), upper=(2.0, 6.0), rate_lower=(-3.0, -7.0), rate_upper=(4.0, 8.0)
    )
    rows = replace(printed, limits=limits).limit_rows

    bounds = dict(zip(rows.names, rows.bound, strict=True))
    ends = "_min", "_max", "_rate_min", "_rate_max"
    found = [bounds[f"{command}{end}"] for command in ("phi", "n_z") for end in ends]
    assert found == [1, 2, 3, 4, 5, 6, 7, 8]


def test_fixed_gains_take_part_in_the_limits_but_not_in_the_search(printed):
    K_fixed = np.full((2, 4), np.nan)
    K_fixed[0, 2:] = ft.PAPER_GAINS.K[0, 2:]
    fixed = replace(printed, K_fixed=K_fixed)

    slack = fixed.slack(ft.PAPER_GAINS.K[np.isnan(K_fixed)])

    assert fixed.k_bounds.shape == (2, 6)
    assert fixed.K(ft.PAPER_GAINS.K[np.isnan(K_fixed)]) == pytest.approx(ft.PAPER_GAINS.K)
    assert slack == pytest.approx(printed.slack(ft.PAPER_GAINS.K.ravel()), abs=ROUNDING)


def test_in_a_decoupled_structure_each_command_has_the_gains_of_its_own_channel():
    scenario = ft.load_scenario("paper", changes={"tuning.structure": "decoupled"})
    problem = ft.loop.tuning_problem(scenario)

    assert np.array_equal(problem.K_fixed, DECOUPLED, equal_nan=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"I_star": 0.0}, "`I_star` must be positive, got 0"),
        ({"limits": ft.loop.Limits.none(2)}, "`x_0` must be given with `limits`"),
        ({"limits": ft.loop.Limits.none(3), "x_0": np.ones(2)}, "`limits` must have 2"),
        ({"K_min": np.zeros((2, 2))}, r"`K_min` must have shape \(2, 4\)"),
        ({"K_min": np.ones((2, 4)), "K_max": np.zeros((2, 4))}, "`K_min` must not"),
    ],
)
def test_a_problem_that_makes_no_sense_is_refused_by_name(model, change, message):
    with pytest.raises(ft.InputError, match=message):
        ft.loop.TuningProblem(model=model, **change)


@pytest.mark.parametrize(
    ("status", "solved"),
    [("optimal", True), ("found", True), ("infeasible", False), ("failed", False)],
)
def test_gains_that_are_optimal_or_found_solve_their_problem(model, status, solved):
    problem = ft.loop.TuningProblem(model=model)

    found = ft.TuningResult(status=status, reason="", method="some", problem=problem)

    assert found.solved == solved
