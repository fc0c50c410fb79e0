"""A recorded scenario as the text of a file that flies it again."""

import json
import math
from collections.abc import Mapping
from typing import Any


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML of nested plain values: scalars first, then tables, then arrays of tables.

    Parameters
    ----------
    tables : mapping
        Strings, numbers, booleans, lists and mappings; None is left out.
    """
    return "\n".join(_lines(tables, ())).strip() + "\n"


def _lines(tables: Mapping[str, Any], place: tuple[str, ...]) -> list[str]:
    lines: list[str] = []
    below: list[str] = []
    for key, value in tables.items():
        path = (*place, key)
        if isinstance(value, Mapping):
            below += ["", f"[{'.'.join(map(_key, path))}]", *_lines(value, path)]
        elif _is_array_of_tables(value):
            for item in value:
                below += ["", f"[[{'.'.join(map(_key, path))}]]", *_lines(item, path)]
        elif value is not None:
            lines.append(f"{_key(key)} = {_value(value)}")
    return lines + below


def _is_array_of_tables(value: Any) -> bool:
    return (
        isinstance(value, (list, tuple))
        and bool(value)
        and all(isinstance(item, Mapping) for item in value)
    )


def _key(key: str) -> str:
    return (
        key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else _quoted(key)
    )


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "nan" if math.isnan(value) else f"{value}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(item) for item in value)}]"
    if isinstance(value, Mapping):
        inside = (f"{_key(key)} = {_value(item)}" for key, item in value.items())
        return f"{{{', '.join(inside)}}}"
    return str(value)


def _quoted(text: str) -> str:
    """A basic string: JSON's escapes are TOML's too, but for DEL, which JSON leaves as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
