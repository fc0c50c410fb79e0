"""TOML and JSON files: read whole and strictly, so that a schema can judge every value."""

import json
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from flighttune.errors import ScenarioError
from flighttune.mistakes import shown

MOST_BYTES = 16_000_000
"""Largest file that is read: a certificate at a thousand conditions has a tenth of it."""

DEEPEST = 32
"""Most tables and arrays inside each other."""

LONG_KEY = re.compile(r"(?:[\w\"'-]+[ \t]*\.[ \t]*){32}")
"""A dotted key of TOML that is deeper still; `tomllib` takes minutes for a thousand times that."""

LONGEST_TEXT = 2000
"""Characters of a text or a key."""

MOST_BITS = 1023
"""Of an integer that is a float as well."""


def stamp(file: Path) -> tuple[int, ...]:
    """When a file was last written to, which one it is, and its size.

    Raises
    ------
    OSError
        If there is none.
    """
    found = file.stat()
    return found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size


def toml_tables(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or holds what no file of ours does.
    """
    return _tables(path, _toml, "TOML")


def json_tables(path: Path) -> dict[str, Any]:
    """The object of a JSON file; ``NaN`` and ``Infinity`` are read as floats.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not JSON, gives a key twice, or holds what no file of ours
        does.
    """
    return _tables(path, _json, "JSON")


def json_object(text: str, place: str) -> dict[str, Any]:
    """The object of a JSON text inside a file, read as strictly as `json_tables`.

    Raises
    ------
    ScenarioError
        As of `json_tables`; the message begins with `place`.
    """
    return _checked(text, place, _json, "JSON")


def _toml(text: str) -> Any:
    if LONG_KEY.search(text):
        raise RecursionError
    return tomllib.loads(text)


def _json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_unique)


def _tables(path: Path, parse: Callable[[str], Any], language: str) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ScenarioError(f"{path}: the file must have at most {MOST_BYTES} bytes, got more.")
        return _checked(data.decode("utf-8"), f"{path}: the file", parse, language)
    except OSError as error:
        raise ScenarioError(f"{path}: the file must be readable: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: the file must be UTF-8 text: {error}.") from error


def _checked(text: str, place: str, parse: Callable[[str], Any], language: str) -> dict[str, Any]:
    try:
        tables = parse(text)
    except ValueError as error:
        why = str(error).partition("; use sys")[0]  # Python's advice is for programmers
        raise ScenarioError(f"{place} must be valid {language}: {why}.") from error
    except RecursionError:
        raise ScenarioError(
            f"{place} must not have more than {DEEPEST} tables inside each other."
        ) from None
    if not isinstance(tables, dict):
        raise ScenarioError(f"{place} must hold one object, got {type(tables).__name__}.")
    for fault in _impossible(tables):
        raise ScenarioError(f"{place.removesuffix(' the file')} {fault}.")
    return tables


def _impossible(tables: dict[str, Any]) -> Iterator[str]:
    """What no schema of ours can judge: it would overflow, or could not be written again."""
    pending: list[tuple[str, Any, int]] = [("", tables, 0)]
    while pending:
        key, value, depth = pending.pop()
        if depth > DEEPEST:
            yield f"`{shown(key)}` must not have more than {DEEPEST} tables inside each other"
        elif isinstance(value, dict):
            for name, item in value.items():
                if not _is_text(name):
                    most = f"up to {LONGEST_TEXT} Unicode characters"
                    yield f"`{shown(name)!a}` must be a key of {most}"
                pending.append((f"{key}.{name}".removeprefix("."), item, depth + 1))
        elif isinstance(value, list):
            pending += [(f"{key}[{i}]", item, depth + 1) for i, item in enumerate(value)]
        elif isinstance(value, int) and value.bit_length() > MOST_BITS:
            yield f"`{shown(key)}` must be a number below 1e308, got an integer beyond it"
        elif isinstance(value, str) and not _is_text(value):
            got = f"{shown(value)!a} of {len(value)}"
            most = f"up to {LONGEST_TEXT} Unicode characters"
            yield f"`{shown(key)}` must be text of {most}, got {got}"


def _is_text(text: str) -> bool:
    """Whether text is short and can be written: JSON has escapes for halves of characters."""
    halves = not text.isascii() and any("\ud800" <= one <= "\udfff" for one in text)
    return len(text) <= LONGEST_TEXT and not halves


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a JSON file; a key that is given twice would hide its first value."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"`{shown(twice)}` is given twice")
    return table
