"""The problem, its polytope of gains, stable starts, and the slopes that SLSQP is given."""

from dataclasses import replace

import numpy as np
import pytest
from printed import lagged

import flighttune as ft
from flighttune.control.tuning import envelope, program
from flighttune.control.tuning.result import Assessment, assessment
from flighttune.control.tuning.tune import searches
from tests.control.tuning.conftest import DECOUPLED, relaxed

PRINTED_DIGITS = 5e-4
ROUNDING = 1e-12
STEP, TRUNCATION = 1e-5, 1e-6  # of central differences, whose error is relative to the largest


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


@pytest.mark.parametrize(("beyond", "within"), [(1e-3, True), (-1e-3, False)])
def test_gains_beyond_either_of_their_bounds_are_not_within_limits(model, beyond, within):
    K = ft.PAPER_GAINS.K
    for name, end in (("K_max", K.max() + beyond), ("K_min", K.min() - beyond)):
        problem = ft.loop.TuningProblem(model=model, **{name: np.full((2, 4), end)})
        assert assessment(problem, K).within_limits == within


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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_starts_are_stable_inside_the_bounds_and_the_same_for_one_seed(seed):
    problem = ft.loop.TuningProblem(
        model=lagged(), K_fixed=DECOUPLED, K_max=np.full((2, 4), 3.0), seed=seed
    )

    k = program.stabilising_starts(problem, 6)

    assert k.shape == (6, 4)
    loops = [ft.loop.closed_loop(problem.model, problem.gains(K)) for K in problem.K(k)]
    assert np.linalg.eigvals(loops).real.max() < 0.0
    assert k.max() <= 3.0
    assert np.array_equal(k, program.stabilising_starts(problem, 6))


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


def test_slopes_of_several_models_are_those_of_central_differences(printed, model):
    K_fixed = np.full((2, 4), np.nan)
    K_fixed[0, 1] = 0.1
    whole = {"I_star": 9.0, "K_fixed": K_fixed, "scaling": None}
    several = [replace(printed, model=plant, **whole) for plant in (model, lagged())]
    task = program.Program(several, "R_K")
    z = np.array([2.5, 0.8, 0.3, -0.2, 2.7, 0.1, 0.9, 4.0, -3.0, -2.0, 1.0])

    slopes = task.room_slopes(z)

    moves = STEP * np.eye(len(z))
    differences = np.array([task.room(z + move) - task.room(z - move) for move in moves]).T
    assert slopes == pytest.approx(
        differences / (2.0 * STEP), abs=TRUNCATION * np.abs(slopes).max()
    )


def test_starts_outside_the_limits_end_inside_where_there_is_room(printed):
    problem = relaxed(printed, 7.0)
    k = program.stabilising_starts(problem, 12)
    outside = k[problem.slack(k).min(axis=1) < 0.0]

    ends = searches(problem, outside, "R_K")

    assert len(outside) > 2
    assert all(end.within_limits and end.I_K <= problem.I_star for end in ends)
    assert [end.R_K for end in ends] == pytest.approx([0.526] * len(ends), abs=5e-4)


@pytest.mark.parametrize(
    ("measured", "meets"),
    [
        ({}, True),
        ({"I_K": 5.0 + 1e-9}, False),
        ({"E_K": 2.0 + 1e-9}, False),
        ({"R_K": 0.3 * (1.0 - 2e-9)}, False),
        ({"R_K": 0.3 * (1.0 - 0.5e-9)}, True),  # rounding
        ({"within_limits": False}, False),
    ],
)
def test_gains_meet_a_problem_within_all_its_bounds(model, measured, meets):
    problem = ft.loop.TuningProblem(
        model=model, I_star=5.0, E_star=2.0, x_0=np.ones(2), weights=(np.ones(2), np.ones(2)),
        R_min=0.3,
    )  # fmt: skip
    figures = {"R_K": 0.3, "I_K": 5.0, "E_K": 2.0, "spectral_abscissa": -0.1, "cost": 1.0}
    found = Assessment(K=np.zeros((2, 4)), within_limits=True, active=(), **figures)

    assert found._replace(**measured).meets(problem) == meets
    assert not found._replace(R_K=0.0).meets(replace(problem, R_min=0.0))


