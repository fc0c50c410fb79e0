"""Machine code of a traced step beside floats, and slopes beside differences."""

import ctypes

import numpy as np
import pytest
from object_files import platform_of, taken

from flighttune.compiled import ir, machine, slopes, trace

call = trace.call

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


def step_ir(*step):
    return ir.module(ir.function_ir("step", *step))


def compiled(function):
    """A function of x and y in machine code that gives its value and its slope along (dx, dy)."""
    graph = trace.Graph()
    x, y, dx, dy = (graph.node("input", name) for name in ("x", "y", "dx", "dy"))
    value = function(x, y)
    (slope,) = slopes.slopes(graph, {"x": dx, "y": dy}, [value])
    places = {name: ("s", i) for i, name in enumerate(("x", "y", "dx", "dy"))}
    loaded = machine.Loaded(
        machine.object_code(step_ir(graph, places, [x, y, dx, dy], [value, slope], [], 0))
    )
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


@pytest.mark.parametrize(
    ("name", "at"), [("sqrt", 0.0), ("asin", 1.0), ("acos", 1.0), ("fabs", 0.0)]
)
def test_a_slope_without_bound_is_taken_as_none(name, at):
    assert np.isfinite(compiled(lambda x, y: call(name, x))(at, Y, 1.0, 0.0)).all()


START = (0.3, 0.2)


def moved(x, y):
    """The next x and y: three branches with a root in common, and functions of the old values."""
    root = call("sqrt", x * x + 1.0)
    steep = trace.select(root < 1.3, call("pow", root, 1.7), call("exp", -root) * call("sin", y))
    new = (
        x + 0.05 * call("cos", x) + 0.03 + trace.select(y < 0.5, 0.1 * steep, call("log", root + y))
    )
    return new, y + 0.02 * call("sin", x) * call("cos", new) + 0.02


def shown(x, y):
    """What is shown of the new values."""
    return trace.select(x < 2.0, call("pow", x, 1.5), call("atan", x)), call("sin", x) + y


@pytest.fixture(scope="module")
def step():
    graph = trace.Graph()
    x, y = (graph.node("input", name) for name in "xy")
    new = moved(x, y)
    text = step_ir(graph, {"x": ("s", 0), "y": ("s", 1)}, new, shown(*new), [new[0] * y, y], 0)
    loaded = machine.Loaded(machine.object_code(text))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    function = ctypes.CFUNCTYPE(None, pointer, pointer, count, pointer, pointer, count)(
        loaded.address("step")
    )

    def flown(*counts):
        states, values = np.array(START), np.zeros(4)
        for n in counts:
            function(states.ctypes.data, None, n, None, values.ctypes.data, 2)
        return *states.tolist(), *values.tolist(), loaded

    return lambda *counts: flown(*counts)[:-1]


@pytest.mark.parametrize("counts", [(1,), (60,), (1, 59), (4,) * 15, (7, 1, 52)])
def test_steps_made_together_or_apart_are_those_of_floats_to_the_bit(step, counts):
    state = before = START
    ways = set()
    for _ in range(sum(counts)):
        before, state = state, moved(*state)
        ways.add((before[0] ** 2 + 1.0 < 1.69, before[1] < 0.5, state[0] < 2.0))

    assert sum(counts) == 1 or len(ways) > 2  # branches go both ways
    assert step(*counts) == (*state, *shown(*state), state[0] * before[1], before[1])


@pytest.mark.parametrize("platform", machine.PLATFORMS)
def test_code_for_each_platform_takes_what_its_libraries_have_alone(platform):
    """A process ends if a function is missing when code is loaded."""
    graph = trace.Graph()
    x, y = (graph.node("input", name) for name in "xy")
    # More values at a time than fit into a page of the stack.
    terms = [call("sin", x * (k + 1.5)) for k in range(600)]
    whole = sum(terms)
    values = [sum(term * (whole + k) for k, term in enumerate(terms))]
    values += [operation(x, y) for operation in OPERATIONS.values()]
    text = step_ir(graph, {"x": ("s", 0), "y": ("s", 1)}, [x, y], values, [], 0)
    known = machine.PLATFORMS[platform]
    functions = {*trace.LIBRARY, *(["sincos"] if known.sincos else [])}
    there = {f"{ir.PREFIX}{name}" for name in functions} | {*known.further}

    code = machine.object_code(text, other=platform)

    assert platform_of(code) == platform
    assert {*known.further, f"{ir.PREFIX}pow"} <= taken(code) <= there
