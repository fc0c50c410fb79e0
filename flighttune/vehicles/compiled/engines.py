# SPDX-License-Identifier: LGPL-2.1-or-later
"""Engines that run, with frozen fuel: FGPropulsion with its engines."""

from collections.abc import Callable

from flighttune.vehicles.compiled.air_data import body_arm
from flighttune.vehicles.compiled.atmosphere import FT_TO_M
from flighttune.vehicles.compiled.engine_files import EngineFile, propeller_of, text_of, value_of
from flighttune.vehicles.compiled.functions import hidden_function, number
from flighttune.vehicles.compiled.propellers import Push, propeller
from flighttune.vehicles.compiled.properties import Properties, Unsupported, named
from flighttune.vehicles.compiled.tables import table_of
from flighttune.vehicles.compiled.trace import Number, different, select
from flighttune.vehicles.compiled.vectors import ZERO, Vector, add, cross, times

_PSF_TO_PA = 47.88
_HP, _WATTS = 550.0, 745.7

# Speed of a crankshaft below which an engine brakes nothing, 1/min.
_TURNS = 0.1


def propulsion(now: Properties, engines: tuple[EngineFile, ...], dt: float) -> None:
    """Forces (lbf) and moments (lbf ft) of all engines, in body axes."""
    force: Vector = ZERO
    moment: Vector = ZERO
    for engine in engines:
        push = _push(now, engine, dt)
        now[f"{engine.at}/thrust-lbs"] = push.thrust
        along = times(engine.orientation, [push.thrust, 0.0, 0.0])
        lever = cross(body_arm(push.place, now.cg), along)
        force, moment = add(force, along), add(moment, add(push.moment, lever))
    now.forces["prop"], now.moments["prop"] = force, moment


def _push(now: Properties, engine: EngineFile, dt: float) -> Push:
    throttle = now[engine.numbered("fcs/throttle-pos-norm")]
    kind, pusher = engine.kind, engine.pusher.tag
    motors: dict[tuple[str, str], Callable[..., Number]] = {
        ("electric", "direct"): _electric,
        ("turbine", "direct"): _turbine,
        ("electric", "propeller"): _electric,
        ("piston", "propeller"): _piston,
    }
    if (kind, pusher) not in motors:
        raise Unsupported(f"the engine <{engine.motor.tag}> with <{pusher}>")
    output = motors[kind, pusher](now, engine, throttle, dt)
    if pusher == "propeller":
        return propeller(now, engine, output, dt)
    # Without a thruster the power of an electric motor is its thrust.
    return Push(output, ZERO, now.vector(named(f"{engine.at}/{{}}-position")))


def _electric(now: Properties, engine: EngineFile, throttle: Number, dt: float) -> Number:
    watts = number(now, text_of(engine.motor, "power", 745.7))
    power = (watts * throttle / _WATTS) * _HP
    if engine.pusher.tag == "direct":
        return select(power > 0.0, power, 0.0)
    return _not_negative_at_rest(now, engine, power, 1.0)


def _not_negative_at_rest(
    now: Properties, engine: EngineFile, power: Number, ratio: float
) -> Number:
    """Power, which takes nothing from a propeller at rest."""
    rpm = now[f"{engine.at}/propeller-rpm"] * ratio
    return select(rpm <= _TURNS, select(power > 0.0, power, 0.0), power)


def _seek(value: Number, target: Number, up: Number, down: Number, dt: float) -> Number:
    """A value on its way to a target, at most so fast up and down."""
    lower, higher = value - dt * down, value + dt * up
    rising = select(value < target, select(higher > target, target, higher), value)
    return select(value > target, select(lower < target, target, lower), rising)


_TURBINE_NUMBERS = {
    "idlen1": 30.0,
    "idlen2": 60.0,
    "maxn1": 100.0,
    "maxn2": 100.0,
    **dict.fromkeys(("bypassratio", "bleed", "augmented", "augmethod"), 0.0),
}

