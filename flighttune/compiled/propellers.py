# SPDX-License-Identifier: LGPL-2.1-or-later
"""Thrust, torque and speed of a propeller: FGPropeller."""

import math
from typing import NamedTuple

from flighttune.compiled.air_data import body_arm
from flighttune.compiled.engine_files import EngineFile, PropellerFile, propeller_of
from flighttune.compiled.functions import number
from flighttune.compiled.properties import (
    AIR_RATES,
    AIR_VELOCITY,
    INERTIAL_RATES,
    Properties,
    named,
)
from flighttune.compiled.tables import Table1
from flighttune.compiled.trace import Number, atan2, different, fabs, select, sqrt
from flighttune.compiled.vectors import Vector, add, cross, times, transposed

# Speeds below which a propeller stands: revolutions a second, and rad/s
_STANDS, _STILL = 0.01, 0.01

# Side wind (ft/s) and factor from which thrust acts off the axis.
_SIDE, _P_FACTOR = 0.0001, 0.0001

# Speed from which a governor works, 1/min.
_GOVERNED = 200.0

# Steps in which a feathered blade comes nearer to its end by a factor of e.
_FEATHERING = 300


class Push(NamedTuple):
    """Output of a thruster: thrust (lbf), its own moment (lbf ft), and where it acts (in)."""

    thrust: Number
    moment: Vector
    place: Vector


def propeller(now: Properties, engine: EngineFile, power: Number) -> Push:
    """Thrust of a propeller, and its speed after the step, from a `power` in ft lbf/s."""
    file, at = propeller_of(engine), engine.at
    place = now.vector([f"{at}/{x}-reference-position" for x in "xyz"])
    turning = cross(now.vector(AIR_RATES), body_arm(place, now.cg))
    air = times(transposed(engine.orientation), add(now.vector(AIR_VELOCITY), turning))
    rpm, rho = now[f"{at}/propeller-rpm"], now["atmosphere/rho-slugs_ft3"]
    rps, diameter = rpm / 60.0, file.diameter
    tip = rps * diameter * math.pi
    tip_mach = sqrt(tip * tip + air[0] * air[0]) / now["atmosphere/a-fps"]
    advance = select(rps > _STANDS, air[0] / (diameter * rps), air[0] / diameter)
    now[f"{at}/advance-ratio"] = advance
    pitch = _blade_angle(now, engine, file, rpm)
    correction = tip_mach, rpm
    c_p = _coefficient(file, "POWER", advance, pitch) * file.power_factor
    c_p = _corrected(file, "CP", c_p, *correction)
    turns = select(rps < _STANDS, _STANDS, rps)
    fifth = diameter * diameter * diameter * diameter * diameter
    left_over = power - c_p * turns * turns * turns * fifth * rho
    factor = number(now, file.thrust_factor)
    c_t = _corrected(file, "CT", _coefficient(file, "THRUST", advance, pitch) * factor, *correction)
    now[f"{at}/thrust-coefficient"] = c_t
    thrust = c_t * rps * rps * (diameter * diameter * diameter * diameter) * rho
    induced = _induced_velocity(thrust, air[0], rho * (0.25 * diameter * diameter * math.pi))
    now[f"{at}/prop-induced-velocity_fps"] = induced
    acting = _acting_place(now, engine, file, place, air, induced)
    moment = _turned(now, engine, file, power, left_over)
    return Push(thrust, moment, acting)


def _blade_angle(now: Properties, engine: EngineFile, file: PropellerFile, rpm: Number) -> Number:
    """Blade angle (deg), by a governor or set by flight control; 0 if it is fixed."""
    if file.pitch is None:
        return 0.0
    low, high, least, most = file.pitch
    angle = now[f"{engine.at}/blade-angle"]
    if not file.governed:
        return angle
    wanted = least + (most - least) * now[engine.numbered("fcs/advance-pos-norm")]
    turned = select(rpm > _GOVERNED, angle - (wanted - rpm) * now.elapsed, angle)
    turned = select(turned < low, low, select(turned > high, high, turned))
    feathered = different(now[engine.numbered("fcs/feather-pos-norm")], 0.0)
    angle = select(feathered, angle + (high - angle) / _FEATHERING, turned)
    now[f"{engine.at}/blade-angle"] = angle
    return angle


def _coefficient(file: PropellerFile, name: str, advance: Number, pitch: Number) -> Number:
    table = file.tables[f"C_{name}"]
    return table.at(advance) if isinstance(table, Table1) else table.at(advance, pitch)


def _corrected(
    file: PropellerFile, kind: str, coefficient: Number, tip_mach: Number, rpm: Number
) -> Number:
    """A coefficient with its factors by tip speed and by speed."""
    for name, key in ((f"{kind}_MACH", tip_mach), (f"{kind}_RPM_FACTOR", rpm)):
        table = file.tables.get(name)
        if isinstance(table, Table1):
            coefficient = coefficient * table.at(key)
    return coefficient


def _induced_velocity(thrust: Number, speed: Number, mass: Number) -> Number:
    """Induced velocity: half the increase of airspeed behind the propeller, ft/s."""
    total = speed * fabs(speed) + 2.0 * thrust / mass
    root = sqrt(fabs(total))
    return select(total > 0.0, 0.5 * (-speed + root), 0.5 * (-speed - root))


def _acting_place(
    now: Properties,
    engine: EngineFile,
    file: PropellerFile,
    place: Vector,
    air: Vector,
    induced: Number,
) -> Vector:
    """Where thrust acts: off the axis in a wind from the side."""
    acting = now.vector(named(f"{engine.at}/{{}}-position"))
    if not file.p_factor > _P_FACTOR:
        return acting
    side = sqrt(air[1] * air[1] + air[2] * air[2])
    factor = file.sense * file.p_factor * atan2(side, air[0] + induced) / side
    some = side > _SIDE
    y = select(some, place[1] + factor * air[2], acting[1])
    z = select(some, place[2] + factor * air[1], acting[2])
    now[f"{engine.at}/y-position"], now[f"{engine.at}/z-position"] = y, z
    return [acting[0], y, z]


def _turned(
    now: Properties, engine: EngineFile, file: PropellerFile, power: Number, left_over: Number
) -> Vector:
    """The moment by torque and rotation; the speed is moved on."""
    rps = now[f"{engine.at}/propeller-rpm"] / 60.0
    omega = rps * 2.0 * math.pi
    torque = -file.sense * power / select(omega > _STILL, omega, _STILL)
    now[f"{engine.at}/propeller-torque-ftlb"] = torque
    excess = left_over / select(omega > _STILL, omega, 1.0)
    new = (rps + ((excess / file.inertia) / (2.0 * math.pi)) * now.elapsed) * 60.0
    new = select(new < 0.0, 0.0, new)
    now[f"{engine.at}/propeller-rpm"], now[f"{engine.at}/engine-rpm"] = new, new * file.gear_ratio
    spin = file.inertia * omega * file.sense * file.moment_sign
    turned = cross(now.vector(INERTIAL_RATES), times(engine.orientation, [spin, 0.0, 0.0]))
    return add(turned, times(engine.orientation, [torque, 0.0, 0.0]))
