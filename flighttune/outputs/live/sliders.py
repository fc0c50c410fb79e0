"""Sliders of the page, by the keys of a scenario, and the scenario with their values."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from flighttune.base.errors import InputError
from flighttune.base.files.budget import LARGEST_INTEGER, LEAST_INTEGER
from flighttune.base.files.table import shown, toml_tables
from flighttune.base.signals import SYMBOLS
from flighttune.control.gains import COMMANDS, PIGains
from flighttune.flight.load import check_scenario, chosen_entry
from flighttune.flight.scenario.load import (
    places_of,
    scenario_from,
    value_at,
    with_changes,
    with_gains,
)
from flighttune.flight.scenario.schema import Scenario

ROWS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["slider"]

# Upper end of a gain's slider, relative to the gain, or to the largest of its matrix if it is 0.
GAIN_END = 3.0

# Headings of the gains from each error to its own command, and of the other gains.
GAINS, ACROSS = "Gains", "Gains across channels"

# Upper end of the slider of a feedback, which must stay below 1.
MAX_FEEDBACK = 0.95

# Tables that affect aircraft alone.
OF_AIRCRAFT = ("navigation", "plant", "seed", "turbulence", "wind")

# Values of sliders that have moved, by their keys.
Values: TypeAlias = Mapping[str, float | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Slider:
    """A slider, by the key of the scenario that it sets."""

    key: str
    group: str
    label: str
    value: float | str  # at the start
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    choices: Sequence[str] = ()  # the first leaves the table out
    together: str = ""  # those with the same name here move together if the page's box is ticked
    opposite: str = ""  # key of the other end of its range, which keeps its ratio to this one

    @property
    def table(self) -> str:
        """The table of its key."""
        return self.key.partition(".")[0]


def with_one_gain_set(source: Scenario, wanted: str | None) -> tuple[Scenario, PIGains | None]:
    """A scenario with one law, its gain set and the limits in numbers; None if no gains act."""
    entry = chosen_entry(source, wanted)
    scenario = with_gains(source, [wanted or entry.name], source.title)
    tables = scenario.as_dict()
    if scenario.aircraft and not tables.get("limits"):  # then those of the first aircraft are flown
        own = toml_tables(scenario.aircraft[0].config.file)["limits"]
        tables["limits"] = {key: x for key, x in own.items() if not key.startswith("n_x")}
    if not entry.law.by_gains:
        return scenario_from(tables), None
    gains = entry.found_gains
    (listed,) = tables["gains"]
    named = listed if isinstance(listed, dict) else {"name": listed}
    feedback = {"feedback": list(gains.feedback)} if gains.law == "exact" else {}
    tables["gains"] = [{**named, **gains.as_lists(), **feedback}]
    return scenario_from(tables), gains


def sliders_of(scenario: Scenario, gains: PIGains | None) -> list[Slider]:
    """The sliders of a scenario with one gain set, gains first."""
    return [*(gain_sliders(gains) if gains else ()), *_of_rows(scenario)]


def gain_sliders(gains: PIGains) -> list[Slider]:
    """A slider of every gain: from each error to its own command, feedback, then the others."""
    sliders = list[Slider]()
    for name in ("K_P", "K_I"):
        matrix = getattr(gains, name)
        for (i, j), value in np.ndenumerate(matrix):
            end = float(GAIN_END * (abs(value) or abs(matrix).max() or 1.0))
            error, command = (SYMBOLS.get(x, x) for x in (gains.errors[j], gains.inputs[i]))
            slider = Slider(
                key=f"gains[0].{name}[{i}][{j}]",
                group=GAINS if i == j else ACROSS,
                label=f"{name} of {error}" + (f" to {command}" if i != j else ""),
                value=float(value),
                low=0.0 if i == j and value >= 0.0 else -end,
                high=end,
                together=name if i == j else "",
            )
            sliders.append(slider)
    for i, value in enumerate(gains.feedback if gains.law == "exact" else ()):
        key, label = f"gains[0].feedback[{i}]", f"feedback of {SYMBOLS[COMMANDS[i]]}"
        sliders.append(Slider(key=key, group=GAINS, label=label, value=value, high=MAX_FEEDBACK))
    return sorted(sliders, key=lambda x: x.group == ACROSS)


def _of_rows(scenario: Scenario) -> Iterator[Slider]:
    """Sliders of those `ROWS` that have a value in the scenario, or a default where it has none."""
    tables = scenario.as_dict()
    for given in ROWS:
        row = dict(given)
        absent, relative = row.pop("absent", None), row.pop("relative", False)
        top = row["key"].partition(".")[0]
        if top in OF_AIRCRAFT and not scenario.aircraft:
            continue
        value = value_at(tables, places_of(row["key"], tables, absent)[0])
        if value is None and (top == "plant" or top not in tables):
            value = absent
        if value is None or isinstance(value, list | dict):
            continue
        if "choices" not in row:
            scale = value if relative else 1.0
            row |= {"low": min(scale * row["low"], value), "high": max(scale * row["high"], value)}
        yield Slider(value=value, **row)


def moved(scenario: Scenario, sliders: Sequence[Slider], values: Values) -> Scenario:
    """The scenario with values of sliders; the given one if none has moved."""
    known = {x.key: x for x in sliders}
    if unknown := values.keys() - known.keys():
        raise InputError(f"`{shown(min(unknown))}` must be a slider of the page.")
    for key, value in values.items():
        if isinstance(value, int) and not LEAST_INTEGER <= value <= LARGEST_INTEGER:
            raise InputError(f"`{shown(key)}` must be a number of at most 64 bits.")
    changes = {key: value for key, value in values.items() if value != known[key].value}
    if not changes:
        return scenario
    tables = scenario.as_dict()
    new = {known[key].table for key in changes} - tables.keys()
    changes = {x.key: x.value for x in sliders if x.table in new} | changes
    for slider in sliders:
        if changes.get(slider.key) in slider.choices[:1]:
            del tables[slider.table], changes[slider.key]
        value = changes.get(slider.key)
        if slider.opposite and isinstance(value, float | int):
            end = value_at(tables, places_of(slider.opposite, tables, value)[0])
            changes[slider.opposite] = value * (end / slider.value)
    changed = scenario_from(with_changes(tables, changes, scenario.title))
    check_scenario(changed, scenario.title)
    return changed
