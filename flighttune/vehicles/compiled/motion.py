# SPDX-License-Identifier: LGPL-2.1-or-later
"""Attitude and acceleration at the start of a flight, to the bit, from JSBSim's first steps."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.vehicles.compiled.properties import INERTIAL_RATES, INERTIAL_VELOCITY, named
from flighttune.vehicles.compiled.rigid_body import quaternion_rate
from flighttune.vehicles.compiled.vectors import matrix_of, quaternion_of
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

# Doubles on each side of a guess that are tried, for quaternions and for an acceleration.
_NEAR, _TRIED = 4, 64


def neighbours(x: float, count: int) -> list[float]:
    """A double and those next to it, the nearest first."""
    near = [x]
    up = down = x
    for _ in range(count):
        up, down = math.nextafter(up, math.inf), math.nextafter(down, -math.inf)
        near += [up, down]
    return near


@dataclass(frozen=True)
class Motion:
    """What JSBSim shows of the rigid body at an instant."""

    rotation: FloatArray  # shape (3, 3): from the Earth to the body
    rates: list[float]
    velocity: list[float]
    acceleration: list[float]


def motion_reader(fdm: Fdm) -> Callable[[], Motion]:
    """A function that reads the motion now."""
    names = INERTIAL_RATES, INERTIAL_VELOCITY, named("accelerations/{}idot-ft_sec2", "uvw")
    rates, velocity, acceleration = ([fdm.reader(name) for name in group] for group in names)

    def motion() -> Motion:
        groups = ([read() for read in group] for group in (rates, velocity, acceleration))
        return Motion(fdm.earth_to_body(), *groups)

    return motion


def quaternion_from(motions: Sequence[Motion], dt: float) -> list[float]:
    """The quaternion that gives the rotations of JSBSim to the bit, now and in the steps after."""
    guess = [float(x) for x in quaternion_of(motions[0].rotation.tolist())]
    found = [_nearest(guess, _NEAR // 2, motions, dt)]
    if found[0][1]:  # not exact: it lies further away
        found.append(_nearest(guess, _NEAR, motions, dt))
    return min(found, key=itemgetter(1))[0]


def _nearest(
    guess: Sequence[float], count: int, motions: Sequence[Motion], dt: float
) -> tuple[list[float], int]:
    """The best quaternion near a guess, and how many entries of its first rotation are wrong."""
    # All combinations of near doubles, a column each; arithmetic of NumPy is that of JSBSim.
    near = np.meshgrid(*(neighbours(x, count) for x in guess), indexing="ij")
    starts = now = np.array([values.ravel() for values in near])
    first: int | None = None
    for motion in motions:
        wrong = np.zeros(now.shape[1], dtype=int)
        for row, wanted in zip(matrix_of(list(now)), motion.rotation, strict=True):
            for a, b in zip(row, wanted, strict=True):
                wrong += np.not_equal(a, b)
        fewest = int(wrong.min())
        first = fewest if first is None else first
        starts, now = starts[:, wrong == fewest], now[:, wrong == fewest]
        if starts.shape[1] == 1:  # further steps cannot choose any more
            break
        moved = now + dt * np.array(quaternion_rate(list(now), motion.rates))
        now = _normalized(moved)
    return starts[:, 0].tolist(), first or 0


def _normalized(q: FloatArray) -> FloatArray:
    """Quaternions of length 1, a column each."""
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    keep = np.abs(length - 1.0) < 1e-10
    return np.where(keep, q, q * (1.0 / length))


def acceleration_before(motions: Sequence[Motion], dt: float) -> list[float]:
    """The acceleration before the start with which JSBSim makes its first step, to the bit."""
    found = []
    before, after = motions[0], motions[1]
    for v_0, a_0, v_1 in zip(before.velocity, before.acceleration, after.velocity, strict=True):
        wanted = (1.5 * a_0 - (v_1 - v_0) / dt) / 0.5
        # Any that gives the velocity after the step will do: it is not used again.
        near = (
            a_1
            for a_1 in (a_0, *neighbours(wanted, _TRIED))
            if v_0 + dt * (1.5 * a_0 - 0.5 * a_1) == v_1
        )
        found.append(next(near, a_0))
    return found
