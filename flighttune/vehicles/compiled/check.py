# SPDX-License-Identifier: LGPL-2.1-or-later
"""The check flight: JSBSim and the compiled step fly the same, and every property is compared."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray, same_bits
from flighttune.base.errors import FlightTuneError, PlantError
from flighttune.base.words import told_apart
from flighttune.control.controller import FlightCondition
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.compiled.aircraft import CompiledStep
from flighttune.vehicles.compiled.evaluated import EvaluatedFdm, Evaluation, Loaded, LoadedFdm
from flighttune.vehicles.compiled.model import Source
from flighttune.vehicles.compiled.properties import INERTIAL_VELOCITY
from flighttune.vehicles.compiled.rigid_body import ACCELERATION_1, INERTIAL_ACCELERATION
from flighttune.vehicles.compiled.step import place_of
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.trim import level
from flighttune.vehicles.plants.weather import Gust, Turbulence, Weather, WindProfile

# Length of the flight and the shortest that counts, s; time of a doublet's half, s.
DURATION, _SHORTEST, _HALF = 20.0, 2.0, 2.0

# Time between two looks at what the step takes for constant, s.
_LOOK = 0.5

# Shares of the limits on roll and load factor, and of the airspeed, that the doublets take.
_ROLL, _LOAD, _AIRSPEED = 0.4, 0.4, 0.05

# Air of the flight, m/s.
_WIND = (2.0, -1.5, 0.2)
_TURBULENCE = {"severity": 3, "wind_20ft": 4.0}
_GUST = Gust(axis="down", peak=1.5, start=1.5, rise=0.7, hold=0.4)
_SEED = 11

# Height of an aircraft without a design flight, m.
_HEIGHT = 1000.0

_COMMANDS = (properties.PHI_CMD, properties.N_Z_CMD, properties.V_A_CMD)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Result of the check flight of an aircraft.

    Attributes
    ----------
    steps, compared : int
        Steps flown and properties compared in each.
    difference : str
        What differed first; empty if every property was equal to the bit in every step.
    """

    steps: int
    compared: int
    difference: str = ""


class Unchecked(Exception):
    """Why an aircraft with these numbers cannot be flown to check its step."""


class _Unchanging(JSBSimPlant):
    """An aircraft on which nothing fails or ends in flight: its loop would write that."""

    def changes(self) -> list[tuple[float, str, float]]:
        """Nothing, at any time."""
        return []


def case_of(config: AircraftConfig) -> str:
    """Digest of all numbers that decide a check: what it finds holds for flights with these alone.

    Faults are no part of it, because none comes in a check.
    """
    off = config.off_nominal and config.off_nominal.model_copy(update={"fault": None})
    numbers = config.model_dump_json(), repr(config.gains), repr(off)
    return sha256("\n".join(numbers).encode()).hexdigest()


def check_flight(step: CompiledStep, config: AircraftConfig) -> Verdict:
    """Fly both and compare them; raises `Unchecked` if there is too little to compare."""
    try:
        first, second = (_started(step, config) for _ in range(2))
        expected, ends, constants = _flown_by_jsbsim(step, first, config)
    except FlightTuneError as error:
        raise Unchecked(f"there is no flight to check it in: {error}") from error
    return _compared(step, second, config, expected, ends, constants)


def _started(step: CompiledStep, config: AircraftConfig) -> JSBSimPlant:
    """The aircraft in its design flight, in wind, and in the turbulence and gust of the step."""
    still: FlightCondition = level(config, *_design(config))
    weather = Weather(
        wind=WindProfile(((0.0, _WIND),)),
        turbulence=Turbulence(**_TURBULENCE, model=model)
        if (model := step.air.turbulence)
        else None,
        gust=_GUST if step.air.gust else None,
    )
    plant = _Unchanging(config, steps=step.steps, weather=weather, seed=_SEED)
    plant.start(still)
    return plant


def commands_at(t: float, config: AircraftConfig, V_a: float) -> tuple[float, float, float]:
    """Roll, load factor and airspeed (m/s) at a time: a doublet in each, then in all."""

    def doublet(start: float) -> float:
        return {0: 1.0, 1: -1.0}.get(math.floor((t - start) / _HALF), 0.0)

    (_, phi_max), (n_z_min, n_z_max) = config.limits.phi, config.limits.n_z
    together = doublet(16.0)
    roll, load, speed = (doublet(start) + together for start in (1.0, 6.0, 11.0))
    reach = min(n_z_max - 1.0, 1.0 - n_z_min)
    return _ROLL * phi_max * roll, 1.0 + _LOAD * reach * load, V_a * (1.0 + _AIRSPEED * speed)


