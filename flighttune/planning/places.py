"""Dispersed keys of a scenario: the places they mean, and drawn values set there."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from flighttune.errors import InputError, ScenarioError
from flighttune.planning.schema import Dispersion
from flighttune.scenario.load import Place, places_of, value_at, with_values
from flighttune.scenario.schema import Scenario

# Tables and keys of a scenario that are the same for all draws; each draw has its own seed
NOT_DISPERSED = (
    *("plant.kind", "plant.aircraft", "plant.name", "gains", "tuning", "envelope", "expect"),
    *("seed", "title", "verifies", "source"),
)

# Hint for a key that cannot be dispersed
INSTEAD = {"plant": "give each plant in a [[plant]]", "gains": "give each gain set in `gains`"}


def dispersed_places(
    disperse: Sequence[Dispersion], scenario: Scenario, source: str
) -> dict[str, tuple[Place, ...]]:
    """Every place that each dispersed key means, in the undispersed scenario."""
    values = scenario.as_dict()
    places_by_key: dict[str, tuple[Place, ...]] = {}
    for table in disperse:
        where = f"{source}: [[disperse]] `{table.key}`"
        named = re.sub(r"\[[^\]]*\]", "", table.key)
        top = named.split(".")[0]
        if {named, top} & {*NOT_DISPERSED}:
            why = INSTEAD.get(top, "it is the same for all draws")
            raise ScenarioError(f"{where} must not be dispersed: {why}.")
        # a value by which to see which plants have the key
        tried = {"sets": table.central, "adds": 0.0, "multiplies": 1.0}[table.acts]
        try:
            places = places_of(table.key, values, tried)
        except InputError as error:
            stop = "" if str(error).endswith("?") else "."
            raise ScenarioError(f"{where} {error}{stop}") from None
        for other, theirs in places_by_key.items():
            if any(a[: len(b)] == b[: len(a)] for a in places for b in theirs):
                raise ScenarioError(f"{where} must be dispersed once, but `{other}` means it too.")
        for place in places if table.acts != "sets" else ():
            value = value_at(values, place)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ScenarioError(
                    f"{where} must be a number in the scenario for `acts` {table.acts!r}, "
                    f"got {'nothing' if value is None else repr(value)}."
                )
        places_by_key[table.key] = places
    return places_by_key


def with_drawn(
    tables: Mapping[str, Any],
    disperse: Sequence[Dispersion],
    places: Mapping[str, tuple[Place, ...]],
    drawn: Mapping[str, Any],
) -> dict[str, Any]:
    """The tables of a scenario with the drawn values of each key set, added or multiplied by."""
    values: list[tuple[Place, Any]] = []
    for table in disperse:
        for place in places[table.key]:
            value = drawn[table.key]
            if table.acts == "adds":
                value = value_at(tables, place) + value
            elif table.acts == "multiplies":
                value = value_at(tables, place) * value
            values.append((place, value))
    return with_values(tables, values)
