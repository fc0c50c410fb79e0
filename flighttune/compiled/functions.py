# SPDX-License-Identifier: LGPL-2.1-or-later
"""Functions of the XML: operations, tables and properties."""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeAlias
from xml.etree.ElementTree import Element

from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.tables import Table3, table_1, table_2
from flighttune.compiled.trace import (
    Condition,
    Number,
    Truth,
    Value,
    call,
    different,
    equal,
    fabs,
    lookup,
    negated,
    power,
    segment,
    select,
    sqrt,
)

# Elements that say something about a function and are no part of it.
_NO_OPERATIONS = ("description", "documentation")

# Beginning of a number that differs from flight to flight.
PLACEHOLDER = "{{"

_INVERSE_LOG2 = 1.0 / math.log10(2.0)

# Size below which a number is false.
_FALSE = 1e-9

Result: TypeAlias = Number | Truth


def number(now: Properties, text: str) -> Number:
    """The number in a text; what stands for one of each flight is a parameter."""
    text = text.strip()
    return now[f"_number:{text}"] if text.startswith(PLACEHOLDER) else float(text)


def is_number(text: str) -> bool:
    """Whether a text is a number, or stands for one."""
    if text.strip().startswith(PLACEHOLDER):
        return True
    try:
        float(text)
    except ValueError:
        return False
    return True


def prop(now: Properties, name: str) -> Number:
    """The property of a name, which may begin with a minus sign."""
    name = name.strip().replace("#", now.engine)
    return now[name[1:]] * -1.0 if name.startswith("-") else now[name]


def value_or_property(now: Properties, text: str) -> Number:
    """A number, or the property of that name."""
    return number(now, text) if is_number(text) else prop(now, text)


def truth(x: Result) -> Truth:
    """Whether a number counts as true; comparisons stay conditions."""
    if isinstance(x, Condition | bool):
        return x
    return negated(fabs(x) < _FALSE)


def as_number(x: Result) -> Number:
    """1 or 0 for a condition."""
    return select(x, 1.0, 0.0) if isinstance(x, Condition | bool) else x


def function(now: Properties, element: Element) -> Number:
    """The value of a ``<function>``, which is shown under its name."""
    x = as_number(_operation(now, only_operation(element)))
    for name in (element.get("name"), element.get("copyto")):
        if name and name.strip():
            now[name.replace("#", now.engine)] = x
    return x


def hidden_function(now: Properties, element: Element) -> Number:
    """The value of a function that is shown nowhere under its own name."""
    return as_number(_operation(now, only_operation(element)))


def only_operation(element: Element) -> Element:
    """The one operation of a function."""
    operations = _parts(element)
    if len(operations) != 1:
        raise Unsupported("a function with several operations")
    return operations[0]


def _parts(element: Element) -> list[Element]:
    return [part for part in element if part.tag not in _NO_OPERATIONS]


def _operation(now: Properties, element: Element) -> Result:
    if element.get("apply"):
        raise Unsupported("a property with `apply`")
    if element.tag not in _OPERATIONS:
        raise Unsupported(f"<{element.tag}> in a function")
    x = _OPERATIONS[element.tag](now, element)
    if name := (element.get("name") or "").strip():
        now[name.replace("#", now.engine)] = as_number(x)
    return x


def _numbers(now: Properties, element: Element) -> list[Number]:
    return [as_number(_operation(now, part)) for part in _parts(element)]


def _truths(now: Properties, element: Element) -> list[Truth]:
    return [truth(_operation(now, part)) for part in _parts(element)]


Operation: TypeAlias = Callable[[Properties, Element], Result]


def _of_numbers(rule: Callable[..., Result]) -> Operation:
    """An operation on all numbers in an element."""
    return lambda now, element: rule(*_numbers(now, element))


def _of_one(name: str) -> Operation:
    return _of_numbers(lambda x: call(name, x))


def _product(*xs: Number) -> Number:
    return reduce(operator.mul, xs, 1.0)


def _sum(*xs: Number) -> Number:
    return reduce(operator.add, xs, 0.0)


def _quotient(a: Number, b: Number) -> Number:
    if not isinstance(b, Value):
        return a / b if b else math.inf
    return select(different(b, 0.0), a / b, math.inf)


def _root(x: Number) -> Number:
    return select(x >= 0.0, sqrt(x), -math.inf)


def _fraction(x: Number) -> Number:
    return x - call("trunc", x)


def _logarithm(name: str, factor: float = 1.0) -> Operation:
    return _of_numbers(lambda x: select(x > 0.0, call(name, x) * factor, -math.inf))


def _remainder(a: Number, b: Number) -> Number:
    return select(different(b, 0.0), call("fmod", a, b), math.inf)


def _whole_remainder(a: Number, b: Number) -> Number:
    return call("fmod", call("trunc", a), call("trunc", b))


def _smallest(*xs: Number) -> Number:
    return reduce(lambda least, x: select(x < least, x, least), xs)


