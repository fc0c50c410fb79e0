"""Validation errors of pydantic as one line that names key, requirement and value."""

import difflib
import re
from collections.abc import Iterable
from reprlib import Repr

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

MAX_LISTED = 5
"""Mistakes listed in one line; the rest is counted."""

MAX_CHARACTERS = 80
"""Characters of a key or a value that a message repeats."""

_ABRIDGED = Repr()
_ABRIDGED.maxstring = _ABRIDGED.maxother = MAX_CHARACTERS


def shown(key: str) -> str:
    """A key as a message repeats it: the middle of a long one is left out."""
    if len(key) <= MAX_CHARACTERS:
        return key
    half = MAX_CHARACTERS // 2
    return f"{key[:half]}...{key[-half:]}"


def abridged(value: object) -> str:
    """A value as a message repeats it: the middle of a long one is left out."""
    return _ABRIDGED.repr(value)


def joined(faults: Iterable[str]) -> str:
    """Faults as one line that ends in a full stop, or in the last one's question mark."""
    sentences = [fault.removesuffix(".") for fault in faults]
    more = len(sentences) - MAX_LISTED
    line = "; ".join(sentences[:MAX_LISTED]) + (f"; and {more} more" if more > 0 else "")
    return " ".join(line.split()) + ("" if line.endswith("?") else ".")


def mistakes(error: ValidationError, model: type[BaseModel], tables: object) -> str:
    """All mistakes in `tables`, read as `model`, as one line; the most informative first."""
    problems = sorted(error.errors(include_url=False), key=_informative, reverse=True)
    # A value of a union has a problem for every member that was tried: one of them is enough.
    by_place: dict[tuple[int | str, ...], str] = {}
    for problem in problems:
        keys, place = _keys_and_place(problem, tables)
        by_place.setdefault(place, _sentence(problem, keys, model))
    return joined(by_place.values())


def first_mistake(error: ValidationError) -> str:
    """The first mistake in a file of ours: dotted key, what its value must be and what it is."""
    problem = error.errors(include_url=False)[0]
    key = ".".join(map(str, problem["loc"]))
    # A class that checks itself named the field; the table that it stands in comes in front.
    by_class = re.fullmatch(r"Value error, `([^`]*)`(.*?)\.?", problem["msg"], re.DOTALL)
    if by_class:
        return f"`{shown(f'{key}.{by_class[1]}'.removeprefix('.'))}`{by_class[2]}."
    return f"`{shown(key)}` {_requirement(problem)}."


def _keys_and_place(
    problem: ErrorDetails, tables: object
) -> tuple[list[str], tuple[int | str, ...]]:
    """Keys down to the value that is wrong, and its place in front of any member of a union.

    Pydantic puts the member of a union that it tried among the keys; it is none of the tables'.
    """
    keys: list[str] = []
    place: list[int | str] = []
    value, in_member = tables, False
    last = len(problem["loc"]) - 1
    for i, part in enumerate(problem["loc"]):
        is_missing = i == last and problem["type"] == "missing"
        if (isinstance(value, dict) and part in value) or is_missing:
            value = value.get(part) if isinstance(value, dict) else None
            keys.append(str(part))
        elif isinstance(value, list) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            in_member = True
        if not in_member:
            place.append(part)
    return keys, tuple(place)


def _informative(problem: ErrorDetails) -> tuple[int, bool, bool]:
    """Sorts a problem: the member of a union that fits best fails deepest, and an unknown key that
    is a typing error explains the key that is missing.
    """
    a_list = isinstance(problem.get("input"), list)
    return (
        len(problem["loc"]),
        problem["type"] == "extra_forbidden",
        a_list and problem["type"] != "float_type",
    )


def _sentence(problem: ErrorDetails, keys: list[str], model: type[BaseModel]) -> str:
    key = shown(keys[-1]) if keys else ""
    table = f"[{shown('.'.join(keys[:-1]))}] " if len(keys) > 1 else ""
    kind, message = problem["type"], problem["msg"]
    if kind == "extra_forbidden":
        names = _known_keys(model, keys[:-1])
        close = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
        hint = f"did you mean `{close[0]}`?" if close else f"known are {', '.join(names)}."
        return f"{table}`{key}` is not a known key; {hint}"
    if kind == "value_error" and message.startswith("Value error, ["):
        return f"{message.removeprefix('Value error, ')}."  # a validator named table and key
    if kind == "value_error" and message.startswith("Value error, `"):
        inside = f"[{shown('.'.join(keys))}] " if keys else ""
        return f"{inside}{message.removeprefix('Value error, ')}."  # ... the key in its own table
    return f"{table}`{key}` {_requirement(problem)}."


def _requirement(problem: ErrorDetails) -> str:
    """The requirement that a value misses, and the value."""
    plain = {
        "missing": "must be given",
        "extra_forbidden": "must not be there: the key is unknown",
        "unexpected_keyword_argument": "must not be there: the key is unknown",
    }
    if problem["type"] in plain:
        return plain[problem["type"]]
    # "List should have at least 1 item after validation, ..." becomes "must have at least 1 item".
    message = re.sub(r"^(Value error,|Input|List|Tuple|String) ", "", problem["msg"])
    message = message.split(" after validation")[0].replace("should", "must")
    if problem["type"] in ("model_type", "dict_type", "dataclass_type"):
        message = "must be a table"
    return f"{message}, got {abridged(problem.get('input'))}"


def _known_keys(model: type[BaseModel], keys: Iterable[str]) -> list[str]:
    for key in keys:
        for candidate in _tables_of(model, key):
            model = candidate
    return list(model.model_fields)


def _tables_of(model: type[BaseModel], key: str) -> list[type[BaseModel]]:
    field = model.model_fields.get(key)
    tables: list[type[BaseModel]] = []
    pending = [field.annotation] if field else []
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            tables.append(kind)
        pending.extend(getattr(kind, "__args__", ()))
    return tables
