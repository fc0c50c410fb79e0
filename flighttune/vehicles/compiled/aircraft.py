# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, and the start of a flight on it."""

from dataclasses import dataclass

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import PlantError
from flighttune.base.units import FT
from flighttune.vehicles.compiled.model import Air, Source
from flighttune.vehicles.compiled.signals import GROUND, HEIGHT_0
from flighttune.vehicles.compiled.start import start_values
from flighttune.vehicles.compiled.step import MachineStep, Names
from flighttune.vehicles.compiled.turbulence import gust_numbers
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED, JSBSimPlant


@dataclass(frozen=True)
class Start:
    """The start of one flight: its states and parameters, by the places of `Names`."""

    states: FloatArray
    parameters: FloatArray


class CompiledStep:
    """The step of an aircraft in machine code, for all flights that differ in numbers alone.

    Attributes
    ----------
    air : Air
        The kind of air that it is for.
    steps : int
        Integration steps in a sample of the inner loop.
    names : Names
        Places of states, parameters, stream, signals and properties in their arrays.
    address : int
        Address of ``step``, as `MachineStep` describes it.
    normals_address : int
        Address of ``normals``; 0 in calm air.
    """

    def __init__(self, source: Source, air: Air, names: Names, code: bytes) -> None:
        self.air, self.steps = air, source.steps
        self._source = source
        self._model = source.model(air)
        self._machine = machine = MachineStep(names, code)
        self.names, self.address = names, machine.address
        self.normals_address, self.fly = machine.normals_address, machine.fly

    def start_from(self, plant: JSBSimPlant) -> Start:
        """The start of a flight whose plant has started; the plant cannot fly any more."""
        fdm = plant.fdm
        if fdm is None:
            raise PlantError("`JSBSimPlant` must be started before its flight is compiled.")
        own = {HEIGHT_0: fdm.reader("position/h-sl-ft")() * FT, GROUND: fdm.ground}
        if self.air.gust:
            if plant.weather is None or plant.weather.gust is None:
                raise PlantError("`weather` must have a gust for a step that is made for one.")
            own |= gust_numbers(plant.weather.gust, fdm.rate)
        names = [x for x in (*self.names.states, *self.names.parameters) if x not in own]
        numbers = Source(plant.config, fdm.steps).numbers
        values = start_values(fdm, self._model, numbers, names) | own
        return Start(*self._machine.arrays(values.__getitem__))

    def normals(self, seed: int, steps: int) -> FloatArray:
        """The numbers of the stream of a flight in turbulence, a row a step; none in calm air."""
        if not self.names.stream:
            return np.empty((steps, 0))
        return self._machine.normals(seed or LARGEST_SEED + 1, steps)
