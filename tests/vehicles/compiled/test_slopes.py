"""The slope of each operation of a traced step against central differences of it, compiled both."""

import ctypes

import numpy as np
import pytest

from flighttune.vehicles.compiled import slopes as rules
from flighttune.vehicles.compiled import trace
from flighttune.vehicles.compiled.ir import step_ir
from flighttune.vehicles.compiled.machine import Loaded, object_code
from flighttune.vehicles.compiled.trace import Graph, call

X, Y, HALF = 0.37, 1.21, 1e-6

OPERATIONS = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: 3.0 - x - y,
    "product": lambda x, y: x * y * 2.5,
    "quotient": lambda x, y: y / x + 2.0 / y,
    "negative": lambda x, y: -x * y,
    "power of a number": lambda x, y: call("pow", x, 1.7),
    "power": lambda x, y: call("pow", x, y),
    "number to a power": lambda x, y: call("pow", 2.0, x),
    "atan2": lambda x, y: call("atan2", y, x) + call("atan2", x, -2.0),
    "fmod": lambda x, y: call("fmod", 7.0 * x, y),
    "select": lambda x, y: trace.select(x < y, x * x, y) + trace.select(x > y, x, y * y),
    "limits": lambda x, y: trace.constrained(0.1, x, 0.5) + trace.constrained(2.0, y, 3.0),
    **{
        name: lambda x, y, name=name: call(name, x * y)
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "log10", "sqrt")
    },
    "fabs": lambda x, y: call("fabs", x - y),
    **{
        name: lambda x, y, name=name: y * call(name, 10.0 * x)
        for name in ("round", "floor", "ceil", "trunc")
    },
}


def compiled(function):
    """A function of x and y in machine code that gives its value and its slope along (dx, dy)."""
    graph = Graph()
    x, y, dx, dy = (graph.node("input", name) for name in ("x", "y", "dx", "dy"))
    value = function(x, y)
    (slope,) = rules.slopes(graph, {"x": dx, "y": dy}, [value])
    places = {name: ("s", i) for i, name in enumerate(("x", "y", "dx", "dy"))}
    loaded = Loaded(object_code(step_ir(graph, places, [x, y, dx, dy], [value, slope], [], 0)))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    step = ctypes.CFUNCTYPE(None, pointer, pointer, count, pointer, pointer, count)(
        loaded.address("step")
    )

    def evaluated(*numbers):
        states, shown = np.array(numbers), np.zeros(2)
        step(states.ctypes.data, None, 1, None, shown.ctypes.data, 1)
        return shown, loaded

    return lambda *numbers: evaluated(*numbers)[0]


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_the_slope_of_an_operation_is_that_of_differences(name, way):
    function = compiled(OPERATIONS[name])
    low, high = (
        function(X + side * way[0], Y + side * way[1], 0.0, 0.0)[0] for side in (-HALF, HALF)
    )

    assert function(X, Y, *way)[1] == pytest.approx((high - low) / (2.0 * HALF), abs=1e-8)


def test_every_operation_of_a_step_has_a_rule_or_goes_in_steps():
    steps = {"round", "floor", "ceil", "trunc"}
    known = {*trace.LIBRARY, *trace.INSTRUCTIONS, "fadd", "fsub", "fmul", "fdiv", "fneg", "select"}
    assert rules._RULES.keys() == known - steps


@pytest.mark.parametrize(
    ("name", "at"), [("sqrt", 0.0), ("asin", 1.0), ("acos", 1.0), ("fabs", 0.0)]
)
def test_a_slope_without_bound_is_taken_as_none(name, at):
    assert np.isfinite(compiled(lambda x, y: call(name, x))(at, Y, 1.0, 0.0)).all()
