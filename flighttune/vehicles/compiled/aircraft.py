# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, and the start of a flight on it."""

import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import PlantError
from flighttune.base.units import FT
from flighttune.vehicles.compiled.evaluated import EvaluatedFdm
from flighttune.vehicles.compiled.model import Air, Source
from flighttune.vehicles.compiled.normals import seeded
from flighttune.vehicles.compiled.signals import GROUND, HEIGHT_0
from flighttune.vehicles.compiled.start import start_values
from flighttune.vehicles.compiled.step import MachineStep, Names
from flighttune.vehicles.compiled.turbulence import gust_numbers
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant


@dataclass(frozen=True)
class Start:
    """The start of one flight: states and parameters in the order of `Names`.

    `random` is the state of the turbulence's random generator.
    """

    states: FloatArray
    parameters: FloatArray
    random: npt.NDArray[np.int64]


class CompiledStep:
    """The step of an aircraft in machine code, for all flights that differ only in numbers.

    Attributes
    ----------
    source : Source
        The aircraft.
    air : Air
        The kind of air.
    steps : int
        Integration steps in a sample of the inner loop.
    names : Names
        Places of states, parameters, stream, signals and properties in their arrays.
    functions : tuple
        ``step`` and ``normals``, as `MachineStep` describes them.
    """

    def __init__(self, source: Source, air: Air, names: Names, code: bytes) -> None:
        self.source, self.air, self.steps = source, air, source.steps
        self._model = source.model(air)
        self._machine = machine = MachineStep(names, code)
        self.names, self.functions = names, machine.functions
        self.normals, self.fly = machine.normals, machine.fly

    def start_from(self, plant: JSBSimPlant) -> Start:
        """The start of a flight, from a plant that has started; the plant cannot fly afterwards."""
        fdm = plant.fdm
        if fdm is None:
            raise PlantError("`JSBSimPlant` must be started before its flight is compiled.")
        own = {HEIGHT_0: fdm.reader("position/h-sl-ft")() * FT, GROUND: fdm.ground}
        if self.air.gust:
            if plant.weather is None or plant.weather.gust is None:
                raise PlantError("`weather` must have a gust for a step with a gust.")
            own |= gust_numbers(plant.weather.gust, fdm.rate)
        names = [x for x in (*self.names.states, *self.names.parameters) if x not in own]
        if isinstance(fdm, EvaluatedFdm):
            values = fdm.start_values(names) | own
            return Start(*self._machine.arrays(values.__getitem__), seeded(plant.seed))
        numbers = Source(plant.config, fdm.steps, fdm.files).numbers
        with warnings.catch_warnings(action="ignore"):  # of the matrix class that JSBSim returns
            values = start_values(fdm, self._model, numbers, names) | own
        return Start(*self._machine.arrays(values.__getitem__), seeded(plant.seed))
