"""The problem, its polytope of gains, and starts that are stable."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.inner_loop import with_input_lag
from flighttune.control.linear_model import closed_loops
from flighttune.tuning.problem import decoupled
from flighttune.tuning.program import stabilising_starts

PRINTED_DIGITS = 5e-4
ROUNDING = 1e-12


def test_the_papers_gains_break_its_own_limits_by_the_amounts_known(printed):
    u_and_rates = {
        "phi": (-2.461, -3.745),
        "n_z": (-0.569, -1.639),
    }  # K* (x_0; x_0 dt), K* (0; x_0)

    names, slack = printed.limit_rows.names, printed.slack(ft.PAPER_GAINS.K.ravel())
    slack = dict(zip(names, slack, strict=True))

    for i, (channel, (u, rate)) in enumerate(u_and_rates.items()):
        assert slack[f"{channel}_min"] == pytest.approx(
            u - printed.limits.lower[i], abs=PRINTED_DIGITS
        )
        assert slack[f"{channel}_rate_max"] == pytest.approx(
            printed.limits.rate_upper[i] - rate, abs=PRINTED_DIGITS
        )


def test_fixed_gains_take_part_in_the_limits_but_not_in_the_search(printed):
    K_fixed = np.full((2, 4), np.nan)
    K_fixed[0, 2:] = ft.PAPER_GAINS.K[0, 2:]
    fixed = replace(printed, K_fixed=K_fixed)

    slack = fixed.slack(ft.PAPER_GAINS.K[np.isnan(K_fixed)])

    assert fixed.k_bounds.shape == (2, 6)
    assert fixed.K(ft.PAPER_GAINS.K[np.isnan(K_fixed)]) == pytest.approx(ft.PAPER_GAINS.K)
    assert slack == pytest.approx(printed.slack(ft.PAPER_GAINS.K.ravel()), abs=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
def test_starts_are_stable_inside_the_bounds_and_the_same_for_one_seed(model, seed):
    lagged = with_input_lag(model, (4.0, 8.0))
    problem = ft.loop.TuningProblem(
        model=lagged, K_fixed=decoupled(lagged), K_max=np.full((2, 4), 3.0), seed=seed
    )

    k = stabilising_starts(problem, 6)

    assert k.shape == (6, 4)
    assert np.linalg.eigvals(closed_loops(lagged, problem.K(k))).real.max() < 0.0
    assert k.max() <= 3.0
    assert np.array_equal(k, stabilising_starts(problem, 6))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"I_star": 0.0}, ft.InputError, "`I_star` must be positive, got 0"),
        ({"limits": ft.loop.Limits.none(2)}, ft.InputError, "`x_0` must be given with `limits`"),
        (
            {"limits": ft.loop.Limits.none(3), "x_0": np.ones(2)},
            ft.InputError,
            "`limits` must have 2",
        ),
        ({"K_min": np.zeros((2, 2))}, ft.InputError, r"`K_min` must have shape \(2, 4\)"),
        ({"K_min": np.ones((2, 4)), "K_max": np.zeros((2, 4))}, ft.InputError, "`K_min` must not"),
    ],
)
def test_a_problem_that_makes_no_sense_is_refused_by_name(model, change, error, message):
    with pytest.raises(error, match=message):
        ft.loop.TuningProblem(model=model, **change)
