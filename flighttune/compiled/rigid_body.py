# SPDX-License-Identifier: LGPL-2.1-or-later
"""Motion of the rigid body over a sphere at rest: FGPropagate, FGInertial, FGAccelerations."""

from typing import NamedTuple

from flighttune.compiled.properties import (
    ANGULAR_RATES,
    DEGREES,
    INERTIAL_RATES,
    INERTIAL_VELOCITY,
    LOCAL_VELOCITY,
    POSITION,
    VELOCITY,
    Properties,
    named,
)
from flighttune.compiled.trace import Number, atan, atan2, equal, fabs, select, sqrt
from flighttune.compiled.vectors import (
    Matrix,
    Vector,
    add,
    cross,
    euler_angles,
    magnitude,
    matrix_of,
    normalized,
    over,
    product,
    quaternion_of,
    scale,
    sub,
    times,
    transposed,
)

QUATERNION, QUATERNION_RATE = named("_q{}", "0123"), named("_q-dot{}", "0123")
ANGULAR_ACCELERATION, INERTIAL_ACCELERATION = named("_pqri-dot-{}"), named("_uvwi-dot-{}")
BODY_ACCELERATION, VELOCITY_RATE = named("_body-acceleration-{}"), named("_uvw-dot-{}")
# Derivatives of the steps before, by which JSBSim integrates.
VELOCITY_1, VELOCITY_2 = named("_v1-{}"), named("_v2-{}")
ACCELERATION_1 = named("_a1-{}")
INERTIA = [f"_J{i}{j}" for i in range(3) for j in range(3)]
INVERSE_INERTIA = [f"_J-inverse{i}{j}" for i in range(3) for j in range(3)]


class Planet(NamedTuple):
    """Radius (ft) and gravitational parameter (ft^3/s^2) of a sphere at rest."""

    radius: float
    GM: float


def integrate(now: Properties) -> None:
    """Move attitude, rates, position and velocity on by one step."""
    q = add(now.vector(QUATERNION), scale(now.elapsed, now.vector(QUATERNION_RATE)))
    now.put(QUATERNION, normalized(q))
    rates = add(now.vector(INERTIAL_RATES), scale(now.elapsed, now.vector(ANGULAR_ACCELERATION)))
    now.put(INERTIAL_RATES, rates)
    v_0, v_1, v_2 = map(now.vector, (INERTIAL_VELOCITY, VELOCITY_1, VELOCITY_2))
    weighted = add(sub(scale(23.0, v_0), scale(16.0, v_1)), scale(5.0, v_2))
    now.put(POSITION, add(now.vector(POSITION), scale((1 / 12.0) * now.elapsed, weighted)))
    now.put(VELOCITY_1, v_0)
    now.put(VELOCITY_2, v_1)
    a_0, a_1 = now.vector(INERTIAL_ACCELERATION), now.vector(ACCELERATION_1)
    now.put(INERTIAL_VELOCITY, add(v_0, scale(now.elapsed, sub(scale(1.5, a_0), scale(0.5, a_1)))))
    now.put(ACCELERATION_1, a_0)


def hold(now: Properties) -> None:
    """Let a step pass without motion; derivatives become those of the step before."""
    now.put(QUATERNION, normalized(now.vector(QUATERNION)))
    now.put(VELOCITY_2, now.vector(VELOCITY_1))
    now.put(VELOCITY_1, now.vector(INERTIAL_VELOCITY))
    now.put(ACCELERATION_1, now.vector(INERTIAL_ACCELERATION))


def propagate(now: Properties, planet: Planet) -> None:
    """Place, velocities and attitude from the integrated state."""
    earth_to_local = _local_frame(now, planet)
    # The Earth is at rest: inertial frame and frame of the Earth are one.
    q, rates = now.vector(QUATERNION), now.vector(INERTIAL_RATES)
    now.earth_to_body = matrix_of(q)
    now.local_to_body = product(now.earth_to_body, transposed(earth_to_local))
    now.body_to_local = transposed(now.local_to_body)
    now.put(VELOCITY, times(now.earth_to_body, now.vector(INERTIAL_VELOCITY)))
    now.put(ANGULAR_RATES, rates)
    now.put(QUATERNION_RATE, quaternion_rate(q, rates))
    attitude = matrix_of(quaternion_of(now.local_to_body))
    now.sin_theta = -attitude[0][2]
    angles = euler_angles(attitude)
    shown = (("phi", "roll"), ("theta", "pitch"), ("psi", "heading-true"))
    for (symbol, name), angle in zip(shown, angles, strict=True):
        now[f"attitude/{symbol}-rad"] = now[f"attitude/{name}-rad"] = angle
        now[f"attitude/{symbol}-deg"] = angle * DEGREES
    now.put(LOCAL_VELOCITY, times(now.body_to_local, now.vector(VELOCITY)))
    now["velocities/h-dot-fps"] = -now[LOCAL_VELOCITY[2]]


