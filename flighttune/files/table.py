"""TOML and JSON files, read whole and strictly; tables as TOML, and their hash."""

import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from flighttune.errors import ScenarioError
from flighttune.files.mistakes import shown

# Largest file that is read: a certificate at a thousand conditions has a tenth of it.
MAX_BYTES = 16_000_000

# A dotted key of over 32 parts: `tomllib` takes minutes for 100,000. The expression begins only
# where a key can and gives nothing back, so that it costs one pass of any text.
PART = r"""(?:"[^"\n]*+"|'[^'\n]*+'|[\w-]++)"""
DEEP_KEY = re.compile(rf"(?m)(?:^|[\[{{,])[ \t]*+(?:{PART}[ \t]*+\.[ \t]*+){{32}}")


def stamp(file: Path) -> tuple[int, ...]:
    """Time of the last write to a file, its number and its size; empty without a file."""
    try:
        status = file.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size


def toml_tables(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ScenarioError if it cannot be read."""
    return _tables(path, _toml, "TOML")


def json_tables(path: Path) -> dict[str, Any]:
    """The object of a JSON file, read strictly; ``NaN`` and ``Infinity`` are read as floats."""
    return _tables(path, _json, "JSON")


def json_object(text: str, place: str) -> dict[str, Any]:
    """The object of a JSON text inside a file; a ScenarioError begins with `place`."""
    return _parsed(text, place, _json, "JSON")


def toml_value(text: str, place: str) -> Any:
    """A value written as TOML; a text that is no TOML is itself the value."""

    def parse(line: str) -> Any:
        try:
            return _toml(line)
        except tomllib.TOMLDecodeError:
            return {"value": text}

    return _parsed(f"value = {text}", place, parse, "TOML")["value"]


def _toml(text: str) -> Any:
    if DEEP_KEY.search(text):
        raise RecursionError
    tables = tomllib.loads(text)
    for key in _large_integers(tables, ()):
        raise ValueError(f"`{shown('.'.join(key))}` must be an integer of at most 64 bits")
    return tables


def _large_integers(value: Any, place: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Places of integers that TOML does not have; of thousands of digits Python prints none."""
    if isinstance(value, (dict, list)):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inside in items:
            yield from _large_integers(inside, (*place, str(key)))
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        yield place


def _json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_unique)


def _tables(path: Path, parse: Callable[[str], Any], language: str) -> dict[str, Any]:
    return _parsed(file_text(path), f"{path}: the file", parse, language)


def file_text(path: Path) -> str:
    """The text of a file; ScenarioError if it is too large or no UTF-8."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise ScenarioError(f"{path}: the file must have at most {MAX_BYTES} bytes, got more.")
        return data.decode("utf-8-sig")
    except OSError as error:
        raise ScenarioError(f"{path}: the file must be readable: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: the file must be UTF-8 text: {error}.") from error


def _parsed(text: str, place: str, parse: Callable[[str], Any], language: str) -> dict[str, Any]:
    try:
        tables = parse(text)
    except ValueError as error:
        reason = str(error).partition("; use sys")[0]  # Python's advice is for programmers
        raise ScenarioError(f"{place} must be valid {language}: {reason}.") from error
    except RecursionError:
        raise ScenarioError(f"{place} must not be nested so deeply.") from None
    if not isinstance(tables, dict):
        raise ScenarioError(f"{place} must hold one object, got {type(tables).__name__}.")
    return tables


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a JSON file; a key that is given twice would hide its first value."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"`{shown(twice)}` is given twice")
    return table


def hash_of(values: Any) -> str:
    """SHA-256 of plain values, the same for any order of their keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML of nested plain values, such as a recorded scenario; None is left out."""
    import tomlkit

    return tomlkit.dumps(_without_none(tables))


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item) for item in value]
    return value
