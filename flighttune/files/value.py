"""Values as JSON files: the class of a value, a frozen dataclass, is the format of its file too.

The keys are the names of the fields, and the first one names the format with its version. Files
are read strictly: an unknown, missing or repeated key, a value of another type and another version
are refused in one line that names file and key. What the class itself checks when it is made holds
for files as well.
"""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import abridged, mistakes
from flighttune.files.table import json_tables
from flighttune.files.whole import write_text

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


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
