"""Bang-bang disturbances: against the worst there is for a linear loop."""

import numpy as np
import pytest
from commands import answer
from dispersed import KINEMATIC, tables_of
from made_up import scenario_file
from scipy.signal import dimpulse, dlti

import flighttune as ft

SMALL = 1e-4
"""Disturbance (rad/s) under which the loop is linear to 1e-3: angles stay below 3e-4 rad."""

LINEAR = 1e-3
BY_INTERVALS = 0.01
"""Part of the optimum lost, as sensitivities are means over intervals of two or three samples."""

SAME = 1e-9
COUPLED = {"name": "coupled", "K_P": [[1.5, 2.5], [-2.5, 0.5]], "K_I": [[10.0, 0.0], [0.0, 1.0]]}
V_A, G = 25.0, 9.81


def level(rate=20.0, duration=6.0, **tables):
    """Level flight under gains that couple two oscillations, without limits that could act."""
    return tables_of(
        (KINEMATIC,),
        **{
            "gains": [COUPLED],
            "flight": {"V_a_mps": V_A, "duration_s": duration, "g_mps2": G},
            "limits": {},
            "controller": {"feed_forward": True, "rate_hz": rate},
            **tables,
        },
    )


def to_the_course(rate, samples):
    """What d_chi and d_gamma of the samples before the last, and the start, do to its course error.

    The shapes are (2, samples) and (2,). The law adds `K_I dt / 2` times the last two errors to its
    integral, nothing at the start; `z` has the part of the sum that is older than the sample.
    """
    dt, g_over_v = 1.0 / rate, G / V_A
    K_P, half = np.array(COUPLED["K_P"]), 0.5 * np.array(COUPLED["K_I"]) / rate
    A = np.block([[np.eye(2) - dt * g_over_v * (K_P + half), dt * g_over_v * np.eye(2)],
                  [-2.0 * half, np.eye(2)]])  # fmt: skip
    B, C = np.vstack([dt * np.eye(2), np.zeros((2, 2))]), np.array([[-1.0, 0.0, 0.0, 0.0]])
    _, found = dimpulse(dlti(A, B, C, np.zeros((1, 2)), dt=dt), n=samples + 1)
    start = C @ np.linalg.matrix_power(A, samples) @ np.vstack([np.eye(2), half])
    return np.stack([one[1:, 0] for one in found]), start[0]


def largest_by_square_waves(h, rate):
    """By all square waves that `worst` searches, on a grid of 120 frequencies and 73 phases."""
    t = np.arange(h.shape[1]) / rate
    omega, phase = np.linspace(0.05, 6.0, 120), np.linspace(-np.pi, np.pi, 73)
    waves = np.copysign(1.0, np.sin(omega[:, None, None] * t + phase[:, None]))
    return sum(np.abs(waves @ one[::-1]).max() for one in h)


@pytest.mark.parametrize(
    ("rate", "duration", "start_deg", "budget"),
    [
        pytest.param(5.0, 2.4, 0.002, 150, marks=pytest.mark.slow),
        pytest.param(20.0, 6.0, 0.0, 400, marks=pytest.mark.soak),
    ],
)
def test_for_a_linear_loop_it_is_the_worst_there_is_and_flies_to_what_is_said(
    tmp_path, rate, duration, start_deg, budget
):
    path, out = tmp_path / "level.toml", tmp_path / "worst.toml"
    scenario_file(path, ft.scenario_from(level(rate, duration)))

    said = answer(
        "worst", path, "--disturbance", SMALL, "--start-deg", start_deg, "--metric",
        "chi.peak_rad", "--budget", budget, "--out", out,
    )  # fmt: skip

    h, start = to_the_course(rate, round(rate * duration))
    optimum = SMALL * np.abs(h).sum() + np.deg2rad(start_deg) * np.abs(start).sum()
    assert said["family"] == "bang_bang"
    assert said["flights"] <= budget
    assert said["value"] == pytest.approx(optimum, rel=BY_INTERVALS)
    assert said["value"] <= optimum * (1.0 + LINEAR)
    if not start_deg:  # a longer flight has more switches than a square wave can have
        assert said["value"] > SMALL * largest_by_square_waves(h, rate)
    (run,) = ft.fly(ft.load_scenario(out)).runs
    assert run.signals["chi_err"].abs().max() == pytest.approx(said["value"], rel=SAME)
    assert {*run.signals["d_chi"].abs()} == {SMALL}


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
