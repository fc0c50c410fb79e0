"""Dispersed keys of a scenario, by dotted path: finding them, and setting drawn values."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from pydantic import ValidationError

from flighttune.campaign.planning.schema import MAX_KEY, Dispersion
from flighttune.errors import InputError, ScenarioError
from flighttune.mistakes import mistakes
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable

# Names of tables and positions in arrays from the top of a scenario to a value
Place: TypeAlias = tuple[str | int, ...]

# Tables and keys of a scenario that are the same for all draws; each draw has its own seed
NOT_DISPERSED = (
    *("plant.kind", "plant.aircraft", "plant.name", "gains", "tuning", "envelope", "expect"),
    *("seed", "title", "verifies", "source"),
)

# Hint for a key that cannot be dispersed
INSTEAD = {"plant": "give each plant in a [[plant]]", "gains": "give each gain set in `gains`"}

SEGMENT = r"[\w/+-]+(?:\[[^\[\]]+\])*"
PATH = re.compile(rf"{SEGMENT}(?:\.{SEGMENT})*")


def places_of(key: str, tables: Mapping[str, Any], value: Any) -> tuple[Place, ...]:
    """Every place of a scenario that a dotted key means.

    ``name[1]`` is a position in an array, counted from 0; ``plant`` without a position is every
    plant that has the key, ``plant[LABEL]`` the plant of that label. `value` is a value that the
    key can have: it tells which kinds of plant have the key.
    """
    if len(key) > MAX_KEY or not PATH.fullmatch(key):
        raise InputError(
            "must be names joined by dots, each with [position] or [name] after it, and have at "
            f"most {MAX_KEY} characters"
        )
    # a position in brackets is a step of its own, `[0]`
    steps = tuple(re.findall(r"\[[^\[\]]+\]|[^.\[\]]+", key))
    if steps[0] == "plant" and not (steps[1:] and steps[1].startswith("[")):
        return _of_plants(steps[1:], tables["plant"], value)
    return (_walked(steps, tables),)


def value_at(tables: Mapping[str, Any], place: Place) -> Any:
    """The value at a place; None if the place is empty."""
    value: Any = tables
    for step in place:
        if isinstance(value, Mapping):
            value = value.get(step)
        else:
            value = value[step] if isinstance(value, list) and isinstance(step, int) else None
    return value


def with_values(tables: Mapping[str, Any], values: Iterable[tuple[Place, Any]]) -> dict[str, Any]:
    """A copy of `tables` with values put in; tables off the way to a value are shared with it.

    Tables on the way that are missing are made.
    """
    changed = dict(tables)
    for place, value in values:
        changed = _with_value(changed, place, value)
    return changed


def _with_value(table: Any, place: Place, value: Any) -> Any:
    step, *below = place
    changed: Any = list(table) if isinstance(table, list) else dict(table or {})
    if below:
        own = changed[step] if isinstance(step, int) else changed.get(step)
        value = _with_value(own, (*below,), value)
    changed[step] = value
    return changed


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
            own = value_at(values, place)
            if isinstance(own, bool) or not isinstance(own, (int, float)):
                raise ScenarioError(
                    f"{where} must be a number in the scenario for `acts` {table.acts!r}, "
                    f"got {'nothing' if own is None else repr(own)}."
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


def _walked(steps: tuple[str, ...], tables: Mapping[str, Any]) -> Place:
    place: list[str | int] = []
    at: Any = tables
    for step in steps:
        name, where = step.strip("[]"), spelled(place)
        if isinstance(at, list):
            if not step.startswith("["):
                raise InputError(f"must say which of `{where}` is meant, by its position: [0], ...")
            labels = [PlantTable.model_validate(each).label for each in at if where == "plant"]
            position = labels.index(name) if name in labels else int(name) if name.isdigit() else -1
            if not 0 <= position < len(at):
                label = f" or a label ({', '.join(labels)})" if labels else ""
                raise InputError(
                    f"must be a position, 0 to {len(at) - 1},{label} of `{where}`, got {step}"
                )
            place.append(position)
            at = at[position]
        elif isinstance(at, Mapping) or at is None:
            place.append(name)
            at = at.get(name) if at else None
        else:
            raise InputError(f"must be a key of a table, but `{where}` is {at!r}")
    return tuple(place)


def _of_plants(
    steps: tuple[str, ...], plants: list[dict[str, Any]], value: Any
) -> tuple[Place, ...]:
    if not steps:
        raise InputError("must be a key of a plant, got the plants themselves")
    flyable: list[Place] = []
    refusals: list[str] = []
    for i, table in enumerate(plants):
        place = _walked(steps, table)
        changed = with_values(table, [(place, value)])
        try:
            PlantTable.model_validate(changed)
        except ValidationError as error:
            refusals.append(mistakes(error, changed, PlantTable))
        else:
            flyable.append(("plant", i, *place))
    if not flyable:
        raise InputError(f"must be a key of a plant that flies: {refusals[-1].removesuffix('.')}")
    return tuple(flyable)


def spelled(place: Iterable[str | int]) -> str:
    """A place as a dotted path, ``plant[0].airframe.mass_factor``."""
    words = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return "".join(words).removeprefix(".")
