"""Signatures of public names as `help` and editors show them: plain types and short defaults."""

import inspect
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

Kind = TypeVar("Kind")

# A longer signature has no types of keywords that may be left out.
MAX_LENGTH = 300

# Names that NumPy 2.5 has for its types.
NUMPY = {"NDArray": "ndarray", "ArrayLike": "array_like"}

PLAIN_DEFAULTS = type(None), bool, int, float, str, tuple


class _Text:
    """An annotation or a default that is shown by its text."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def short_signature(signature: inspect.Signature) -> inspect.Signature:
    """The signature with each type in a few words, and without a type where the default shows it.

    Libraries write types in full, so that one array takes 200 characters.
    """
    back = signature.return_annotation
    parameters = [_short(x) for x in signature.parameters.values()]
    short = signature.replace(
        parameters=parameters,
        return_annotation=back if back is signature.empty else _Text(short_type(back)),
    )
    if len(str(short)) <= MAX_LENGTH:
        return short
    untyped = [x if x.default is x.empty else x.replace(annotation=x.empty) for x in parameters]
    return short.replace(parameters=untyped)


def _short(parameter: inspect.Parameter) -> inspect.Parameter:
    empty, default = parameter.empty, parameter.default
    optional = default is None
    if not isinstance(default, PLAIN_DEFAULTS) and default is not empty:
        default = _Text("...")
    text = "" if parameter.annotation is empty else short_type(parameter.annotation)
    if optional:
        text = text.removesuffix(" | None")
    untyped = not text or (default is not empty and not optional)
    return parameter.replace(annotation=empty if untyped else _Text(text), default=default)


def short_type(annotation: Any) -> str:
    """An annotation in a few words: ``float`` for one with a unit, ``ndarray`` for any array."""
    origin, inside = typing.get_origin(annotation), typing.get_args(annotation)
    if isinstance(annotation, str):
        return annotation
    if annotation is None or annotation is type(None):
        return "None"
    if origin in (typing.Union, types.UnionType):
        return " | ".join(dict.fromkeys(_alternatives(inside)))
    if origin is typing.Annotated:
        return short_type(inside[0])
    if origin is typing.Literal:
        return " | ".join(dict.fromkeys(type(x).__name__ for x in inside))
    name = getattr(origin or annotation, "__name__", str(annotation))
    name = NUMPY.get(name, name)
    several = isinstance(origin, type) and not issubclass(origin, Mapping | Callable)
    if not several or name == "ndarray":
        return name
    parts = ["..." if x is Ellipsis else short_type(x) for x in inside]
    return f"{name}[{', '.join(parts)}]"


def _alternatives(kinds: tuple[Any, ...]) -> Iterator[str]:
    """Types of a union, None last; what NumPy takes for an array is a union of types of its own."""
    array = any("numpy._typing" in str(x) for x in kinds)
    if array:
        yield "array_like"
    own = (x for x in kinds if isinstance(x, type) and x.__module__.startswith("flighttune"))
    yield from map(short_type, own if array else (x for x in kinds if x is not type(None)))
    if type(None) in kinds:
        yield "None"


def with_short_signatures(kind: type[Kind]) -> type[Kind]:
    """The class, whose constructor and public methods now have short signatures.

    The constructor carries its own, because a subclass would inherit a signature of the class.
    """
    if "__pydantic_fields__" in vars(kind):
        setattr(kind, "__signature__", short_signature(inspect.signature(kind)))  # noqa: B010
    for base in kind.__mro__:
        if not base.__module__.startswith("flighttune"):
            continue
        for name, method in vars(base).items():
            call = getattr(method, "__func__", method)
            made = name in ("__init__", "__new__", "__call__") and call.__module__ != "typing"
            if isinstance(call, types.FunctionType) and (made or name[0] != "_"):
                setattr(call, "__signature__", short_signature(inspect.signature(call)))  # noqa: B010
    return kind
