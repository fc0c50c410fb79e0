# SPDX-License-Identifier: LGPL-2.1-or-later
"""Attitude and acceleration at the start of a flight, to the bit, from JSBSim's first steps."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from flighttune.compiled.dynamics import Doubles, FlightDynamics
from flighttune.compiled.properties import INERTIAL_RATES, INERTIAL_VELOCITY, Unsupported, named
from flighttune.compiled.rigid_body import quaternion_rate
from flighttune.compiled.vectors import (
    add,
    euler_angles,
    matrix_of,
    normalized,
    quaternion_by,
    quaternion_of,
    quaternion_product,
    scale,
)

# Doubles tried on each side of an acceleration.
_TRIED = 64

# Rotation from the Earth to north, east and down where flights begin.
AT_START = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)


def neighbours(x: float, count: int) -> Iterator[float]:
    """A double and its neighbours, the nearest first."""
    up = down = x
    yield x
    for _ in range(count):
        yield (up := math.nextafter(up, math.inf))
        yield (down := math.nextafter(down, -math.inf))


@dataclass(frozen=True)
class Motion:
    """Motion of the rigid body at an instant, as JSBSim shows it."""

    rotation: Doubles  # shape (3, 3): from the Earth to the body
    rates: list[float]
    velocity: list[float]
    acceleration: list[float]


def motion_reader(fdm: FlightDynamics) -> Callable[[], Motion]:
    """A function that reads the motion now."""
    names = INERTIAL_RATES, INERTIAL_VELOCITY, named("accelerations/{}idot-ft_sec2", "uvw")
    rates, velocity, acceleration = ([fdm.reader(name) for name in group] for group in names)

    def motion() -> Motion:
        groups = ([read() for read in group] for group in (rates, velocity, acceleration))
        return Motion(fdm.earth_to_body(), *groups)

    return motion


def quaternion_from(
    before: Sequence[float], written: Sequence[float], motions: Sequence[Motion], dt: float
) -> list[float]:
    """The quaternion at the start, which gives JSBSim's rotations to the bit in the first steps.

    `before`: angles of JSBSim's initial state before those of the start were `written`.
    """
    # Angles are written one by one, and each changes the others by rounding.
    angles, local = list(before), quaternion_by(*before)
    for i, angle in enumerate(written):
        angles[i] = angle
        local = quaternion_by(*angles)
        angles = list(euler_angles(matrix_of(local)))
    q = [float(x) for x in quaternion_product(quaternion_of(AT_START), local)]
    if not _gives(q, motions, dt):
        raise Unsupported("the attitude at this start")
    return q


def _gives(q: Sequence[float], motions: Sequence[Motion], dt: float) -> bool:
    """Whether a quaternion gives the rotations of all `motions`."""
    for motion in motions:
        if matrix_of(q) != motion.rotation.tolist():
            return False
        moved = add(q, scale(dt, quaternion_rate(q, motion.rates)))
        q = [float(x) for x in normalized(moved)]
    return True


def acceleration_before(motions: Sequence[Motion], dt: float) -> list[float]:
    """The acceleration before the start with which JSBSim makes its first step, to the bit."""
    found = []
    before, after = motions[0], motions[1]
    for v_0, a_0, v_1 in zip(before.velocity, before.acceleration, after.velocity, strict=True):
        wanted = (1.5 * a_0 - (v_1 - v_0) / dt) / 0.5
        # Any value that gives the velocity after the step will do: it is not used again.
        for a_1 in chain((a_0, wanted), neighbours(wanted, _TRIED)):
            if v_0 + dt * (1.5 * a_0 - 0.5 * a_1) == v_1:
                found.append(a_1)
                break
        else:
            raise Unsupported("the acceleration before this start")
    return found
