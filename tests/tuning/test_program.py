"""The slopes that SLSQP is given, and starts from which the way to the optimum is hard."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.inner_loop import with_input_lag
from flighttune.tuning.program import Program, stabilising_starts
from flighttune.tuning.tune import relaxed, searches
from tests.tuning.conftest import ALL_LIMITS

STEP = 1e-5
TRUNCATION = 1e-6
"""Error of central differences, relative to the largest entry."""


def test_slopes_of_several_models_are_those_of_central_differences(printed, model):
    K_fixed = np.full((2, 4), np.nan)
    K_fixed[0, 1] = 0.1
    several = [
        ft.loop.TuningProblem(
            model=plant, I_star=9.0, limits=printed.limits, x_0=printed.x_0, K_fixed=K_fixed
        )
        for plant in (model, with_input_lag(model, (4.0, 8.0)))
    ]
    task = Program(several, "R_K")
    z = np.array([2.5, 0.8, 0.3, -0.2, 2.7, 0.1, 0.9, 4.0, -3.0, -2.0, 1.0])

    slopes = task.room_slopes(z)

    moves = STEP * np.eye(len(z))
    differences = np.array([task.room(z + move) - task.room(z - move) for move in moves]).T
    assert slopes == pytest.approx(
        differences / (2.0 * STEP), abs=TRUNCATION * np.abs(slopes).max()
    )


def test_starts_outside_the_limits_end_inside_where_there_is_room(printed):
    problem = relaxed(printed, ALL_LIMITS, 7.0)
    k = stabilising_starts(problem, 12)
    outside = k[problem.slack(k).min(axis=1) < 0.0]

    ends = searches(problem, outside, "R_K")

    assert len(outside) > 2
    assert all(end.within_limits and end.I_K <= problem.I_star for end in ends)
    assert [end.R_K for end in ends] == pytest.approx([0.526] * len(ends), abs=5e-4)