def quaternion_rate(q: Vector, rates: Vector) -> Vector:
    """Derivative of the attitude quaternion."""
    a, b, c, d = q
    p, q_rate, r = rates
    return [
        -0.5 * (b * p + c * q_rate + d * r),
        0.5 * (a * p - d * q_rate + c * r),
        0.5 * (d * p + a * q_rate - b * r),
        0.5 * (-c * p + b * q_rate + a * r),
    ]


def _local_frame(now: Properties, planet: Planet) -> Matrix:
    """Rotation from the Earth to north, east and down; the place by latitude, longitude, height."""
    x, y, z = position = now.vector(POSITION)
    radius = magnitude(position)
    across = sqrt(x * x + y * y)
    pole = equal(across, 0.0)
    sin_lon, cos_lon = select(pole, 0.0, y / across), select(pole, 1.0, x / across)
    # The geodetic latitude of the general ellipsoid, whose flattening is zero here.
    a_0 = sqrt(across * across + fabs(z) * fabs(z))
    cubed = (across * across + fabs(z) * fabs(z)) * a_0
    s_1, c_1 = fabs(z) * cubed * cubed, across * cubed * cubed
    sign = select(z >= 0.0, 1.0, -1.0)
    now["position/lat-geod-rad"] = sign * atan(s_1 / c_1)
    squared = s_1 * s_1
    norm = sqrt(squared + c_1 * c_1)
    cos_lat, sin_lat = c_1 / norm, sign * s_1 / norm
    up = across * c_1 + fabs(z) * s_1 - planet.radius * sqrt(squared + c_1 * c_1)
    now["position/long-gc-rad"] = select(pole, 0.0, atan2(y, x))
    now["position/geod-alt-ft"] = now["position/h-agl-ft"] = up / norm
    now["_radius"] = radius
    # Flights begin on the equator, at the first meridian.
    now["position/from-start-neu-n-ft"], now["position/from-start-neu-e-ft"] = z, y
    now["position/h-sl-ft"] = radius - planet.radius
    return [
        [-cos_lon * sin_lat, -sin_lon * sin_lat, cos_lat],
        [-sin_lon, cos_lon, 0.0],
        [-cos_lon * cos_lat, -sin_lon * cos_lat, -sin_lat],
    ]


def gravity(position: Vector, radius: Number, planet: Planet) -> Vector:
    """Acceleration towards the centre of the sphere."""
    pull = planet.GM / (radius * radius)
    return [-pull * (x / radius) for x in position]


def accelerate(now: Properties, inertia: Matrix, inverse: Matrix) -> None:
    """Angular and linear accelerations by the forces and moments of the step."""
    rates, mass = now.vector(INERTIAL_RATES), now["inertia/mass-slugs"]
    turning = sub(now.moments["total"], cross(rates, times(inertia, rates)))
    angular = times(inverse, turning)
    now.put(ANGULAR_ACCELERATION, angular)
    now.put(named("accelerations/{}dot-rad_sec2", "pqr"), angular)
    body = over(now.forces["total"], mass)
    now.put(BODY_ACCELERATION, body)
    linear = sub(body, cross(now.vector(ANGULAR_RATES), now.vector(VELOCITY)))
    linear = add(linear, times(now.earth_to_body, now.gravity))
    now.put(VELOCITY_RATE, linear)
    now.put(named("accelerations/{}dot-ft_sec2", "uvw"), linear)
    inertial = add(times(transposed(now.earth_to_body), body), now.gravity)
    now.put(INERTIAL_ACCELERATION, inertial)


def inverse_inertia(J: Matrix) -> Matrix:
    """Inverse of a symmetric matrix of inertia, by its cofactors."""
    xx, yy, zz = J[0][0], J[1][1], J[2][2]
    xy, xz, yz = -J[0][1], -J[0][2], -J[1][2]
    k_1, k_2, k_3 = yy * zz - yz * yz, yz * xz + xy * zz, xy * yz + yy * xz
    factor = 1.0 / (xx * k_1 - xy * k_2 - xz * k_3)
    k_1, k_2, k_3 = k_1 * factor, k_2 * factor, k_3 * factor
    k_4, k_5 = (zz * xx - xz * xz) * factor, (xy * xz + yz * xx) * factor
    k_6 = (xx * yy - xy * xy) * factor
    return [[k_1, k_2, k_3], [k_2, k_4, k_5], [k_3, k_5, k_6]]
