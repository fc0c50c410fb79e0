"""What is wrong with a file, in words: pydantic's problems as one line."""

import difflib
from collections.abc import Iterable
from itertools import takewhile

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

UNION_TAGS = {"step", "ramp", "doublet", "str", "float", "constrained-float", "GainsTable"}

MOST_TOLD = 5
"""Mistakes told of in one line; of more there is the number."""


def joined(faults: Iterable[str]) -> str:
    """Faults as one line that ends in a full stop, or in the last one's question mark."""
    told = [fault.removesuffix(".") for fault in faults]
    more = len(told) - MOST_TOLD
    line = "; ".join(told[:MOST_TOLD])
    line = f"{line}; and {more} more" if more > 0 else line
    return " ".join(line.split()) + ("" if line.endswith("?") else ".")


def mistakes(error: ValidationError, model: type[BaseModel]) -> str:
    """What is wrong with values for `model`, the most telling first.

    Parameters
    ----------
    error : ValidationError
        What pydantic found.
    model : type of BaseModel
        What the values were read as.
    """
    problems = error.errors(include_url=False)
    problems.sort(key=_telling, reverse=True)
    places: dict[tuple[int | str, ...], ErrorDetails] = {}
    for problem in problems:
        places.setdefault(_place(problem), problem)
    return joined(_sentence(problem, model) for problem in places.values())


def _keys(problem: ErrorDetails) -> tuple[str, ...]:
    return tuple(part for part in problem["loc"] if isinstance(part, str) and not _is_tag(part))


def _telling(problem: ErrorDetails) -> tuple[int, bool, bool]:
    """Of the readings of a union the one that fits best fails deepest; a typo explains a gap."""
    a_list = isinstance(problem.get("input"), list)
    return (
        len(problem["loc"]),
        problem["type"] == "extra_forbidden",
        a_list and problem["type"] != "float_type",
    )


def _place(problem: ErrorDetails) -> tuple[int | str, ...]:
    """Where the file is wrong: all readings of a union fail at one place."""
    untagged = takewhile(lambda part: not (isinstance(part, str) and _is_tag(part)), problem["loc"])
    return tuple(untagged)


def _sentence(problem: ErrorDetails, model: type[BaseModel]) -> str:
    keys = _keys(problem)
    key = keys[-1] if keys else ""
    table = f"[{'.'.join(keys[:-1])}] " if len(keys) > 1 else ""
    got = problem.get("input")
    kind = problem["type"]
    if kind == "extra_forbidden":
        known = _known_keys(model, keys[:-1])
        close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
        hint = f"did you mean `{close[0]}`?" if close else f"known are {', '.join(known)}."
        return f"{table}`{key}` is not a known key; {hint}"
    if kind == "missing":
        return f"{table}`{key}` must be given."
    message = problem["msg"]
    if kind == "value_error":
        message = message.removeprefix("Value error, ")
        if message.startswith(("`", "[")):
            return f"{table}{message}."
        return f"{table}`{key}` {message}, got {got!r}."
    if kind == "union_tag_invalid" or kind == "union_tag_not_found":
        return f"{table}`{key}` must have a `shape` of step, ramp or doublet, got {got!r}."
    for soft in ("be", "have", "match"):
        message = message.replace(f"should {soft}", f"must {soft}")
    message = message.removeprefix("Input ")
    message = message.removeprefix("List ").removeprefix("String ").split(" after validation")[0]
    if kind == "model_type":
        message = "must be a table"
    return f"{table}`{key}` {message}, got {got!r}."


def _is_tag(part: str) -> bool:
    """Whether `part` is how pydantic names a member of a union, not a key of the file."""
    return part in UNION_TAGS or "[" in part


def _known_keys(model: type[BaseModel], keys: Iterable[str]) -> list[str]:
    for key in keys:
        for candidate in _tables_of(model, key):
            model = candidate
    return list(model.model_fields)


def _tables_of(model: type[BaseModel], key: str) -> list[type[BaseModel]]:
    field = model.model_fields.get(key)
    found: list[type[BaseModel]] = []
    pending = [field.annotation] if field else []
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found.append(kind)
        pending.extend(getattr(kind, "__args__", ()))
    return found
