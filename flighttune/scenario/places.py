"""Keys of a scenario by dotted path: finding the places they mean, and setting values there."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeAlias

from pydantic import ValidationError

from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import mistakes, shown
from flighttune.scenario.tables import PlantTable

# Names of tables and positions in arrays from the top of a scenario to a value
Place: TypeAlias = tuple[str | int, ...]

# Characters of a key, which has a few names
MAX_KEY = 255

SEGMENT = r"[\w/+-]+(?:\[[^\[\]]+\])*"
PATH = re.compile(rf"{SEGMENT}(?:\.{SEGMENT})*")


def places_of(key: str, tables: Mapping[str, Any], value: Any) -> tuple[Place, ...]:
    """Every place of a scenario that a dotted key means.

    ``name[1]`` is a position in an array, from 0; ``plant`` without one is every plant that can
    have this `value` there, ``plant[LABEL]`` the plant of that label.
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
    """A copy of `tables` with values put in; tables off the way to a value are shared with it."""
    changed = dict(tables)
    for place, value in values:
        changed = _with_value(changed, place, value)
    return changed


def _with_value(table: Any, place: Place, value: Any) -> Any:
    step, *below = place
    changed: Any = list(table) if isinstance(table, list) else dict(table or {})
    if below:
        inside = changed[step] if isinstance(step, int) else changed.get(step)
        value = _with_value(inside, (*below,), value)
    changed[step] = value
    return changed


def with_changes(
    tables: Mapping[str, Any], changes: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """The tables of a scenario with values set by dotted keys; `source` is named in errors."""
    changed = dict(tables)
    for key, value in leaves(changes):
        try:
            places = places_of(key, changed, value)
        except InputError as error:
            stop = "" if str(error).endswith("?") else "."
            raise ScenarioError(f"{source} `{shown(key)}` {error}{stop}") from None
        changed = with_values(changed, [(place, value) for place in places])
    return changed


def leaves(tables: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables; a list is a value."""
    for name, value in tables.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _walked(steps: tuple[str, ...], tables: Mapping[str, Any]) -> Place:
    place: list[str | int] = []
    table: Any = tables
    for step in steps:
        name, where = step.strip("[]"), spelled(place)
        if isinstance(table, list):
            if not step.startswith("["):
                raise InputError(f"must say which of `{where}` is meant, by its position: [0], ...")
            labels = [_label(each) for each in table if where == "plant"]
            digits = name.isascii() and name.isdigit()
            position = labels.index(name) if name in labels else int(name) if digits else -1
            if not 0 <= position < len(table):
                label = f" or a label ({', '.join(filter(None, labels))})" if labels else ""
                raise InputError(
                    f"must be a position, 0 to {len(table) - 1},{label} of `{where}`, got {step}"
                )
            place.append(position)
            table = table[position]
        elif isinstance(table, Mapping) or table is None:
            place.append(name)
            table = table.get(name) if table else None
        else:
            raise InputError(f"must be a key of a table, but `{where}` is {table!r}")
    return tuple(place)


def _label(plant: Any) -> str:
    """The label of a plant's table; none as long as a value in it is wrong."""
    try:
        return PlantTable.model_validate(plant).label
    except ValidationError:
        return ""


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
