"""Branches and values that a step hands on, in machine code, against the same source on floats."""

import ctypes

import numpy as np
import pytest

from flighttune.vehicles.compiled import trace
from flighttune.vehicles.compiled.branches import sides
from flighttune.vehicles.compiled.ir import step_ir
from flighttune.vehicles.compiled.machine import Loaded, object_code

START = (0.3, 0.2)


def moved(x, y):
    """The next x and y: three branches with a root in common, and functions of the old values."""
    root = trace.call("sqrt", x * x + 1.0)
    steep = trace.select(
        root < 1.3, trace.call("pow", root, 1.7), trace.call("exp", -root) * trace.call("sin", y)
    )
    new = (
        x
        + 0.05 * trace.call("cos", x)
        + 0.03
        + trace.select(y < 0.5, 0.1 * steep, trace.call("log", root + y))
    )
    return new, y + 0.02 * trace.call("sin", x) * trace.call("cos", new) + 0.02


def shown(x, y):
    """What is shown of the new values."""
    return trace.select(x < 2.0, trace.call("pow", x, 1.5), trace.call("atan", x)), trace.call(
        "sin", x
    ) + y


@pytest.fixture(scope="module")
def step():
    graph = trace.Graph()
    x, y = (graph.node("input", name) for name in "xy")
    new = moved(x, y)
    text = step_ir(graph, {"x": ("s", 0), "y": ("s", 1)}, new, shown(*new), [new[0] * y, y], 0)
    loaded = Loaded(object_code(text))
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


def test_a_side_of_a_condition_has_what_nothing_else_needs():
    graph = trace.Graph()
    x, y = (graph.node("input", name) for name in "xy")
    both = x * y
    inner = trace.select(y < 1.0, trace.call("exp", both), y + 2.0)
    outer = trace.select(x < 1.0, inner * both, trace.call("pow", both, 3.5) / y)
    places = sorted(trace.needed(graph, [outer]))

    alone = sides(graph, places, {outer.place})

    by_name = {graph.nodes[place].op: side for place, side in alone.items()}
    assert by_name["call exp"] == (inner.place, True)
    assert by_name["call pow"] == by_name["fdiv"] == (outer.place, False)
    assert alone[inner.place] == (outer.place, True)
    assert both.place not in alone  # all sides need it
    assert sides(graph, places, {*places}) == {}
