"""The continuous loop against an implicit method that knows nothing of switches."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flighttune.control.gains import PAPER_GAINS, PIGains, paper_family
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError, ShapeError
from flighttune.plants.base import FlightCondition
from flighttune.plants.kinematic import KinematicPlant
from flighttune.simulate.continuous import continuous_flight
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.loop import simulate
from flighttune.simulate.reference import Reference

TRAJECTORY = 1e-6  # rad, what the reproduction of the paper asks for
STEEPNESS = 1e7  # 1/s: an error of the softened law of about 1e-7 rad
NEVER = math.inf
RANGE = ([-math.pi / 4, -2.1], [math.pi / 4, 2.1])
RATES = ([-math.pi / 6, -1.0], [math.pi / 6, 1.0])
MAGNITUDE = Limits(
    lower=RANGE[0], upper=RANGE[1], rate_lower=[-NEVER, -NEVER], rate_upper=[NEVER, NEVER]
)
PRINTED = Limits(lower=RANGE[0], upper=RANGE[1], rate_lower=RATES[0], rate_upper=RATES[1])
START = FlightCondition(V_a=25.0, chi=math.pi / 3, gamma=math.pi / 4, phi=math.pi / 3, n_z=1.0)
REF = (0.0, math.pi / 12)
WAVES = Sinusoid(chi_amplitude=0.1, chi_omega=0.15, gamma_amplitude=0.1, gamma_omega=0.15)
HALF_SECONDS = np.arange(41) * 0.5


def flown(gains=PAPER_GAINS, t=HALF_SECONDS, **settings):
    return continuous_flight(gains, t, condition=START, ref=REF, disturbance=WAVES, **settings)


def softened_errors(gains, limits, anti_windup):
    """Errors of the law with every jump replaced by a slope of `STEEPNESS`, by Radau IIA."""
    k, limited = STEEPNESS, bool(np.isfinite(limits.rate_upper).all())
    lead = np.linalg.norm(gains.K_I) / np.linalg.norm(gains.K_P)
    following = 2.0 * limits.rate_upper.max() / k if limited else 0.0

    def loop(t, y):
        e = REF - y[:2]
        v, b = gains.K_P @ e + y[2:4], gains.K_I @ e
        saturated = np.clip(v, limits.lower, limits.upper)
        u = y[4:] if limited else saturated
        z_dot = b
        if anti_windup == "conditional":
            z_dot = b * (1.0 - np.clip(k * ((v - u) * np.sign(b) - following), 0.0, 1.0))
        elif anti_windup == "back_calculation":
            z_dot = b - lead * (v - u)
        u_dot = np.clip(k * (saturated - u), limits.rate_lower, limits.rate_upper)
        chi_dot = 9.81 / 25.0 * math.tan(u[0]) + 0.1 * math.sin(0.15 * t)
        gamma_dot = 9.81 / 25.0 * (u[1] * math.cos(u[0]) - math.cos(y[1]))
        x_dot = [chi_dot, gamma_dot + 0.1 * math.cos(0.15 * t)]
        return np.concatenate([x_dot, z_dot, u_dot if limited else np.zeros(2)])

    start = [START.chi, START.gamma, 0.0, 0.0, START.phi, START.n_z]
    span, settings = (0.0, 20.0), {"rtol": 1e-9, "atol": 1e-11, "max_step": 0.02}
    found = solve_ivp(loop, span, start, method="Radau", t_eval=HALF_SECONDS, **settings)
    return REF - found.y[:2].T


@pytest.mark.parametrize("anti_windup", ["none", "conditional", "back_calculation"])
@pytest.mark.parametrize("limits", [MAGNITUDE, PRINTED], ids=["magnitude", "and_rate"])
@pytest.mark.parametrize("name", ["paper", "K1", "K6"])
def test_errors_agree_with_an_implicit_method_on_the_softened_law(name, limits, anti_windup):
    gains = paper_family()[name]

    flight = flown(gains, limits=limits, anti_windup=anti_windup)

    expected = softened_errors(gains, limits, anti_windup)
    assert flight.status == "completed"
    assert np.abs(flight.error - expected).max() < TRAJECTORY


@pytest.mark.parametrize("anti_windup", ["none", "conditional", "back_calculation"])
def test_the_sampled_controller_comes_closer_in_proportion_to_its_sample_time(anti_windup):
    def distance(dt):
        history = simulate(
            KinematicPlant(WAVES),
            MimoPI(PAPER_GAINS, PRINTED, dt=dt, anti_windup=anti_windup),
            Reference(chi=REF[0], gamma=REF[1]),
            condition=START,
            duration=12.0,
        )
        errors = history.signals[["chi_err", "gamma_err"]].to_numpy()[:: round(0.5 / dt)]
        return np.abs(errors - flown(limits=PRINTED, anti_windup=anti_windup).error[:25]).max()

    assert distance(0.01) / distance(0.005) == pytest.approx(2.0, rel=0.1)


def test_the_papers_peaks_are_those_of_magnitude_limits_alone():
    flight = flown(t=np.arange(2001) * 0.01, limits=MAGNITUDE)

    assert flight.error.max(axis=0) == pytest.approx([0.774, 0.361], abs=5e-4)
    assert flight.t[flight.error.argmax(axis=0)] == pytest.approx([5.24, 2.69], abs=0.01)


def test_the_error_rate_is_the_derivative_of_the_error():
    t = 3.0 + np.arange(3) * 1e-4
    flight = flown(t=t, limits=MAGNITUDE)

    slope = (flight.error[2] - flight.error[0]) / (t[2] - t[0])
    assert flight.error_rate[1] == pytest.approx(slope, abs=TRAJECTORY)


def test_commands_keep_their_limits_and_are_the_clipped_wish_where_only_these_hold():
    flight = flown(t=np.arange(2001) * 0.01, limits=MAGNITUDE)

    wish = flight.error @ PAPER_GAINS.K_P.T + flight.integral
    assert flight.unlimited == pytest.approx(wish, abs=TRAJECTORY)
    assert flight.u == pytest.approx(np.clip(wish, *RANGE), abs=TRAJECTORY)
    assert len(flight.switches) > 0


def test_a_command_that_starts_outside_its_range_comes_back_at_the_rate_limit():
    t = np.linspace(0.0, 0.5, 6)
    flight = flown(t=t, limits=PRINTED)

    assert flight.u[:, 0] == pytest.approx(math.pi / 3 - math.pi / 6 * t, abs=TRAJECTORY)


def test_conditional_anti_windup_holds_the_wish_at_the_limit_it_slides_along():
    still = PIGains(K_P=np.zeros((2, 2)), K_I=np.diag([1.0, 0.0]))
    flight = continuous_flight(
        still,
        np.linspace(0.0, 3.0, 7),
        condition=FlightCondition(V_a=25.0, chi=-1.0),
        ref=(0.0, 0.0),
        limits=MAGNITUDE,
        anti_windup="conditional",
    )

    met = flight.switches[0]
    after = flight.t > met
    assert after.any()
    assert flight.unlimited[after, 0].max() <= math.pi / 4 + TRAJECTORY


def test_without_feedback_the_disturbance_integrates_to_its_closed_form():
    flight = flown(PIGains(K_P=np.zeros((2, 2)), K_I=np.zeros((2, 2))))

    wave = 0.1 / 0.15 * (1.0 - np.cos(0.15 * HALF_SECONDS))
    assert flight.x[:, 0] == pytest.approx(START.chi + wave, abs=1e-10)


@pytest.mark.parametrize(("name", "roll_deg"), [("K2", -239.5), ("K3", -179.5), ("paper", -119.5)])
def test_a_wish_beyond_90_deg_of_roll_ends_the_flight(name, roll_deg):
    flight = flown(paper_family()[name])

    assert flight.status == "diverged"
    assert f"roll command {roll_deg} deg at t = 0.00 s" in flight.reason


@pytest.mark.parametrize("name", ["K2", "K3", "paper"])
def test_taken_literally_the_law_without_limits_diverges_upside_down(name):
    flight = flown(paper_family()[name], roll="any")

    assert flight.status == "diverged"
    assert "gamma 1000 rad" in flight.reason
    assert flight.t[-1] < 20.0


@pytest.mark.parametrize("name", ["K1", "K4", "K5", "K6"])
def test_taken_literally_the_law_without_limits_converges_for_the_others(name):
    flight = flown(paper_family()[name], roll="any")

    assert flight.status == "completed"
    assert np.abs(flight.error[-1]).max() < 0.1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"t": [0.0, 0.0]}, r"`t` must hold increasing times"),
        ({"t": [-1.0, 0.0]}, r"`t` must hold increasing times"),
        ({"anti_windup": "clamp"}, r"`anti_windup` must be none, .* got 'clamp'"),
        ({"tracking_time": 0.0}, r"`tracking_time` must be positive, got 0\.0"),
        ({"roll": "free"}, r"`roll` must be below_90_deg or any, got 'free'"),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        flown(**settings)


def test_gains_and_limits_must_be_of_two_commands():
    with pytest.raises(ShapeError, match=r"must be of two commands"):
        flown(limits=Limits.none(3))
