# SPDX-License-Identifier: LGPL-2.1-or-later
"""Piston engines, also with a supercharger: FGPiston."""

from dataclasses import dataclass

from flighttune.compiled.atmosphere import FT_TO_M
from flighttune.compiled.engine_files import (
    EngineFile,
    functions_of,
    propeller_of,
    table_in,
    value_in,
    value_of,
)
from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.tables import Table1, table_of
from flighttune.compiled.trace import Number, different, negated, power, select

_PSF_TO_PA, _INHG_TO_PA, _PSI_TO_PA = 47.88, 3386.38, 6895
_STANDARD_PRESSURE = 101320.73
_MOST_SPEEDS = 3

# Whether all starters turn
STARTER = "propulsion/starter_cmd"

# Pressure by which ambient pressure must pass a switch of a supercharger, Pa.
_HYSTERESIS = 1000

# Efficiency of combustion over the ratio of fuel to air
_MIXTURE = table_of(
    (
        *((0.05000, 0.00000), (0.05137, 0.00862), (0.05179, 0.21552), (0.05430, 0.48276)),
        *((0.05842, 0.70690), (0.06312, 0.83621), (0.06942, 0.93103), (0.07786, 1.00000)),
        *((0.08845, 1.00000), (0.09270, 0.98276), (0.10120, 0.93103), (0.11455, 0.72414)),
        *((0.12158, 0.45690), (0.12435, 0.23276), (0.12500, 0.00000)),
    )
)

# Indicated power below which an engine stops, hp; share of the idle speed below which it does.
_STOPS, _SLOWEST = 0.1250, 0.8

# Ratios of specific heats of air, as two formulas of JSBSim have them.
_FILLING, _COMPRESSION = 1.3, 1.414


@dataclass(frozen=True)
class _Air:
    """Pressures (Pa) around the engine, and its speeds."""

    ambient: Number
    ram: Number
    rpm: Number
    piston_speed: Number  # mean, ft/s


def piston(now: Properties, engine: EngineFile) -> Number:
    """Power, hp; the engine stops and starts by itself."""
    functions_of(now, engine, ())
    return power_of(now, engine)


def power_of(now: Properties, engine: EngineFile) -> Number:
    """Power of a piston engine (hp) whose functions are evaluated."""
    motor, at = engine.motor, engine.at
    if now.trimming and supercharger_of(engine):
        raise Unsupported("a supercharger in a trim")
    air = _air(now, engine)
    ambient, rpm, speed = air.ambient, air.rpm, air.piston_speed
    # Both magnetos are on. Fuel is that of the step before.
    slowest = value_of(motor, "idlerpm", 600.0) * _SLOWEST
    was = different(now[f"{at}/set-running"], 0.0)
    turns = (was & (rpm >= slowest)) | (rpm > slowest)
    runs = turns & (now[f"{at}/fuel-flow-rate-pps"] > 0.0)
    throttled = _throttled_pressure(now, engine, air)
    manifold, loss = _boosted(now, engine, throttled, air)
    now[f"{at}/map-pa"], now[f"{at}/map-inhg"] = manifold, manifold / _INHG_TO_PA
    flow = _air_flow(now, engine, manifold, air)
    mixture = now[engine.numbered("fcs/mixture-pos-norm")]
    fuel = (flow * ((1.3 * mixture) * 101325.0 / ambient)) / 14.7
    now[f"{at}/fuel-flow-rate-pps"] = rate = fuel * 2.2046
    table = table_in(motor, "MIXTURE") or _MIXTURE
    if not isinstance(table, Table1):
        raise Unsupported("a table MIXTURE of two dimensions")
    friction = now[f"{at}/friction-hp"]
    burned = ((rate * 3600) / now[f"{at}/bsfc-lbs_hphr"]) * table.at(fuel / flow)
    standing = _cranked(now, engine, rpm) if now.starting else -friction
    indicated = select(runs, burned - friction, standing)
    dynamic = value_in(motor, "dynamic-fmep", "PA", 18400.0)
    static = value_in(motor, "static-fmep", "PA", 46500.0)
    rubbing = select(runs, -dynamic * speed * FT_TO_M - static, 0.0)
    pumped = (throttled - ambient) * now[f"{at}/volumetric-efficiency"]
    work = (pumped + rubbing) * _displacement(engine) * rpm
    goes_on = runs & negated(indicated < _STOPS)
    now[f"{at}/set-running"] = select(goes_on, 1.0, 0.0)
    return indicated + work / (value_of(motor, "cycles", 4.0) * 22371) - loss


