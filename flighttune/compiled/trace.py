# SPDX-License-Identifier: LGPL-2.1-or-later
"""Symbolic doubles: arithmetic in Python that is recorded as a graph of operations.

The same source runs on floats, which folds it. Only what changes no bit is simplified: constants,
``x*1``, ``x/1``, ``x-0`` and ``x+(-0)``. A sum with +0 makes +0 of -0, and a product with 0 has a
sign, as in JSBSim.
"""

import math
import struct
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeAlias

# Functions of the C library that a step may call, with the number of their arguments, and those for
# which LLVM has an instruction.
LIBRARY = {
    **dict.fromkeys(
        ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "log10", "round"), 1
    ),
    **dict.fromkeys(("atan2", "pow", "fmod"), 2),
}
INSTRUCTIONS = ("sqrt", "fabs", "floor", "ceil", "trunc")


class Graph:
    """Operations of a step, each of them once, in an order in which they can be executed."""

    def __init__(self) -> None:
        self.nodes: list[Value] = []
        self.index: dict[tuple[Any, ...], Value] = {}

    def node(self, op: str, *args: Any, condition: bool = False) -> Any:
        """The value of an operation on the places of others."""
        key = (op, *args)
        if key not in self.index:
            kind = Condition if condition else Value
            self.index[key] = kind(self, len(self.nodes), op, args)
            self.nodes.append(self.index[key])
        return self.index[key]


def bits(x: float) -> int:
    """The 64 bits of a double."""
    return struct.unpack("<Q", struct.pack("<d", x))[0]


def of_bits(pattern: int) -> float:
    """The double of 64 bits."""
    return struct.unpack("<d", struct.pack("<Q", pattern))[0]


class Value:
    """A double that is known when the step runs."""

    __slots__ = ("args", "graph", "op", "place")

    def __init__(self, graph: Graph, place: int, op: str, args: tuple[Any, ...]) -> None:
        self.graph, self.place, self.op, self.args = graph, place, op, args

    def __add__(self, other: "Number") -> "Number":
        return _sum(self, other)

    def __radd__(self, other: "Number") -> "Number":
        return _sum(other, self)

    def __sub__(self, other: "Number") -> "Number":
        return _difference(self, other)

    def __rsub__(self, other: "Number") -> "Number":
        return _difference(other, self)

    def __mul__(self, other: "Number") -> "Number":
        return _product(self, other)

    def __rmul__(self, other: "Number") -> "Number":
        return _product(other, self)

    def __truediv__(self, other: "Number") -> "Number":
        return _quotient(self, other)

    def __rtruediv__(self, other: "Number") -> "Number":
        return _quotient(other, self)

    def __neg__(self) -> "Value":
        return self.graph.node("fneg", self.place)

    def __lt__(self, other: "Number") -> "Condition":
        return _comparison("olt", self, other)

    def __le__(self, other: "Number") -> "Condition":
        return _comparison("ole", self, other)

    def __gt__(self, other: "Number") -> "Condition":
        return _comparison("ogt", self, other)

    def __ge__(self, other: "Number") -> "Condition":
        return _comparison("oge", self, other)


class Condition(Value):
    """A condition that is known when the step runs."""

    __slots__ = ()

    def __and__(self, other: "Truth") -> "Truth":
        if isinstance(other, bool):
            return self if other else False
        return self.graph.node("and", self.place, other.place, condition=True)

    __rand__ = __and__

    def __or__(self, other: "Truth") -> "Truth":
        if isinstance(other, bool):
            return True if other else self
        return self.graph.node("or", self.place, other.place, condition=True)

    __ror__ = __or__

    def __invert__(self) -> "Condition":
        return self.graph.node("not", self.place, condition=True)


# A double, known or symbolic, or an array of them: all have the same arithmetic.
Number: TypeAlias = Any
Truth: TypeAlias = bool | Condition


def constant_of(x: Number) -> float | None:
    """The number of a value that is known already, or None."""
    return None if isinstance(x, Value) else float(x)


def _place(graph: Graph, x: Number) -> int:
    return x.place if isinstance(x, Value) else graph.node("const", bits(float(x))).place


def _operation(op: str, a: Number, b: Number) -> Value:
    graph = graph_of(a, b)
    return graph.node(op, _place(graph, a), _place(graph, b))


def _sum(a: Number, b: Number) -> Number:
    if _is(a, -0.0):
        return b
    return a if _is(b, -0.0) else _operation("fadd", a, b)


def _difference(a: Number, b: Number) -> Number:
    if _is(a, -0.0):
        return -b
    return a if _is(b, 0.0) else _operation("fsub", a, b)


def _product(a: Number, b: Number) -> Number:
    if _is(a, 1.0):
        return b
    return a if _is(b, 1.0) else _operation("fmul", a, b)


def _quotient(a: Number, b: Number) -> Number:
    return a if _is(b, 1.0) else _operation("fdiv", a, b)


def _is(x: Number, known: float) -> bool:
    """Whether a value is a known number, to the bit."""
    return (y := constant_of(x)) is not None and bits(y) == bits(known)