def _largest(*xs: Number) -> Number:
    return reduce(lambda largest, x: select(x > largest, x, largest), xs)


def _rounded(x: Number, multiple: Number = 1.0) -> Number:
    return call("round", x / multiple) * multiple


def _chosen(index: Number, *cases: Number) -> Number:
    """The case of an index, rounded; beyond the last there is none in JSBSim either."""
    number_of = call("trunc", index + 0.5)
    return reduce(
        lambda y, k: select(equal(number_of, float(k)), cases[k], y), range(len(cases)), math.nan
    )


def _choice(now: Properties, element: Element) -> Number:
    condition, *cases = _parts(element)
    holds = truth(_operation(now, condition))
    a, b = (as_number(_operation(now, case)) for case in cases)
    return select(holds, a, b)


def _all(now: Properties, element: Element) -> Truth:
    return reduce(operator.and_, _truths(now, element), True)


def _any(now: Properties, element: Element) -> Truth:
    return reduce(operator.or_, _truths(now, element), False)


def _not(now: Properties, element: Element) -> Truth:
    (condition,) = _truths(now, element)
    return negated(condition)


@dataclass(frozen=True)
class _Interpolation:
    """A table in a function: linear between its points, constant beyond."""

    keys: Sequence[float]
    values: Sequence[float]

    def at(self, x: Number) -> Number:
        xs, ys = self.keys, self.values
        i = segment(xs, x)
        x_0, x_1, y_0, y_1 = lookup(xs, i), lookup(xs, i, 1), lookup(ys, i), lookup(ys, i, 1)
        inside = y_0 + (x - x_0) * (y_1 - y_0) / (x_1 - x_0)
        return select(x <= xs[0], ys[0], select(x >= xs[-1], ys[-1], inside))


def _interpolated(now: Properties, element: Element) -> Number:
    x, *points = _numbers(now, element)
    if any(isinstance(point, Value) for point in points):
        raise Unsupported("<interpolate1d> between points that change")
    fixed = [float(point) for point in points if not isinstance(point, Value)]
    return _Interpolation(fixed[::2], fixed[1::2]).at(x)


def table(now: Properties, element: Element) -> Number:
    """The value of a ``<table>`` at the properties that are its keys."""
    if element.get("type") == "internal":
        raise Unsupported("an internal table in a function")
    keys = {
        key.get("lookup", "row"): prop(now, key.text or "")
        for key in element.findall("independentVar")
    }
    data = element.findall("tableData")
    if len(data) > 1:
        points = tuple(float(part.get("breakPoint", "nan")) for part in data)
        tables = tuple(table_2(part.text or "") for part in data)
        return Table3(points, tables).at(keys["row"], keys["column"], keys["table"])
    text = data[0].text or ""
    if len(keys) == 1:
        return table_1(text).at(keys["row"])
    return table_2(text).at(keys["row"], keys["column"])


_COMPARISONS: dict[str, Callable[[Number, Number], Truth]] = {
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": equal,
    "nq": different,
}

_OPERATIONS: dict[str, Operation] = {
    **dict.fromkeys(("property", "p"), lambda now, element: prop(now, element.text or "")),
    **dict.fromkeys(("value", "v"), lambda now, element: number(now, element.text or "")),
    **dict.fromkeys(("table", "t"), table),
    "pi": lambda now, element: math.pi,
    "product": _of_numbers(_product),
    "sum": _of_numbers(_sum),
    "avg": _of_numbers(lambda *xs: _sum(*xs) / float(len(xs))),
    "difference": _of_numbers(lambda *xs: reduce(operator.sub, xs)),
    "min": _of_numbers(_smallest),
    "max": _of_numbers(_largest),
    "and": _all,
    "or": _any,
    "not": _not,
    "quotient": _of_numbers(_quotient),
    "pow": _of_numbers(power),
    "toradians": _of_numbers(lambda x: x * math.pi / 180.0),
    "todegrees": _of_numbers(lambda x: x * 180.0 / math.pi),
    "sqrt": _of_numbers(_root),
    "ln": _logarithm("log"),
    "log10": _logarithm("log10"),
    "log2": _logarithm("log10", _INVERSE_LOG2),
    "mod": _of_numbers(_whole_remainder),
    "fmod": _of_numbers(_remainder),
    "roundmultiple": _of_numbers(_rounded),
    "switch": _of_numbers(_chosen),
    "abs": _of_numbers(fabs),
    "sign": _of_numbers(lambda x: select(x < 0.0, -1.0, 1.0)),
    "integer": _of_one("trunc"),
    "fraction": _of_numbers(_fraction),
    "ifthen": _choice,
    "interpolate1d": _interpolated,
    **{
        name: _of_one(name)
        for name in ("exp", "sin", "cos", "tan", "asin", "acos", "atan", "floor", "ceil")
    },
    "atan2": _of_numbers(lambda a, b: call("atan2", a, b)),
    **{name: _of_numbers(relation) for name, relation in _COMPARISONS.items()},
}
