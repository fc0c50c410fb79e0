"""Gains for gusts and estimation errors, under bounds on the rates of the commands."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

DEG, DT, V_A = math.pi / 180.0, 0.02, 25.0
SUMMED = 2e-3  # relative: a sum over logarithmic frequencies in place of an integral
HELD, BETTER = 2e-3, 5e-3

OMEGA = np.geomspace(1e-4, math.pi / DT, 4000)


def test_densities_of_navigation_have_the_deviations_of_the_covariance_recursion():
    """0.0657 m/s of velocity and 0.133 deg of tilt, by the recursion in test_navigation.py."""
    quiet = ft.loop.Navigation.of("standard", roll_noise=0.0)
    densities = quiet.densities(OMEGA, DT, V_A)
    sd = {name: math.sqrt(np.trapezoid(each, OMEGA)) for name, each in densities.items()}

    assert sd["chi"] * V_A == pytest.approx(0.0657, rel=0.005)
    assert sd["phi"] / DEG == pytest.approx(0.133, rel=0.01)
    assert sd["n_z"] == pytest.approx(quiet.n_z_noise, rel=SUMMED)
    assert sd["V_a"] * V_A == pytest.approx(math.hypot(0.3, 0.2), rel=0.01)


@cache
def tuned(*rates, **tuning):
    keys = {"model": "identified", "identified": "aerosonde", "objective": "rms", "feedback": True}
    stated = {"command_rate_max": list(rates)} if rates else {}
    plant = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    tables = {"tuning": keys | stated | {"navigation": "standard"} | tuning, "plant": plant}
    return ft.tune(made_up_scenario(law=["exact"], gains=["tuned"], **tables), starts=3)


@pytest.mark.slow
@pytest.mark.parametrize(("bounds", "held"), [((4.0, 0.2), [0, 1]), ((3.0, 0.5), [0])])
def test_the_rates_of_the_commands_are_at_their_bounds_which_are_named(bounds, held):
    result = tuned(*bounds)
    roll, lift = result.in_noise.rates
    shares = np.array([roll / DEG, lift]) / bounds

    assert shares[held] == pytest.approx(1.0, rel=HELD)
    assert (shares <= 1.0 + HELD).all()
    assert "command_rate" in result.active
    percents = "% and ".join(f"{100.0 * share:.0f}" for share in shares)
    assert any(f"{percents}% of their bounds" in note for note in result.answer().notes)


@pytest.mark.slow
def test_errors_and_rates_are_those_of_the_transfer_functions_of_each_channel():
    """Of gusts d, errors of the estimates and of what is fed back, with a lag P of each command.

    The command is ``u = a (e - n) - k (P u + d' + m)`` with ``a = (1 + k) (K_P + K_I / s)``, and
    ``e = -d - P u / s``; a rate is the difference of two samples.
    """
    result = tuned(4.0, 0.2)
    noise, gains = result.problem.noise, result.gains
    w, s = noise.omega, 1j * noise.omega
    moved = (2.0 * np.sin(0.5 * w * noise.dt) / noise.dt) ** 2
    lags = ft.loop.load_identified("aerosonde").nearest(V_A, 0.0).lags
    for i, lag in enumerate(lags):
        h, own = lag.delay + 0.5 * DT, replace(lag, delay=0.0).response(w)
        P = (1.0 - 0.5 * s * h) / (1.0 + 0.5 * s * h) * own
        k = gains.feedback[i]
        a = (1.0 + k) * (gains.K_P[i, i] + gains.K_I[i, i] / s)
        returned = 1.0 + a * P / s + k * P
        commands = [x / returned for x in (a + k * s, a, k * noise.units[i])]
        errors = [P / s * u for u in commands]
        errors[0] = errors[0] - 1.0
        densities = noise.gusts[i], noise.estimates[i], noise.measured[i]

        def rms(responses, by=1.0, densities=densities):
            power = sum(np.abs(x) ** 2 * d for x, d in zip(responses, densities, strict=True))
            return math.sqrt(np.trapezoid(power * by, w))

        assert result.in_noise.errors[i] == pytest.approx(rms(errors), rel=1e-9)
        rate = rms(commands, moved / noise.units[i] ** 2)
        assert result.in_noise.rates[i] == pytest.approx(rate, rel=1e-9)


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
