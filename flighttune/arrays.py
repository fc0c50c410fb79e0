"""Numbers and float arrays: the aliases, and the checks applied where they come in."""

import math
import sys
from typing import Annotated, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.errors import InputError, ShapeError


class _Lists:
    """Form of an array in files: a list of finite numbers, or of such lists."""

    @staticmethod
    def __get_pydantic_core_schema__(_kind: Any, _handler: Any) -> Any:
        from pydantic_core import core_schema as schema  # where values are read or written

        lists = schema.plain_serializer_function_ser_schema(np.ndarray.tolist)
        return schema.no_info_plain_validator_function(_array_of, serialization=lists)


def _array_of(lists: Any) -> "FloatArray":
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


FloatArray: TypeAlias = Annotated[npt.NDArray[np.float64], _Lists]
Floats: TypeAlias = float | FloatArray


def check_positive(unit: str = "", **values: float | None) -> None:
    """Refuse the first of `values` that is not positive and finite; None is not looked at."""
    for name, value in values.items():
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"`{name}` must be positive, got {value} {unit}".rstrip() + ".")


def check_not_negative(unit: str = "", **values: float) -> None:
    """Refuse the first of `values` that is negative or not finite."""
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"`{name}` must not be negative, got {value} {unit}".rstrip() + ".")


def check_at_least(least: float, **values: float | None) -> None:
    """Refuse the first of `values` that is smaller than `least`; None is not looked at."""
    for name, value in values.items():
        if value is not None and not value >= least:
            raise InputError(f"`{name}` must be at least {least:g}, got {value}.")


def check_between(low: float, high: float, **values: float) -> None:
    """Refuse the first of `values` that is not strictly between `low` and `high`."""
    for name, value in values.items():
        if not low < value < high:
            raise InputError(f"`{name}` must be between {low:g} and {high:g}, got {value:g}.")


def check_finite(unit: str = "", **values: npt.ArrayLike) -> None:
    """Refuse the first of `values`, numbers or tuples of them, that is not finite."""
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise InputError(f"`{name}` must be finite, got {value} {unit}".rstrip() + ".")


def read_only_matrix(
    name: str, value: npt.ArrayLike, shape: tuple[int, int] | None = None
) -> FloatArray:
    """Return `value` as a finite, read-only copy with two axes, of `shape` if given."""
    return _read_only(name, value, shape, axes=2)


def read_only_vector(
    name: str, value: npt.ArrayLike, shape: tuple[int] | None = None
) -> FloatArray:
    """Return `value` as a finite, read-only copy with one axis, of `shape` if given."""
    return _read_only(name, value, shape, axes=1)


def square_matrices(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return `value` as a finite float array of shape (..., n, n), n >= 1."""
    matrices = np.asarray(value, dtype=float)
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2] or matrices.shape[-1] == 0:
        raise ShapeError(f"`{name}` must have shape (..., n, n), got {matrices.shape}.")
    if not np.isfinite(matrices).all():
        raise InputError(f"`{name}` must be finite, got {np.array2string(matrices, threshold=20)}.")
    return matrices


def _read_only(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None, *, axes: int
) -> FloatArray:
    array = np.array(value, dtype=float)
    if array.ndim != axes:
        raise ShapeError(f"`{name}` must have {axes} axes, got shape {array.shape}.")
    if shape is not None and array.shape != shape:
        raise ShapeError(f"`{name}` must have shape {shape}, got {array.shape}.")
    if not np.isfinite(array).all():
        raise InputError(f"`{name}` must be finite, got {array.tolist()}.")
    array.flags.writeable = False
    return array
