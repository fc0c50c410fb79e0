"""Bang-bang disturbances: against the worst there is for a linear loop."""

from itertools import product

import numpy as np
import pytest
from commands import answer
from dispersed import KINEMATIC, tables_of
from flown_campaigns import flown_here
from made_up import scenario_file
from scipy.signal import dimpulse, dlti

import flighttune as ft
from flighttune.claims.tubes.tube import stated_problem
from flighttune.studies import worst

SMALL = 1e-4
"""Disturbance (rad/s) under which the loop is linear to 1e-3: angles stay below 3e-4 rad."""

LINEAR = 1e-3
BY_INTERVALS = 0.01
"""Part of the optimum lost, as sensitivities are means over intervals of two or three samples."""

SAME = 1e-9
BUDGET = 400
COUPLED = {"name": "coupled", "K_P": [[1.5, 2.5], [-2.5, 0.5]], "K_I": [[10.0, 0.0], [0.0, 1.0]]}
RATE, DURATION, V_A, G = 20.0, 6.0, 25.0, 9.81
SAMPLES = round(RATE * DURATION)


def level(**tables):
    """Level flight under gains that couple two oscillations, without limits that could act."""
    return tables_of(
        (KINEMATIC,),
        **{
            "gains": [COUPLED],
            "flight": {"V_a_mps": V_A, "duration_s": DURATION, "g_mps2": G},
            "limits": {},
            "controller": {"feed_forward": True, "rate_hz": RATE},
            **tables,
        },
    )


def to_the_course():
    """What d_chi and d_gamma of the samples before the last do to its course error, (2, k).

    The law adds `K_I dt / 2` times the last two errors to its integral; `z` has the part of the
    sum that is older than the sample.
    """
    dt, g_over_v = 1.0 / RATE, G / V_A
    K_P, half = np.array(COUPLED["K_P"]), 0.5 * np.array(COUPLED["K_I"]) / RATE
    A = np.block([[np.eye(2) - dt * g_over_v * (K_P + half), dt * g_over_v * np.eye(2)],
                  [-2.0 * half, np.eye(2)]])  # fmt: skip
    B, C = np.vstack([dt * np.eye(2), np.zeros((2, 2))]), np.array([[-1.0, 0.0, 0.0, 0.0]])
    _, found = dimpulse(dlti(A, B, C, np.zeros((1, 2)), dt=dt), n=SAMPLES + 1)
    return np.stack([one[1:, 0] for one in found])


def largest_by_square_waves(h):
    """By all square waves that `worst` searches, on a grid of 120 frequencies and 73 phases."""
    t = np.arange(SAMPLES) / RATE
    omega, phase = np.linspace(0.05, 6.0, 120), np.linspace(-np.pi, np.pi, 73)
    waves = np.copysign(1.0, np.sin(omega[:, None, None] * t + phase[:, None]))
    return sum(np.abs(waves @ one[::-1]).max() for one in h)


def searched(folder, start_deg):
    """What `worst` says of disturbances, and of starts within `start_deg`."""
    path = folder / "level.toml"
    scenario_file(path, ft.scenario_from(level()))
    with flown_here():
        return answer(
            "worst", path, "--disturbance", SMALL, "--start-deg", start_deg, "--metric",
            "chi.peak_rad", "--budget", BUDGET, "--out", folder / "worst.toml",
        )  # fmt: skip


@pytest.mark.soak
def test_for_a_linear_loop_it_is_the_worst_there_is_and_flies_to_what_is_said(tmp_path):
    said = searched(tmp_path, 0.0)

    h = to_the_course()
    optimum = SMALL * np.abs(h).sum()
    assert said["family"] == "bang_bang"
    assert said["flights"] <= BUDGET
    assert said["value"] == pytest.approx(optimum, rel=BY_INTERVALS)
    assert said["value"] <= optimum * (1.0 + LINEAR)
    assert said["value"] > SMALL * largest_by_square_waves(h)
    (run,) = ft.fly(ft.load_scenario(tmp_path / "worst.toml")).runs
    assert run.signals["chi_err"].abs().max() == pytest.approx(said["value"], rel=SAME)
    assert {*run.signals["d_chi"].abs()} == {SMALL}


def test_a_tube_encloses_every_switching_time():
    switched = {"chi_amplitude": -0.01, "chi_switch_s": [1.0], "gamma_amplitude": 0.02}
    scenario = ft.scenario_from(level(disturbance=switched))

    problem = stated_problem(scenario, scenario.gains[0].gains())

    assert (problem.disturbances[1] == [0.01, 0.02]).all()
    assert (problem.disturbances[0] == [-0.01, -0.02]).all()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"chi_switch_s": [2.0, 1.0]}, r"`chi_switch_s` must .*rise, got 1 s after 2 s"),
        ({"gamma_switch_s": [0.0]}, r"`gamma_switch_s` must be positive.* got 0 s"),
        ({"gamma_switch_s": [1.0, 6.0]}, r"`gamma_switch_s` must lie before the end.* got 6 s"),
        ({"chi_switch_s": [1.0], "wave": "square"}, "`wave` must be absent with chi_switch_s"),
        ({"chi_switch_s": [1.0], "as_wind": True}, "`as_wind` must be absent with chi_switch_s"),
        ({"chi_switch_s": [], "chi_phase_deg": 1.0}, "`chi_phase_deg` must be absent"),
    ],
)
def test_switching_times_that_cannot_be_flown_are_refused_in_one_line(table, message):
    with pytest.raises(ft.ScenarioError, match=message) as refused:
        ft.scenario_from(level(disturbance={"chi_amplitude": 0.1, **table}))

    assert "\n" not in str(refused.value)


def test_slopes_of_errors_that_are_sums_of_signs_are_their_weights():
    """Each error is a weighted sum of the signs of every sample, weights equal in a block."""
    rng = np.random.default_rng(5)
    blocks = [np.array([0]), np.arange(1, 5), np.arange(5, 9), np.arange(9, 13)]
    about = np.where(rng.random((13, 2)) < 0.5, -1.0, 1.0)
    weight = rng.normal(size=(len(blocks), 2, 13, 2))

    def flown(signs):
        each = sum(
            np.einsum("c,cte->te", signs[block].sum(axis=0), w)
            for block, w in zip(blocks, weight, strict=True)
        )
        return 0.3 + each

    targets, pushed = np.array([4, 12]), (0, 1)
    others = [worst._other(about, block, channel) for block in blocks for channel in (0, 1)]
    errors = [flown(x) for x in (about, *others)]
    slopes = worst._slopes(about, blocks, errors, targets, pushed)

    for slope, (target, error) in zip(slopes, product(targets, pushed), strict=True):
        assert slope[0] == pytest.approx(weight[0, :, target, error])
        # between the middles of blocks they are interpolated
        for channel in (0, 1):
            each = np.interp(np.arange(1, 13), (2.5, 6.5, 10.5), weight[1:, channel, target, error])
            assert slope[1:, channel] == pytest.approx(each)
    (alone, _) = worst._slopes(about, blocks, errors, targets, (1,))
    assert alone == pytest.approx(slopes[1])
    # a flight that ended early has no slope
    lost = worst._slopes(about, blocks, [*errors[:-1], None], targets, pushed)[0]
    assert lost[-1] == pytest.approx([slopes[0][-1, 0], 0.0])
