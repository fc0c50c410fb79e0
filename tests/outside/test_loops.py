"""Indicators and margins of the loops that scenarios fly, against SciPy and python-control."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov, svdvals

import flighttune as ft
from flighttune.control.margins import loop_margins
from flighttune.flight.models import gain_set, identified_models, law_model

ROUNDING = 1e-8
FLAT = 1e-9
"""Gain below which python-control's crossing is at infinite frequency."""

LOOPS = [
    ("paper", "paper"),
    ("paper", "tuned"),
    ("paper", "K6"),
    ("c172_cruise_turn", "paper"),
    ("jet_pull_up", "by_hand"),
]


@pytest.mark.parametrize(("name", "gains"), LOOPS)
@pytest.mark.parametrize("identified", [False, True], ids=["kinematic", "identified"])
def test_indicators_are_those_of_scipys_lyapunov_solver(name, gains, identified):
    scenario = ft.load_scenario(name)
    model = identified_models(scenario)[0].model if identified else law_model(scenario)
    A_K = ft.loop.closed_loop(model, gain_set(scenario, gains))

    found = ft.loop.indicators(A_K)

    if not np.all(np.linalg.eigvals(A_K).real < 0.0):
        assert found.status == "unstable"
        return
    Q = solve_continuous_lyapunov(A_K.T, -np.eye(len(A_K)))
    R_K = 1.0 / np.linalg.eigvalsh(Q).max()
    assert found.R_K == pytest.approx(R_K, rel=ROUNDING)
    assert found.I_K == pytest.approx(np.linalg.cond(Q) / (R_K * svdvals(A_K).min()), rel=ROUNDING)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "gains"), [("paper_identified", "tuned_identified"), ("jet_pull_up", "by_hand")]
)
def test_margins_on_the_identified_aircraft_are_those_of_python_control(name, gains):
    import control

    scenario = ft.load_scenario(name)
    model, chosen = identified_models(scenario)[0].model, gain_set(scenario, gains)
    n, m, p = model.shape
    A = np.block([[model.A, np.zeros((n, p))], [model.C, np.zeros((p, p))]])
    B = np.vstack([model.B, np.zeros((p, m))])
    C = -np.hstack([chosen.K_P @ model.C, chosen.K_I])

    *channels, _ = loop_margins(model, chosen)

    for i, channel in enumerate(channels):
        others = [j for j in range(m) if j != i]
        loop = control.ss(A - B[:, others] @ C[others], B[:, [i]], C[[i]], 0.0)
        with np.errstate(over="ignore"):  # of its polynomials of high order
            gain, phase, _, _, crossover, _ = control.stability_margins(loop, returnall=True)
        lag = np.deg2rad(np.mod(phase, 360.0))
        decrease = max(gain[(gain > FLAT) & (gain < 1.0)], default=0.0)
        assert channel.gain_increase == pytest.approx(min(gain[gain > 1.0]), rel=ROUNDING)
        assert channel.gain_decrease == pytest.approx(decrease, rel=ROUNDING)
        assert channel.phase_margin == pytest.approx(min(lag), rel=ROUNDING)
        assert channel.delay_margin == pytest.approx(min(lag / crossover), rel=ROUNDING)
