"""Linear models and tuning problems of scenarios, against formulas of design/roll_rate.md."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

V, G = 25.0, 9.81
LIMITS = {
    "phi_deg": [-45.0, 40.0], "phi_rate_dps": 90.0, "n_z": [0.0, 2.0], "n_z_rate_per_s": 1.5,
}  # fmt: skip
BEHIND = {"plant": [{"kind": "point_mass_lag", "identified": "aerosonde"}]}
HALF_A_SAMPLE = 0.01


def scenario(law="paper", tuning=None, **changes):
    """A climb of 6 deg on the lags of the Aerosonde, sampled at 50 Hz."""
    return made_up_scenario(**{
        "flight": {"V_a_mps": V, "h_m": 1000.0, "chi_deg": 350.0},
        "law": np.atleast_1d(law).tolist(),
        "reference": {"chi_deg": 10.0, "gamma_deg": 6.0}, "limits": LIMITS,
        "tuning": {"model": "identified", "roll_rate": True, "lift_rate": True} | (tuning or {}),
    } | BEHIND | changes)  # fmt: skip


def whole_lags():
    """Seconds by which the nearest identified loop follows a ramp, and half a sample."""
    condition = ft.loop.load_identified("aerosonde").nearest(V, math.radians(6.0))
    return [lag.whole + HALF_A_SAMPLE for lag in condition.lags]


def of_loop(made, gains, *names):
    """Measures of the linear loop of gains, as requirements bound them."""
    own = {"name": "own", "K_P": gains.K_P.tolist(), "K_I": gains.K_I.tolist(), "law": gains.law}
    tables = made.as_dict() | {"gains": [own]}
    tables |= {"expect": [{"at_most": {"loop": dict.fromkeys(names, 1e9)}}]}
    tables["flight"] |= {"duration_s": 0.1}
    return [check.value for check in ft.fly(ft.scenario_from(tables)).claim.bounds]


def late():
    """Time by which a roll-out, and by which a change of the load factor, comes late."""
    roll, lift = whole_lags()
    error = math.radians(6.0)
    # A load factor is as late as it takes to change, and as much as the error asks for.
    root = np.roots([1.0, -lift, -V * error / (G * 2.0 * 1.5)]).max()
    return 40.0 / (2.0 * 90.0) + roll, float(root)


@pytest.mark.parametrize(("law", "per_rate"), [("paper", V / G), ("exact", 1.0)])
def test_gains_on_an_identified_loop_are_those_that_the_rate_limits_can_follow(law, per_rate):
    problem = ft.loop.tuning_problem(scenario(law))

    turn, climb = late()
    assert problem.K_max[0, 0] == pytest.approx(per_rate / turn)
    assert problem.K_max[0, 2] == pytest.approx(per_rate / (4.0 * turn**2))
    assert problem.K_max[1, 1] == pytest.approx(per_rate / climb)
    assert problem.K_max[1, 3] == pytest.approx(per_rate / (4.0 * climb**2))
    cross = [problem.K_max[i] for i in ((0, 1), (0, 3), (1, 0), (1, 2))]
    assert cross == [1000.0] * 4  # as [tuning] has it
    assert np.array_equal(problem.K_min, -problem.K_max)
    # the first error is turned the short way
    assert problem.x_0 == pytest.approx([math.radians(20.0), math.radians(6.0)])
    assert problem.limits is None
    assert problem.E_star == math.inf


@pytest.mark.parametrize(
    ("stated", "counts"), [(None, 1.4), (1.3, 1.3), (9.0, 0.5 / math.sin(math.radians(17.5)))]
)
def test_the_sensitivity_of_tuned_gains_leaves_35_deg_of_phase_at_least(stated, counts):
    tuning = {"objective": "decay", "sensitivity_max": stated}
    problem = ft.loop.tuning_problem(scenario(tuning=tuning))

    assert problem.sensitivity_max == pytest.approx(counts)
    assert problem.objective == "decay"


def test_a_first_error_of_the_path_angle_counts_from_that_of_the_start():
    climbing = scenario(flight={"V_a_mps": V, "h_m": 1000.0, "gamma_deg": 2.0})
    problem = ft.loop.tuning_problem(climbing)

    _, lift = whole_lags()
    slew = V * math.radians(4.0) / (G * 2.0 * 1.5)
    late = np.roots([1.0, -lift, -slew]).max()
    assert problem.K_max[1, 1] == pytest.approx(V / G / late)
    assert problem.x_0[1] == pytest.approx(math.radians(4.0))


def test_a_descent_counts_as_a_climb_and_the_slower_side_of_a_rate_as_both():
    descent = scenario(reference={"chi_deg": 10.0, "gamma_deg": -6.0})
    sides = {"phi_rate_dps": [-90.0, 120.0], "n_z_rate_per_s": [-1.5, 2.5]}
    other = {"phi_rate_dps": [-120.0, 90.0], "n_z_rate_per_s": [-2.5, 1.5]}
    expected = ft.loop.tuning_problem(scenario()).K_max

    for made in (*(scenario(limits=LIMITS | x) for x in (sides, other)), descent):
        problem = ft.loop.tuning_problem(made)
        assert problem.K_max == pytest.approx(expected)


@pytest.mark.parametrize(("without", "free"), [("phi_rate_dps", 0), ("n_z_rate_per_s", 1)])
def test_without_a_limit_of_its_rate_a_command_does_not_bound_its_gains(without, free):
    limited = scenario().as_dict()
    del limited["limits"][without]

    problem = ft.loop.tuning_problem(made_up_scenario(**limited))

    assert problem.K_max[free, [free, 2 + free]].tolist() == [1000.0, 1000.0]
    bounded = 1 - free
    assert (problem.K_max[bounded, [bounded, 2 + bounded]] < 1000.0).all()


def test_the_weight_on_the_airspeed_is_left_to_a_gain_of_its_own():
    """Along a climb the weight takes ``g sin(gamma)`` of the airspeed's rate."""
    limits = LIMITS | {"n_x": [-0.3, 0.4]}
    made = scenario(reference={"chi_deg": 10.0, "gamma_deg": 6.0, "V_mps": V}, limits=limits)

    problem = ft.loop.tuning_problem(made)

    V_of, gamma = (problem.model.states.index(name) for name in ("V", "gamma"))
    assert problem.model.A[V_of, gamma] == 0.0
    assert problem.x_0 == pytest.approx([math.radians(20.0), math.radians(6.0), 0.0])
    assert problem.K_max.shape == (3, 6)
    assert problem.K_max[2, [2, 5]].tolist() == [1000.0, 1000.0]
    tuned = ft.tune(made, starts=1).gains
    assert tuned.K_P[2, 1] == pytest.approx(-math.cos(math.radians(6.0)))
    coupled = [tuned.K[i] for i in ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 3), (2, 4))]
    assert coupled == [0.0] * 7


