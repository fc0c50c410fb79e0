"""Tuning for several models: channels, the worst one, and what cannot be asked."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.inner_loop import inner_loop_scaling, with_inner_loop
from flighttune.control.tuning import envelope
from flighttune.control.tuning.envelope import channels, tune_worst_case
from flighttune.flight.gains import _tuned_for


def problem(w=8.0, gamma=0.25, lags=None, **kept):
    law = ft.loop.kinematic_model(V_a=25.0, gamma=gamma, g=9.81)
    second = {"order": 2, "damping": 0.7, "delay": 0.05}
    lags = lags or [ft.loop.InnerLag(natural_frequency=f, **second) for f in (w, 2.0 * w)]
    return ft.loop.TuningProblem(
        model=with_inner_loop(law, lags), scaling=inner_loop_scaling(law, lags), seed=1, **kept
    )


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
