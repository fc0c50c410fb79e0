"""Why flights failed, counted: sentences that differ only in their numbers are one."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from flighttune.present.tables import Column, Table

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|(?<=[\s=])-?(?:inf|nan)\b")

COLUMNS = [
    Column("ended", "ended"),
    Column("count", "flights"),
    Column("reason", "reason, with the ranges of its numbers"),
    Column("run", "first draw"),
]


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
    return Table(COLUMNS, records, "flights that did not complete", name="endings")


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