def test_a_smaller_largest_gain_counts_and_limits_that_are_not_asked_for_do_not():
    small, free, level = (
        ft.loop.tuning_problem(x)
        for x in (
            scenario(tuning={"gain_max": 0.3, "E_star": 2.0, "input_limits": True}),
            scenario(tuning={"roll_rate": False, "lift_rate": False}),
            scenario(reference={"chi_deg": 10.0, "gamma_deg": 0.0}),
        )
    )

    assert (small.K_max == 0.3).all()
    assert small.E_star == 2.0
    assert small.limits.upper == pytest.approx([math.radians(40.0), 2.0])
    assert (free.K_max == 1000.0).all()
    assert level.K_max[1, 1] == 1000.0  # no first error of the path angle
    assert level.K_max[0, 0] < 1000.0


@pytest.mark.parametrize("law", ["paper", "exact"])
def test_the_roll_rate_that_gains_need_is_that_which_allows_them(law):
    made = scenario(law)
    problem = ft.loop.tuning_problem(made)
    K = np.minimum(problem.K_max, 1.0) * [[1, 0, 1, 0], [0, 1, 0, 1]]
    for own, other in ((0, 2), (2, 0)):
        gains = K.copy()
        gains[0, own] = problem.K_max[0, own]
        gains[0, other] *= 0.01
        of = ft.PIGains.from_lists(gains[:, :2], gains[:, 2:], law=law)

        assert of_loop(made, of, "roll_rate_dps") == pytest.approx([90.0])
    steep = ft.PIGains.from_lists([[1e3, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 0.1]], law=law)
    assert of_loop(made, steep, "roll_rate_dps") == [math.inf]  # no rate makes up for the lag
    unlimited = scenario(law)
    free = LIMITS.keys() - {"phi_deg"}
    unlimited = made_up_scenario(
        **unlimited.as_dict() | {"limits": {name: LIMITS[name] for name in free}}
    )
    assert math.isnan(*of_loop(unlimited, of, "roll_rate_dps"))


def test_margins_of_a_loop_are_those_of_the_textbook():
    """Course and path angle behind an integrator each: (k_P s + k_I) / s^2."""
    made = scenario(
        "exact", tuning={"model": "kinematic"}, reference={"chi_deg": 9.0, "gamma_deg": 0}
    )
    K_P, K_I = np.array([5.0, 2.0]), np.array([1.0, 3.0])
    gains = ft.PIGains.from_lists(np.diag(K_P), np.diag(K_I), law="exact")

    names = "phase_margin_rad", "delay_margin_s", "gain_margin_dB", "disk_margin"
    found = dict(zip(names, of_loop(made, gains, *names), strict=True))

    crossing = np.sqrt(0.5 * (K_P**2 + np.sqrt(K_P**4 + 4.0 * K_I**2)))
    phase = np.arctan2(K_P * crossing, K_I)
    assert found["phase_margin_rad"] == pytest.approx(phase.min())
    # that of the course, which is crossed at the higher frequency
    assert found["delay_margin_s"] == pytest.approx((phase / crossing).min())
    assert np.argmin(phase) != np.argmin(phase / crossing)
    assert found["gain_margin_dB"] == math.inf
    assert 0.0 < found["disk_margin"] <= 2.0


