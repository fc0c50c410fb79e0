# SPDX-License-Identifier: LGPL-2.1-or-later
"""Attitude and acceleration at the start of a flight, to the bit, from JSBSim's first steps."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.vehicles.compiled.properties import (
    INERTIAL_RATES,
    INERTIAL_VELOCITY,
    Unsupported,
    named,
)
from flighttune.vehicles.compiled.rigid_body import quaternion_rate
from flighttune.vehicles.compiled.vectors import add, matrix_of, normalized, quaternion_of, scale
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

# Doubles tried on each side of a guess. Quaternion: for the largest component, and at most for
# smaller components, whose doubles lie closer. Then for an acceleration.
_NEAR, _TRIED = ((2, 8), (4, 4), (2, 64), (2, 256)), 64

# Most quaternions tried at once (100 MB), most steps until one is left, and steps that it must
# give: a neighbour of the true one that differs in a small component alone may give a dozen.
_MOST, STEPS, _CONFIRMED = 1_000_000, 200, 100

# Of a component this much smaller than the largest, as of a level start to the north, the last bits
# are lost in the sums. Where they are not, the comparison with JSBSim finds it.
_NOTHING = 2.0**-16

_UNKNOWN = "the attitude at this start"


def neighbours(x: float, count: int) -> list[float]:
    """A double and its neighbours, the nearest first."""
    near = [x]
    up = down = x
    for _ in range(count):
        up, down = math.nextafter(up, math.inf), math.nextafter(down, -math.inf)
        near += [up, down]
    return near


@dataclass(frozen=True)
class Motion:
    """Motion of the rigid body at an instant, as JSBSim shows it."""

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


def quaternion_from(
    motions: Sequence[Motion], dt: float, more: Callable[[], Motion]
) -> list[float]:
    """The quaternion that gives JSBSim's rotations to the bit, now and in the next steps.

    `more` makes another step as long as several quaternions reproduce `motions`.
    """
    motions = list(motions)
    guess = [float(x) for x in quaternion_of(motions[0].rotation.tolist())]
    widest = max(map(math.ulp, guess))
    for count, most in _NEAR:
        counts = [min(count * round(widest / math.ulp(x)), most) for x in guess]
        few = math.prod(2 * n + 1 for n in counts) <= _MOST
        if few and (found := _nearest(guess, counts, motions, dt, more)) is not None:
            return found
    raise Unsupported(_UNKNOWN)


def _nearest(
    guess: Sequence[float],
    counts: Sequence[int],
    motions: list[Motion],
    dt: float,
    more: Callable[[], Motion],
) -> list[float] | None:
    """The exact quaternion within `counts` doubles on each side of a guess, or None.

    Raises
    ------
    Unsupported
        If several that differ in more than zeros give all rotations. They become one later, but the
        rounding of other properties tells them apart in a sample before.
    """
    # All combinations of near doubles, a column each; NumPy computes the same bits as JSBSim.
    near = np.meshgrid(*map(neighbours, guess, counts), indexing="ij")
    starts = now = np.array([values.ravel() for values in near])
    for k in range(STEPS):
        if starts.shape[1] == 1:  # numbers take a tenth of the time of arrays of length 1
            motions += [more() for _ in range(_CONFIRMED - len(motions))]
            return starts[:, 0].tolist() if _gives(now[:, 0].tolist(), motions[k:], dt) else None
        if k == len(motions):
            motions.append(more())
        motion, wrong = motions[k], np.zeros(now.shape[1], dtype=int)
        for row, wanted in zip(matrix_of(list(now)), motion.rotation, strict=True):
            for a, b in zip(row, wanted, strict=True):
                wrong += np.not_equal(a, b)
        starts, now = starts[:, wrong == 0], now[:, wrong == 0]
        if not starts.shape[1]:
            return None
        moved = now + dt * np.array(quaternion_rate(list(now), motion.rates))
        now = _normalized(moved)
    differ = np.ptp(starts, axis=1) > 0.0
    if np.any(np.abs(starts[differ, 0]) > _NOTHING * np.max(np.abs(starts[:, 0]))):
        raise Unsupported(_UNKNOWN)
    return starts[:, 0].tolist()


def _gives(q: Sequence[float], motions: Sequence[Motion], dt: float) -> bool:
    """Whether a quaternion gives the rotations of all `motions`."""
    for motion in motions:
        if matrix_of(q) != motion.rotation.tolist():
            return False
        moved = add(q, scale(dt, quaternion_rate(q, motion.rates)))
        q = [float(x) for x in normalized(moved)]
    return True


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
        # Any value that gives the velocity after the step will do: it is not used again.
        near = (
            a_1
            for a_1 in (a_0, *neighbours(wanted, _TRIED))
            if v_0 + dt * (1.5 * a_0 - 0.5 * a_1) == v_1
        )
        if (a_1 := next(near, None)) is None:
            raise Unsupported("the acceleration before this start")
        found.append(a_1)
    return found
