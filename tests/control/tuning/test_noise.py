"""Gains for gusts and estimation errors, under bounds on the rates of the commands."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fuzzing import slow
from made_up import made_up_scenario
from scipy.integrate import quad

import flighttune as ft
from flighttune.control.tuning.noise import Noise, NoisyLoop
from flighttune.control.tuning.shaped import GustLoop
from flighttune.vehicles.plants.navigation import ERRORS
from tests.control.tuning.test_fed_back import lags, sensitivity

DEG, DT, V_A = math.pi / 180.0, 0.02, 25.0
SUMMED = 2e-3  # relative: a sum over logarithmic frequencies in place of an integral
HELD, BETTER = 2e-3, 5e-3

INTEGRATOR = ft.loop.LinearModel(
    A=[[0.0]], B=[[-1.0]], C=[[1.0]], states=("e",), inputs=("chi_dot",), errors=("chi",)
)
OMEGA = np.geomspace(1e-4, math.pi / DT, 4000)


def noise(omega=OMEGA, **densities):
    """Noise on one channel; what is left out is zero."""
    zero = np.zeros((1, len(omega)))
    parts = {name: densities.get(name, zero) for name in ("gusts", "estimates", "measured")}
    ones = np.ones(1)
    return Noise(omega=omega, units=2.0 * ones, rates_max=ones, dt=DT, **parts)


def rms(gains, model=INTEGRATOR, feedback=0.0, **densities):
    loop = NoisyLoop(model, noise(**densities))
    return loop.rms(np.array([gains]), np.array([feedback]))


def test_an_integrator_under_proportional_control_has_the_error_of_a_first_order_filter():
    """White errors of density S leave ``e = K / (s + K) n``: a variance of ``S K pi / 2``."""
    K_P, S = 1.5, 1e-4

    found = rms([K_P, 0.0], estimates=np.full((1, len(OMEGA)), S))

    assert found.errors == pytest.approx([math.sqrt(S * K_P * math.pi / 2.0)], rel=0.01)


def test_the_rate_of_a_command_is_that_of_its_samples():
    """``u = K s / (s + K) n``: a difference of samples over dt, in units of two inputs."""
    K_P, S = 1.5, 1e-4

    def density(w):
        return S * (K_P * w) ** 2 / (w * w + K_P**2) * (2.0 * math.sin(w * DT / 2.0) / DT) ** 2

    by_hand = math.sqrt(quad(density, 0.0, math.pi / DT)[0]) / 2.0
    found = rms([K_P, 0.0], estimates=np.full((1, len(OMEGA)), S))
    assert found.rates == pytest.approx([by_hand], rel=SUMMED)


def test_gusts_alone_leave_the_errors_of_the_lyapunov_equation():
    """The same loop and Dryden spectrum by `GustLoop`, in the time domain, with feedback."""
    a, w = 0.05, 6.0
    names = {"states": ("chi", "chi_dot"), "inputs": ("chi_dot",), "errors": ("chi",)}
    model = ft.loop.LinearModel(A=[[0.0, -1.0], [0.0, -w]], B=[[0.0], [w]], C=[[1.0, 0.0]], **names)
    omega = np.geomspace(1e-4, 1e5, 6000)
    x = (omega / a) ** 2
    dryden = (1.0 + 3.0 * x) / (1.0 + x) ** 2 / (math.pi * a)

    problem = ft.loop.TuningProblem(model=model, objective="rms", gusts=np.array([a]))
    by_lyapunov = GustLoop(problem).errors(np.array([[1.5, 0.8]]), np.array([0.4]))
    found = rms([1.5, 0.8], model, 0.4, omega=omega, gusts=dryden[None])
    assert found.errors == pytest.approx(by_lyapunov, rel=SUMMED)


def test_densities_of_navigation_have_the_deviations_of_the_covariance_recursion():
    """0.0657 m/s of velocity and 0.133 deg of tilt, by the recursion in test_navigation.py."""
    quiet = ft.loop.Navigation.of("standard", roll_noise=0.0)
    densities = quiet.densities(OMEGA, DT, V_A)
    sd = {name: math.sqrt(np.trapezoid(each, OMEGA)) for name, each in densities.items()}

    assert sd["chi"] * V_A == pytest.approx(0.0657, rel=0.005)
    assert sd["phi"] / DEG == pytest.approx(0.133, rel=0.01)
    assert sd["n_z"] == pytest.approx(quiet.n_z_noise, rel=SUMMED)
    assert sd["V_a"] * V_A == pytest.approx(math.hypot(0.3, 0.2), rel=0.01)


@pytest.mark.slow
def test_densities_of_navigation_are_those_of_drawn_errors():
    """Variance of velocity and climb above 1 Hz, over 40 draws of 200 s."""
    n, V = 10_000, {"chi": "v_north", "gamma": "v_up"}
    omega = np.linspace(2.0 * math.pi, math.pi / DT, 2000)
    densities = ft.loop.Navigation.of("standard").densities(omega, DT, 1.0)
    flights = [
        ft.loop.Navigation.of("standard", seed=seed).errors(n, DT, V_A) for seed in range(40)
    ]
    for name, drawn in V.items():
        errors = np.array(flights)[:, :, ERRORS.index(drawn)]
        lines = np.abs(np.fft.rfft(errors * np.hanning(n), axis=1)) ** 2
        fast = np.fft.rfftfreq(n, DT) >= 1.0
        power = 2.0 * lines[:, fast].sum(axis=1).mean() / n / np.sum(np.hanning(n) ** 2)
        assert np.trapezoid(densities[name], omega) == pytest.approx(power, rel=0.03)


@cache
def tuned(*rates, **tuning):
    keys = {"model": "identified", "identified": "aerosonde", "objective": "rms", "feedback": True}
    stated = {"command_rate_max": list(rates)} if rates else {}
    plant = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    tables = {"tuning": keys | stated | {"navigation": "standard"} | tuning, "plant": plant}
    return ft.tune(made_up_scenario(law=["exact"], gains=["tuned"], **tables), starts=3)


@pytest.mark.parametrize("rates", [(4.0, 0.2), *slow(((3.0, 0.1),))])
@pytest.mark.slow
def test_the_rates_of_the_commands_are_at_their_bounds_which_are_named(rates):
    result = tuned(*rates)
    roll, lift = result.in_noise.rates

    assert (roll / DEG, lift) == pytest.approx(rates, rel=HELD)
    assert "command_rate" in result.active
    assert any("100% and 100% of their bounds" in note for note in result.answer().notes)


@pytest.mark.slow
def test_the_default_bounds_are_shares_of_the_limits_of_the_aircraft():
    """The Aerosonde's rates are 30 deg/s and 1 1/s; the scenario states none."""
    roll, lift = tuned().problem.noise.rates_max

    assert (roll / DEG, lift) == pytest.approx((3.0, 0.15))