@pytest.mark.parametrize(("K_P", "nearer"), [([9.0, 2.0], 0), ([2.0, 9.0], 1)])
def test_a_gain_margin_is_that_of_the_channel_that_swings_first(K_P, nearer):
    made = scenario("exact", tuning={"model": "kinematic", "sample_delay": True,
        "lag_rad_s": [5.0, 5.0], "roll_rate": False, "lift_rate": False,
    })  # fmt: skip
    gains = ft.PIGains.from_lists(np.diag(K_P), np.diag([0.2, 0.3]), law="exact")
    (margin,) = of_loop(made, gains, "gain_margin_dB")

    model = ft.loop.tuning_problem(made).model
    for factor, stable in ((0.999, True), (1.001, False)):
        each = np.ones(2)
        each[nearer] = factor * 10.0 ** (margin / 20.0)
        A_cl = ft.loop.closed_loop(replace(model, B=model.B * each), gains)
        assert (np.linalg.eigvals(A_cl).real.max() < 0.0) == stable


def test_noise_for_tuning_is_that_of_light_gusts_and_a_share_of_the_rate_limits():
    """MIL-F-8785C: a deviation of a tenth of 15 knots, and Dryden's scales at 100 m."""
    made = scenario("exact", tuning={"objective": "rms", "navigation": "standard"},
                    flight={"V_a_mps": V, "h_m": 100.0})  # fmt: skip
    problem = ft.loop.tuning_problem(made)
    found = problem.noise

    sd = 0.1 * 7.7 / V
    # Below 1000 ft the slowest gusts are those of 2 pi V / L, well above 1e-3 rad/s.
    assert np.trapezoid(found.gusts, found.omega, axis=1) == pytest.approx(
        [sd**2] * len(found.gusts), rel=0.03
    )
    feet = 100.0 / 0.3048
    across, down = (x * 0.3048 for x in (feet / (0.177 + 0.000823 * feet) ** 1.2, feet))
    slow = sd**2 / (math.pi * V) * np.array([across, down])
    assert found.gusts[:, 0] == pytest.approx(slow, rel=1e-3)
    assert found.rates_max == pytest.approx([0.1 * math.radians(90.0), 0.15 * 1.5])
    assert found.dt == 0.02
    assert (found.omega[0], found.omega[-1]) == pytest.approx((1e-3, math.pi / 0.02))
    seen = ft.loop.Navigation.of("standard").densities(found.omega, 0.02, V)
    assert np.array_equal(found.estimates, [seen["chi"], seen["gamma"]])
    assert np.array_equal(found.measured, [seen["phi"], seen["n_z"]])
    assert problem.gusts == pytest.approx([V / across, V / down])
    assert found.units == pytest.approx([G / V] * 2)  # of a rate; the law's command is one
    stated = scenario("exact", tuning={
        "objective": "rms", "navigation": "rtk", "command_rate_max": [6.0, 0.2],
    })  # fmt: skip
    assert ft.loop.tuning_problem(stated).noise.rates_max == pytest.approx([math.radians(6.0), 0.2])
    calm = scenario("exact")
    of_calm = ft.loop.tuning_problem(calm)
    assert (of_calm.objective, of_calm.gusts, of_calm.noise) == ("R_K", None, None)


W = np.array([0.3, 2.0, 11.0])  # rad/s


def response(model):
    """From the commands to the errors at `W`, shape (3, p, m)."""
    n = len(model.states)
    inside = [np.linalg.solve(1j * w * np.eye(n) - model.A, model.B) for w in W]
    return np.array([model.C @ x for x in inside])


def test_a_model_behind_assumed_lags_and_half_a_sample_has_their_phase():
    tuning = {"model": "kinematic", "roll_rate": False, "lift_rate": False}
    plain, lagged, held = (
        ft.loop.tuning_problem(scenario(tuning=tuning | more)).model
        for more in ({}, {"lag_rad_s": [5.0, 8.0]}, {"sample_delay": True})
    )

    of_lags = 1.0 / (1.0 + 1j * W[:, None] / np.array([5.0, 8.0]))
    assert response(lagged) == pytest.approx(response(plain) * of_lags[:, None, :])
    late = np.exp(-1j * W * HALF_A_SAMPLE)[:, None, None]
    assert response(held) == pytest.approx(response(plain) * late, rel=1e-3)
