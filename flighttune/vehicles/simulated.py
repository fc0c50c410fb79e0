"""Starts of many flights of one aircraft, for the simulator of the compiled room."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import FlightTuneError, InputError, PlantError
from flighttune.base.files.table import validated
from flighttune.compiled.aircraft import CompiledStep, Start
from flighttune.compiled.face import Refusal
from flighttune.compiled.normals import seeded
from flighttune.compiled.properties import Unsupported
from flighttune.compiled.simulator import Inputs, Trimmed, numbers
from flighttune.control.controller import FlightCondition
from flighttune.vehicles.aircraft.aircraft import (
    SURFACES,
    AircraftConfig,
    OffNominal,
    load_aircraft,
)
from flighttune.vehicles.plants.jsbsim import properties, steps
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import unchanged
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED, JSBSimPlant, check_off_nominal
from flighttune.vehicles.plants.weather import CALM, NED, Weather, WindProfile
from flighttune.vehicles.weather_keys import GustTable, TurbulenceTable

_COMMANDS: Mapping[str, str] = {"phi_cmd": properties.PHI_CMD, "n_z_cmd": properties.N_Z_CMD}
_SURFACES: Mapping[str, str] = dict(zip((*SURFACES, "throttle"), properties.TRIMS, strict=True))

# Arguments of a flight that are no differences of the aircraft.
_CONDITION = tuple(field.name for field in fields(FlightCondition) if field.name != "n_z")

# Differences of an aircraft that are no numbers.
_NO_NUMBERS = "coefficient_factors", "fault"


def loaded(aircraft: str | Path, inputs: Inputs) -> "Simulated":
    """An aircraft by its name or folder, with the inputs that its flights take."""
    return Simulated(load_aircraft(aircraft), inputs)


class Simulated:
    """An aircraft whose flights the simulator of the compiled room starts."""

    def __init__(self, config: AircraftConfig, inputs: Inputs) -> None:
        self.name, self._config = config.folder.name, config
        self._by_surfaces = inputs == "surfaces"
        self.inputs: Mapping[str, str] = _SURFACES if self._by_surfaces else _COMMANDS
        self.others: Mapping[str, str] = (
            {} if self._by_surfaces else {"V_a_cmd": properties.V_A_CMD}
        )

    def trimmed(
        self,
        n: int | None,
        *,
        wind: npt.ArrayLike = CALM,
        turbulence: str | None = None,
        model: str = "tustin",
        gust: Mapping[str, Any] | None = None,
        seed: npt.ArrayLike | None = None,
        **given: npt.ArrayLike,
    ) -> Trimmed:
        """Flights that start in steady flight, as `Aircraft.trim` says."""
        columns = {name: _differing(name, np.atleast_1d(x)) for name, x in self._read(given)}
        winds = np.atleast_2d(numbers("wind", wind))
        if winds.ndim != 2 or winds.shape[1] != len(CALM):
            raise InputError(f"`wind` must have the shape (3,) or (n, 3), got {winds.shape}.")
        seeds = None if seed is None else np.atleast_1d(numbers("seed", seed))
        n = _flights(n, columns | {"wind": winds} | ({} if seeds is None else {"seed": seeds}))
        table = {"intensity": turbulence, "model": model}
        dryden = validated(TurbulenceTable, table, "`trim`").turbulence() if turbulence else None
        blow = None if gust is None else validated(GustTable, gust, "`gust` of `trim`")

        @cache
        def begun(row: tuple[tuple[str, float], ...], air: NED) -> Any:
            of = dict(row)
            still = not (dryden or blow or any(air))
            cosine = blow and blow.gust(of.get("V_a", steps.design_flight(self._config)[0]))
            profile = WindProfile(((0.0, air),))
            weather = Weather(wind=profile, turbulence=dryden, gust=cosine)
            return self._started(of, None if still else weather)

        flights = []
        for i, drawn in enumerate(np.arange(n) if seeds is None else np.broadcast_to(seeds, n)):
            row = tuple((name, float(x[i % len(x)])) for name, x in columns.items())
            try:
                step, start, shown = begun(row, tuple(winds[i % len(winds)].tolist()))
            except FlightTuneError as error:
                raise type(error)(f"flight {i}: {error}") from error
            if flights and step.source != flights[0][0].source:
                raise PlantError(f"flight {i}: its model has other parts than that of the first.")
            random = seeded(int(drawn) or LARGEST_SEED + 1)
            flights.append((step, replace(start, random=random), shown))
        every, starts, shown = zip(*flights, strict=True)
        return Trimmed(every[0], starts, shown)

    def _read(self, given: Mapping[str, npt.ArrayLike]) -> Iterator[tuple[str, FloatArray]]:
        """The numbers of a trim by name."""
        known = (*_CONDITION, *(x for x in OffNominal.model_fields if x not in _NO_NUMBERS))
        for name, values in given.items():
            if name not in known:
                raise InputError(f"`trim` must be given {', '.join(known)}, got `{name}`.")
            yield name, numbers(name, values)

    def _config_of(self, row: Mapping[str, float]) -> AircraftConfig:
        """The aircraft of a flight, with what differs from its files."""
        differs = {name: x for name, x in row.items() if name not in _CONDITION}
        if not differs:
            return self._config
        off = validated(OffNominal, differs, "`trim`")
        config = self._config.with_off_nominal(off)
        check_off_nominal(config)
        return config

    def _started(
        self, row: Mapping[str, float], weather: Weather | None
    ) -> tuple[CompiledStep, Start, Mapping[str, float]]:
        """Step and start of a flight, and what it shows."""
        config = self._config_of(row)
        V_a, h = steps.design_flight(config)
        given = {"V_a": V_a, "h": h} | {name: row[name] for name in _CONDITION if name in row}
        plant = JSBSimPlant(config, weather=weather)
        step, start, shown = started(plant, FlightCondition(**given))
        return step, (self._disengaged(step, start, shown) if self._by_surfaces else start), shown

    def _disengaged(self, step: CompiledStep, start: Start, shown: Mapping[str, float]) -> Start:
        """A start whose surfaces stay where they are, without the inner loop."""
        parameters, names = start.parameters.copy(), step.names.parameters
        held = {property_: shown[name] for name, property_ in self.inputs.items()}
        for name, value in {properties.ENGAGED: 0.0, **held}.items():
            parameters[names.index(name)] = value
        return replace(start, parameters=parameters)


def started(
    plant: JSBSimPlant, condition: FlightCondition
) -> tuple[CompiledStep, Start, Mapping[str, float]]:
    """Step and start of an aircraft with its weather, and what it shows there.

    Raises PlantError where only JSBSim can fly: several integration steps in a sample of the inner
    loop, a wind that changes, or a fault.
    """
    config, air = plant.config, plant.weather or Weather()
    files = unchanged(config)
    step = steps.compiled(
        config,
        turbulence=air.turbulence and air.turbulence.model,
        gust=air.gust is not None,
        files=files,
    )
    why = step.reason if isinstance(step, Refusal) else ""
    if air.changes:
        why = "its wind changes over time or height"
    elif plant.steps > 1:
        why = "a sample of its inner loop has several integration steps"
    if not why:
        plant.start(condition, steps.evaluated(config, ground=plant.ground, files=files))
        why = "something changes in flight" if plant.changes() else ""
    fdm = plant.fdm
    if why or isinstance(step, Refusal) or fdm is None:
        raise PlantError(f"{config.file}: it must fly compiled: {why}.")
    shown = {name: _value(fdm, name) for name in step.names.properties}
    shown |= dict(zip(plant.signals, plant.observe(), strict=True))
    return step, steps.start_of(step, plant), shown


def _value(fdm: Fdm, name: str) -> float:
    """A property at a start; not a number where only a step has it."""
    try:
        return fdm.value(name, np.nan)
    except (PlantError, Unsupported):
        return np.nan


def _differing(name: str, values: FloatArray) -> FloatArray:
    """Values of which none leaves an aircraft as its files have it where another one does not.

    A model with a factor has other parts than one without, and all flights have the same parts.
    """
    field = OffNominal.model_fields.get(name)
    if field is None or (values == field.default).all():
        return values
    nearly = np.nextafter(field.default, np.inf)  # changes nothing that is larger than rounding
    return np.where(values == field.default, nearly, values)


def _flights(n: int | None, columns: Mapping[str, FloatArray]) -> int:
    """The number of flights that all arguments state."""
    lengths = {name: len(x) for name, x in columns.items() if len(x) != 1}
    n = n or max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != n:
            raise InputError(f"`{name}` must be one value or {n} of them, got {length}.")
    return n
