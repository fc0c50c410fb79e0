# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft, and the start of a flight on it."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.compiled.dynamics import Doubles, FlightDynamics
from flighttune.compiled.evaluated import Memory
from flighttune.compiled.model import Air, Source
from flighttune.compiled.normals import seeded
from flighttune.compiled.start import start_values
from flighttune.compiled.step import MachineStep, Names


@dataclass(frozen=True)
class Start:
    """The start of one flight: states and parameters in the order of `Names`.

    `random` is the state of the turbulence's random generator.
    """

    states: Doubles
    parameters: Doubles
    random: npt.NDArray[np.int64]


class CompiledStep:
    """The step of an aircraft in machine code, for all flights that differ only in numbers.

    Attributes
    ----------
    source : Source
        The aircraft.
    air : Air
        The kind of air.
    names : Names
        Places of states, parameters, stream, signals and properties in their arrays.
    functions : tuple
        ``step`` and ``normals``, as `MachineStep` describes them.
    machine : MachineStep
        The step itself.
    """

    def __init__(self, source: Source, air: Air, names: Names, code: bytes) -> None:
        self.source, self.air = source, air
        self._model = source.model(air)
        self.machine = machine = MachineStep(names, code)
        self.names, self.functions = names, machine.functions
        self.normals, self.fly = machine.normals, machine.fly

    def start(
        self,
        fdm: FlightDynamics,
        numbers: Mapping[str, float],
        own: Mapping[str, float],
        *,
        seed: int,
        swing: Callable[[float], None],
    ) -> Start:
        """The start of a flight, from an aircraft at its start, which cannot fly afterwards.

        `numbers` are those of the flight by placeholder, `own` are values of states and parameters
        that JSBSim has not, `seed` is that of turbulence; `swing`: as for `start_values`.
        """
        names = [x for x in (*self.names.states, *self.names.parameters) if x not in own]
        if isinstance(fdm, Memory):
            values = fdm.start_values(names)
        else:
            with warnings.catch_warnings(action="ignore"):  # of JSBSim's class of matrices
                values = start_values(fdm, self._model, numbers, names, swing)
        return Start(*self.machine.arrays((values | {**own}).__getitem__), seeded(seed))
