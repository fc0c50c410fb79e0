"""Labels of columns: name, unit and format of the values in files and rows, by key."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flighttune.base.endings import endings
from flighttune.base.names import UNIT_OF_SUFFIX
from flighttune.base.signals import CHANNEL_WORDS, SYMBOLS
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import figures, half_width, number, p_value, percent
from flighttune.outputs.answers.answer import Column, Table


def endings_table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """Number, reasons and places of flights that did not complete."""
    records = [{"ended": row["status"].replace("_", " "), **row} for row in endings(rows)]
    shown = columns("ended count reason run", of="endings")
    return Table(shown, records, "flights that did not complete", name="endings")


TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

# Ways to write a number that the labels name.
WRITERS = {"percent": percent, "figures": figures, "p_value": p_value, "half_width": half_width}


def _labelled(
    key: str, name: str, unit: str = "", digits: str = "z.4g", more: Mapping[str, Any] | None = None
) -> Column:
    settings = {"digits": WRITERS.get(digits, digits), **(more or {})}
    if "ends" in settings:
        settings["ends"] = tuple(settings["ends"])
    if settings.get("factor") == "rad" or ("_rad" in key and unit.startswith("deg")):
        settings["factor"] = DEG_PER_RAD
    return Column(key, name, unit, **settings)


METRIC_LABELS, QUANTITIES = (
    {key: _labelled(key, *row) for key, row in TABLES[kind].items()}
    for kind in ("metrics", "quantities")
)


def metric_label(key: str, channels: Mapping[str, str] = SYMBOLS) -> Column:
    """Column of a measure by its key in rows or ``[[expect]]``: ``chi.MO_rad``, overshoot of χ."""
    channel, _, metric = key.partition(".")
    metric, _, band = metric.partition(" within ")
    si = metric.replace("_deg", "_rad").replace("_dps", "_rad_s")
    label = (METRIC_LABELS | QUANTITIES)[si]
    label = replace(label, key=key, factor=label.factor if si == metric else 1.0)
    if band:
        label = replace(label, name=f"{label.name.partition(' (')[0]} (within {band})")
    if channel not in channels:
        return label
    name, bracket, band = label.name.partition(" (")
    name, _, part = name.partition(", ")
    where = part and f" in the {part}"
    label = replace(label, name=f"{name} of {channels[channel]}{where}{bracket}{band}", short="")
    if channel == "V" and metric.startswith("ITAE"):
        return replace(label, unit=label.unit.replace("rad", "m/s"))
    if metric != "effort_rms":
        return label
    # The effort belongs to the command: roll for the course, load factor for the path angle.
    unit, factor = ("deg", DEG_PER_RAD) if channel == "chi" else ("1", 1.0)
    return replace(label, unit=unit, factor=factor)


def measure_words(key: str) -> str:
    """A measure in words, with its channel: ``chi.MO_deg`` is the overshoot of course."""
    return metric_label(key, CHANNEL_WORDS).name


def in_words(requirement: Mapping[str, Any]) -> dict[str, Any]:
    """A requirement with its measure in words, and all its values in the shown `unit`."""
    label = metric_label(requirement["measure"])
    values = {
        key: label.factor * requirement[key]
        for key in ("bound", "value", "start", "alone", "beside")
        if isinstance(requirement.get(key), float | int)
    }
    unit = label.unit.strip("1")
    words = {"words": measure_words(requirement["measure"]), "unit": unit}
    if "sense" in requirement:
        bound = number(values["bound"], "z.4g")
        words["must_be"] = f"{requirement['sense']} {bound} {unit}".strip()
    return {**requirement, **values, **words}


def columns(keys: str, of: str = "") -> list[Column]:
    """Columns of a table by the keys of its records, separated by spaces.

    Labels of a single table are in ``[tables.NAME]``; `of` is the name.
    """
    own = {key: _labelled(key, *row) for key, row in TABLES["tables"][of].items()} if of else {}
    return [own.get(key) or _column(key) for key in keys.split()]


def _column(key: str) -> Column:
    parent, _, last = key.rpartition(".")
    channel = parent.rpartition(".")[2]
    if last in METRIC_LABELS:
        label = METRIC_LABELS[last]
        if channel not in SYMBOLS:
            return replace(label, key=key)
        name, short = (f"{x} {SYMBOLS[channel]}" if x else "" for x in (label.name, label.short))
        return replace(metric_label(f"{channel}.{last}"), key=key, name=name, short=short)
    if last in QUANTITIES:
        return replace(QUANTITIES[last], key=key)
    for suffix, unit in UNIT_OF_SUFFIX.items():
        if last.endswith(suffix):
            return Column(key, last.removesuffix(suffix).replace("_", " "), unit)
    return Column(key, last.replace("_", " "))
