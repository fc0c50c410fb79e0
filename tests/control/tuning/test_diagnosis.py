"""Why the printed problem is infeasible, held against tuning at the factors diagnosed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import flighttune as ft
from flighttune.control.tuning.tune import diagnosis

# Level flight at 25 m/s, in which the integral gain of the course is the only free gain.
ALONE = ft.loop.TuningProblem(
    model=ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81),
    K_fixed=np.array([[4.0, 0.0, np.nan, 0.0], [0.0, 4.0, 0.0, 3.0]]),
)


def radius(K_I):
    """I_K by the integral gain of the course: it falls up to 3, and is that of the path to 6."""
    gains = ft.PIGains(K_P=4.0 * np.eye(2), K_I=np.diag([K_I, 3.0]))
    return ft.loop.indicators(ft.loop.closed_loop(ALONE.model, gains)).I_K


def test_a_command_that_the_fixed_gains_alone_exceed_leaves_none_and_its_limit_is_in_the_way():
    """An error of 0.1 rad asks for four times the roll allowed, the integral gain for the rest."""
    limits = ft.loop.Limits(
        lower=(-0.1, -np.inf), upper=(0.1, np.inf), rate_lower=(-9.0, -np.inf),
        rate_upper=(9.0, np.inf),
    )  # fmt: skip
    problem = replace(ALONE, I_star=20.0, limits=limits, x_0=np.array([0.1, 0.0]))
    needed = brentq(lambda K_I: radius(K_I) - 20.0, 1.0, 3.0, rtol=1e-9)

    tuned, found = ft.tune(problem, starts=1), diagnosis(problem)

    assert (tuned.status, tuned.gains, tuned.smallest_I_K) == ("infeasible", None, None)
    assert (tuned.R_K, tuned.agreeing) == (0.0, 0)
    assert "No stabilising gains were found within the limits" in tuned.reason
    assert (found.smallest_I_K, found.largest_R_K) == (np.inf, 0.0)
    assert found.common_factor == pytest.approx(4.0 + 0.1 * needed, rel=1e-6)
    assert found.binding == ("phi_max",)
    of_roll, of_rate = found.limits
    assert (of_roll["name"], of_rate["name"]) == ("phi", "phi_rate")
    assert of_roll["factor_alone"] == pytest.approx(4.0 + 0.1 * needed, rel=1e-6)
    assert of_roll["smallest_I_K_without"] == pytest.approx(radius(4.0), rel=1e-6)
    assert (of_rate["factor_alone"], of_rate["smallest_I_K_without"]) == (np.inf, np.inf)
    assert of_rate["use"] == pytest.approx(0.1 * needed / 9.0, rel=1e-6)


@pytest.mark.parametrize(("I_star", "factor"), [(20.0, 0.0), (10.0, np.inf)])
def test_where_no_limit_is_in_the_way_there_is_no_factor_or_none_suffices(I_star, factor):
    found = diagnosis(replace(ALONE, I_star=I_star))

    assert (found.common_factor, found.limits) == (factor, ())
    assert (found.gains is None) == (factor > 0.0)
    assert found.smallest_I_K == pytest.approx(radius(4.0), rel=1e-6)
    assert found.largest_R_K > 0.0


def test_gains_that_no_bound_allows_have_no_cost_either():
    weights = np.ones(2), np.ones(2)
    costly = replace(ALONE, I_star=10.0, weights=weights, x_0=np.array([0.1, 0.0]))

    found = ft.tune(costly, starts=1)

    assert found.status == "infeasible"
    assert "`I_star` must be at least 10.8" in found.reason
    assert radius(4.0) == pytest.approx(10.8, abs=0.05)


@pytest.mark.slow
def test_a_scenario_that_its_limits_make_infeasible_says_which_and_by_how_much():
    """In a decoupled climb the course needs an integral gain that its roll rate does not allow."""
    limits = {"phi_deg": [-60.0, 60.0], "phi_rate_dps": 20.0, "n_z": [-3.0, 4.0]}
    changes = {f"limits.{key}": value for key, value in limits.items()}
    changes |= {"limits.n_z_rate_per_s": 9.0, "tuning.I_star": 8.0, "tuning.structure": "decoupled"}

    tuned = ft.tune("paper", changes=changes | {"tuning.input_limits": True}, starts=1)

    found, model, near = tuned.diagnosis, tuned.problem.model, {"rel": 1e-5}
    K, x_0 = found.gains.K, tuned.problem.x_0
    at_start, rates = K @ np.append(x_0, 0.1 * x_0), K[:, 2:] @ x_0
    assert tuned.status == "infeasible"
    assert found.binding == ("phi_rate_min",)
    assert -rates[0] == pytest.approx(found.common_factor * math.radians(20.0), **near)
    loop = ft.loop.indicators(ft.loop.closed_loop(model, found.gains))
    assert loop.I_K == pytest.approx(8.0, **near)
    rows = {row["name"]: row for row in found.limits}
    assert found.limits[0]["name"] == "phi_rate"
    assert rows["phi_rate"]["use"] == pytest.approx(found.common_factor, **near)
    assert rows["phi"]["use"] == pytest.approx(-at_start[0] / math.radians(60.0), **near)
    assert rows["n_z"]["use"] == pytest.approx(-at_start[1] / 3.0, **near)
    assert rows["n_z_rate"]["use"] == pytest.approx(-rates[1] / 9.0, **near)
    assert (found.smallest_I_K, tuned.smallest_I_K) == pytest.approx((tuned.I_K,) * 2, **near)
    # without the limit in the way the bound is met; without another it is not
    assert rows["phi_rate"]["smallest_I_K_without"] < 8.0 < rows["phi"]["smallest_I_K_without"]
    assert 1.0 < found.common_factor <= rows["phi_rate"]["factor_alone"] < math.inf
    assert {rows[name]["factor_alone"] for name in ("phi", "n_z", "n_z_rate")} == {math.inf}
    assert 0.0 < found.largest_R_K < 0.54