@pytest.mark.slow
def test_calmer_commands_cost_errors_and_wide_bounds_cost_nothing():
    calm, wide = tuned(3.0, 0.1), tuned(100.0, 100.0)

    assert (calm.in_noise.errors > wide.in_noise.errors).all()
    assert (wide.in_noise.rates[0] / DEG, wide.in_noise.rates[1]) > (4.0, 0.3)
    assert "command_rate" not in wide.active


@pytest.mark.soak
def test_random_gains_around_the_answer_are_no_better():
    result, rng = tuned(4.0, 0.2), np.random.default_rng(1)
    problem, gains = result.problem, result.gains
    loop = NoisyLoop(problem.model, problem.noise)
    for _ in range(400):
        K = gains.K * rng.uniform(0.85, 1.15, gains.K.shape)
        fed = np.array(gains.feedback) * rng.uniform(0.85, 1.15, 2)
        found = loop.rms(K, fed)
        K_P, K_I = np.diag(K[:, :2]), np.diag(K[:, 2:])
        peaks = np.array([*map(sensitivity, lags(), K_P, K_I, fed)])
        allowed = (found.rates <= problem.noise.rates_max) & (peaks <= problem.sensitivity_max)
        assert (found.errors >= result.in_noise.errors * (1.0 - BETTER))[allowed].all()


def test_a_grade_needs_the_objective_and_a_bound_needs_the_grade():
    with pytest.raises(ft.InputError, match=r"`navigation` must be absent without objective"):
        tuned(objective="decay")
    with pytest.raises(ft.InputError, match=r"`command_rate_max` must be absent without"):
        tuned(4.0, 0.2, navigation=None)


def test_noise_must_be_positive_and_fit_the_channels():
    good = noise()
    with pytest.raises(ft.InputError, match=r"`omega` must be positive and rise"):
        replace(good, omega=good.omega[::-1])
    with pytest.raises(ft.InputError, match=r"`rates_max` must be 1 positive numbers"):
        replace(good, rates_max=np.zeros(1))


@pytest.mark.soak
def test_gentle_gains_keep_the_errors_with_calmer_commands_and_ailerons():
    """The ailerons move a third less on four legs in light turbulence with a standard receiver."""
    legs = (0.0, 0.0), (560.0, 0.0), (730.0, 560.0), (340.0, 950.0), (-220.0, 1120.0)
    changes = {
        "route.waypoint": [{"north_m": n, "east_m": e} for n, e in legs],
        "gains": ["tuned_fed_back", "tuned_gentle"],
        "navigation": {"grade": "standard"},
        "turbulence": {"intensity": "light"},
        "seed": 7,
        "expect": [],
    }
    quick, gentle = (run.signals for run in ft.fly("circuit", changes=changes).runs[-2:])

    def rate(signals, name):
        return float(np.sqrt(np.mean(np.diff(signals[name]) ** 2)))

    for name, most in (("phi_cmd", 0.8), ("n_z_cmd", 0.5), ("aileron", 0.7)):
        assert rate(gentle, name) < most * rate(quick, name)
    for name in ("cross_track", "height_err"):
        sides = (float(np.quantile(np.abs(signals[name]), 0.95)) for signals in (gentle, quick))
        ratio = next(sides) / next(sides)
        assert ratio == pytest.approx(1.0, abs=0.03)