def check_start(
    step: CompiledStep, evaluation: Evaluation, source: Source, ground: float
) -> tuple[Loaded, str]:
    """Start flights by both; what JSBSim showed, and the first number that differs, if any does."""
    weather = Weather(wind=WindProfile(((0.0, _WIND),)))
    config, loaded = source.config, evaluation.loaded
    try:
        straight = level(config, *_design(config))
        straight = replace(straight, h=straight.h + ground)
        turn = replace(straight, h=straight.h + 70.0, chi=0.7, gamma=straight.gamma + 0.02, phi=0.2)
        flights: list[tuple[FlightCondition, Weather | None]] = [(straight, None)]
        if config.engines.count:
            flights.append((turn, weather))
        started = []
        for condition, air in flights:
            plant = JSBSimPlant(config, steps=step.steps, weather=air, ground=ground)
            fdm = LoadedFdm(config, steps=step.steps, ground=ground, files=source.files)
            plant.start(condition, fdm)
            started.append((condition, plant))
            now = fdm.shown()
            moved = {x for x, value in loaded.after.items() if _differ(value, now.get(x, np.nan))}
            loaded = replace(loaded, moved=sorted({*loaded.moved, *moved}))
    except FlightTuneError as error:
        raise Unchecked(f"there is no start to check it at: {error}") from error
    evaluation = replace(evaluation, loaded=loaded)
    written = "ft/", "atmosphere/gust-", "_"
    constants = (x for x in evaluation.code.names.parameters if not x.startswith(written))
    if taken := set(constants) & set(loaded.moved):
        return loaded, f"`{min(taken)}`, taken for constant, is moved by a start"
    for condition, plant in started:
        by_jsbsim = _start_numbers(step, plant)
        other = JSBSimPlant(config, steps=step.steps, weather=plant.weather, ground=ground)
        other.start(condition, EvaluatedFdm(evaluation, source, ground=ground))
        compiled = _start_numbers(step, other)
        for name, value in by_jsbsim.items():
            if _differ(value, compiled[name]):
                wanted, got = told_apart(value, compiled[name])
                return loaded, f"`{name}` differs at a start: {wanted} by JSBSim, {got} compiled"
    return loaded, ""


def _differ(a: float, b: float) -> bool:
    """Whether numbers of a start differ; a sum of zeros may have either sign before a step."""
    return not (a == b or (math.isnan(a) and math.isnan(b)))


def _start_numbers(step: CompiledStep, plant: JSBSimPlant) -> dict[str, float]:
    """States and parameters at a start; the acceleration before it by the velocity it leads to."""
    start, rate = step.start_from(plant), plant.rate
    numbers = dict(zip(step.names.states, start.states.tolist(), strict=True))
    numbers |= dict(zip(step.names.parameters, start.parameters.tolist(), strict=True))
    vectors = INERTIAL_VELOCITY, INERTIAL_ACCELERATION, ACCELERATION_1
    for v, a, before in zip(*vectors, strict=True):
        if before in numbers:
            change = 1.5 * numbers[a] - 0.5 * numbers[before]
            numbers[before] = numbers[v] + 1.0 / rate * change
    return numbers


def _design(config: AircraftConfig) -> tuple[float, float]:
    """Airspeed (m/s) and height (m) of the design flight."""
    if config.design:
        return config.design.V_a, config.design.h
    return 0.5 * sum(config.envelope.V_a), _HEIGHT


def _shown(step: CompiledStep, plant: JSBSimPlant) -> list[int]:
    """Places of the properties that JSBSim shows too."""
    fdm = _fdm(plant)
    return [i for i, name in enumerate(step.names.properties) if fdm.shows(name)]


def _fdm(plant: JSBSimPlant) -> Fdm:
    """The flight dynamics of a plant that has started."""
    if plant.fdm is None:
        raise PlantError("`JSBSimPlant` must be started before it is compared.")
    return plant.fdm


