"""Dual numbers: a compiled flight flown again with the slopes of all values that it computes.

Loop and laws are the functions of the flight, run on numbers that carry their slopes with respect
to p parameters. The step of the aircraft is compiled with slopes.
"""

import math
from collections.abc import Callable
from functools import cache
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray


class Dual:
    """A number and its p slopes; comparisons use the number alone."""

    __slots__ = ("d", "x")
    __array_ufunc__ = None  # a NumPy number on the left leaves the operation to this class

    def __init__(self, x: float, d: FloatArray) -> None:
        self.x, self.d = x, d

    def __add__(self, other: "Dual | float") -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.x + other.x, self.d + other.d)
        return Dual(self.x + other, self.d)

    __radd__ = __add__

    def __sub__(self, other: "Dual | float") -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.x - other.x, self.d - other.d)
        return Dual(self.x - other, self.d)

    def __rsub__(self, other: float) -> "Dual":
        return Dual(other - self.x, -self.d)

    def __mul__(self, other: "Dual | float") -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.x * other.x, self.x * other.d + other.x * self.d)
        return Dual(self.x * other, self.d * other)

    __rmul__ = __mul__

    def __truediv__(self, other: "Dual | float") -> "Dual":
        if isinstance(other, Dual):
            x = self.x / other.x
            return Dual(x, (self.d - x * other.d) / other.x)
        return Dual(self.x / other, self.d / other)

    def __rtruediv__(self, other: float) -> "Dual":
        x = other / self.x
        return Dual(x, self.d * (-x / self.x))

    def __mod__(self, other: float) -> "Dual":
        return Dual(self.x % other, self.d)

    def __neg__(self) -> "Dual":
        return Dual(-self.x, -self.d)

    def __abs__(self) -> "Dual":
        return -self if self.x < 0.0 else self

    def __int__(self) -> int:
        return int(self.x)

    def __bool__(self) -> bool:
        return self.x != 0.0

    def __lt__(self, other: "Dual | float") -> bool:
        return self.x < value_of(other)

    def __le__(self, other: "Dual | float") -> bool:
        return self.x <= value_of(other)

    def __gt__(self, other: "Dual | float") -> bool:
        return self.x > value_of(other)

    def __ge__(self, other: "Dual | float") -> bool:
        return self.x >= value_of(other)

    def __eq__(self, other: object) -> bool:
        return self.x == (other.x if isinstance(other, Dual) else other)

    __hash__ = None  # type: ignore[assignment]


def value_of(x: Dual | float) -> float:
    """The number without its slopes."""
    return x.x if isinstance(x, Dual) else x


def _rule(
    function: Callable[[float], float], slope: Callable[[float, float], float]
) -> Callable[[Dual | float], Dual | float]:
    """A function of one number, on duals; `slope` is a function of its argument and value."""

    def on_dual(x: Dual | float) -> Dual | float:
        if not isinstance(x, Dual):
            return function(x)
        y = function(x.x)
        return Dual(y, x.d * slope(x.x, y))

    return on_dual


def _atan2(y: Dual | float, x: Dual | float) -> Dual | float:
    b, a = value_of(y), value_of(x)
    angle, slopes = math.atan2(b, a), np.asarray(a * _slopes(y) - b * _slopes(x))
    if not slopes.shape:
        return angle
    return Dual(angle, slopes / (a * a + b * b or 1.0))


def _slopes(x: Dual | float) -> FloatArray | float:
    return x.d if isinstance(x, Dual) else 0.0


def _copysign(x: Dual | float, sign: Dual | float) -> Dual | float:
    y = math.copysign(value_of(x), value_of(sign))
    if not isinstance(x, Dual):
        return y
    return Dual(y, x.d if y == x.x else -x.d)


# The part of `math` that laws and loop use.
_MATH = SimpleNamespace(
    pi=math.pi,
    tau=math.tau,
    sin=_rule(math.sin, lambda x, _: math.cos(x)),
    cos=_rule(math.cos, lambda x, _: -math.sin(x)),
    tan=_rule(math.tan, lambda _, y: 1.0 + y * y),
    asin=_rule(math.asin, lambda x, _: 1.0 / math.sqrt(1.0 - x * x) if abs(x) < 1.0 else 0.0),
    acos=_rule(math.acos, lambda x, _: -1.0 / math.sqrt(1.0 - x * x) if abs(x) < 1.0 else 0.0),
    atan=_rule(math.atan, lambda x, _: 1.0 / (1.0 + x * x)),
    sqrt=_rule(math.sqrt, lambda _, y: 0.5 / y if y else 0.0),
    atan2=_atan2,
    copysign=_copysign,
    isnan=lambda x: math.isnan(value_of(x)),
    isfinite=lambda x: math.isfinite(value_of(x)),
)


@cache
def on_duals(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function written for Numba, as a function of duals."""
    plain = getattr(function, "py_func", function)
    scope = dict(plain.__globals__)
    for name in _names(plain.__code__):
        used = scope.get(name)
        if used is math:
            scope[name] = _MATH
        elif isinstance(getattr(used, "py_func", used), FunctionType):
            scope[name] = on_duals(used)
    return FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__)


def _names(code: CodeType) -> set[str]:
    inner = [_names(x) for x in code.co_consts if isinstance(x, CodeType)]
    return {*code.co_names}.union(*inner)


class DualArray:
    """An array of numbers, shape S, and an array of their slopes, shape (p, *S)."""

    def __init__(self, values: FloatArray, slopes: FloatArray) -> None:
        self.values, self.slopes = values, slopes

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, key: Any) -> Any:
        values, slopes = self.values[key], self.slopes[_behind(key)]
        if isinstance(values, np.ndarray):
            return DualArray(values, slopes)
        return Dual(float(values), slopes.copy())  # the array may be overwritten later

    def __setitem__(self, key: Any, x: Dual | float) -> None:
        self.values[key] = value_of(x)
        self.slopes[_behind(key)] = _slopes(x)


def _behind(key: Any) -> tuple[Any, ...]:
    """The key of an element or part in the array of slopes, which has one more axis in front."""
    return (slice(None), *key) if isinstance(key, tuple) else (slice(None), key)


class Rows(DualArray):
    """An array of a compiled step with slopes: a row per slope, each beginning with the values."""

    def __init__(self, values: FloatArray, slopes: FloatArray) -> None:
        self._n = n = len(values)
        self.rows = np.hstack([np.tile(values, (len(slopes), 1)), slopes])
        super().__init__(self.rows[0, :n], self.rows[:, n:])
        first = self.rows.ctypes.data
        self.addresses = [first + i * self.rows.strides[0] for i in range(len(slopes))]
        # The loop hands `array.ctypes.data` to the step: here that is this object.
        self.ctypes = SimpleNamespace(data=self)

    def share(self) -> None:
        """Copy the values of the first row to all rows."""
        self.rows[1:, : self._n] = self.values


def step_of_rows(step: Callable[..., None]) -> Callable[..., None]:
    """A compiled step with slopes as the loop calls it: one call of the step for each slope."""

    def fly(
        states: Rows, parameters: Rows, steps: int, stream: int, shown: Rows, how_much: int
    ) -> None:
        for array in (states, parameters):
            array.share()
        places = states.addresses, parameters.addresses, shown.addresses
        for x, p, o in zip(*places, strict=True):
            step(x, p, steps, stream, o, how_much)

    return fly
