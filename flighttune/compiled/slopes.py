# SPDX-License-Identifier: LGPL-2.1-or-later
"""Slopes of a traced step in forward mode: a second graph, for the change of each value."""

import math
from collections.abc import Callable, Mapping, Sequence

from flighttune.compiled.trace import (
    Graph,
    Number,
    Value,
    call,
    constant_of,
    cos,
    needed,
    of_bits,
    power,
    select,
    sin,
    sqrt,
    symbolic,
)

# Prefix of the name of the slope of a state, parameter or signal.
SLOPE = "d:"


def slopes(graph: Graph, of: Mapping[str, Number], values: Sequence[Number]) -> list[Number]:
    """Slopes of values from the slopes `of` inputs; inputs that are not listed have slope zero.

    A value that jumps, such as the segment of a table or a rounded number, has its slope between
    two jumps, which is zero.
    """
    found: dict[int, Number] = {}
    roots = [value for value in values if isinstance(value, Value)]
    for place in sorted(needed(graph, roots)):  # operands come first
        node = graph.nodes[place]
        found[place] = of.get(node.args[0], 0.0) if node.op == "input" else _slope(node, found)
    return [found[x.place] if isinstance(x, Value) else 0.0 for x in values]


def _slope(node: Value, found: Mapping[int, Number]) -> Number:
    """The slope of an operation, from the slopes of its operands."""
    graph, (op, _, name) = node.graph, node.op.partition(" ")
    rule = _RULES.get(name if op == "call" else op)
    if rule is None:  # constants, conditions, and values that change in steps
        return 0.0
    if op == "select":
        condition, *places = node.args
        # The condition of a `select` is not a double.
        return select(graph.nodes[condition], *(found[x] for x in places))  # type: ignore[arg-type]
    changes = [found[place] for place in node.args]
    if not symbolic(*changes) and not any(changes):
        return 0.0
    return rule(node, *(_value(graph, place) for place in node.args), *changes)


def _value(graph: Graph, place: int) -> Number:
    node = graph.nodes[place]
    return of_bits(node.args[0]) if node.op == "const" else node


def _plus(a: Number, b: Number) -> Number:
    """A sum of slopes; the sign of a zero does not matter, so that zeros are left out."""
    if constant_of(a) == 0.0:
        return b
    return a if constant_of(b) == 0.0 else a + b


def _times(a: Number, b: Number) -> Number:
    """A product with a slope, zero if a factor is."""
    return 0.0 if 0.0 in (constant_of(a), constant_of(b)) else a * b


def _where(positive: Number, a: Number) -> Number:
    """A slope where a number is positive, else zero: there the slope is undefined."""
    if constant_of(positive) is not None:
        return a if positive > 0.0 else 0.0
    return select(positive > 0.0, a, 0.0)


def _power(node: Value, x: Number, y: Number, dx: Number, dy: Number) -> Number:
    by_base = _times(y * power(x, y - 1.0), dx)
    if constant_of(dy) == 0.0:
        return by_base
    logarithm = math.log(x) if not symbolic(x) and x > 0.0 else call("log", x)
    return _plus(by_base, _where(x, node * logarithm * dy))


def _atan2(_: Value, y: Number, x: Number, dy: Number, dx: Number) -> Number:
    square = x * x + y * y
    return _where(square, _plus(_times(x, dy), -_times(y, dx)) / square)


def _fmod(node: Value, x: Number, y: Number, dx: Number, dy: Number) -> Number:
    return _plus(dx, -_times((x - node) / y, dy))


def _fabs(_: Value, x: Number, dx: Number) -> Number:
    return select(x < 0.0, -dx, dx)


# Slope of an operation from its value, its operands and their slopes.
_RULES: Mapping[str, Callable[..., Number]] = {
    "select": select,
    "fadd": lambda _, a, b, da, db: _plus(da, db),
    "fsub": lambda _, a, b, da, db: _plus(da, -db),
    "fmul": lambda _, a, b, da, db: _plus(_times(da, b), _times(a, db)),
    "fdiv": lambda q, a, b, da, db: _plus(da, -_times(q, db)) / b,
    "fneg": lambda _, a, da: -da,
    "sqrt": lambda root, x, dx: _where(root, dx / (2.0 * root)),
    "fabs": _fabs,
    "sin": lambda _, x, dx: cos(x) * dx,
    "cos": lambda _, x, dx: -(sin(x) * dx),
    "tan": lambda tangent, x, dx: (1.0 + tangent * tangent) * dx,
    "asin": lambda _, x, dx: _where(1.0 - x * x, dx / sqrt(1.0 - x * x)),
    "acos": lambda _, x, dx: _where(1.0 - x * x, -dx / sqrt(1.0 - x * x)),
    "atan": lambda _, x, dx: dx / (1.0 + x * x),
    "atan2": _atan2,
    "exp": lambda e, x, dx: e * dx,
    "log": lambda _, x, dx: dx / x,
    "log10": lambda _, x, dx: dx / (x * math.log(10.0)),
    "pow": _power,
    "fmod": _fmod,
}
