"""Rigid-body linearisation of a trimmed JSBSim aircraft, and its modes."""

import math
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.bench import CONTROLS, AirframeState, Bench, slopes
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.trim import trim

# States of the longitudinal motion, then of the lateral one.
STATES = ("V_a", "alpha", "theta", "q", "beta", "phi", "p", "r")

# Share of its size from which an eigenvalue's imaginary part counts: below it is rounding.
OSCILLATES = 1e-9

# Half widths of the central differences: rad, rad/s, m/s and 1. Airspeed and throttle come last,
# because the engine settles anew for them.
_HALF_WIDTHS = {**dict.fromkeys((*STATES[1:], *CONTROLS[:-1]), 1e-3), "V_a": 0.1, "throttle": 0.01}


def linearize(config: AircraftConfig, condition: FlightCondition) -> tuple[FloatArray, FloatArray]:
    """Linearise the airframe of an aircraft about steady flight at `condition`.

    Returns A and B of ``x' = A x + B u``, shapes (8, 8) and (8, 4): states `STATES`, inputs
    `CONTROLS`, SI and rad, inner loop off and without actuator lags.
    """
    fdm = Fdm(config)
    x_0 = trim(fdm, condition)
    bench = Bench(fdm, condition.h)
    # Not JSBSim's FGLinearization: it never returns where an engine takes its time to settle, and
    # ends the process for an aircraft without engine. Where it works it agrees.
    by = slopes(lambda state: _state_rates(state, bench.accelerations(state)), x_0, _HALF_WIDTHS)
    A, B = (np.column_stack([by[name] for name in names]) for names in (STATES, CONTROLS))
    return A, B


def _state_rates(state: AirframeState, measured: dict[str, float]) -> FloatArray:
    """Rates of `STATES` from the accelerations measured in `state`."""
    u, v, w = state.velocity
    u_dot, v_dot, w_dot = (measured[name] for name in ("u_dot", "v_dot", "w_dot"))
    # Derivatives of V_a = |(u, v, w)|, alpha = atan2(w, u) and beta = asin(v / V_a).
    V_dot = (u * u_dot + v * v_dot + w * w_dot) / state.V_a
    ahead = math.hypot(u, w)
    sin_phi, cos_phi = math.sin(state.phi), math.cos(state.phi)
    turning = state.q * sin_phi + state.r * cos_phi
    alpha_dot = (u * w_dot - w * u_dot) / ahead**2
    theta_dot = state.q * cos_phi - state.r * sin_phi
    beta_dot = (v_dot - v * V_dot / state.V_a) / ahead
    phi_dot = state.p + math.tan(state.theta) * turning
    p_dot, q_dot, r_dot = (measured[name] for name in ("p_dot", "q_dot", "r_dot"))
    return np.array([V_dot, alpha_dot, theta_dot, q_dot, beta_dot, phi_dot, p_dot, r_dot])


def modes(A: FloatArray) -> list[dict[str, Any]]:
    """Natural motions of an airframe with its controls fixed, A of `linearize`, as records."""
    longitudinal, lateral = (
        sorted(map(complex, np.linalg.eigvals(block)), key=abs, reverse=True)
        for block in (A[:4, :4], A[4:, 4:])
    )
    pairs = [value for value in lateral if _oscillates(value)]
    real = [value for value in lateral if not _oscillates(value)]
    # In each plane the fastest comes first. The two largest longitudinal eigenvalues are the short
    # period, the others the phugoid; either may be two motions without oscillation. The faster
    # lateral pair is the dutch roll; the largest real eigenvalue is the roll mode, the smallest the
    # spiral.
    named = [
        *zip(["short period"] * 2 + ["phugoid"] * 2, longitudinal, strict=True),
        *zip(["dutch roll"] * 2 + ["roll-spiral"] * 2, pairs, strict=False),
        *zip(["roll", *["lateral"] * (len(real) - 2), "spiral"], real, strict=False),
    ]
    return [
        {
            "name": name,
            "eigenvalue_per_s": [value.real, value.imag],
            "natural_frequency_rad_s": abs(value),
            # 1 or -1 for a motion without oscillation, 0 for none at all
            "damping": -value.real / abs(value) if value else 0.0,
        }
        for name, value in named
        if not (_oscillates(value) and value.imag < 0.0)
    ]


def _oscillates(eigenvalue: complex) -> bool:
    return abs(eigenvalue.imag) > OSCILLATES * abs(eigenvalue)
