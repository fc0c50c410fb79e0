"""Numbers and float arrays: their type aliases, and the checks of values from outside."""

import math
import numbers
import sys
from collections.abc import Callable, Mapping
from typing import Annotated, Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import PlainSerializer, PlainValidator

from flighttune.base.errors import InputError, ShapeError
from flighttune.base.words import got


def _array_of(lists: Any) -> npt.NDArray[np.float64]:
    pending = [lists]
    while pending:
        entry = pending.pop()
        if isinstance(entry, list):
            pending += entry
        elif type(entry) not in (int, float) or not abs(entry) <= sys.float_info.max:
            raise ValueError("must be lists of finite numbers")
    try:
        return np.array(lists, dtype=float)
    except ValueError as error:
        raise ValueError("must have rows of one length") from error


# In files an array is a list of finite numbers, or of such lists.
FloatArray: TypeAlias = Annotated[
    npt.NDArray[np.float64], PlainValidator(_array_of), PlainSerializer(np.ndarray.tolist)
]
Floats: TypeAlias = float | FloatArray


def _check(
    holds: Callable[[Any], bool], requirement: str, values: Mapping[str, Any], unit: str = ""
) -> None:
    """Raise InputError for the first of `values` that fails `holds`; None is skipped."""
    for name, value in values.items():
        if value is None:
            continue
        if not isinstance(value, float) and not is_number(value):
            raise InputError(f"`{name}` must {requirement}, got {got(value)}.")
        if not holds(value):
            raise InputError(f"`{name}` must {requirement}, got {value} {unit}".rstrip() + ".")


def check_positive(unit: str = "", **values: float | None) -> None:
    """Refuse the first of `values` that is not positive and finite; None is skipped."""
    _check(lambda value: math.isfinite(value) and value > 0.0, "be positive", values, unit)


def check_not_negative(unit: str = "", **values: float) -> None:
    """Refuse the first of `values` that is negative or not finite; None is skipped."""
    _check(lambda value: math.isfinite(value) and value >= 0.0, "not be negative", values, unit)


def check_at_least(least: float, **values: float | None) -> None:
    """Refuse the first of `values` that is smaller than `least`; None is skipped."""
    _check(lambda value: value >= least, f"be at least {least:g}", values)


def check_between(low: float, high: float, **values: float) -> None:
    """Refuse the first of `values` not strictly between `low` and `high`; None is skipped."""
    _check(lambda value: low < value < high, f"be between {low:g} and {high:g}", values)


def check_upright(**angles: float) -> None:
    """Refuse the first of `angles` (rad) that is not inside +-pi/2."""
    # Commands and files state degrees, so the message repeats the number in degrees.
    degrees = {
        name: round(math.degrees(angle), 9) if is_number(angle) else angle
        for name, angle in angles.items()
    }
    _check(lambda angle: abs(angle) < 90.0, "lie inside +-90 deg", degrees, "deg")


def check_finite(**values: npt.ArrayLike | None) -> None:
    """Refuse the first of `values`, numbers or tuples, that is not finite; None is skipped."""
    for name, value in values.items():
        # NumPy takes ten times as long for a single number
        if value is None or (isinstance(value, float) and math.isfinite(value)):
            continue
        if not np.isfinite(numbers_of(name, value)).all():
            raise InputError(f"`{name}` must be finite, got {value}.")


def check_numbers(**values: Any) -> None:
    """Refuse the first of `values` that is not a finite number, such as None or an array."""
    for name, value in values.items():
        if not is_number(value):
            raise InputError(f"`{name}` must be a finite number, got {got(value)}.")
        check_finite(**{name: float(value)})


def is_number(value: Any) -> bool:
    """Whether a value is a real number that a float can represent, infinity and NaN included."""
    if isinstance(value, float):
        return True
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def numbers_of(name: str, value: Any) -> FloatArray:
    """`value` as an array of floats; InputError if an entry is not a real number."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "iuf" or not array.size:
            return array.astype(float, copy=False)
    except (ValueError, TypeError, OverflowError):  # ragged rows, or not numbers
        pass
    raise InputError(f"`{name}` must be real numbers in rows of one length, got {got(value)}.")


def read_only_matrix(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None, *, axes: int = 2
) -> FloatArray:
    """Return `value` as a finite, read-only copy with two axes, of `shape` if given."""
    array = np.array(numbers_of(name, value))
    if array.ndim != axes:
        raise ShapeError(f"`{name}` must have {axes} axes, got shape {array.shape}.")
    if shape is not None and array.shape != shape:
        raise ShapeError(f"`{name}` must have shape {shape}, got {array.shape}.")
    if not np.isfinite(array).all():
        raise InputError(f"`{name}` must be finite, got {array.tolist()}.")
    array.flags.writeable = False
    return array


def read_only_vector(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None
) -> FloatArray:
    """Return `value` as a finite, read-only copy with one axis, of `shape` if given."""
    return read_only_matrix(name, value, shape, axes=1)


def set_read_only(value: object, **shapes: tuple[int, ...]) -> None:
    """Replace arrays of a frozen `value` by finite, read-only copies of `shapes`.

    A value of None stays where None is the default.
    """
    stated: Any = getattr(value, "__dataclass_fields__", {})
    for name, shape in shapes.items():
        array: Any = getattr(value, name)
        if array is not None or (name in stated and stated[name].default is not None):
            given: Any = array
            array = read_only_matrix(name, given, shape, axes=len(shape))
        object.__setattr__(value, name, array)


def true_spans(flag: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index and one past the last index of every span in which `flag` is true."""
    edges = np.flatnonzero(np.diff(flag.astype(int), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def square_matrices(name: str, value: npt.ArrayLike, axes: int | None = None) -> FloatArray:
    """Return `value` as a finite float array of shape (..., n, n), n >= 1, with `axes` if given."""
    matrices = numbers_of(name, value)
    if axes not in (None, matrices.ndim):
        raise ShapeError(f"`{name}` must have {axes} axes, got shape {matrices.shape}.")
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2] or matrices.shape[-1] == 0:
        raise ShapeError(f"`{name}` must have shape (..., n, n), got {matrices.shape}.")
    if not np.isfinite(matrices).all():
        raise InputError(f"`{name}` must be finite, got {np.array2string(matrices, threshold=20)}.")
    return matrices
