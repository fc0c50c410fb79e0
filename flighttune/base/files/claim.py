"""Files of claims in JSON: sealed when they are written, and opened only with the right seal.

The seal is the SHA-256 of all other bytes of the file. Archives of claims have it in their comment:
`array.write_sealed` and `load.sealed_bytes`, which this module uses too.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from flighttune.base.errors import ScenarioError, naming
from flighttune.base.files import load, table, whole

# Key of the seal, the last one of the file.
SEAL = "sha256"


class Claim(table.ValueOfFile, Protocol):
    """A claim that is a file of its own."""

    # Format of files that were written without a seal, by flighttune 0.5.0 and before; empty if
    # such a file is refused
    UNSEALED: ClassVar[str]


C = TypeVar("C", bound=Claim)


def write(value: Claim, path: str | Path) -> None:
    """Write a claim with its seal, whole or not at all."""
    text = json.dumps({**table.tables_of(value), SEAL: load.BLANK}, indent=2, allow_nan=False)
    with whole.whole_file(Path(path)) as part:
        part.write_bytes(load.seal(f"{text}\n".encode()))


def read(path: str | Path, kind: type[C]) -> C:
    """Read a claim; a file whose seal is missing or wrong is refused, see `current`."""
    with naming(path, ScenarioError):
        tables = table.json_tables(Path(path))
        if tables.get("format") == kind.FORMAT:
            load.sealed_bytes(Path(path), load.words_of(kind.FORMAT), "make it again")
            tables.pop(SEAL, None)
        return table.value_of(current(tables, kind), kind)


def current(tables: Mapping[str, Any], kind: type[Claim]) -> Mapping[str, Any]:
    """The tables of a claim in the format of today, which differs from `UNSEALED` by the seal."""
    if kind.UNSEALED and tables.get("format") == kind.UNSEALED:
        return {**tables, "format": kind.FORMAT}
    return tables