# Shares of a spool's time, by the rule that JSBSim has for engines without functions of their own
_SPOOLS = {"N2SpoolUp": 1.0, "N2SpoolDown": 3.0, "N1SpoolUp": 1.0, "N1SpoolDown": 2.4}


def _turbine(now: Properties, engine: EngineFile, throttle: Number, dt: float) -> Number:
    """Thrust of a turbine that runs."""
    n, motor = engine.number, engine.motor
    x = {name: value_of(motor, name, default) for name, default in _TURBINE_NUMBERS.items()}
    augmentation = select(throttle > 1.0, throttle - 1.0, 0.0)
    throttle = select(throttle > 1.0, throttle - (throttle - 1.0), throttle)
    target = {f"n{k}": x[f"idlen{k}"] + throttle * (x[f"maxn{k}"] - x[f"idlen{k}"]) for k in (1, 2)}
    # The first step of a flight leaves the phase of the trim.
    first = different(now[f"_first{n}"], 0.0)
    now[f"_first{n}"] = 0.0
    value = {part.get("name", ""): hidden_function(now, part) for part in motor.findall("function")}
    norm, sigma = now[f"_n2-norm{n}"], now["atmosphere/sigma"]
    for name, factor in _SPOOLS.items():
        value.setdefault(name, _spool_rate(norm, sigma, factor * 90.0 / (x["bypassratio"] + 3.0)))
    for k in (2, 1):
        speed = select(first, target[f"n{k}"], now[f"{engine.at}/n{k}"])
        up, down = value[f"N{k}SpoolUp"], value[f"N{k}SpoolDown"]
        now[f"{engine.at}/n{k}"] = _seek(speed, target[f"n{k}"], up, down, dt)
    n_2 = now[f"{engine.at}/n2"]
    norm = (n_2 - x["idlen2"]) / (x["maxn2"] - x["idlen2"])
    now[f"_n2-norm{n}"] = norm
    dry = number(now, text_of(motor, "milthrust", 10000.0))
    idle = dry * value["IdleThrust"]
    thrust = idle + (((dry - idle) * value["MilThrust"]) * norm * norm)
    full = number(now, text_of(motor, "maxthrust", 10000.0))
    bled = thrust * (1.0 - x["bleed"])
    if not x["augmented"] or x["augmethod"] not in (1, 2):
        return bled  # nothing lights it
    before = select(different(now[f"_augmented{n}"], 0.0), thrust, bled)
    if x["augmethod"] == 1:
        lit = (throttle > 0.99) & (n_2 > 97.0)
        burning = value["AugThrust"] * full
    else:
        lit = augmentation > 0.0
        share = select(augmentation < 1.0, augmentation, 1.0)
        burning = before + (full * value["AugThrust"] - before) * share
    now[f"_augmented{n}"] = select(lit, 1.0, 0.0)
    return select(lit, burning, before)


def _spool_rate(norm: Number, sigma: Number, delay: float) -> Number:
    m = norm + 0.1
    m = select(m < 1.0, m, 1.0)
    return delay / (1.0 + 3.0 * (1.0 - m) * (1.0 - m) * (1.0 - m) + (1.0 - sigma))


# Efficiency of combustion over the ratio of fuel to air
_MIXTURE = table_of(
    (
        *((0.05000, 0.00000), (0.05137, 0.00862), (0.05179, 0.21552), (0.05430, 0.48276)),
        *((0.05842, 0.70690), (0.06312, 0.83621), (0.06942, 0.93103), (0.07786, 1.00000)),
        *((0.08845, 1.00000), (0.09270, 0.98276), (0.10120, 0.93103), (0.11455, 0.72414)),
        *((0.12158, 0.45690), (0.12435, 0.23276), (0.12500, 0.00000)),
    )
)

_HEAT_RATIO = 1.3


