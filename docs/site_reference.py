"""Parts of the site made while it is built: tables of keys, help, and what the search needs."""

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from figures.commands import helps
from figures.formats import KEYS

import flighttune
from flighttune.base.quantities import Table
from flighttune.campaigns.planning.schema import CampaignTable
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import AircraftConfig

SHOWN = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum", "minLength", "minItems")
SIGN = {
    "minimum": ">=",
    "exclusiveMinimum": ">",
    "maximum": "<=",
    "exclusiveMaximum": "<",
    "minLength": "characters >=",
    "minItems": "entries >=",
}


# Words that are explained below a heading of a page, for the search and the index.
EXPLAINED = {
    "scenarios/README": {
        "# Write a scenario": "own scenario; own manoeuvre",
        "## Requirements": "requirement; overshoot; settling time; rise time; ITAE; expect",
    },
    "docs/aircraft": {"# Use an aircraft of your own": "own aircraft; FlightGear aircraft"},
    "docs/own_law": {"# Fly a law or a plant of your own": "own law; own plant"},
    "docs/weather": {"# Fly in wind, gusts and turbulence": "wind; gust; turbulence"},
    "docs/theory": {"# Theory in two pages": "R_K; I_K"},
}


def complete(_app: object, name: str, source: list[str]) -> None:
    """Add index entries to a page, and generated parts to theirs; `source` is changed."""
    for heading, words in EXPLAINED.get(name, {}).items():
        entries = ", ".join(f"! {word}" for word in words.split("; "))
        marked = f"{heading}\n\n```{{index}} {entries}\n```\n"
        assert f"{heading}\n" in source[0], f"{name}: no heading {heading}"
        source[0] = source[0].replace(f"{heading}\n", marked, 1)
    if name == "docs/keys":
        source[0] += "\n" + "\n".join(keys())
    if name == "docs/commands":
        source[0] += "\n" + helps()
    if name == "docs/formats":
        source[0] += "\n" + KEYS.read_text(encoding="utf-8")


def index_entry(_app: object, _what: str, name: str, *rest: Any) -> None:
    """Let the search find a public name as it is written in a program: ``ft.fly``."""
    public = name.removeprefix("flighttune.")
    if public in public_names():
        rest[-1][:0] = [f".. index:: ! ft.{public}", ""]


def public_names() -> list[str]:
    """Public names as they are written behind ``ft.``, those of its namespaces with both parts."""
    spaces = {name: getattr(flighttune, name).__all__ for name in ("compiled", "gym", "loop")}
    names = [*(name for name in dir(flighttune) if name not in spaces)]
    names += [f"{space}.{name}" for space, inside in spaces.items() for name in inside]
    return [name for name in names if "__" not in name]


def pages_to_search(app: Any, error: Exception | None) -> None:
    """Write the text of all pages for `search.js`, with the anchors that results may point to."""
    if error is not None or app.builder.name != "html":
        return
    pages = {}
    for page in sorted(app.env.found_docs):
        whole = (Path(app.outdir) / f"{page}.html").read_text(encoding="utf-8")
        body = whole.partition("<article")[2].partition(">")[2].partition("</article>")[0]
        body = re.sub(r'<a class="headerlink".*?</a>', "", body)
        body = re.sub(r"<(/?)(section|dl|dt|dd|p|span)\b([^>]*)>", _with_id_alone, body)
        pages[page] = re.sub(r"<(?!/?(?:section|dl|dt|dd|p|span)[ >])[^>]*>", "", body)
    text = f"const PAGES = {json.dumps(pages, ensure_ascii=False)};\n"
    (Path(app.outdir) / "_static" / "pages.js").write_text(text, encoding="utf-8")


def _with_id_alone(tag: re.Match[str]) -> str:
    end, name, attributes = tag.groups()
    anchor = re.search(r' id="[^"]*"', attributes)
    return f"<{end}{name}{anchor[0] if anchor else ''}>"


def load_pages(app: Any, page: str, *_: object) -> None:
    """Let the page of the search, and no other, load the text of all pages."""
    if page == "search":
        app.add_js_file("pages.js")


def keys() -> Iterator[str]:
    """Tables of every key of scenarios, campaigns and aircraft."""
    for title, model in (
        ("Scenarios", Scenario),
        ("Campaigns", CampaignTable),
        ("Aircraft", AircraftConfig),
    ):
        yield f"## {title}\n"
        schema = model.model_json_schema(by_alias=True)
        models: dict[str, type[Table]] = {}
        _models(model, models)
        yield from _table("(top)", schema, model)
        for name, table in schema.get("$defs", {}).items():
            if "properties" in table:
                yield from _table(name, table, models[name])


def _models(model: Any, found: dict[str, type[Table]]) -> None:
    """Collect a table and those in it by the names that the schema gives them."""
    if isinstance(model, type) and issubclass(model, Table):
        if model.__name__ not in found:
            found[model.__name__] = model
            for field in model.model_fields.values():
                _models(field.annotation, found)
    else:
        for part in getattr(model, "__args__", ()):
            _models(part, found)


def meanings(model: type[Table]) -> dict[str, str]:
    """What the comments above or behind the keys of a table say of them.

    A comment begins with the unit inside the program, which is not that of the key: it is cut.
    """
    said: dict[str, str] = {}
    above = ""
    sources = [inspect.getsource(base) for base in model.mro() if issubclass(base, Table)]
    for line in "\n".join(reversed(sources)).splitlines():
        code, _, comment = line.partition("# ")
        comment = f"{above} {comment}".strip()
        name = re.match(r"    (\w+): ", code)
        if name and name[1] in model.model_fields:
            said[model.model_fields[name[1]].alias or name[1]] = _in_words(comment)
        elif comment and code.strip() == ")":
            said[list(said)[-1]] = _in_words(comment)
        above = "" if code.strip() else comment
    return said


def _in_words(comment: str) -> str:
    text = re.sub(r"^(m/s|rad/s|rad|1/s|s): | \(rad\)", "", comment)
    return text if re.match(r"\w[A-Z]", text) else text[:1].lower() + text[1:]


def _table(name: str, schema: dict[str, Any], model: type[Table]) -> Iterator[str]:
    said = meanings(model)
    yield f"### {name.removesuffix('Table').removeprefix('_')}\n"
    yield f"{inspect.getdoc(model)}\n".replace("``", "`").partition("Examples")[0]
    yield "| key | value | default | meaning |"
    yield "|---|---|---|---|"
    required = schema.get("required", ())
    for key, one in schema["properties"].items():
        default = "required" if key in required else _toml(one.get("default"))
        yield f"| `{key}` | {_kind(one)} | {default} | {said.get(key, '')} |"
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
    named: str = schema.get("type", "any")
    kind = {"array": "list", "string": "text", "object": "table"}.get(named, named)
    if isinstance(schema.get("items"), dict):
        kind += f" of {_kind(schema['items'])}"
    bounds = [f"{SIGN[one]} {schema[one]:g}" for one in SHOWN if one in schema]
    return ", ".join([kind, *bounds])
