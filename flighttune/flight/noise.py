"""Gusts and estimation errors for which the gains of a scenario are tuned."""

import math

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.control.law import Law
from flighttune.control.tuning.noise import Noise
from flighttune.flight.conditions import limits_on
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.jsbsim.linearize import STATES, linearize
from flighttune.vehicles.plants.jsbsim.trim import level
from flighttune.vehicles.plants.navigation import Navigation
from flighttune.vehicles.plants.weather import turbulence_scales
from flighttune.vehicles.weather_keys import INTENSITIES

# Standard deviation of a gust over the wind 20 ft above the ground, which is light.
GUST_SHARE = 0.1

# Default bounds on the rms rates of the commands, as shares of the limits of the rates.
RATE_SHARE = 0.1, 0.15

# Frequencies (rad/s) from the slowest that matters in a flight to that of half the sample rate.
SLOWEST, FREQUENCIES = 1e-3, 300


def tuning_noise(scenario: Scenario, law: Law) -> Noise | None:
    """The noise for which gains are tuned under bounds on command rates; None without a grade.

    Gusts are those of light Dryden turbulence below 1000 ft, of MIL-F-8785C. An aircraft follows
    them with the lags of its free airframe, which is linearised in level flight.
    """
    settings, f = scenario.tuning, scenario.flight
    if settings.navigation is None:
        return None
    V_a, g, dt = f.V_a_mps, f.g_mps2, 1.0 / scenario.controller.rate_hz
    omega = np.geomspace(SLOWEST, math.pi / dt, FREQUENCIES)
    p, m = (3, 3) if scenario.airspeed else (2, 2)
    seen = Navigation.of(settings.navigation).densities(omega, dt, V_a)
    measured, rates_max = np.zeros((m, len(omega))), np.full(m, math.inf)
    measured[:2], rates_max[:2] = (seen["phi"], seen["n_z"]), _rates_max(scenario)
    return Noise(
        omega=omega,
        gusts=_gusts(scenario, omega)[:p],
        estimates=np.array([seen["chi"], seen["gamma"], seen["V_a"]])[:p],
        measured=measured,
        units=np.full(m, law.command_per_rate(V_a, g) * g / V_a),
        rates_max=rates_max,
        dt=dt,
    )


def _rates_max(scenario: Scenario) -> FloatArray:
    """Largest rms rates of roll (rad/s) and load factor (1/s)."""
    if (stated := scenario.tuning.command_rate_max) is not None:
        return np.array([stated[0] * DEG, stated[1]])
    limits = limits_on(scenario, scenario.aircraft)
    rates = np.minimum(limits.rate_upper, -limits.rate_lower)[:2]
    return np.array(RATE_SHARE) * rates


def _gusts(scenario: Scenario, omega: FloatArray) -> FloatArray:
    """Densities of the angles by which gusts turn the path, and of the airspeed, shape (3, k)."""
    V_a, h = scenario.flight.V_a_mps, scenario.flight.h_m
    across, down = turbulence_scales(h)
    sd = GUST_SHARE * INTENSITIES["light"][1] / V_a
    lags = np.zeros(3)
    if scenario.aircraft:
        config = scenario.aircraft[0].config
        A, _ = linearize(config, level(config, V_a, h))
        lags[:2] = [-1.0 / A[i, i] for i in map(STATES.index, ("beta", "alpha"))]
    a = V_a / np.array([across, down, across])[:, None]
    x = (omega / a) ** 2
    dryden = sd**2 * (1.0 + 3.0 * x) / (1.0 + x) ** 2 / (math.pi * a)
    return dryden / (1.0 + (lags[:, None] * omega) ** 2)
