"""Reference pages of the site that are made while it is built.

The public names come from their docstrings, the keys of files from the schemas that read them.
"""

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
    """Append to the pages of the reference what is made for them; `source` is changed."""
    made = {"docs/api": public_names, "docs/keys": keys}.get(name)
    if made is not None:
        source[0] += "\n" + "\n".join(made())


def public_names() -> Iterator[str]:
    """Every public name with its docstring, by the package that it lives in."""
    of_package: dict[str, list[str]] = {}
    for name, module in flighttune._public_modules().items():
        of_package.setdefault(module.split(".")[1], []).append(name)
    for package, names in of_package.items():
        yield f"## {package}\n"
        for name in sorted(names):
            yield f"### {name}\n"
            yield from ("```{eval-rst}", *_directive(name), "```\n")


def _directive(name: str) -> Iterator[str]:
    found = getattr(flighttune, name)
    if isinstance(found, type):
        kind = "autoexception" if issubclass(found, Exception) else "autoclass"
        yield f".. {kind}:: {found.__module__}.{found.__qualname__}"
        yield "   :members:"
        yield "   :exclude-members: model_config"
    elif callable(found):
        yield f".. autofunction:: {found.__module__}.{found.__qualname__}"
    else:
        yield f".. autodata:: flighttune.{name}"
        yield "   :no-value:"


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
