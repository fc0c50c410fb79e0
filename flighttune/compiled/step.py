# SPDX-License-Identifier: LGPL-2.1-or-later
"""The compiled step of an aircraft: its states, parameters, signals and machine code."""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.compiled import normals, turbulence
from flighttune.compiled.dynamics import Doubles
from flighttune.compiled.ir import ALONE, Lanes, function_ir, module
from flighttune.compiled.machine import Loaded
from flighttune.compiled.properties import Properties
from flighttune.compiled.run import Model, run
from flighttune.compiled.slopes import SLOPE, slopes
from flighttune.compiled.trace import Graph, Number

# Further values of the last step by name, from the properties after it.
Shown: TypeAlias = Callable[[Properties], Mapping[str, Number]]


@dataclass(frozen=True)
class Names:
    """Places in the arrays of a compiled step."""

    states: tuple[str, ...]
    parameters: tuple[str, ...]
    stream: tuple[str, ...]  # inputs of which every step has its own
    signals: tuple[str, ...]
    properties: tuple[str, ...]


def traced(
    model: Model, shown: Shown, *, sloped: bool = False, lanes: Lanes = ALONE
) -> tuple[Names, str]:
    """The names and the IR of a step, of one aircraft or of several in the lanes of a vector.

    `sloped`: behind its states, parameters and signals stand their slopes; it has no properties.
    """
    graph = Graph()
    now = Properties(graph, model.dt)
    run(now, model)
    signals = dict(shown(now))
    stream = tuple(turbulence.NOISE) if model.turbulence else ()
    inputs = [name for name in now.inputs if name not in stream]
    states = tuple(name for name in inputs if name in now.now)
    names = Names(
        states=states,
        parameters=tuple(name for name in inputs if name not in now.now),
        stream=stream,
        signals=tuple(signals),
        properties=tuple(name for name in now.now if not name.startswith("_")),
    )
    new = [now.now[name] for name in states]
    properties = [now.now[name] for name in names.properties]
    if sloped:
        names, new, signals = _with_slopes(graph, names, new, signals)
        properties = []
    arrays = {"s": names.states, "p": names.parameters, "u": names.stream}
    places = {name: (array, i) for array, of in arrays.items() for i, name in enumerate(of)}
    values = list(signals.values()), properties, len(stream)
    step = function_ir("step", graph, places, new, *values, lanes=lanes)
    return names, module(step, normals.NORMALS)


def _with_slopes(
    graph: Graph, names: Names, new: list[Number], signals: dict[str, Number]
) -> tuple[Names, list[Number], dict[str, Number]]:
    """Names, new states and signals, each with its slopes behind it."""
    inputs = *names.states, *names.parameters
    known = {name: graph.node("input", f"{SLOPE}{name}") for name in inputs}
    values = [*new, *signals.values()]
    found = slopes(graph, known, values)
    of_states, of_signals = found[: len(new)], found[len(new) :]
    behind = dict(zip((f"{SLOPE}{name}" for name in signals), of_signals, strict=True))
    every = {
        kind: (*own, *(f"{SLOPE}{name}" for name in own))
        for kind in ("states", "parameters", "signals")
        for own in [getattr(names, kind)]
    }
    return replace(names, properties=(), **every), new + of_states, signals | behind


class MachineStep:
    """One step of an aircraft in machine code, for any number of flights.

    ``step(states, parameters, n, stream, shown, how_much)`` makes n steps in place; all but n and
    `how_much` are addresses of doubles. If `how_much` is 1 the signals of the last step are
    written to ``shown``, if it is 2 its properties behind them. `stream` has a row of numbers for
    each step, the normal numbers of turbulence: ``normals(state, n, out)`` makes the next n from
    the state of the generator, an integer of 64 bits. n is even: the numbers come in pairs.

    `functions` are ``step`` and ``normals``, good as long as this object lives.
    """

    def __init__(self, names: Names, code: bytes) -> None:
        self.names = names
        self._loaded = Loaded(code)
        void, pointer, count = None, ctypes.c_void_p, ctypes.c_int64
        of_step = ctypes.CFUNCTYPE(void, pointer, pointer, count, pointer, pointer, count)
        of_normals, address = ctypes.CFUNCTYPE(void, pointer, count, pointer), self._loaded.address
        self.functions: tuple[Any, Any] = (of_step(address("step")), of_normals(address("normals")))

    def arrays(self, values: Callable[[str], float]) -> tuple[Doubles, Doubles]:
        """States and parameters of a flight from their values by name."""
        states, parameters = (
            np.array([values(name) for name in names], dtype=float)
            for names in (self.names.states, self.names.parameters)
        )
        return states, parameters

    def normals(self, state: npt.NDArray[np.int64], steps: int) -> Doubles:
        """The next numbers of the stream of a flight, a row a step; none in calm air."""
        out = np.empty((steps, len(self.names.stream)))
        self.functions[1](state.ctypes.data, out.size, out.ctypes.data)
        return out

    def fly(
        self,
        states: Doubles,
        parameters: Doubles,
        steps: int,
        stream: Doubles | None = None,
        shown: Doubles | None = None,
    ) -> None:
        """Make steps; `shown` has room for the signals, or also for the properties behind them."""
        how_much = 0
        if shown is not None:
            how_much = 1 if len(shown) == len(self.names.signals) else 2
        self.functions[0](
            states.ctypes.data,
            parameters.ctypes.data,
            steps,
            None if stream is None else stream.ctypes.data,
            None if shown is None else shown.ctypes.data,
            how_much,
        )


def place_of(names: Sequence[str], name: str) -> int:
    """Where a name is in an array; -1 if the step does not need it."""
    return names.index(name) if name in names else -1
