# SPDX-License-Identifier: LGPL-2.1-or-later
"""An aircraft before its flight: evaluated, or held still while its engines settle.

All functions work on one row of numbers, which stands for JSBSim's memory.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

from flighttune.compiled.engine_files import EngineFile
from flighttune.compiled.engines import run_engine
from flighttune.compiled.ir import function_ir, module
from flighttune.compiled.machine import Loaded
from flighttune.compiled.properties import Properties, named
from flighttune.compiled.run import Model, run_still
from flighttune.compiled.step import Names
from flighttune.compiled.trace import Graph, Number, Truth, fabs, select
from flighttune.compiled.trimming import STATE, evaluation

# Length of a step, s; change of thrust, as a share of it, that ends the wait; samples so far, and
# whether the last one changed so little.
ELAPSED, SHARE, SAMPLES, AT_REST = "_elapsed", "_share", "_samples", "_at-rest"

# JSBSim's search for a steady thrust: its steps, s; the change of thrust that is none, lbf; the
# samples in a row that make a steady one, and the longest search.
_SEARCH_STEP, _NO_CHANGE, _STEADY, MAX_SEARCH = 0.5, 0.0001, 120, 6000
THRUST, UNCHANGED = "_thrust", "_unchanged"

# Numbers of the row that JSBSim has not
ROW = ELAPSED, SHARE, SAMPLES, AT_REST, THRUST, UNCHANGED


def before_flight(model: Model, thrusts: Sequence[str]) -> tuple[Names, str]:
    """Names of the row, those that are never written first, and the IR of `BeforeFlight`.

    `thrusts` are the properties with the thrust of the engines.
    """
    functions: dict[str, tuple[Properties, Truth]] = {"evaluate": (evaluation(model), False)}
    if thrusts:
        functions["hold"] = _held(model, thrusts[0])
        functions |= {f"search{x.number}": _searched(model, x) for x in model.engines}
    every = {name: None for now, _ in functions.values() for name in (*now.inputs, *now.now)}
    written = {name for now, _ in functions.values() for name in now.now}
    # The numbers of the initial state stand together.
    parameters = (*STATE, *(name for name in every if name not in written and name not in STATE))
    states = tuple(name for name in every if name in written)
    places = {name: ("s", i) for i, name in enumerate((*parameters, *states))}
    texts = [
        function_ir(name, now.graph, places, [now[x] for x in places], until=until)
        for name, (now, until) in functions.items()
    ]
    return Names(states, parameters, (), (), ()), module(*texts)


def _held(model: Model, thrust: str) -> tuple[Properties, Truth]:
    """A step of an aircraft that stays still, and whether its thrust is steady."""
    now = Properties(Graph(), model.dt)
    now.elapsed, now.starting = now[ELAPSED], True
    before, samples = now[thrust], now[SAMPLES]
    run_still(now, model)
    change = fabs(now[thrust] - before)
    at_rest = (samples > 0.0) & (change < now[SHARE] * fabs(before))
    now[SAMPLES], now[AT_REST] = samples + 1.0, _number(at_rest)
    return now, at_rest


def _searched(model: Model, engine: EngineFile) -> tuple[Properties, Truth]:
    """A step of an engine alone, and whether its thrust is steady."""
    now = Properties(Graph(), model.dt)
    now.elapsed, now.cg = _SEARCH_STEP, now.vector(named("inertia/cg-{}-in"))
    before, unchanged = now[THRUST], now[UNCHANGED]
    thrust = run_engine(now, engine).thrust
    count = select(fabs(before - thrust) < _NO_CHANGE, unchanged + 1.0, 0.0)
    now[THRUST], now[UNCHANGED] = thrust, count
    return now, count > float(_STEADY)


def _number(condition: Truth) -> Number:
    return select(condition, 1.0, 0.0)


class BeforeFlight:
    """Machine code of an aircraft before its flight.

    Each of `functions`, by name, takes the address of the row and the largest number of steps. They
    are good as long as this object lives.
    """

    def __init__(self, names: Names, code: bytes, engines: int) -> None:
        self.names, self._loaded = names, Loaded(code)
        void, pointer, count = None, ctypes.c_void_p, ctypes.c_int64
        kind = ctypes.CFUNCTYPE(void, pointer, pointer, count, pointer, pointer, count)
        wanted = ("evaluate", "hold", *(f"search{i}" for i in range(engines)))
        found = {name: self._loaded.address(name) for name in wanted}
        self.functions: dict[str, Any] = {name: kind(x) for name, x in found.items() if x}