def _cranked(now: Properties, engine: EngineFile, rpm: Number) -> Number:
    """Indicated power of an engine that does not run, hp: that of a starter that turns it."""
    motor, at = engine.motor, engine.at
    fastest = value_of(motor, "starter-rpm", -1.0)
    if fastest < 0.0:
        fastest = 2 * value_of(motor, "idlerpm", 600.0)
    strength = value_of(motor, "starter-torque", -1.0)
    if strength < 0.0:
        strength = value_in(motor, "maxhp", "HP", 200.0) * 0.4
    share = select(rpm < fastest, 1.0 - rpm / fastest, 0.0)
    torque = strength * share * now[f"{at}/starter-norm"]
    power = torque * select(rpm < 1.0, 1.0, rpm) / 5252
    return select(different(now[STARTER], 0.0), power, -now[f"{at}/friction-hp"])


def _air(now: Properties, engine: EngineFile) -> _Air:
    ambient = now["atmosphere/P-psf"] * _PSF_TO_PA
    total = now["propulsion/pt-lbs_sqft"] * _PSF_TO_PA
    ram = (total - ambient) * now[f"{engine.at}/ram-air-factor"] + ambient
    rpm = now[f"{engine.at}/propeller-rpm"] * propeller_of(engine).gear_ratio
    speed = (rpm * value_in(engine.motor, "stroke", "IN", 4.375)) / 360
    return _Air(ambient, ram, rpm, speed)


def _displacement(engine: EngineFile) -> float:
    """Displacement, m^3."""
    inch = 1.0 / 12.0
    cubic_feet = 1.0 / (FT_TO_M * FT_TO_M * FT_TO_M)
    return value_in(engine.motor, "displacement", "IN3", 360.0) * (inch * inch * inch / cubic_feet)


def _throttled_pressure(now: Properties, engine: EngineFile, air: _Air) -> Number:
    """Pressure behind the throttle, before a supercharger, Pa."""
    motor, at = engine.motor, engine.at
    peak = value_of(motor, "peak-piston-speed", 100.0)
    idle = (value_of(motor, "idlerpm", 600.0) * value_in(motor, "stroke", "IN", 4.375)) / 360
    least = value_in(motor, "minmp", "INHG", 6.5) * _INHG_TO_PA
    airbox = now[f"{at}/air-intake-impedance-factor"]
    closed = (peak / idle) * (_STANDARD_PRESSURE / least - 1) - airbox
    throttle = now[engine.throttle]
    shut = (1 - throttle) * (1 - throttle) * closed
    through = select(air.piston_speed > 0.0, peak / air.piston_speed, 999999.0)
    pressure = now[f"_throttled{engine.number}"]
    change = pressure - air.ram * (through / (through + airbox + shut))
    lag = value_of(motor, "man-press-lag", 1.0)
    change = select(lag > now.elapsed, change * (now.elapsed / lag), change)
    now[f"_throttled{engine.number}"] = pressure - change
    return pressure - change


@dataclass(frozen=True)
class Supercharger:
    """Speeds of a supercharger that can be used, each with its numbers."""

    multiples: tuple[float, ...]  # of pressure at the rated speed
    speeds: tuple[float, ...]  # rated, 1/min
    pressures: tuple[float, ...]  # rated, Pa
    takeoff: tuple[float, ...] | None  # pressures with the lever fully open, Pa
    switches: tuple[float, ...]  # ambient pressures at which the next speed is taken, Pa
    manual: bool
    unlimited: bool


def supercharger_of(engine: EngineFile) -> Supercharger | None:
    """The supercharger of a piston engine."""
    motor = engine.motor
    count = int(value_of(motor, "numboostspeeds", 0.0))

    def numbers(name: str, unit: str, default: float = 0.0) -> list[float]:
        names = [f"{name}{k}" for k in range(1, _MOST_SPEEDS + 1)]
        return [value_in(motor, each, unit, default) for each in names]

    boosts, powers = numbers("ratedboost", "PSI"), numbers("ratedpower", "HP")
    heights, speeds = numbers("ratedaltitude", "FT"), numbers("ratedrpm", "RPM", 2500.0)
    takeoff = value_in(motor, "takeoffboost", "PSI", 0.0)
    usable = 0
    for k in range(min(count, _MOST_SPEEDS)):
        if boosts[k] <= 0.0 or powers[k] <= 0.0 or heights[k] < 0.0:
            break
        if k and heights[k] < heights[k - 1]:
            break
        usable = k + 1
    if not usable:
        return None
    rated = [_STANDARD_PRESSURE + boost * _PSI_TO_PA for boost in boosts[:usable]]
    more = (takeoff - boosts[0]) * _PSI_TO_PA if takeoff > boosts[0] else None
    return Supercharger(
        multiples=tuple(
            pressure / (_standard_pressure(h) * _PSF_TO_PA)
            for pressure, h in zip(rated, heights, strict=False)
        ),
        speeds=tuple(speeds[:usable]),
        pressures=tuple(rated),
        takeoff=None if more is None else tuple(pressure + more for pressure in rated),
        switches=tuple(
            _standard_pressure(h + 1000 if h > 0.0 else h) * _PSF_TO_PA
            for h in heights[: usable - 1]
        ),
        manual=value_of(motor, "boostmanual", 0.0) == 1,
        unlimited=value_of(motor, "boostoverride", 0.0) == 1,
    )