def _comparison(relation: str, a: Number, b: Number) -> Condition:
    graph = graph_of(a, b)
    return graph.node(f"fcmp {relation}", _place(graph, a), _place(graph, b), condition=True)


def graph_of(*values: Any) -> Graph:
    """The graph of the first symbolic value."""
    return next(x.graph for x in values if isinstance(x, Value))


def symbolic(*values: Any) -> bool:
    """Whether any of the values is known only when the step runs."""
    return any(isinstance(x, Value) for x in values)


def call(name: str, *xs: Number) -> Number:
    """A function of `LIBRARY` or `INSTRUCTIONS`."""
    if not symbolic(*xs):
        return _plain(name, *xs)
    graph = graph_of(*xs)
    return graph.node(f"call {name}", *(_place(graph, x) for x in xs))


def _plain(name: str, *xs: float) -> float:
    if name == "round":  # away from zero, as the C library does it
        return math.copysign(math.floor(abs(xs[0]) + 0.5), xs[0])
    return float(getattr(math, name)(*xs))


def sqrt(x: Number) -> Number:
    """Square root."""
    return call("sqrt", x)


def sin(x: Number) -> Number:
    """Sine."""
    return call("sin", x)


def cos(x: Number) -> Number:
    """Cosine."""
    return call("cos", x)


def tan(x: Number) -> Number:
    """Tangent."""
    return call("tan", x)


def asin(x: Number) -> Number:
    """Inverse sine."""
    return call("asin", x)


def atan(x: Number) -> Number:
    """Inverse tangent."""
    return call("atan", x)


def atan2(y: Number, x: Number) -> Number:
    """Angle of the point (x, y)."""
    return call("atan2", y, x)


def exp(x: Number) -> Number:
    """Exponential function."""
    return call("exp", x)


def power(x: Number, y: Number) -> Number:
    """`x` to the power of `y`."""
    return call("pow", x, y)


def fabs(x: Number) -> Number:
    """Absolute value."""
    return call("fabs", x)


def equal(a: Number, b: Number) -> Truth:
    """Whether two numbers are equal."""
    return _comparison("oeq", a, b) if symbolic(a, b) else a == b


def different(a: Number, b: Number) -> Truth:
    """Whether two numbers differ; NaN differs from all."""
    return _comparison("une", a, b) if symbolic(a, b) else a != b


def negated(condition: Truth) -> Truth:
    """The opposite of a condition."""
    return ~condition if isinstance(condition, Condition) else not condition


def select(condition: Truth, a: Number, b: Number) -> Number:
    """`a` where the condition holds, else `b`; both are evaluated."""
    if isinstance(condition, bool):
        return a if condition else b
    if a is b or (constant_of(a) is not None and constant_of(a) == constant_of(b)):
        return a
    graph = condition.graph
    return graph.node("select", condition.place, _place(graph, a), _place(graph, b))


def least(a: Number, b: Number) -> Number:
    """std::min: `b` where it is less than `a`."""
    return select(b < a, b, a)


def largest(a: Number, b: Number) -> Number:
    """std::max: `b` where `a` is less than it."""
    return select(a < b, b, a)


def constrained(low: Number, x: Number, high: Number) -> Number:
    """`x` between two bounds; the lower one wins."""
    return select(x < low, low, select(x > high, high, x))


def segment(breakpoints: Sequence[float], key: Number, *, at_or_below: bool = False) -> Number:
    """Number of the inner breakpoints below `key`, or not above it: its segment, from 0 on."""
    inner, relation = tuple(breakpoints[1:-1]), "ole" if at_or_below else "olt"
    if isinstance(key, Value):
        return key.graph.node("segment", inner, key.place, relation)
    return float(sum(x < key or (at_or_below and x == key) for x in inner))


def flat_index(row: Number, columns: int, column: Number) -> Number:
    """The place in a table that is written row by row."""
    if not symbolic(row, column):
        return row * columns + column
    graph = graph_of(row, column)

    def integer(x: Number) -> int:
        return x.place if isinstance(x, Value) else graph.node("integer", int(x)).place

    return graph.node("flat", integer(row), columns, integer(column))


def lookup(values: Sequence[float], index: Number, further: int = 0) -> Number:
    """The value at an index, or `further` places behind it."""
    if not isinstance(index, Value):
        return values[int(index) + further]
    return index.graph.node("gather", tuple(values), index.place, further)


def needed(graph: Graph, roots: Sequence[Value], known: Collection[int] = ()) -> set[int]:
    """Places of all operations that the values depend on, up to those that are known."""
    found: set[int] = set()
    pending = [value.place for value in roots]
    while pending:
        if (place := pending.pop()) not in found and place not in known:
            found.add(place)
            pending += operands(graph.nodes[place])
    return found


_PLACES: dict[str, Callable[[tuple[Any, ...]], Sequence[int]]] = {
    "const": lambda _: (),
    "input": lambda _: (),
    "integer": lambda _: (),
    "segment": lambda args: args[1:2],
    "gather": lambda args: args[1:2],
    "flat": lambda args: (args[0], args[2]),
}


def operands(node: Value) -> Sequence[int]:
    """Places of the operations that one depends on."""
    return _PLACES.get(node.op, lambda args: args)(node.args)
