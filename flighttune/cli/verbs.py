"""Signatures and docstrings of verbs, read from source, so that a help does not import NumPy.

The signature gives types, units and defaults, the docstring only the sentences of the help.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from inspect import cleandoc
from pathlib import Path
from typing import Any, Literal, get_origin

from flighttune.base import units
from flighttune.base.public import modules_of
from flighttune.campaigns.engine.fliers import FlownBy

# Types by their names in signatures; other types have no form on a command line.
KINDS: dict[str, Any] = {x.__name__: x for x in (str, int, float, bool, Path)}
UNITS = {name: x.__metadata__[0] for name, x in vars(units).items() if hasattr(x, "__metadata__")}
KINDS |= {"Columns": list[str], **dict.fromkeys(UNITS, float)}
SEQUENCES = "Iterable", "Sequence"


@dataclass(frozen=True, kw_only=True)
class Argument:
    """A parameter of a verb, which may become an option."""

    name: str
    kind: Any = None  # type on a command line; None without a form there
    unit: str = ""
    default: Any = None  # also None if it is not a literal
    several: bool = False  # takes any number of values
    text: str = ""  # its sentences in the docstring


def arguments_of(place: str) -> dict[str, Argument]:
    """Parameters of a verb, ``module:function`` below flighttune; empty for an empty place."""
    if not place:
        return {}
    module, _, name = f"flighttune.{place}".partition(":")
    verb = _definition(module, name)
    texts = _texts(verb)
    return {x.name: replace(x, text=texts.get(x.name, "")) for x in _stated(verb.args, module)}


def _definition(module: str, name: str) -> ast.FunctionDef:
    """Signature and docstring of a verb."""
    pattern = re.compile(rf'^def {name}\(.*?^    """.*?"""', re.DOTALL | re.MULTILINE)
    (text,) = pattern.findall(_source(module))
    *_, verb = ast.parse(text).body  # after its overloads
    assert isinstance(verb, ast.FunctionDef)
    return verb


@cache
def _source(module: str) -> str:
    """The text of a module; of a package, of its ``__init__``."""
    place = Path(__file__).parents[2].joinpath(*module.split("."))
    file = place.with_suffix(".py")
    return (file if file.is_file() else place / "__init__.py").read_text(encoding="utf-8")


def _stated(stated: ast.arguments, module: str) -> Iterator[Argument]:
    """Parameters of a signature; a parameter for any number of values comes last."""
    parameters = [*stated.args, *stated.kwonlyargs]
    defaults = [*stated.defaults, *stated.kw_defaults]
    required: list[ast.expr | None] = [None] * (len(parameters) - len(defaults))
    for x, default in zip(parameters, required + defaults, strict=True):
        annotation, default = x.annotation or ast.Constant(""), getattr(default, "value", None)
        kind, unit = _kind(annotation, module), _unit(annotation)
        yield Argument(name=x.arg, kind=kind, unit=unit, default=default)
    if stated.kwarg and ast.unparse(stated.kwarg.annotation or ast.Pass()) == "Unpack[FlownBy]":
        yield from (Argument(name=name) for name in FlownBy.__annotations__)
    if stated.vararg:
        yield Argument(name=stated.vararg.arg, kind=list[str], several=True)


def _kind(annotation: ast.expr | None, module: str) -> Any:
    """Type of a value on a command line, a list for a sequence; None without a form there."""
    match annotation:
        case ast.BinOp(left=left, right=right):
            kinds = [x for x in (_kind(left, module), _kind(right, module)) if x]
            return next((x for x in kinds if get_origin(x) is list), next(iter(kinds), None))
        case ast.Subscript(value=ast.Name(id="Literal"), slice=values):
            return Literal[ast.literal_eval(values)]
        case ast.Subscript(value=ast.Name(id=name), slice=inner) if name in SEQUENCES:
            kind = _kind(inner, module)
            return kind and list[kind]
        case ast.Name(id=name):
            return KINDS.get(name) or _kind(_choices(name, module), module)
    return None


def _unit(annotation: ast.expr) -> str:
    names = [x.id for x in ast.walk(annotation) if isinstance(x, ast.Name)]
    return next((UNITS[name] for name in names if name in UNITS), "")


def _choices(name: str, module: str) -> ast.expr | None:
    """The `Literal` with this name in a module, or in the module from which it is imported."""
    text = _source(module)
    if alias := re.search(rf"^{name}(?:: TypeAlias)? = (Literal\[[^\]]*\])", text, re.MULTILINE):
        return ast.parse(alias[1], mode="eval").body
    names = rf"(?:\([^)]*|.*)\b{name}\b"
    if origin := re.search(rf"^from (flighttune[\w.]*) import {names}", text, re.MULTILINE):
        return _choices(name, origin[1])
    return None


def _texts(verb: ast.FunctionDef) -> dict[str, str]:
    """Text of each parameter in a NumPy docstring, or in the docstring that it refers to."""
    text = cleandoc(ast.get_docstring(verb) or "")
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n\w+\n-+\n|\Z)", text, re.DOTALL)
    entry = re.compile(r"^(\w[\w, ]*) : ([^\n]*)\n?((?:    .*\n?)*)", re.MULTILINE)
    texts = {}
    for names, described, words in entry.findall(section[1] if section else ""):
        own = dict.fromkeys(names.split(", "), words)
        if other := re.fullmatch(r"as for `(\w+)`", described):
            shared = _texts(_definition(modules_of("flighttune")[other[1]], other[1]))
            own = {name: shared[name] for name in own}
        texts |= own
    return texts