@pytest.mark.parametrize(
    ("I_K", "active", "said"),
    [
        (6.0, (), "`I_star` must be at least 6, the smallest I_K reached, got 5."),
        (6.0, ("phi_max", "n_z_min"), "reached with phi_max, n_z_min binding, got 5."),
        (5.0, (), "No gains were found with an E_K of at most `E_star` 2; those of the smallest"),
    ],
)
def test_what_a_problem_lacks_is_said_of_the_gains_of_the_smallest_radius(model, I_K, active, said):
    problem = ft.loop.TuningProblem(model=model, I_star=5.0, E_star=2.0)
    found = Assessment(
        K=np.zeros((2, 4)), R_K=0.1, I_K=I_K, E_K=3.0, spectral_abscissa=-0.1, within_limits=True,
        active=active, cost=np.nan,
    )  # fmt: skip

    assert said in found.why_not(problem)


@pytest.mark.parametrize(
    ("status", "solved"),
    [("optimal", True), ("found", True), ("infeasible", False), ("failed", False)],
)
def test_gains_that_are_optimal_or_found_solve_their_problem(model, status, solved):
    problem = ft.loop.TuningProblem(model=model)

    found = ft.TuningResult(status=status, reason="", method="some", problem=problem)

    assert found.solved == solved


def test_a_channel_of_a_decoupled_model_has_its_own_rows_and_columns_of_everything():
    """Roll behind a lag and load factor without one; channels are in the order of inputs."""
    law = ft.loop.kinematic_model(V_a=25.0, gamma=0.2, g=9.81)
    lagged_roll = ft.loop.LinearModel(
        A=[[0, 0, law.B[0, 0]], [0, law.A[1, 1], 0], [0, 0, -4.0]],
        B=[[0, 0], [0, law.B[1, 1]], [4.0, 0]],
        C=[[1, 0, 0], [0, 1, 0]],
        states=("chi", "gamma", "phi"),
    )
    numbers = np.arange(8.0).reshape(2, 4)
    limits = ft.loop.Limits(
        lower=(-1.0, -2.0), upper=(3.0, 4.0), rate_lower=(-5.0, -6.0), rate_upper=(7.0, 8.0)
    )
    problem = ft.loop.TuningProblem(
        model=lagged_roll, limits=limits, x_0=np.array([0.1, 0.2]), scaling=np.arange(1.0, 6.0),
        K_min=-1.0 - numbers, K_max=10.0 + numbers, gusts=np.array([0.3, 0.4]), E_star=9.0,
    )  # fmt: skip

    (rolls, of_chi, roll), (loads, of_gamma, load) = envelope.channels(problem)

    assert [x.tolist() for x in (rolls, of_chi, loads, of_gamma)] == [[0], [0], [1], [1]]
    assert roll.model.names == (("chi", "phi"), ("phi",), ("chi",))
    assert load.model.names == (("gamma",), ("n_z",), ("gamma",))
    assert roll.model.A == pytest.approx(np.array([[0, law.B[0, 0]], [0, -4.0]]))
    assert (roll.model.B.tolist(), roll.model.C.tolist()) == ([[0], [4]], [[1, 0]])
    assert load.model.A == pytest.approx(law.A[1:, 1:])
    assert load.model.B == pytest.approx(law.B[1:, 1:])
    assert roll.scaling.tolist() == [1.0, 3.0, 4.0]
    assert load.scaling.tolist() == [2.0, 5.0]
    assert (roll.K_max.tolist(), load.K_min.tolist()) == ([[10.0, 12.0]], [[-6.0, -8.0]])
    assert (roll.x_0.tolist(), load.gusts.tolist()) == ([0.1], [0.4])
    for own, ends in ((roll.limits, (-1.0, 3.0, -5.0, 7.0)), (load.limits, (-2.0, 4.0, -6.0, 8.0))):
        found = own.lower, own.upper, own.rate_lower, own.rate_upper
        assert np.concatenate(found).tolist() == list(ends)
    assert roll.E_star == 9.0
    # a turn couples them, and the whole problem is its only channel
    turning = ft.loop.kinematic_model(V_a=25.0, gamma=0.2, phi=0.3, g=9.81)
    coupled = replace(problem, model=turning, scaling=None)
    ((inputs, errors, whole),) = envelope.channels(coupled)
    assert (inputs.tolist(), errors.tolist()) == ([0, 1], [0, 1])
    assert whole.model.B.tolist() == turning.B.tolist()
    assert whole.K_max.tolist() == (10.0 + numbers).tolist()
