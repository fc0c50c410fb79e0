"""Validation errors of pydantic as one line that names key, requirement and value."""

import difflib
import re
from collections.abc import Iterable, Sequence
from reprlib import Repr
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from flighttune.errors import ScenarioError

# Mistakes listed in one line; the rest is counted.
MAX_LISTED = 5

# Characters of a key or a value that a message repeats.
MAX_CHARACTERS = 80

# Characters of a word that a message repeats whole: as many as the name of a file can have.
MAX_WORD = 255

Model = TypeVar("Model", bound=BaseModel)

_ABRIDGED = Repr()
_ABRIDGED.maxstring = _ABRIDGED.maxother = MAX_CHARACTERS


def shown(key: str) -> str:
    """A key as a message repeats it: the middle of a long one is left out."""
    return abridged(key)[1:-1]


def abridged(value: object) -> str:
    """A value as a message repeats it: the middle of a long one is left out."""
    return _ABRIDGED.repr(value)


def joined(faults: Iterable[str]) -> str:
    """Faults as one line that ends in a full stop, or in the last one's question mark."""
    sentences = [fault.removesuffix(".") for fault in faults]
    more = len(sentences) - MAX_LISTED
    line = "; ".join(sentences[:MAX_LISTED]) + (f"; and {more} more" if more > 0 else "")
    words = (word if len(word) <= MAX_WORD else shown(word) for word in line.split())
    return " ".join(words) + ("" if line.endswith("?") else ".")


def mistakes(error: ValidationError, tables: object, model: type[BaseModel] | None = None) -> str:
    """All mistakes in `tables` as one line, the deepest first; a `model` is that of a TOML file."""
    # An unknown key comes before the key that is missing in its place, and the fault of a range
    # before the remark that a range is no number.
    problems = sorted(
        error.errors(include_url=False),
        key=lambda problem: (len(problem["loc"]), problem["type"] not in ("missing", "float_type")),
        reverse=True,
    )
    sentences: dict[tuple[int | str, ...], str] = {}
    for problem in problems:
        place = _place(problem, tables)
        # A value of a union has a problem for each member: the member that fits best fails deepest.
        if not any(deeper[: len(place)] == place for deeper in sentences):
            sentences[place] = _sentence(problem, place, model)
    return joined(sentences.values())


def validated(model: type[Model], tables: Any, source: object) -> Model:
    """Tables read as `model`; a ScenarioError names `source`, the file, and each wrong key."""
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        named = None if str(source).endswith(".json") else model
        raise ScenarioError(f"{source}: {mistakes(error, tables, named)}") from None


def _place(problem: ErrorDetails, tables: Any) -> tuple[int | str, ...]:
    """Keys and indices down to the wrong value, without the members of unions in between."""
    place = []
    for part in problem["loc"]:
        inside: Any = dict(enumerate(tables)) if isinstance(tables, list) else tables
        if isinstance(inside, dict) and part in inside:
            tables = inside[part]
            place.append(part)
    if problem["type"] == "missing":
        place.append(problem["loc"][-1])
    return tuple(place)


def _sentence(
    problem: ErrorDetails, place: tuple[int | str, ...], model: type[BaseModel] | None
) -> str:
    kind, message = problem["type"], problem["msg"].removeprefix("Value error, ")
    if message.startswith("["):  # a validator named table and key
        return message
    keys = [str(part) for part in place if model is None or isinstance(part, str)]
    if message.startswith("`"):  # a table that checks itself named the key in it
        inside, fault = message[1:].split("`", 1)
        return f"{_named([*keys, inside], model)}{fault}"
    key, subject = keys[-1] if keys else "", _named(keys, model)
    if kind == "missing":
        return f"{subject} must be given"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        names = _known_keys(model, keys[:-1]) if model else []
        close = difflib.get_close_matches(shown(key), names, n=1, cutoff=0.5)
        hint = f"did you mean `{close[0]}`?" if close else f"the keys are {', '.join(names)}"
        return f"{subject} is not a known key" + (f"; {hint}" if names else "")
    if kind in ("model_type", "dict_type", "dataclass_type"):
        message = "must be a table"
    # "List should have at least 1 item after validation, ..." becomes "must have at least 1 item".
    message = re.sub("^(Input|List|Tuple|String) | after validation.*", "", message)
    message = message.replace("should", "must", 1)
    value = problem.get("input")
    if kind == "too_long" and isinstance(value, list):
        return f"{subject} {message}, got {len(value)}"
    return f"{subject} {message}, got {abridged(value)}"


def _named(keys: list[str], model: type[BaseModel] | None) -> str:
    if model is None or len(keys) < 2:
        return f"`{shown('.'.join(keys))}`"
    return f"[{shown('.'.join(keys[:-1]))}] `{shown(keys[-1])}`"


def _known_keys(model: type[BaseModel], place: Sequence[str]) -> list[str]:
    """Keys of the table at `place` in a model; of all tables that can be there."""
    tables = [_fields(model)]
    for key in place:
        kinds = [table[key].annotation for table in tables if key in table]
        inside = []
        for kind in kinds:  # which grows by the members of lists and unions
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                inside.append(_fields(kind))
            kinds += getattr(kind, "__args__", ())
        tables = inside or tables  # the key of a dictionary leads to no other table
    return list(dict.fromkeys(key for table in tables for key in table))


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}
