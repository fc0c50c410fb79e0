# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, or why there is none: what the rest of the package imports."""

from dataclasses import dataclass
from functools import lru_cache

from flighttune.base.arrays import FloatArray
from flighttune.base.units import FT
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.compiled import machine
from flighttune.vehicles.compiled.model import Source
from flighttune.vehicles.compiled.properties import Unsupported
from flighttune.vehicles.compiled.run import Model
from flighttune.vehicles.compiled.signals import GROUND, HEIGHT_0, shown_signals
from flighttune.vehicles.compiled.start import start_values
from flighttune.vehicles.compiled.step import MachineStep, traced
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.weather import TurbulenceModel


@dataclass(frozen=True)
class Refusal:
    """Why JSBSim flies an aircraft itself."""

    reason: str


@dataclass(frozen=True)
class Start:
    """The start of one flight."""

    states: FloatArray
    parameters: FloatArray


class CompiledStep:
    """The step of an aircraft in machine code, for all flights that differ in numbers alone.

    Attributes
    ----------
    names : Names
        Places of states, parameters, signals and properties in their arrays.
    machine : MachineStep
        The machine code.
    """

    def __init__(self, model: Model, step: MachineStep) -> None:
        self.model, self.machine, self.names = model, step, step.names

    def start_from(self, plant: JSBSimPlant) -> Start:
        """The start of a flight whose plant has started; the plant cannot fly any more."""
        fdm = plant.fdm
        if fdm is None:
            raise AssertionError("the plant has started")
        source = Source(plant.config, fdm.steps)
        names = (*self.names.states, *self.names.parameters)
        own = {HEIGHT_0: fdm.reader("position/h-sl-ft")() * FT, GROUND: fdm.ground}
        known = [name for name in names if name not in own]
        values = start_values(fdm, self.model, source.numbers, known) | own
        return Start(*self.machine.arrays(values.__getitem__))


def compiled(
    config: AircraftConfig, *, steps: int = 1, turbulence: TurbulenceModel | None = None
) -> CompiledStep | Refusal:
    """The compiled step of an aircraft in still air or wind, or in a kind of turbulence.

    `steps`: integration steps in a sample of the inner loop.
    """
    if why := machine.unknown_platform():
        return Refusal(why)
    source = Source(config, steps)
    return _compiled(source, turbulence)


@lru_cache(maxsize=32)
def _compiled(source: Source, turbulence: TurbulenceModel | None) -> CompiledStep | Refusal:
    try:
        model = source.model(turbulence)
        thrust = source.config.engines.thrust or ""
        names, text = traced(model, lambda now: shown_signals(now, model.engines, thrust))
        return CompiledStep(model, MachineStep(names, machine.object_code(text)))
    except Unsupported as what:
        return Refusal(f"the compiled step does not know {what}")
