"""Gains of the inner loop from the derivatives of the airframe."""

import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

from flighttune.arrays import FloatArray
from flighttune.errors import PlantError
from flighttune.plants.jsbsim.aircraft_tables import Design
from flighttune.plants.jsbsim.airframe import Airframe
from flighttune.units import G_0

ACTUATOR = 25.0
"""Bandwidth of the surface actuators, rad/s."""

ROLL_STIFFNESS = 2.3
"""Natural frequency of the roll error over the bandwidth of the roll model, where not given."""

WELL_DAMPED = 0.9
DUTCH_ROLL_DAMPING = 0.7
SIDE_FORCE = 1.0
"""Bandwidth at which the rudder takes the lateral load factor to zero, rad/s."""

LARGEST_DAMPER = 0.6
"""Largest gain from pitch rate to pitch acceleration over the bandwidth of the actuator."""

MODEL_LEAD = 2.0
"""Bandwidth of the load-factor model over that of the response asked for, at most 20 rad/s."""

_SPAN, _STEP = 2.0, 0.01


def inner_loop_gains(airframe: Airframe, design: Design) -> dict[str, float]:
    """Return the gains by the JSBSim property that takes them, in the units of ``aircraft.toml``.

    Parameters
    ----------
    airframe : Airframe
        Derivatives at the design condition.
    design : Design
        Bandwidths asked for.

    Raises
    ------
    PlantError
        If a surface or the throttle has no effect, or one of the wrong sign.

    Notes
    -----
    Roll: the error of the roll model obeys ``e'' + 2 zeta omega e' + omega^2 e = 0``, omega being
    `roll_error` of the design; the integrator is an order slower than the model. Pitch: least
    squares of the linear step response, with actuator, to that of two equal real poles. Yaw:
    damping of the dutch roll, and the static effect of the rudder on the lateral load factor.
    Rolling at the rate p without sideslip takes the yaw rate
    ``r = g/V phi + alpha p``: the feed-forward of the rudder meets the yaw moment of p, of that r
    and of the aileron, and ``r' = g/V p``. Speed: a first-order loop on the slope of thrust.
    """
    _check_effects(airframe)
    return {
        "inner-loop/V_a-design-mps": airframe.V_a,
        **_roll(airframe, design),
        **_pitch(airframe, design.n_z),
        **_yaw(airframe),
        **_speed(airframe, design.speed),
    }


def _check_effects(airframe: Airframe) -> None:
    senses = (
        ("p_dot", "aileron", 1.0), ("q_dot", "elevator", -1.0), ("r_dot", "rudder", -1.0),
        ("u_dot", "throttle", 1.0), ("n_z", "alpha", 1.0), ("r_dot", "beta", 1.0),
    )  # fmt: skip
    for what, by, sense in senses:
        slope = airframe.of(what, by)
        if not sense * slope > 0.0:
            raise PlantError(
                f"the slope of {what} by {by} must be {'positive' if sense > 0 else 'negative'} "
                f"for this inner loop, got {slope:g}."
            )


def _roll(airframe: Airframe, design: Design) -> dict[str, float]:
    damping, effect = -airframe.of("p_dot", "p"), airframe.of("p_dot", "aileron")
    bandwidth = design.roll
    omega = design.roll_error or min(ROLL_STIFFNESS * bandwidth, 0.5 * ACTUATOR)
    k_p = omega**2 / effect
    return {
        "inner-loop/roll/model-rad_sec": bandwidth,
        "inner-loop/roll/k_ff": damping / effect,
        "inner-loop/roll/k_p": k_p,
        "inner-loop/roll/k_i": 0.1 * bandwidth * k_p,
        "inner-loop/roll/k_d": max(0.0, 2.0 * WELL_DAMPED * omega - damping) / effect,
    }