def _flown_by_jsbsim(
    step: CompiledStep, plant: JSBSimPlant, config: AircraftConfig
) -> tuple[FloatArray, int, dict[str, float]]:
    """Rows of the properties after each step; the steps; what JSBSim moved of the parameters."""
    fdm = _fdm(plant)
    read = [fdm.reader(step.names.properties[i]) for i in _shown(step, plant)]
    write_V_a = fdm.writer(properties.V_A_CMD)
    V_a, rate = fdm.reader(properties.V_A_CMD)(), fdm.rate
    constant = {
        name: fdm.reader(name)
        for name in step.names.parameters
        if not name.startswith("_") and name not in _COMMANDS and fdm.shows(name)
    }
    before = [value() for value in constant.values()]
    moved: dict[str, float] = {}
    rows = np.empty((round(DURATION * rate), len(read)))
    look = max(1, round(_LOOK * rate))
    for k, row in enumerate(rows):
        phi, n_z, speed = commands_at(k / rate, config, V_a)
        write_V_a(speed)
        going = plant.advance(phi, n_z, 1.0 / rate) is None
        row[:] = [value() for value in read]
        if k % look == 0 or k == len(rows) - 1 or not going:
            same = same_bits([value() for value in constant.values()], before)
            moved = {name: k / rate for name, kept in zip(constant, same, strict=True) if not kept}
        if moved or not going:
            return rows[: k + 1], k + 1, moved
    return rows, len(rows), moved


def _compared(
    step: CompiledStep,
    plant: JSBSimPlant,
    config: AircraftConfig,
    expected: FloatArray,
    steps: int,
    moved: dict[str, float],
) -> Verdict:
    places, fdm = _shown(step, plant), _fdm(plant)
    if moved:
        name, t = next(iter(moved.items()))
        return Verdict(
            steps=steps,
            compared=len(places),
            difference=f"`{name}`, taken for constant, is moved by JSBSim by t = {t:.3f} s",
        )
    if steps < _SHORTEST * fdm.rate:
        raise Unchecked(f"the check flight left the envelope after {steps} steps")
    actual = _flown_compiled(step, plant, config, steps)[:, places]
    same = same_bits(actual, expected)
    names = [step.names.properties[i] for i in places]
    return Verdict(
        steps=steps,
        compared=len(places),
        difference="" if same.all() else _difference(names, expected, actual, same),
    )


def _flown_compiled(
    step: CompiledStep, plant: JSBSimPlant, config: AircraftConfig, steps: int
) -> FloatArray:
    """Rows of all properties after each step of the compiled flight."""
    fdm, names = _fdm(plant), step.names
    V_a, rate = fdm.reader(properties.V_A_CMD)(), fdm.rate
    start = step.start_from(plant)
    shown = np.empty(len(names.signals) + len(names.properties))
    rows = np.empty((steps, len(names.properties)))
    stream = step.normals(start.random, steps)
    levers = [place_of(names.parameters, name) for name in _COMMANDS]
    used = [i for i, place in enumerate(levers) if place >= 0]
    for k, row in enumerate(rows):
        values = commands_at(k / rate, config, V_a)
        for i in used:
            start.parameters[levers[i]] = values[i]
        step.fly(start.states, start.parameters, 1, stream[k : k + 1], shown)
        row[:] = shown[len(names.signals) :]
    return rows


def _difference(names: Sequence[str], expected: FloatArray, actual: FloatArray, same: Any) -> str:
    """The property that differs first, and the largest relative difference of any."""
    first = int(np.argmin(same.all(axis=1)))
    j = int(np.argmin(same[first]))
    with np.errstate(all="ignore"):
        size = np.abs(expected).max(axis=0, initial=0.0)
        relative = np.abs(actual - expected).max(axis=0) / np.where(size > 0.0, size, 1.0)
    worst = int(np.argmax(np.nan_to_num(relative, nan=np.inf)))
    wanted, got = told_apart(float(expected[first, j]), float(actual[first, j]))
    return (
        f"`{names[j]}` differs first, in step {first + 1}: {wanted} by JSBSim, {got} compiled; "
        f"most differs `{names[worst]}`, by {relative[worst]:.1e} of its largest value; "
        f"{int((~same.all(axis=0)).sum())} of {len(names)} properties differ"
    )