def _piston(now: Properties, engine: EngineFile, throttle: Number, dt: float) -> Number:
    """Power of a piston engine that runs, without a supercharger, ft lbf/s."""
    motor, at = engine.motor, engine.at
    if motor.find("numboostspeeds") is not None or motor.find("boost-loss-factor") is not None:
        raise Unsupported("a piston engine with a supercharger")
    if any(table.get("name") == "MIXTURE" for table in motor.findall("table")):
        raise Unsupported("a piston engine with a mixture table")
    ambient = now["atmosphere/P-psf"] * _PSF_TO_PA
    total = now["propulsion/pt-lbs_sqft"] * _PSF_TO_PA
    ram = (total - ambient) * now[f"{at}/ram-air-factor"] + ambient
    gear = propeller_of(engine).gear_ratio
    rpm = now[f"{at}/propeller-rpm"] * gear
    speed = (rpm * value_of(motor, "stroke", 4.375)) / 360.0
    manifold = _manifold_pressure(now, engine, throttle, speed, ram, dt)
    air = _air_flow(now, engine, manifold, ambient, rpm)
    mixture = now[engine.numbered("fcs/mixture-pos-norm")]
    fuel = (air * ((1.3 * mixture) * 101325.0 / ambient)) / 14.7
    burned = _MIXTURE.at(fuel / air)
    pph = (fuel * 2.2046) * 3600.0
    indicated = (pph / now[f"{at}/bsfc-lbs_hphr"]) * burned - now[f"{at}/friction-hp"]
    dynamic, static = (
        value_of(motor, "dynamic-fmep", 18400.0),
        value_of(motor, "static-fmep", 46500.0),
    )
    friction = -dynamic * speed * FT_TO_M - static
    pumped = (manifold - ambient) * now[f"{at}/volumetric-efficiency"]
    work = (pumped + friction) * _displacement(engine) * rpm
    hp = indicated + work / (value_of(motor, "cycles", 4.0) * 22371.0)
    now[f"{at}/power-hp"] = hp
    return _not_negative_at_rest(now, engine, hp * _HP, gear)


def _displacement(engine: EngineFile) -> float:
    """Displacement, m^3."""
    inch = 1.0 / 12.0
    return value_of(engine.motor, "displacement", 360.0) * (
        inch * inch * inch / (1.0 / (FT_TO_M * FT_TO_M * FT_TO_M))
    )


def _manifold_pressure(
    now: Properties, engine: EngineFile, throttle: Number, speed: Number, ram: Number, dt: float
) -> Number:
    """Pressure behind the throttle, Pa."""
    motor, at = engine.motor, engine.at
    peak = value_of(motor, "peak-piston-speed", 100.0)
    idle = (value_of(motor, "idlerpm", 600.0) * value_of(motor, "stroke", 4.375)) / 360
    least = value_of(motor, "minmp", 6.5) * 3386.38
    airbox = now[f"{at}/air-intake-impedance-factor"]
    closed = (peak / idle) * (101320.73 / least - 1) - airbox
    shut = (1.0 - throttle) * (1.0 - throttle) * closed
    through = select(speed > 0.0, peak / speed, 999999.0)
    wanted = ram * (through / (through + airbox + shut))
    pressure = now[f"{at}/map-pa"]
    change = pressure - wanted
    lag = value_of(motor, "man-press-lag", 1.0)
    if lag > dt:
        change = change * (dt / lag)
    now[f"{at}/map-pa"] = pressure - change
    return now[f"{at}/map-pa"]


def _air_flow(
    now: Properties, engine: EngineFile, manifold: Number, ambient: Number, rpm: Number
) -> Number:
    """Mass of air a second, kg/s."""
    compression = value_of(engine.motor, "compression-ratio", 8.5)
    ratio = select(manifold < 1.0, compression, ambient / manifold)
    ratio = select(ratio > compression, compression, ratio)
    filled = (_HEAT_RATIO - 1) / _HEAT_RATIO
    filled = filled + (compression - ratio) / (_HEAT_RATIO * (compression - 1))
    swept = (_displacement(engine) * (rpm / 60.0)) / 2.0
    volume = swept * (now[f"{engine.at}/volumetric-efficiency"] * filled)
    temperature = now["atmosphere/T-R"] / 1.8
    return volume * (manifold / (287.3 * temperature))