def _pitch(airframe: Airframe, bandwidth: float) -> dict[str, float]:
    effect, lift = -airframe.of("q_dot", "elevator"), airframe.of("n_z", "alpha")
    model = min(MODEL_LEAD * bandwidth, 20.0)
    t = np.arange(0.0, _SPAN, _STEP)
    wanted = 1.0 - (1.0 + bandwidth * t) * np.exp(-bandwidth * t)
    scale = np.array([1.0, bandwidth / lift, bandwidth**2 / lift]) * bandwidth / effect

    def off(log_gains: FloatArray) -> FloatArray:
        k_q, k_p, k_i = scale * np.exp(log_gains)
        flown = _n_z_step(airframe, model, k_q, k_p, k_i, len(t))
        return np.append(np.clip(flown - wanted, -10.0, 10.0), 0.02 * log_gains)

    highest = [math.log(LARGEST_DAMPER * ACTUATOR / bandwidth), 2.0, 2.0]
    found = least_squares(off, np.minimum(0.0, np.array(highest) - 0.1), bounds=(-4.0, highest))
    k_q, k_p, k_i = (scale * np.exp(found.x)).tolist()
    return {
        "inner-loop/pitch/model-rad_sec": model,
        "inner-loop/pitch/k_p": k_p,
        "inner-loop/pitch/k_i": k_i,
        "inner-loop/pitch/k_q": k_q,
    }


def _n_z_step(
    airframe: Airframe, model: float, k_q: float, k_p: float, k_i: float, count: int
) -> FloatArray:
    """Load factor of the linear short period after a step of its command, shape (count,)."""
    of, g_over_V = airframe.of, G_0 / airframe.V_a
    n_alpha, n_e = of("n_z", "alpha"), of("n_z", "elevator")
    m_alpha, m_q, m_e = of("q_dot", "alpha"), of("q_dot", "q"), of("q_dot", "elevator")
    alpha, q, elevator, n_model, integral, command = range(6)
    A = np.zeros((6, 6))
    n_z = np.zeros(6)
    n_z[[alpha, elevator]] = n_alpha, n_e
    A[alpha] = -g_over_V * n_z
    A[alpha, q] = 1.0
    A[q, [alpha, q, elevator]] = m_alpha, m_q, m_e
    A[n_model, [n_model, command]] = -model, model
    error = -n_z
    error[n_model] += 1.0
    A[integral] = error
    law = -k_p * error
    law[q] += k_q
    law[n_model] -= k_q * g_over_V
    law[integral] -= k_i
    A[elevator] = ACTUATOR * law
    A[elevator, elevator] -= ACTUATOR
    step = expm(A * _STEP)
    x = np.zeros(6)
    x[command] = 1.0
    response = np.empty(count)
    for k in range(count):
        response[k] = n_z @ x
        x = step @ x
    return np.nan_to_num(response, nan=10.0, posinf=10.0, neginf=-10.0)


def _yaw(airframe: Airframe) -> dict[str, float]:
    of = airframe.of
    effect, weathercock = -of("r_dot", "rudder"), of("r_dot", "beta")
    side = of("n_y", "beta")
    damping = -of("r_dot", "r") - side * G_0 / airframe.V_a
    wanted = 2.0 * DUTCH_ROLL_DAMPING * math.sqrt(weathercock)
    static = abs(side * effect / weathercock)
    roll_k_ff = -of("p_dot", "p") / of("p_dot", "aileron")
    adverse = of("r_dot", "p") + of("r_dot", "aileron") * roll_k_ff
    k_r = max(0.0, wanted - damping) / effect
    straight = adverse - G_0 / airframe.V_a + airframe.alpha * of("r_dot", "r")
    return {
        "inner-loop/yaw/k_ff": straight / effect - airframe.alpha * k_r,
        "inner-loop/yaw/k_r": k_r,
        "inner-loop/yaw/k_p": 0.75 * SIDE_FORCE / static,
        "inner-loop/yaw/k_i": SIDE_FORCE / static,
    }


def _speed(airframe: Airframe, bandwidth: float) -> dict[str, float]:
    thrust = airframe.of("u_dot", "throttle")
    return {
        "inner-loop/speed/k_gamma": G_0 / thrust,
        "inner-loop/speed/k_p": bandwidth / thrust,
        "inner-loop/speed/k_i": 0.25 * bandwidth**2 / thrust,
    }
