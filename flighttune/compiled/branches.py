# SPDX-License-Identifier: LGPL-2.1-or-later
"""Operations that a step needs on one side of a condition only, so that they may be left out."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import TypeAlias

from flighttune.compiled.trace import LIBRARY, Graph, operands

# A side of a select: its place, and whether it is the side where the condition holds
Side: TypeAlias = tuple[int, bool]


def sides(graph: Graph, places: Sequence[int], used: Collection[int]) -> dict[int, Side]:
    """The innermost side of a select on which alone an operation is needed, by its place.

    `places` are in order; `used` are those whose values are needed in any case. Only sides that
    call the C library are worth a branch: all other operations cost less than its end.
    """
    users: dict[int, list[int]] = defaultdict(list)
    for place in places:
        for operand in operands(graph.nodes[place]):
            users[operand].append(place)
    found: dict[int, Side | None] = {}
    for place in reversed(places):
        needing = [_of_operand(graph, user, place, found[user]) for user in users[place]]
        found[place] = None if place in used else _common(needing, found)
    of_calls = (side for place, side in found.items() if _calls(graph, place))
    calls = {around for side in of_calls for around in _outwards(side, found)}
    return {
        place: side
        for place, inner in found.items()
        if (side := _worth(inner, calls, found)) is not None
    }


def _calls(graph: Graph, place: int) -> bool:
    return graph.nodes[place].op.removeprefix("call ") in LIBRARY


def _of_operand(graph: Graph, user: int, place: int, around: Side | None) -> Side | None:
    """The side on which an operation needs an operand; `around` is that of the operation."""
    node = graph.nodes[user]
    if node.op == "select" and node.args.count(place) == 1 and node.args[0] != place:
        return user, node.args[1] == place
    return around


def _common(needing: Sequence[Side | None], found: dict[int, Side | None]) -> Side | None:
    """The innermost side that is around all of these."""
    ways = [_outwards(side, found) for side in needing]
    return next((side for side in ways[0] if all(side in way for way in ways)), None)


def _worth(side: Side | None, calls: set[Side], found: dict[int, Side | None]) -> Side | None:
    """The innermost side around this one, or itself, that calls the C library."""
    return next((around for around in _outwards(side, found) if around in calls), None)


def _outwards(side: Side | None, found: dict[int, Side | None]) -> list[Side]:
    """A side and those around it, the innermost first."""
    way = []
    while side is not None:
        way.append(side)
        side = found[side[0]]
    return way
