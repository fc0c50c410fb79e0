# SPDX-License-Identifier: LGPL-2.1-or-later
"""Turboprops that run: FGTurboProp."""

import math

from flighttune.compiled.engine_files import (
    EngineFile,
    functions_of,
    propeller_of,
    table_in,
    value_of,
)
from flighttune.compiled.functions import table
from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.tables import Table2
from flighttune.compiled.trace import Number, different, exp, fabs, select

# Ways of the lever when torque is limited, a second.
_DOWN, _UP = 0.1, 0.05


def turboprop(now: Properties, engine: EngineFile) -> Number:
    """Power, hp."""
    motor, at = engine.motor, engine.at
    if engine.pusher.tag != "propeller":
        raise Unsupported(f"a turboprop with <{engine.pusher.tag}>")
    values = functions_of(now, engine, ("EnginePowerVC",))
    throttle, first = _torque_limited(now, engine), f"_first{engine.number}"
    if now.trimming:
        now[first] = 1.0
        return 0.0
    idle, most = value_of(motor, "idlen1", 30.0), value_of(motor, "maxn1", 100.0)
    delay = value_of(motor, "n1idle_max_delay", 1.0)
    # The first step after a trim begins at idle.
    n_1 = select(different(now[first], 0.0), idle, now[f"{at}/n1"])
    now[first] = 0.0
    n_1 = _approach(n_1, idle + throttle * (most - idle), delay, delay * 2.4, now.elapsed)
    now[f"{at}/n1"] = n_1
    by_speed = table_in(motor, "EnginePowerRPM_N1")
    if not isinstance(by_speed, Table2):
        raise Unsupported("a turboprop without the table EnginePowerRPM_N1")
    rpm = now[f"{at}/propeller-rpm"] * propeller_of(engine).gear_ratio
    power = by_speed.at(rpm, n_1)
    power = power * (values["EnginePowerVC"] if values else _by_airspeed(now, engine))
    limit = value_of(motor, "maxpower", math.nan)
    return select(power > limit, limit, power)


def _approach(value: Number, target: Number, up: float, down: float, dt: Number) -> Number:
    """A value on its way to a target, by a time constant for each direction."""
    falling = (value - target) * exp(-dt / down) + target
    rising = (target - value) * (1 - exp(-dt / up)) + value
    return select(value > target, falling, select(value < target, rising, value))


def _by_airspeed(now: Properties, engine: EngineFile) -> Number:
    """The factor of the power in the older form of a file, without a function."""
    for part in engine.motor.findall("table"):
        if part.get("name") == "EnginePowerVC":
            return table(now, part)
    raise Unsupported("a turboprop without EnginePowerVC")


def _torque_limited(now: Properties, engine: EngineFile) -> Number:
    """The lever behind a device that keeps torque below its limit."""
    throttle = now[engine.throttle]
    limit = value_of(engine.motor, "ielumaxtorque", -1.0)
    if not limit > 0.0:
        return throttle
    n = engine.number
    last, torque = now[f"_lever{n}"], now[f"{engine.at}/propeller-torque-ftlb"]
    above = (fabs(torque) > limit) & (throttle >= last)
    back = (now[f"_limited{n}"] > 0.0) & (throttle >= last)
    lever = select(
        above, last - _DOWN * now.elapsed, select(back, last + _UP * now.elapsed, throttle)
    )
    now[f"_limited{n}"] = select(above | back, 1.0, 0.0)
    now[f"_lever{n}"] = lever
    return lever
