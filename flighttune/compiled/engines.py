# SPDX-License-Identifier: LGPL-2.1-or-later
"""All engines of an aircraft, with frozen fuel: FGPropulsion; electric engines and rockets."""

from collections.abc import Callable
from typing import TypeAlias

from flighttune.compiled.air_data import body_arm
from flighttune.compiled.engine_files import (
    EngineFile,
    factor_of,
    propeller_of,
    text_of,
    value_in,
    value_of,
)
from flighttune.compiled.functions import hidden_function, number
from flighttune.compiled.pistons import piston
from flighttune.compiled.propellers import Push, propeller
from flighttune.compiled.properties import Properties, Unsupported, named
from flighttune.compiled.trace import Number, largest, select
from flighttune.compiled.turbines import turbine
from flighttune.compiled.turboprops import turboprop
from flighttune.compiled.vectors import ZERO, Vector, add, cross, times

_HP, _WATTS = 550.0, 745.7

# Speed of a crankshaft below which an engine brakes nothing, 1/min.
_TURNS = 0.1

# From the step and an engine: its power (hp), or its thrust (lbf)
Motor: TypeAlias = Callable[[Properties, EngineFile], Number]


def propulsion(now: Properties, engines: tuple[EngineFile, ...]) -> None:
    """Forces (lbf) and moments (lbf ft) of all engines, in body axes."""
    force: Vector = ZERO
    moment: Vector = ZERO
    for engine in engines:
        push = run_engine(now, engine)
        along = times(engine.orientation, [push.thrust, 0.0, 0.0])
        lever = cross(body_arm(push.place, now.cg), along)
        force, moment = add(force, along), add(moment, add(push.moment, lever))
    now.forces["prop"], now.moments["prop"] = force, moment


def run_engine(now: Properties, engine: EngineFile) -> Push:
    """One step of an engine and its thruster."""
    now.engine = str(engine.number)
    push = _push(now, engine)
    now[f"{engine.at}/thrust-lbs"] = push.thrust
    return push


def _push(now: Properties, engine: EngineFile) -> Push:
    if engine.kind not in _MOTORS:
        raise Unsupported(f"the engine <{engine.motor.tag}>")
    if now.trimming and engine.kind == "rocket":  # its flow is a quotient by the time that passes
        raise Unsupported("a rocket in a trim")
    output = _MOTORS[engine.kind](now, engine)
    if engine.kind in _POWER:
        now[f"{engine.at}/power-hp"] = output
        output = _braking(now, engine, output * _HP)
    pusher = engine.pusher
    if pusher.tag == "propeller":
        return propeller(now, engine, output)
    place = now.vector(named(f"{engine.at}/{{}}-position"))
    if pusher.tag == "nozzle":
        area = value_in(pusher, "area", "FT2", 0.0)
        return Push(largest(0.0, output - now["atmosphere/P-psf"] * area), ZERO, place)
    if pusher.tag != "direct":
        raise Unsupported(f"the thruster <{pusher.tag}>")
    # Without a thruster, power in ft lbf/s is thrust in lbf.
    return Push(output, ZERO, place)


def _braking(now: Properties, engine: EngineFile, power: Number) -> Number:
    """Power, which takes nothing from a propeller at rest."""
    if engine.pusher.tag != "propeller":
        return largest(power, 0.0)
    rpm = now[f"{engine.at}/propeller-rpm"] * propeller_of(engine).gear_ratio
    return select(rpm <= _TURNS, largest(power, 0.0), power)


def _electric(now: Properties, engine: EngineFile) -> Number:
    watts = number(now, text_of(engine.motor, "power", _WATTS))
    return watts * factor_of(engine.motor, "power", "WATTS") * now[engine.throttle] / _WATTS


def _rocket(now: Properties, engine: EngineFile) -> Number:
    """Vacuum thrust of a liquid rocket whose tanks stay full."""
    motor, at = engine.motor, engine.at
    if motor.find("thrust_table") is not None:
        raise Unsupported("a solid rocket")
    isp = motor.find("isp")
    part = None if isp is None else isp.find("function")
    impulse = now[f"{at}/isp"] if part is None else hidden_function(now, part)
    # Propellant of the step before; with frozen fuel it is what it was at the start.
    flow = now[f"_propellant{engine.number}"]
    burning = impulse * flow
    return select(now[engine.throttle] < value_of(motor, "minthrottle", 0.0), 0.0, burning)


# Kinds of engines whose output is a power, hp; that of the others is a thrust, lbf.
_POWER = ("electric", "piston", "turboprop")

_MOTORS: dict[str, Motor] = {
    "electric": _electric,
    "piston": piston,
    "rocket": _rocket,
    "turbine": turbine,
    "turboprop": turboprop,
}
