"""Why flights did not complete: counts of reasons, which may differ in their numbers."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

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


def why_ended(rows: Iterable[Mapping[str, Any]]) -> str:
    """The reasons of flights in one line, each with its number of flights and status."""
    return "".join(f" {x['count']} {x['status']}: {x['reason']}" for x in endings(rows))


def reasons(texts: Sequence[str], runs: Sequence[int]) -> list[dict[str, Any]]:
    """Counts of sentences, grouped if they differ only in numbers; the most frequent first."""
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
    """The common text of sentences that differ only in numbers, with the range of each number."""
    places = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    ends = ((min(shown, key=float), max(shown, key=float)) for shown in places)
    ranges = (" to ".join(dict.fromkeys(numbers)) for numbers in ends)
    return _NUMBER.sub(lambda _: next(ranges), texts[0])
