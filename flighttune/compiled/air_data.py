# SPDX-License-Identifier: LGPL-2.1-or-later
"""Flow angles, airspeeds and load factors of a step: FGAuxiliary."""

import math

from flighttune.compiled.atmosphere import (
    G_0,
    HEAT_RATIO,
    R_DRY,
    SEA_LEVEL_P,
    SEA_LEVEL_RHO,
    SEA_LEVEL_T,
    stagnation_pressure,
)
from flighttune.compiled.properties import (
    AIR_RATES,
    AIR_VELOCITY,
    ANGULAR_RATES,
    DEGREES,
    INERTIAL_RATES,
    LOCAL_VELOCITY,
    VELOCITY,
    Properties,
    named,
)
from flighttune.compiled.rigid_body import ANGULAR_ACCELERATION, BODY_ACCELERATION, VELOCITY_RATE
from flighttune.compiled.trace import Number, atan2, cos, fabs, power, select, sin, sqrt
from flighttune.compiled.turbulence import TOTAL_WIND
from flighttune.compiled.vectors import Vector, add, cross, over, sub, times, transposed

SLUG_TO_LB = 32.174049
_FPS_TO_KTS = 1.0 / (1852.0 / (3600 * 0.3048))
_IN_TO_FT = 1.0 / 12.0

# Airspeed, and square of its part in the plane of symmetry, below which flow angles are zero
_MOVING, _ALONG = 0.001, 1e-6


def body_arm(place: Vector, cg: Vector) -> Vector:
    """Vector from the centre of gravity to a place (structural frame, inches), ft in body axes."""
    return [
        _IN_TO_FT * (cg[0] - place[0]),
        _IN_TO_FT * (place[1] - cg[1]),
        _IN_TO_FT * (cg[2] - place[2]),
    ]


def air_data(now: Properties) -> None:
    """All air data, from velocity, wind and the accelerations of the previous step."""
    _attitude_rates(now)
    _flow(now)
    _path(now)
    _pressures(now)
    _load_factors(now)


def _attitude_rates(now: Properties) -> None:
    (p, q, r), rates = now.vector(ANGULAR_RATES), now.vector(ANGULAR_RATES)
    phi, theta = now["attitude/phi-rad"], now["attitude/theta-rad"]
    sine, cosine = sin(phi), cos(phi)
    now["velocities/thetadot-rad_sec"] = q * cosine - r * sine
    psi_dot = (q * sine + r * cosine) / cos(theta)
    now["velocities/psidot-rad_sec"] = psi_dot
    now["velocities/phidot-rad_sec"] = p + psi_dot * now.sin_theta
    now.put(AIR_RATES, sub(rates, now.turbulent_rates))


def _flow(now: Properties) -> None:
    """Velocity through the air, angle of attack and sideslip, with their rates."""
    wind = times(now.local_to_body, now.vector(TOTAL_WIND))
    u, v, w = through = sub(now.vector(VELOCITY), wind)
    now.put(AIR_VELOCITY, through)
    u_dot, v_dot, w_dot = now.vector(VELOCITY_RATE)
    plane = u * u + w * w
    squared = plane + v * v
    V, root = sqrt(squared), sqrt(plane)
    moving = V > _MOVING
    along = moving & (plane >= _ALONG)
    beta = select(moving, atan2(v, root), 0.0)
    alpha = select(along, atan2(w, u), 0.0)
    V_dot = (u * u_dot + v * v_dot + w * w_dot) / V
    alpha_dot = (u * w_dot - w * u_dot) / plane
    beta_dot = (v_dot * V - v * V_dot) / (V * root)
    now["aero/alphadot-rad_sec"] = select(along, alpha_dot, 0.0)
    now["aero/betadot-rad_sec"] = select(along, beta_dot, 0.0)
    now["aero/alpha-rad"], now["aero/beta-rad"] = alpha, beta
    now["aero/alpha-deg"], now["aero/beta-deg"] = alpha * DEGREES, beta * DEGREES
    now["aero/mag-beta-rad"], now["aero/mag-beta-deg"] = fabs(beta), fabs(beta) * DEGREES
    now["velocities/vt-fps"] = V
    now["aero/Re"] = V * now["metrics/cbarw-ft"] / now.viscosity
    c_a, s_a, c_b, s_b = cos(alpha), sin(alpha), cos(beta), sin(beta)
    now.wind_to_body = [
        [c_a * c_b, -c_a * s_b, -s_a],
        [s_b, c_b, 0.0],
        [s_a * c_b, -s_a * s_b, c_a],
    ]
    now.body_to_wind = transposed(now.wind_to_body)
    half = 0.5 * now["atmosphere/rho-slugs_ft3"]
    now["aero/qbar-psf"] = half * squared
    now["aero/qbarUW-psf"], now["aero/qbarUV-psf"] = half * plane, half * (u * u + v * v)
    now["velocities/mach"] = V / now["atmosphere/a-fps"]


def _path(now: Properties) -> None:
    north, east, down = now.vector(LOCAL_VELOCITY)
    level, course = sqrt(north * north + east * east), atan2(east, north)
    now["velocities/vg-fps"] = level
    now["flight-path/psi-gt-rad"] = select(course < 0.0, course + 2 * math.pi, course)
    now["flight-path/gamma-rad"] = atan2(-down, level)


def _pressures(now: Properties) -> None:
    mach, P = now["velocities/mach"], now["atmosphere/P-psf"]
    now["propulsion/tat-r"] = now["atmosphere/T-R"] * (1.0 + 0.2 * mach * mach)
    total = stagnation_pressure(mach, P)
    now["propulsion/pt-lbs_sqft"] = total
    now["velocities/vc-fps"] = calibrated = _calibrated(total - P)
    now["velocities/vc-kts"] = calibrated * _FPS_TO_KTS
    now["velocities/ve-fps"] = equivalent = sqrt(2.0 * now["aero/qbar-psf"] / SEA_LEVEL_RHO)
    now["velocities/ve-kts"] = equivalent * _FPS_TO_KTS


def _calibrated(pressure: Number) -> Number:
    """Airspeed at sea level that has an impact pressure, below Mach 1."""
    a, b = 2.0 / (HEAT_RATIO - 1.0), (HEAT_RATIO - 1.0) / HEAT_RATIO
    mach = sqrt(a * (power(pressure / SEA_LEVEL_P + 1.0, b) - 1.0))
    return math.sqrt(HEAT_RATIO * R_DRY * SEA_LEVEL_T) * mach


def _load_factors(now: Properties) -> None:
    body = now.vector(BODY_ACCELERATION)
    n_x, n_y, n_z = over(body, G_0)
    now["accelerations/Nx"], now["accelerations/Ny"], now["accelerations/Nz"] = n_x, n_y, -n_z
    eye = body_arm(now.vector(named("metrics/eyepoint-{}-in")), now.cg)
    rates = now.vector(INERTIAL_RATES)
    pilot = add(body, cross(now.vector(ANGULAR_ACCELERATION), eye))
    pilot = add(pilot, cross(rates, cross(rates, eye)))
    now.put(named("accelerations/a-pilot-{}-ft_sec2"), pilot)
    now.put(named("accelerations/n-pilot-{}-norm"), over(pilot, G_0))
    now["forces/load-factor"] = now["_lift"] / (now["inertia/mass-slugs"] * SLUG_TO_LB)
    height, span = now["position/h-agl-ft"], now["metrics/bw-ft"]
    now["aero/h_b-cg-ft"] = height / span
    below = times(now.body_to_local, now.reference_point)[2]
    now["aero/h_b-mac-ft"] = (height - below) / span
