"""TOML and JSON files, read whole and strictly: tables, and values of classes.

The class of a value, a frozen dataclass, is the format of its file too. The keys are the names of
the fields, and the first one names the format with its version. An unknown, missing or repeated
key, a value of another type and another version are refused in one line that names file and key.
Files are held to the checks that the class itself makes.
"""

import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import abridged, mistakes, shown
from flighttune.files.whole import write_text

# Largest file that is read: a certificate at a thousand conditions has a tenth of it.
MAX_BYTES = 16_000_000

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

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
    return _parsed(file_text(path), f"{path}: the file", _toml, "TOML")


def json_tables(path: Path) -> dict[str, Any]:
    """The object of a JSON file, read strictly; ``NaN`` and ``Infinity`` are read as floats."""
    return _parsed(file_text(path), f"{path}: the file", _json, "JSON")


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


class ValueOfFile(Protocol):
    """A frozen dataclass that can be read and written; `STRICT` is its pydantic configuration."""

    __pydantic_config__: ClassVar[ConfigDict]
    FORMAT: ClassVar[str]  # name and version: readers refuse any other
    UNITS: ClassVar[Mapping[str, str]]  # in the file for its readers: nothing is converted


V = TypeVar("V", bound=ValueOfFile)


def write(value: ValueOfFile, path: str | Path) -> None:
    """Write a value whole or not at all; an OutputError says that it cannot be written."""
    write_text(Path(path), json.dumps(tables_of(value), indent=2, allow_nan=False) + "\n")


def read(path: str | Path, kind: type[V]) -> V:
    """Read a value of some class; a ScenarioError names file and key."""
    tables = json_tables(Path(path))
    try:
        return value_of(tables, kind)
    except InputError as error:
        raise ScenarioError(f"{path}: {error}") from error


def tables_of(value: ValueOfFile) -> dict[str, Any]:
    """The JSON object of a value; floats in it read back to the same bits."""
    fields = _adapter(type(value)).dump_python(value, mode="json")
    return {"format": value.FORMAT, "units": dict(value.UNITS), **fields}


def value_of(tables: Mapping[str, Any], kind: type[V]) -> V:
    """The value whose JSON object `tables` is."""
    fields = dict(tables)
    if (written := fields.pop("format", None)) != kind.FORMAT:
        raise InputError(
            f"`format` must be {kind.FORMAT!r}, got {abridged(written)}; make the file again."
        )
    if fields.pop("units", None) != kind.UNITS:
        raise InputError("`units` must be those of this format: nothing is converted.")
    try:
        # From text: in pydantic's strict mode only there is an array a tuple.
        return _adapter(kind).validate_json(json.dumps(fields))
    except ValidationError as error:
        raise InputError(mistakes(error, fields)) from error


@cache
def _adapter(kind: type[V]) -> TypeAdapter[V]:
    return TypeAdapter(kind)
