"""How commands answer: one JSON object, or tables and lines, on stdout; reasons on stderr."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NoReturn

from flighttune.present.tables import Table

FINE, NO, COULD_NOT_RUN, INTERRUPTED = 0, 1, 2, 130

LONGEST_REASON = 1500
"""Characters of a line about a failure."""


def emit(answer: Mapping[str, Any], text: Iterable[Table | str], *, as_json: bool) -> None:
    """Print what a command found: `answer` with ``--json``, else its tables and lines."""
    if as_json:
        print(json_text(answer))
        return
    for part in text:
        if isinstance(part, Table):
            part.print()
        else:
            print(part)


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table as commands print it."""
    return Table(title=title, head=head, rows=rows)


def pick(value: object, names: str) -> dict[str, Any]:
    """Attributes of `value` by name; `names` are separated by spaces."""
    return {name: getattr(value, name) for name in names.split()}


def json_text(value: Mapping[str, Any]) -> str:
    """One JSON object; numbers that JSON has no word for become null."""
    return json.dumps(_plain(value), indent=2)


def _plain(value: Any) -> Any:
    """`value` in the types of JSON: no NaN or infinity, no array, dataclass or path."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        return {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    # NumPy's arrays and scalars, which are not imported here: --help must be quick.
    return _plain(value.tolist()) if hasattr(value, "tolist") else value


def say(line: str) -> None:
    """Print one line on stdout while a command still runs."""
    print(line)


def tell(line: str) -> None:
    """Print one line on stderr, for someone who watches."""
    print(line, file=sys.stderr)


def fail(reason: str, status: int) -> NoReturn:
    """Print the reason in one line on stderr and exit with `status`; a long one is cut."""
    printable = (one if one.isprintable() else " " for one in reason)  # no codes for a terminal
    line = " ".join("".join(printable).split())
    if len(line) > LONGEST_REASON:
        half = LONGEST_REASON // 2
        line = f"{line[:half]} ... {line[-half:]}"
    tell(f"flighttune: {line}")
    sys.exit(status)
