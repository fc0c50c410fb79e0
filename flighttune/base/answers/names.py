"""Names, symbols and units as a reader sees them; reasons of failures, counted."""

import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flighttune.base.answers.answer import Column, Table, figures, p_value, percent
from flighttune.base.units import DEG_PER_RAD

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|(?<=[\s=])-?(?:inf|nan)\b")


def endings(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Reasons of flights by ``run``, ``status`` and ``reason``; the most frequent status first."""
    rows = sorted(rows, key=lambda row: row["run"])
    return [
        {"status": status, **reason}
        for status, _ in Counter(row["status"] for row in rows).most_common()
        for own in [[row for row in rows if row["status"] == status]]
        for reason in reasons([row["reason"] for row in own], [row["run"] for row in own])
    ]


def endings_table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """How often, why and where flights did not complete."""
    records = [{"ended": row["status"].replace("_", " "), **row} for row in endings(rows)]
    shown = columns("ended count reason run", of="endings")
    return Table(shown, records, "flights that did not complete", name="endings")


def why_ended(rows: Iterable[Mapping[str, Any]]) -> str:
    """The same in a line."""
    return "".join(f" {x['count']} {x['status']}: {x['reason']}" for x in endings(rows))


def reasons(texts: Sequence[str], runs: Sequence[int]) -> list[dict[str, Any]]:
    """Sentences that differ only in their numbers, counted; the most frequent first."""
    places_of: dict[str, list[int]] = {}
    for place, text in enumerate(texts):
        if text:
            places_of.setdefault(_NUMBER.sub("…", text), []).append(place)
    grouped = [
        {
            "reason": _shared([texts[place] for place in members]),
            "count": len(members),
            "run": runs[members[0]],
        }
        for members in places_of.values()
    ]
    return sorted(grouped, key=lambda reason: (-reason["count"], reason["run"]))


def _shared(texts: Sequence[str]) -> str:
    """The common text of sentences that differ only in numbers, with the ranges of these."""
    places = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    ends = ((min(shown, key=float), max(shown, key=float)) for shown in places)
    ranges = (" to ".join(dict.fromkeys(numbers)) for numbers in ends)
    return _NUMBER.sub(lambda _: next(ranges), texts[0])


# Labels, words and units of what stands in files and rows, by key.
TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
WORDS, UNIT_OF_SUFFIX = TABLES["words"], TABLES["unit_of_suffix"]

# Ways to write a number that the labels name.
WRITERS = {"percent": percent, "figures": figures, "p_value": p_value}


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

CHANNEL_SYMBOLS = {"chi": "χ", "gamma": "γ"}
OTHER_SYMBOLS = {"V": "V", "phi": "φ", "n_z": "n_z", "cross_track": "e_y", "height_err": "e_h"}
SYMBOLS = CHANNEL_SYMBOLS | OTHER_SYMBOLS
CHANNEL_NAMES = {"chi": "course", "gamma": "path angle"}
OTHER_WORDS = {"V": "airspeed", "cross_track": "cross track", "height_err": "height"}
CHANNEL_WORDS = CHANNEL_NAMES | OTHER_WORDS


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
    label = replace(label, name=f"{name} of {channels[channel]}{where}{bracket}{band}")
    if channel == "V" and metric.startswith("ITAE"):
        return replace(label, unit=label.unit.replace("rad", "m/s"))
    if metric != "effort_rms":
        return label
    # The effort is that of the command: roll for the course, load factor for the path angle.
    unit, factor = ("deg", DEG_PER_RAD) if channel == "chi" else ("1", 1.0)
    return replace(label, unit=unit, factor=factor)


def measure_words(key: str) -> str:
    """A measure in words, with its channel: ``chi.MO_deg`` is the overshoot of course."""
    return metric_label(key, CHANNEL_WORDS).name


def in_words(requirement: Mapping[str, Any]) -> dict[str, Any]:
    """A requirement with its measure in words, and all its values in the `unit` that is shown."""
    label = metric_label(requirement["measure"])
    values = {
        key: label.factor * requirement[key]
        for key in ("bound", "value", "start", "alone", "beside")
        if isinstance(requirement.get(key), float | int)
    }
    words = {"words": measure_words(requirement["measure"]), "unit": label.unit.strip("1")}
    return {**requirement, **values, **words}


def key_words(key: str) -> str:
    """A dispersed quantity in words, by its key: ``flight.chi_deg`` is the initial course."""
    words: list[str] = []
    owner = ""
    for part in re.split(r"\.(?![^\[]*\])", key):  # no dot of a label
        name, _, place = part.rstrip("]").partition("[")
        end = next((end for end in UNIT_OF_SUFFIX if name.endswith(end)), "")
        name = name.removesuffix(end).replace("V_a", "V-a").replace("n_z", "n-z")
        words += [WORDS.get(word.replace("-", "_"), word) for word in name.split("_")]
        place = str(int(place) + 1) if place.isdigit() else place
        if name == "plant" and place:
            owner = f" of plant {place}" if place.isdigit() else f" of {place}"
        elif place and key.startswith("limits"):
            words.append("minimum" if place == "1" else "maximum")
        elif place:
            words.append(place)
    if words[-1] in ("maximum", "minimum"):
        words.insert(0, words.pop())
    return " ".join(filter(None, words)) + owner


def listed(words: Sequence[str], joint: str = "and", most: int | None = None) -> str:
    """Words as they are read: ``a``, ``a and b``, ``a, b and c``; the first `most` of many."""
    if most is not None and len(words) > most:
        words = [*words[:most], f"{len(words) - most} more"]
    return f" {joint} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def columns(keys: str, of: str = "") -> list[Column]:
    """Columns of a table by the keys of its records, separated by spaces.

    Labels that only one table has are in ``[tables.NAME]``; `of` is that name.
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
        name = f"{label.name} {SYMBOLS[channel]}"
        return replace(metric_label(f"{channel}.{last}"), key=key, name=name)
    if last in QUANTITIES:
        return replace(QUANTITIES[last], key=key)
    for suffix, unit in UNIT_OF_SUFFIX.items():
        if last.endswith(suffix):
            return Column(key, last.removesuffix(suffix).replace("_", " "), unit)
    return Column(key, last.replace("_", " "))


def shown_unit(unit: str) -> tuple[str, float]:
    """Unit that a reader sees for an SI unit, and the factor to it: degrees for radians."""
    if unit in ("rad", "rad/s"):
        return unit.replace("rad", "deg"), DEG_PER_RAD
    return unit, 1.0


def distinct(names: Iterable[str]) -> list[str]:
    """Names in order; one that repeats an earlier one ends in ``_2``, ``_3`` and so on."""
    used: dict[str, None] = {}
    for stem in names:
        name, again = stem, 2
        while name in used:
            name, again = f"{stem}_{again}", again + 1
        used[name] = None
    return list(used)


def rate(per_s: float) -> str:
    """A number a second, to three figures or whole."""
    return f"{per_s:.0f}" if per_s >= 100.0 else f"{per_s:.3g}"


def duration(seconds: float) -> str:
    """A time as one would say it: ``48 s``, ``12 min``, ``3.4 h``."""
    if seconds < 120.0:
        return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
