"""Arguments of public calls, checked against their annotations: one line says what is wrong.

Only calls by a user are checked. Calls inside the package are not.
"""

import collections.abc
import functools
import inspect
import numbers
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import is_number
from flighttune.base.errors import InputError
from flighttune.base.files.budget import is_name
from flighttune.base.signatures import short_signature
from flighttune.base.words import got

Call = TypeVar("Call", bound=Callable[..., Any])
Kind = TypeVar("Kind")

# Largest whole number of a call: nobody can fly so many runs or points, and seeds are smaller.
LARGEST = 2**31

# Most characters of the line that refuses a call.
MAX_LINE = 1000

# Built-in types. An object of another class may be iterable.
PLAIN = (type(None), bool, int, float, complex, str, bytes, list, tuple, dict, set, np.ndarray)

WORDS: dict[Any, str] = {
    bool: "true or false",
    float: "a number",
    int: "a whole number",
    str: "text",
    Path: "a path",
    type(None): "None",
}

# What NumPy takes for an array: a union of types, since NumPy 2.5 one named type.
ARRAY = {*typing.get_args(npt.ArrayLike)} or {npt.ArrayLike}
ARRAYS = np.ndarray, npt.NDArray


def checked(call: Call) -> Call:
    """The function, or the `__init__` of a class, with its arguments checked by annotation."""

    @functools.wraps(call)
    def wrapped(*args: Any, **options: Any) -> Any:
        check(call, args, options)
        return call(*args, **options)

    setattr(wrapped, "__signature__", short_signature(_annotations(call)[0]))  # noqa: B010
    return typing.cast("Call", wrapped)


def checked_class(kind: type[Kind]) -> type[Kind]:
    """The class, with its arguments checked if an instance cannot be built from them.

    Instances that can be built cost no check, because some are made for every flight.
    """
    made: Callable[..., None] = kind.__init__

    @functools.wraps(made)
    def init(self: Kind, *args: Any, **options: Any) -> None:
        try:
            made(self, *args, **options)
        except InputError as error:
            text = " ".join(str(error).split())  # a value may be an array or a long text
            if text == str(error) and len(text) <= MAX_LINE:
                raise
            raise type(error)(f"{text[:MAX_LINE]} ...") from error
        except Exception:
            check(made, (self, *args), options)
            raise

    setattr(kind, "__init__", init)  # noqa: B010
    return kind


def check(call: Callable[..., Any], args: Sequence[Any], options: Mapping[str, Any]) -> None:
    """Refuse the first argument that does not fit its annotation."""
    signature, hints = _annotations(call)
    try:
        given = signature.bind(*args, **options).arguments
    except TypeError as error:  # another name or number of arguments
        raise TypeError(f"{call.__qualname__}() {error}") from None
    for name, value in given.items():
        parameter, annotation = signature.parameters[name], hints[name]
        if parameter.kind is parameter.VAR_KEYWORD:
            continue
        several = parameter.kind is parameter.VAR_POSITIONAL
        for each in value if several else (value,):
            if each is parameter.default:
                continue
            if not fits(each, annotation):
                raise InputError(_misfit(name, each, annotation))
            if isinstance(each, str | PurePath) and not is_name(each):
                raise InputError(
                    f"`{name}` must be a name or path that files can have, got {got(str(each))}."
                )


def _misfit(name: str, value: Any, annotation: Any) -> str:
    """What is wrong with a value, or with the first wrong entry of a dictionary."""
    kinds = typing.get_args(annotation) if _is_union(annotation) else (annotation,)
    for kind in kinds if isinstance(value, Mapping) else ():
        origin, inside = typing.get_origin(kind), typing.get_args(kind)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            for key, each in value.items():
                if not fits(key, inside[0]):
                    return f"each name in `{name}` must be {words(inside[0])}, got {got(key)}."
                if not fits(each, inside[1]):
                    return f"`{name}` must have {words(inside[1])} for {key}, got {got(each)}."
    return f"`{name}` must be {words(annotation)}, got {got(value)}."


def _is_union(annotation: Any) -> bool:
    return typing.get_origin(annotation) in (typing.Union, types.UnionType)


