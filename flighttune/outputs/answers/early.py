"""Flights that end early: how many, the signal that left its range, and a remedy."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from flighttune.base.endings import reasons
from flighttune.base.words import listed, number
from flighttune.outputs.answers.finding import PartFinding

# The signal, its range and its value in the reason of a flight that left the range of its aircraft.
LEFT = re.compile(r"(\w+) must stay inside (\S+) to (\S+?)( deg| m/s|), got (-?[\d.]+)")

FASTER, SLOWER = "fly faster (`flight.V_a_mps`)", "fly slower (`flight.V_a_mps`)"
GENTLER = "turn and climb more gently (`limits`, `route.margin`)"

# Remedies by signal, below and above its range.
WAYS = {
    "alpha": (SLOWER, f"{FASTER} or {GENTLER}"),
    "V_a": (FASTER, SLOWER),
    "n_z": (GENTLER, GENTLER),
    "theta": (f"{FASTER} or {GENTLER}", f"{FASTER} or {GENTLER}"),
}
# Remedies by the status of a flight without such a signal.
OTHER_WAYS = {
    "ground_contact": "fly higher (`flight.h_m`)",
    "no_trim": "fly at an airspeed with steady flight (`flighttune trim`)",
    "not_arrived": f"{FASTER} or in less wind",
}
ANY_WAY = "fly one of them alone (`flighttune fly`)"


def most(lost: Sequence[object], flights: int) -> bool:
    """Whether most flights ended early, so that nothing is told by the others."""
    return 2 * len(lost) > flights


def finding_of_early(
    lost: Mapping[str, Sequence[Mapping[str, Any]]], flights: int
) -> list[PartFinding]:
    """A finding that settles nothing if most flights of a side ended early; else none.

    `lost`: ``status`` and ``reason`` of flights that ended early, by the words for their side, each
    of so many flights.
    """
    sides = {side: rows for side, rows in lost.items() if most(rows, flights)}
    if not sides:
        return []
    said = in_words({side: (rows, flights) for side, rows in sides.items()})
    return [PartFinding(found="open", sentence=said, reason=said)]


def in_words(lost: Mapping[str, tuple[Sequence[Mapping[str, Any]], int]]) -> str:
    """How many flights of each side ended early, why most of them did, and what helps."""
    rows = [row for of_side, _ in lost.values() for row in of_side]
    counts = [f"{len(own)} of {n} flights{side and f' {side}'}" for side, (own, n) in lost.items()]
    why, way = commonest(rows)
    return f"{listed(counts)} ended early. {why}: {way}."


def commonest(rows: Iterable[Mapping[str, Any]]) -> tuple[str, str]:
    """The commonest reason of ended flights with its numbers, and a remedy."""
    found = [(row, LEFT.search(row["reason"] or "")) for row in rows]
    kinds = Counter(left[1] if left else row["status"] for row, left in found)
    (kind, n), many = kinds.most_common(1)[0], len(found)
    share = f"In {n} of them " if n < many else "In all of them "
    lefts = [left for _, left in found if left and left[1] == kind]
    if lefts:
        low, high, unit = lefts[0][2], lefts[0][3], lefts[0][4]
        values = [float(left[5]) for left in lefts]
        ends = " to ".join(dict.fromkeys(number(x, ".4g") for x in (min(values), max(values))))
        above = sum(x >= float(high) for x in values) * 2 >= len(values)
        said = f"{share}{kind} left its range of {low} to {high}{unit} ({ends}{unit})"
        return said, WAYS.get(kind, (ANY_WAY, ANY_WAY))[above]
    own = [row["reason"] or "" for row, left in found if not left and row["status"] == kind]
    words = kind.replace("_", " ")
    told = next((x["reason"] for x in reasons(own, [*range(len(own))])), "").rstrip(".")
    said = f"{share}the end is {words}{told and f' ({told})'}"
    return said, OTHER_WAYS.get(kind, ANY_WAY)
