"""Gains for gusts and estimation errors, under bounds on the rates of the commands."""

import math
from functools import cache

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.control.tuning.noise import Noise, NoisyLoop

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