@functools.cache
def _annotations(call: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    signature, hints = inspect.signature(call), {}
    parameters = [y for x in signature.parameters.values() for y in _stated(x)]
    signature = signature.replace(parameters=parameters)
    for name, parameter in signature.parameters.items():
        stated = types.SimpleNamespace(__annotations__={name: parameter.annotation})
        try:
            hints[name] = typing.get_type_hints(stated, call.__globals__, include_extras=True)[name]
        except (NameError, AttributeError):  # a type of a library that is imported on first use
            hints[name] = Any
        if parameter.annotation is parameter.empty:
            hints[name] = Any
    return signature, hints


def _stated(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    """The parameter itself, or each keyword of the TypedDict that it unpacks."""
    if typing.get_origin(parameter.annotation) is not typing.Unpack:
        return [parameter]
    (table,) = typing.get_args(parameter.annotation)
    named = functools.partial(inspect.Parameter, kind=inspect.Parameter.KEYWORD_ONLY, default=None)
    return [named(name, annotation=x) for name, x in typing.get_type_hints(table).items()]


def fits(value: Any, annotation: Any) -> bool:
    """Whether a value fits an annotation; it does if the annotation cannot be checked."""
    origin, inside = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation is Any or annotation is object or isinstance(annotation, TypeVar):
        return True
    if _is_union(annotation):
        array = {*inside} >= ARRAY
        return (array and _is_array(value)) or any(
            fits(value, each) for each in inside if not (array and each in ARRAY)
        )
    if origin is typing.Literal:
        return isinstance(value, str | int) and value in inside
    if origin in ARRAYS or annotation is npt.ArrayLike:
        return _is_array(value)
    if origin is tuple and inside[-1:] != (Ellipsis,):
        return _is_list(value) and len(value) == len(inside) and all(map(fits, value, inside))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits(key, inside[0]) and fits(each, inside[1]) for key, each in value.items()
        )
    if origin is collections.abc.Callable:
        return callable(value)
    if isinstance(origin, type) and issubclass(origin, Iterable):
        several = origin is collections.abc.Iterable and not isinstance(value, PLAIN)
        if several and isinstance(value, Iterator):  # it can be read only once
            return True
        several = several and isinstance(value, Iterable)
        entries: Any = value if several or _is_list(value) else None
        return entries is not None and all(fits(each, inside[0]) for each in entries)
    if hasattr(annotation, "__metadata__"):
        return fits(value, origin if origin not in (None, typing.Annotated) else inside[0])
    return _is_a(value, annotation)


def _is_a(value: Any, kind: Any) -> bool:
    """Whether a value is an instance of a class; numbers of NumPy count as numbers."""
    if kind is None:
        return value is None
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is int:
        whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
        return whole and abs(int(value)) < LARGEST
    if kind is float:
        return is_number(value)
    if not isinstance(kind, type):
        return True
    if getattr(kind, "_is_protocol", False):
        members = {*dir(kind), *kind.__annotations__} - {*dir(typing.Protocol)}
        return all(hasattr(value, name) for name in members if name[0] != "_")
    return isinstance(value, PurePath if issubclass(kind, PurePath) else kind)


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple | set | frozenset | np.ndarray | range) or (
        isinstance(value, Sequence) and not isinstance(value, str | bytes)
    )


def _is_array(value: Any) -> bool:
    """Whether NumPy can convert a value to numbers."""
    try:
        return np.asarray(value).dtype.kind in "biufc"
    except (ValueError, TypeError, OverflowError):  # the rows have different lengths
        return False


def words(annotation: Any) -> str:
    """The kind of an annotation in words."""
    origin, inside = typing.get_origin(annotation), typing.get_args(annotation)
    if _is_union(annotation):
        array = ARRAY if {*inside} >= ARRAY else set()
        kinds = ["numbers"] * bool(array) + [words(x) for x in inside if x not in array]
        return " or ".join(dict.fromkeys(kinds))
    if origin is typing.Literal:
        return " or ".join(map(repr, inside))
    if origin in ARRAYS or annotation is npt.ArrayLike:
        return "numbers"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a dictionary"
    if origin is collections.abc.Callable:
        return "a function"
    if origin is tuple and inside[-1:] != (Ellipsis,):
        return f"{len(inside)} values, each {' and '.join(dict.fromkeys(map(words, inside)))}"
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return f"a list, each {words(inside[0])}"
    if hasattr(annotation, "__metadata__"):
        return words(annotation.__origin__)
    return WORDS.get(annotation, f"a {getattr(annotation, '__name__', annotation)}")
