"""Parts of the site that are made while it is built: tables of keys, and what the search needs."""

from collections.abc import Iterator
from typing import Any

import flighttune
from flighttune.campaign.planning.schema import Campaign
from flighttune.scenario.schema import Scenario

SHOWN = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum", "minLength", "minItems")
SIGN = {
    "minimum": ">=",
    "exclusiveMinimum": ">",
    "maximum": "<=",
    "exclusiveMaximum": "<",
    "minLength": "characters >=",
    "minItems": "entries >=",
}


def complete(_app: object, name: str, source: list[str]) -> None:
    """Append the tables of keys to their page, from the schemas; `source` is changed."""
    if name == "docs/keys":
        source[0] += "\n" + "\n".join(keys())


def index_entry(_app: object, _what: str, name: str, *rest: Any) -> None:
    """Let the search find a public name as it is written in a program: ``ft.fly``."""
    package, _, public = name.partition(".")
    if package == "flighttune" and public in flighttune.__all__:
        rest[-1][:0] = [f".. index:: ! ft.{public}", ""]


def keys() -> Iterator[str]:
    """Tables of every key of scenarios and campaigns."""
    for title, model in (("Scenarios", Scenario), ("Campaigns", Campaign)):
        yield f"## {title}\n"
        schema = model.model_json_schema(by_alias=True)
        yield from _table("(top)", schema)
        for name, table in schema.get("$defs", {}).items():
            if "properties" in table:
                yield from _table(name, table)


def _table(name: str, schema: dict[str, Any]) -> Iterator[str]:
    yield f"### {name.removesuffix('Table').removeprefix('_')}\n"
    yield "| key | value | default |"
    yield "|---|---|---|"
    required = schema.get("required", ())
    for key, one in schema["properties"].items():
        default = "required" if key in required else _toml(one.get("default"))
        yield f"| `{key}` | {_kind(one)} | {default} |"
    yield ""


def _toml(value: object) -> str:
    """A default as it would be written in a file; of a table, that of its keys."""
    if value is None or isinstance(value, dict):
        return ""
    text = str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')
    return f"`{text}`"


def _kind(schema: dict[str, Any]) -> str:
    """What a value must be, in words."""
    if "$ref" in schema:
        return "table " + schema["$ref"].rsplit("/", 1)[1].removesuffix("Table")
    for several in ("anyOf", "oneOf", "allOf"):
        if several in schema:
            kinds = [_kind(one) for one in schema[several] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{one}`" for one in schema["enum"])
    kind = {"array": "list", "string": "text", "object": "table"}.get(
        schema.get("type", ""), schema.get("type", "any")
    )
    if isinstance(schema.get("items"), dict):
        kind += f" of {_kind(schema['items'])}"
    bounds = [f"{SIGN[one]} {schema[one]:g}" for one in SHOWN if one in schema]
    return ", ".join([kind, *bounds])
