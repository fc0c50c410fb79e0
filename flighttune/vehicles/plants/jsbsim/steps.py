"""The compiled step of an aircraft, checked beside JSBSim and started; or why there is none."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from typing import NamedTuple

import numpy as np

from flighttune.base.errors import FlightTuneError, PlantError
from flighttune.base.units import FT
from flighttune.compiled import face
from flighttune.compiled.aircraft import CompiledStep, Start
from flighttune.compiled.check import (
    DURATION,
    CheckFlight,
    Unchecked,
    check_flight,
    differ,
    start_difference,
)
from flighttune.compiled.evaluated import Evaluation, Loaded
from flighttune.compiled.face import Refusal
from flighttune.compiled.model import Air
from flighttune.compiled.properties import Unsupported
from flighttune.compiled.turbulence import gust_numbers
from flighttune.control.controller import FlightCondition
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, OffNominal
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.evaluated import EvaluatedFdm, Evaluator, LoadedFdm
from flighttune.vehicles.plants.jsbsim.fdm import Fdm, load, thrusts_of
from flighttune.vehicles.plants.jsbsim.model_files import Unchanged, unchanged
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.source import GROUND, HEIGHT_0, source_of
from flighttune.vehicles.plants.jsbsim.trim import level
from flighttune.vehicles.plants.weather import (
    Gust,
    Turbulence,
    TurbulenceModel,
    Weather,
    WindProfile,
)

# Time of a doublet's half in a check flight, s.
_HALF = 2.0

# Shares of the limits on roll and load factor, and of the airspeed, that the doublets take.
_ROLL, _LOAD, _AIRSPEED = 0.4, 0.4, 0.05

# Gusts of the flights, and of gentle ones, m/s.
_GUST = Gust(axis="down", peak=1.5, start=1.5, rise=0.7, hold=0.4)
_GENTLE_GUST = replace(_GUST, peak=0.1)

# Turbulence of gentle flights, so low (m) that it follows the wind at 20 ft (m/s) alone.
_GENTLE = Turbulence(severity=1, wind_20ft=0.2)
_GENTLE_HEIGHT = 250.0

# Height of an aircraft without a design flight, and the least of a check flight: flights near the
# ground are not compiled, m.
_HEIGHT, _LOWEST = 1000.0, 200.0


class _Flight(NamedTuple):
    """A check flight: its air, the sign and size of its doublets, the seed of its turbulence."""

    wind: Weather
    turbulence: Turbulence
    doublets: float
    seed: int


_WIND = Weather(wind=WindProfile(((0.0, (2.0, -1.5, 0.2)),)))
_OTHER_WIND = Weather(wind=WindProfile(((0.0, (-4.0, 3.0, -0.3)),)))

_FLIGHT = _Flight(_WIND, Turbulence(severity=3, wind_20ft=4.0), 1.0, 11)

# Further flights where the step was never compared with JSBSim.
_FURTHER = (
    _Flight(Weather(), Turbulence(severity=1, wind_20ft=2.0), -1.0, 12),
    _Flight(_OTHER_WIND, Turbulence(severity=4, wind_20ft=8.0), 0.7, 13),
)


class _Way(NamedTuple):
    """How a check flight is flown: share of its doublets, air, place in the envelope, path angle.

    `descent` is in rad; `middle`: in the middle of the airspeeds, in place of the design flight.
    """

    doublets: float
    gentle: bool = False
    middle: bool = False
    descent: float = 0.0


# The first that keeps an aircraft inside its envelope is enough. Some have no thrust for level
# flight, and some no design flight inside their envelope.
_WAYS = (
    _Way(1.0),
    _Way(0.4),
    _Way(0.1, gentle=True),
    _Way(0.4, descent=0.06),
    _Way(0.2, middle=True),
    _Way(0.2, middle=True, descent=0.06),
)

# Share of what is off the nominal that an aircraft keeps which has no flight with all of it.
_SMALL = 0.02

_COMMANDS = (properties.PHI_CMD, properties.N_Z_CMD, properties.V_A_CMD)

# Beginnings of properties that a start writes, and of numbers that JSBSim does not show
_WRITTEN = "ft/", "atmosphere/gust-", "_"


def compiled(
    config: AircraftConfig,
    *,
    steps: int = 1,
    turbulence: TurbulenceModel | None = None,
    gust: bool = False,
    files: Unchanged | None = None,
) -> CompiledStep | Refusal:
    """The compiled step of an aircraft in still air or wind, with turbulence or a gust in it.

    The first use of an aircraft compiles its step and flies it beside JSBSim; the result is cached.
    `steps`: integration steps in a sample of the inner loop. `files` are those of an aircraft that
    JSBSim has loaded just now, by default looked at again.
    """

    def check(step: CompiledStep) -> str:
        flights = (_FLIGHT, *_FURTHER) if face.unproven() else (_FLIGHT,)
        return check_flight(step, [_ways(step, flight, config, steps) for flight in flights])

    source = source_of(config, steps, files or unchanged(config))
    return face.compiled(source, Air(turbulence, gust), _case_of(config), check)


def evaluated(
    config: AircraftConfig, *, ground: float = 0.0, files: Unchanged | None = None
) -> Fdm | None:
    """An aircraft that starts without JSBSim, to the bit; None if JSBSim must start it.

    The first use compiles its evaluations and starts it beside JSBSim; the result is cached.
    """
    files = files or unchanged(config)
    step = compiled(config, files=files)
    if isinstance(step, Refusal):
        return None

    def check(evaluation: Callable[[Loaded], Evaluation]) -> tuple[Loaded, str]:
        return _check_starts(step, evaluation, files, ground)

    kind = f"start {ground} {config.engines.settle} {config.settings}"
    evaluation = face.evaluated(step.source, kind, _case_of(config), thrusts_of(config), check)
    if isinstance(evaluation, Refusal):
        return None
    try:
        return Evaluator(evaluation, _evaluated_or_loaded)(files, 1, ground)
    except Unsupported:
        return None  # a start is not refused to its user: JSBSim makes it


def _evaluated_or_loaded(files: Unchanged, steps: int, ground: float) -> Fdm:
    by_code = evaluated(files.config, ground=ground, files=files)
    return by_code or load(files, steps, ground)


def not_compiled(config: AircraftConfig) -> str:
    """Why JSBSim flies all flights of an aircraft itself; empty if long ones are compiled."""
    step = compiled(config)
    return step.reason if isinstance(step, Refusal) else ""


def start_of(step: CompiledStep, plant: JSBSimPlant) -> Start:
    """The start of a flight, from a plant that has started; the plant cannot fly afterwards."""
    fdm = plant.fdm
    if fdm is None:
        raise PlantError("`JSBSimPlant` must be started before its flight is compiled.")
    own = {HEIGHT_0: fdm.reader("position/h-sl-ft")() * FT, GROUND: fdm.ground}
    if step.air.gust:
        if plant.weather is None or plant.weather.gust is None:
            raise PlantError("`weather` must have a gust for a step with a gust.")
        own |= gust_numbers(plant.weather.gust.numbers(fdm.rate))
    by_code = isinstance(fdm, EvaluatedFdm)
    numbers = fdm.numbers if by_code else source_of(plant.config, fdm.steps, fdm.files).numbers
    (_, phi), (low, high) = plant.config.limits.phi, plant.config.limits.n_z

    def swing(share: float) -> None:
        fdm.writer(properties.PHI_CMD)(phi * share)
        fdm.writer(properties.N_Z_CMD)(1.0 + min(high - 1.0, 1.0 - low) * share)

    return step.start(fdm, numbers, own, seed=plant.seed, swing=swing)


def _case_of(config: AircraftConfig) -> str:
    """Digest of all numbers that decide a check: what it finds holds for flights with these alone.

    Faults are no part of it, because none comes in a check.
    """
    off = config.off_nominal and config.off_nominal.model_copy(update={"fault": None})
    numbers = config.model_dump_json(), repr(config.gains), repr(off)
    return sha256("\n".join(numbers).encode()).hexdigest()


class _Unchanging(JSBSimPlant):
    """An aircraft on which nothing fails or ends in flight: its loop would write that."""

    def changes(self) -> list[tuple[float, str, float]]:
        """Nothing, at any time."""
        return []


def _ways(
    step: CompiledStep, flight: _Flight, config: AircraftConfig, steps: int
) -> Iterator[Callable[[], CheckFlight]]:
    """Ways to fly a check flight; in the last the aircraft is nearly that of its files."""
    for way in _WAYS:
        yield partial(_started, step, flight, way, config, steps)
    if config.off_nominal:
        near = config.with_off_nominal(_nearly_nominal(config.off_nominal))
        yield partial(_started, step, flight, _WAYS[0], near, steps)


def _nearly_nominal(off: OffNominal) -> OffNominal:
    """Small differences from the files in the same numbers, which have the same step."""

    def small(name: str, value: float) -> float:
        nominal = 1.0 if name.endswith("_factor") else 0.0
        return nominal + _SMALL * (value - nominal)

    numbers = off.model_dump(exclude={"fault", "coefficient_factors"})
    of_functions = {x: 1.0 + _SMALL * (by - 1.0) for x, by in off.coefficient_factors.items()}
    changed = {name: small(name, value) for name, value in numbers.items()}
    return off.model_copy(update=changed | {"coefficient_factors": of_functions})


def _started(
    step: CompiledStep, flight: _Flight, way: _Way, config: AircraftConfig, steps: int
) -> CheckFlight:
    """An aircraft in a check flight, in the turbulence and gust of the step."""
    model, gust = step.air
    turbulent = _GENTLE if way.gentle else flight.turbulence
    turbulence = replace(turbulent, model=model) if model else None
    blow = _GENTLE_GUST if way.gentle else _GUST
    weather = replace(flight.wind, turbulence=turbulence, gust=blow if gust else None)
    plant = _Unchanging(config, steps=steps, weather=weather, seed=flight.seed)
    plant.start(_condition(config, way))
    fdm = plant.fdm
    assert fdm is not None  # it has started
    V_a, write_V_a = fdm.reader(properties.V_A_CMD)(), fdm.writer(properties.V_A_CMD)

    def advance(commands: Sequence[float]) -> bool:
        phi, n_z, speed = commands
        write_V_a(speed)
        return plant.advance(phi, n_z, 1.0 / fdm.rate) is None

    return CheckFlight(
        fdm=fdm,
        levers=_COMMANDS,
        commands=lambda t: _commands_at(t, config, V_a, way.doublets * flight.doublets),
        advance=advance,
        start=lambda: start_of(step, plant),
    )


def _commands_at(
    t: float, config: AircraftConfig, V_a: float, share: float
) -> tuple[float, float, float]:
    """Roll, load factor and airspeed (m/s) at a time: a doublet in each, then in all."""

    def doublet(start: float) -> float:
        # A command of -0 is none that a law gives.
        return share * {0: 1.0, 1: -1.0}.get(math.floor((t - start) / _HALF), 0.0) + 0.0

    (_, phi_max), (n_z_min, n_z_max) = config.limits.phi, config.limits.n_z
    together = doublet(16.0)
    roll, load, speed = (doublet(start) + together for start in (1.0, 6.0, 11.0))
    reach = min(n_z_max - 1.0, 1.0 - n_z_min)
    return _ROLL * phi_max * roll, 1.0 + _LOAD * reach * load, V_a * (1.0 + _AIRSPEED * speed)


def design_flight(config: AircraftConfig) -> tuple[float, float]:
    """Airspeed (m/s) and height (m) of the design flight."""
    if config.design:
        return config.design.V_a, config.design.h
    return 0.5 * sum(config.envelope.V_a), _HEIGHT


def _condition(config: AircraftConfig, way: _Way) -> FlightCondition:
    """Start of a check flight, so high that it does not end at the ground."""
    V_a, h = design_flight(config)
    if way.middle:
        V_a = 0.5 * sum(config.envelope.V_a)
    h = max(_GENTLE_HEIGHT if way.gentle else h, _LOWEST + DURATION * V_a * way.descent)
    condition = level(config, V_a, h)
    return replace(condition, gamma=condition.gamma - way.descent)


def _check_starts(
    step: CompiledStep, evaluation: Callable[[Loaded], Evaluation], files: Unchanged, ground: float
) -> tuple[Loaded, str]:
    """Start flights by both; what JSBSim showed, and the first number that differs, if any does."""
    loaded, started = _starts(files, ground)
    by_code = Evaluator(evaluation(loaded), _evaluated_or_loaded)
    names = by_code.evaluation.code.names.parameters
    constants = {name for name in names if not name.startswith(_WRITTEN)}
    if taken := constants & set(loaded.moved):
        return loaded, f"`{min(taken)}`, taken for constant, is moved by a start"
    for condition, plant in started:
        by_jsbsim = start_of(step, plant)
        other = JSBSimPlant(files.config, weather=plant.weather, ground=ground)
        other.start(condition, by_code(files, 1, ground))
        if difference := start_difference(step, by_jsbsim, start_of(step, other), plant.rate):
            return loaded, difference
    return loaded, ""


def _starts(
    files: Unchanged, ground: float
) -> tuple[Loaded, list[tuple[FlightCondition, JSBSimPlant]]]:
    """What JSBSim shows before and after starts, and these; the first that it can make."""
    errors: list[FlightTuneError] = []
    for way in _WAYS:
        try:
            return _started_beside(files, ground, way)
        except FlightTuneError as error:
            errors.append(error)
    raise Unchecked(f"there is no start to check it at: {errors[0]}") from errors[0]


def _started_beside(
    files: Unchanged, ground: float, way: _Way
) -> tuple[Loaded, list[tuple[FlightCondition, JSBSimPlant]]]:
    """A start, and one in a turn in wind."""
    config = files.config
    loaded = LoadedFdm(config, ground=ground, files=files).known
    straight = _condition(config, way)
    straight = replace(straight, h=straight.h + ground)
    turn = replace(straight, h=straight.h + 70.0, chi=0.7, gamma=straight.gamma + 0.02, phi=0.2)
    flights: list[tuple[FlightCondition, Weather | None]] = [(straight, None)]
    if config.engines.count:
        flights.append((turn, _WIND))
    started = []
    for condition, air in flights:
        plant = JSBSimPlant(config, weather=air, ground=ground)
        fdm = LoadedFdm(config, ground=ground, files=files)
        plant.start(condition, fdm)
        started.append((condition, plant))
        now = fdm.shown()
        moved = {x for x, value in loaded.after.items() if differ(value, now.get(x, np.nan))}
        loaded = replace(loaded, moved=sorted({*loaded.moved, *moved}))
    return loaded, started