def _standard_pressure(h: float) -> float:
    """Pressure of the standard atmosphere at a height (ft) by a polynomial, psf."""
    coefficients = (
        *(2116.217, -7.648932746e-2, 1.0925498604e-6),
        *(-7.1135726027e-12, 1.7470331356e-17),
    )
    powers = [1.0]
    for _ in coefficients[1:]:
        powers.append(powers[-1] * h)
    total = 0.0
    for coefficient, of_height in zip(coefficients, powers, strict=True):
        total += coefficient * of_height
    return total


def _boosted(
    now: Properties, engine: EngineFile, pressure: Number, air: _Air
) -> tuple[Number, Number]:
    """Pressure behind a supercharger (Pa), and the power that it takes, hp."""
    charger = supercharger_of(engine)
    manifold = pressure
    if charger is not None:
        speed = _supercharger_speed(now, engine, charger, air.ambient)
        of_speed = {
            name: _of(values, speed)
            for name, values in (
                ("multiple", charger.multiples),
                ("rpm", charger.speeds),
                ("limit", charger.pressures),
                ("takeoff", charger.takeoff or charger.pressures),
            )
        }
        factor = ((of_speed["multiple"] - 1) / of_speed["rpm"]) * air.rpm + 1
        manifold = pressure * factor
        if not charger.unlimited:
            limit = of_speed["limit"]
            if charger.takeoff is not None:
                limit = select(now[engine.throttle] > 0.98, of_speed["takeoff"], limit)
            manifold = select(manifold > limit, limit, manifold)
    lost = value_of(engine.motor, "boost-loss-factor", 0.0)
    if engine.motor.find("numboostspeeds") is None or not lost > 0.0:
        return manifold, 0.0
    lost_factor = now[f"{engine.at}/boostloss-factor"]
    g = _COMPRESSION
    work = (pressure * now[f"_air-flow{engine.number}"] * g) / (g - 1)
    loss = work * (power(manifold / pressure, (g - 1) / g) - 1) * lost_factor / 745.7
    now[f"{engine.at}/boostloss-hp"] = loss
    return manifold, loss


def _of(values: tuple[float, ...], speed: Number) -> Number:
    """The number of the speed that is engaged."""
    y: Number = values[0]
    for k, value in enumerate(values[1:], 1):
        y = select(speed >= float(k), value, y)
    return y


def _supercharger_speed(
    now: Properties, engine: EngineFile, charger: Supercharger, ambient: Number
) -> Number:
    """The speed that is engaged, from 0 on."""
    last = len(charger.speeds) - 1
    if not last:
        return 0.0
    name = f"{engine.at}/boost-speed"
    speed = now[name]
    if charger.manual:
        speed = select(speed > last, float(last), select(speed < 0.0, 0.0, speed))
    else:
        here = _of((*charger.switches, 0.0), speed)
        speed = select((speed < last) & (ambient < here - _HYSTERESIS), speed + 1.0, speed)
        below = _of((0.0, *charger.switches), speed)
        speed = select((speed > 0.0) & (ambient > below + _HYSTERESIS), speed - 1.0, speed)
    now[name] = speed
    return speed


def _air_flow(now: Properties, engine: EngineFile, manifold: Number, air: _Air) -> Number:
    """Mass of air a second, kg/s."""
    compression = value_of(engine.motor, "compression-ratio", 8.5)
    ratio = select(manifold < 1.0, compression, air.ambient / manifold)
    ratio = select(ratio > compression, compression, ratio)
    filled = (_FILLING - 1) / _FILLING
    filled = filled + (compression - ratio) / (_FILLING * (compression - 1))
    swept = (_displacement(engine) * (air.rpm / 60)) / 2
    volume = swept * (now[f"{engine.at}/volumetric-efficiency"] * filled)
    now[f"_air-flow{engine.number}"] = volume
    return volume * (manifold / (287.3 * (now["atmosphere/T-R"] / 1.8)))
