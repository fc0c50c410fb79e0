"""Tuning for several models: channels, the worst one, and what cannot be asked."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.inner_loop import inner_loop_scaling, with_inner_loop
from flighttune.control.tuning import envelope
from flighttune.control.tuning.envelope import channels, tune_worst_case
from flighttune.flight.gains import _tuned_for
from flighttune.flight.models import gain_set, identified_problems
from tests.control.tuning.conftest import DECOUPLED

SAME = 1e-4
"""Relative difference between two searches for one optimum."""
STEP = 0.02
"""Relative change of a gain that must not improve an optimum."""


def problem(w=8.0, gamma=0.25, lags=None, **kept):
    law = ft.loop.kinematic_model(V_a=25.0, gamma=gamma, g=9.81)
    second = {"order": 2, "damping": 0.7, "delay": 0.05}
    lags = lags or [ft.loop.InnerLag(natural_frequency=f, **second) for f in (w, 2.0 * w)]
    return ft.loop.TuningProblem(
        model=with_inner_loop(law, lags), scaling=inner_loop_scaling(law, lags), seed=1, **kept
    )


def rate(one, K):
    loop = ft.loop.closed_loop(one.model, one.gains(K))
    return ft.loop.indicators(loop, scaling=one.scaling).R_K


@pytest.mark.slow
def test_one_model_gives_the_optimum_of_the_decoupled_problem():
    one = problem()

    found, plain = tune_worst_case([one]), ft.tune(replace(one, K_fixed=DECOUPLED))

    assert found.R_K == pytest.approx(plain.R_K, rel=2.0 * SAME)


def test_channels_that_a_law_couples_are_tuned_together():
    apart = ft.loop.kinematic_model(V_a=25.0, gamma=0.2, g=9.81)
    A, alone = apart.A.copy(), np.zeros((3, 3))
    A[0, 1], alone[:2, :2] = 0.01, apart.A
    undriven = replace(
        apart, A=alone, B=np.vstack([apart.B, [0.0, 0.0]]), C=np.eye(2, 3),
        states=("chi", "gamma", "drift"),
    )  # fmt: skip

    ((inputs, errors, whole),) = channels(ft.loop.TuningProblem(model=replace(apart, A=A)))
    assert (inputs.tolist(), errors.tolist()) == ([0, 1], [0, 1])
    assert whole.model.A.tolist() == A.tolist()
    ((inputs, errors, whole),) = channels(ft.loop.TuningProblem(model=undriven))
    assert (inputs.tolist(), errors.tolist(), whole.model) == ([0, 1], [0, 1], undriven)
    course, path = channels(ft.loop.TuningProblem(model=apart, scaling=np.array([1, 2, 3, 4.0])))
    for i, (inputs, errors, part) in enumerate((course, path)):
        assert (inputs.tolist(), errors.tolist()) == ([i], [i])
        assert (part.model.A, part.model.B) == (apart.A[i, i], apart.B[i, i])
        assert part.scaling.tolist() == [1.0 + i, 3.0 + i]
        assert part.model.names == tuple((names[i],) for names in apart.names)


@pytest.mark.slow
def test_no_small_change_of_a_gain_improves_the_worst_rate_of_its_channel():
    several = [problem(w) for w in (5.0, 8.0, 12.0)]
    found = tune_worst_case(several)
    assert found.R_K == pytest.approx(min(rate(one, found.gains.K) for one in several))
    for number in range(2):
        parts = [channels(one)[number] for one in several]
        own = found.gains.K[np.ix_(parts[0][0], [number, 2 + number])]
        best = min(rate(part, own) for _, _, part in parts)
        for column in range(2):
            for factor in (1.0 - STEP, 1.0 + STEP):
                moved = own.copy()
                moved[0, column] *= factor
                assert min(rate(part, moved) for _, _, part in parts) < best * (1.0 + SAME)


@pytest.mark.parametrize("frequencies", [(5.0, 12.0), (12.0, 5.0)])
def test_the_figures_of_gains_for_several_models_are_those_of_the_worst(frequencies):
    several = [problem(w) for w in frequencies]

    found = tune_worst_case(several, starts=1)

    loops = [
        ft.loop.indicators(
            ft.loop.closed_loop(one.model, found.gains), scaling=one.scaling, errors=2
        )
        for one in several
    ]
    assert found.R_K == pytest.approx(min(loop.R_K for loop in loops))
    for name in ("I_K", "E_K", "spectral_abscissa"):
        assert getattr(found, name) == pytest.approx(max(getattr(loop, name) for loop in loops))


@pytest.mark.parametrize("frequencies", [(3.0, 12.0), (12.0, 3.0)])
def test_the_sensitivity_of_gains_for_several_models_is_the_largest(monkeypatch, frequencies):
    """By the definition, at the commands: ``(1 - K G)^-1`` at many frequencies."""
    several = [problem(w, gamma=0.0, objective="decay") for w in frequencies]
    own = np.array([[1.0, 0.3]]) * 25.0 / 9.81
    monkeypatch.setattr(envelope, "_tuned", lambda *_: (own, 1, 1, 0.0))
    s = 1j * np.geomspace(1e-2, 1e2, 4000)[:, None, None]

    found = tune_worst_case(several)

    K = found.gains.K_P + found.gains.K_I / s
    peaks = []
    for model in (one.model for one in several):
        G = model.C @ np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B)
        peaks.append(np.linalg.norm(np.linalg.inv(np.eye(2) - K @ G), 2, axis=(1, 2)).max())
    assert min(peaks) < 0.9 * max(peaks)
    assert found.sensitivity == pytest.approx(max(peaks), rel=1e-3)


@pytest.mark.slow
def test_the_worst_of_several_models_is_better_than_that_of_gains_for_one():
    several = [problem(w, gamma) for w in (4.0, 12.0) for gamma in (-0.1, 0.7)]

    found, single = tune_worst_case(several), tune_worst_case(several[-1:])

    assert found.R_K == pytest.approx(min(rate(one, found.gains.K) for one in several))
    assert found.R_K > min(rate(one, single.gains.K) for one in several)
    assert found.R_K < single.R_K * (1.0 + SAME)


@pytest.mark.slow
def test_models_of_different_order_go_together():
    other = problem(gamma=0.0, lags=[ft.loop.InnerLag(order=1, natural_frequency=5.0)] * 2)

    assert tune_worst_case([problem(), other]).status == "optimal"


def test_input_limits_are_kept():
    limits = ft.loop.Limits(
        lower=np.array([-0.3, -0.3]), upper=np.array([0.3, 0.3]),
        rate_lower=np.array([-9.0, -9.0]), rate_upper=np.array([9.0, 9.0]),
    )  # fmt: skip
    x_0 = np.array([0.2, 0.2])
    free, bound = problem(), problem(limits=limits, x_0=x_0)

    found = tune_worst_case([bound])

    asked = found.gains.K @ np.concatenate([x_0, x_0 * bound.dt])
    assert found.status == "optimal"
    assert np.abs(asked).max() <= 0.3
    assert found.R_K < tune_worst_case([free]).R_K


@pytest.mark.parametrize(("share", "status"), [(0.75, "infeasible"), (1.01, "optimal")])
def test_gains_whose_error_is_above_its_bound_are_no_optimum(monkeypatch, share, status):
    """With poles -1 and -2 the error after an impulse is ``2 exp(-2t) - exp(-t)``: E_K = 1/2."""
    law = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    own = np.array([[3.0, 2.0]]) * 25.0 / 9.81
    monkeypatch.setattr(envelope, "_tuned", lambda *_: (own, 1, 1, 0.0))

    found = tune_worst_case([ft.loop.TuningProblem(model=law, E_star=0.5 * share)])

    assert found.E_K == pytest.approx(0.5, rel=1e-6)
    assert (found.status, found.active) == (status, ("E_K",) * (share < 1.0))


def test_problems_with_other_bounds_are_refused():
    with pytest.raises(ft.InputError, match="`problems`"):
        tune_worst_case([problem(), problem(K_max=np.full((2, 4), 3.0))])


@pytest.mark.parametrize(
    ("name", "tuning", "everywhere", "speeds"),
    [
        # The Aerosonde is identified at 25, 20 and 30 m/s.
        ("paper_identified", {"model": "identified", "robust": True}, False, [20.0, 30.0]),
        ("paper_identified", {"model": "identified"}, False, [25.0, 25.0]),
        ("paper", {}, True, [22.0, 28.0]),
        ("paper", {}, False, [25.0]),
    ],
)
def test_gains_say_the_airspeeds_that_they_are_tuned_for(name, tuning, everywhere, speeds):
    changes = {f"tuning.{key}": value for key, value in tuning.items()}

    tuned_for = _tuned_for(ft.load_scenario(name, changes=changes), None, envelope=everywhere)

    assert tuned_for["V_a_mps"] == speeds


@pytest.mark.parametrize("phi_deg", [[-20.0, 45.0], [-45.0, 20.0]])
@pytest.mark.parametrize("phi_rate_dps", [30.0, [-90.0, 30.0], [-30.0, 90.0]])
def test_the_gain_of_the_course_is_bounded_by_the_smaller_bank_and_roll_rate(phi_deg, phi_rate_dps):
    limits = {"phi_deg": phi_deg, "phi_rate_dps": phi_rate_dps}
    limits |= {"n_z": [0.0, 2.0], "n_z_rate_per_s": 1.0}
    changes = {"limits": limits, "tuning.model": "identified", "tuning.roll_rate": True}
    scenario = ft.load_scenario("paper_identified", changes=changes)

    (one,) = identified_problems(scenario)

    # Rolling out of 20 deg takes 2/3 s, half of which counts, and comes late by lag and hold.
    lag = scenario.identified_model.nearest(25.0, np.radians(15.0)).lags[0]
    late = 0.5 * 20.0 / 30.0 + lag.whole + 0.01
    assert one.K_max[0, 0] == pytest.approx(25.0 / scenario.flight.g_mps2 / late, rel=1e-6)


@pytest.mark.slow
def test_the_slower_rate_of_the_load_factor_decides_the_sensitivity_of_gains_fed_back():
    def gains(rate):
        limits = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 60.0}
        limits |= {"n_z": [0.0, 2.0], "n_z_rate_per_s": rate}
        law = [{"name": "exact", "kind": "exact"}]
        changes = {"limits": limits, "law": law, "gains": ["tuned_fed_back"], "expect": []}
        scenario = ft.load_scenario("paper_identified", changes=changes)
        return gain_set(scenario, "tuned_fed_back")

    assert gains([-0.8, 3.0]) == gains([-3.0, 0.8]) == gains(0.8)
