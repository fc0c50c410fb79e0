"""Sliders of the page, by the keys of a scenario, and the scenario with their values."""

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.errors import InputError
from flighttune.base.files.table import shown
from flighttune.base.signals import SYMBOLS
from flighttune.base.units import DEG
from flighttune.control.gains import COMMANDS, PIGains
from flighttune.flight.conditions import command_limits
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

# Largest value that a page may send.
MAX_NUMBER = 1e6

# Tables that affect aircraft alone.
OF_AIRCRAFT = ("navigation", "plant", "seed", "turbulence", "wind")


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
    choices: Sequence[str] = ()
    form: str = ""  # of a range: "both" ends, or the "upper" end alone
    together: str = ""  # gains with the same name here move together if the page's box is ticked

    @property
    def table(self) -> str:
        """The table of its key."""
        return self.key.partition(".")[0]

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers."""
        return isinstance(self.value, int)

    def checked(self, value: object) -> float | str:
        """A value that a page sent; an InputError if it cannot be used."""
        if self.choices and value in self.choices:
            return str(value)
        number = math.nan
        if isinstance(value, int | float) and not (isinstance(value, bool) or self.choices):
            number = float(value)
        if abs(number) <= MAX_NUMBER:
            return round(number) if self.whole else number
        wanted = f"one of {', '.join(self.choices)}" if self.choices else "a number"
        raise InputError(f"`{self.key}` must be {wanted}, got {shown(str(value))}.")


def with_one_gain_set(source: Scenario, wanted: str | None) -> tuple[Scenario, PIGains | None]:
    """A scenario with one law, its gain set and the limits in numbers; None if no gains act."""
    entry = chosen_entry(source, wanted)
    scenario = with_gains(source, [wanted or entry.name], source.title)
    tables = scenario.as_dict()
    if scenario.aircraft and not tables.get("limits"):  # then those of the first aircraft are flown
        tables["limits"] = _limits_of(scenario)
    if not entry.law.by_gains:
        return scenario_from(tables), None
    gains = entry.found_gains
    (listed,) = tables["gains"]
    named = listed if isinstance(listed, dict) else {"name": listed}
    feedback = {"feedback": list(gains.feedback)} if gains.law == "exact" else {}
    tables["gains"] = [{**named, **gains.as_lists(), **feedback}]
    return scenario_from(tables), gains


def _limits_of(scenario: Scenario) -> dict[str, Any]:
    """Limits of roll and load factor, as [limits] states them."""
    limits = command_limits(scenario)
    phi, n_z = np.column_stack([limits.lower, limits.upper])[:2]
    phi_rate, n_z_rate = limits.rate_upper[:2].tolist()
    in_deg = [float(f"{x / DEG:.12g}") for x in (*phi, phi_rate)]  # without the rounding of DEG
    return {
        "phi_deg": in_deg[:2],
        "phi_rate_dps": in_deg[2],
        "n_z": n_z.tolist(),
        "n_z_rate_per_s": n_z_rate,
    }


def sliders_of(scenario: Scenario, gains: PIGains | None) -> list[Slider]:
    """The sliders of a scenario with one gain set, gains first."""
    of_gains = [] if gains is None else sorted(_of_gains(gains), key=lambda x: x.group != GAINS)
    return [*of_gains, *_of_rows(scenario)]


def gain_values(gains: PIGains) -> dict[str, float]:
    """Every gain by the key of its slider."""
    matrices = {"K_P": gains.K_P, "K_I": gains.K_I}
    values = {
        f"gains[0].{name}[{i}][{j}]": x
        for name, matrix in matrices.items()
        for i, row in enumerate(matrix.tolist())
        for j, x in enumerate(row)
    }
    fed = {f"gains[0].feedback[{i}]": x for i, x in enumerate(gains.feedback)}
    return values | (fed if gains.law == "exact" else {})


def _of_gains(gains: PIGains) -> Iterator[Slider]:
    for key, value in gain_values(gains).items():
        _, name, *place = re.findall(r"\d+|K_P|K_I|feedback", key)
        i, j = int(place[0]), int(place[-1])
        if name == "feedback":
            label = f"feedback of {SYMBOLS[COMMANDS[i]]}"
            yield Slider(key=key, group=GAINS, label=label, value=value, high=MAX_FEEDBACK)
            continue
        own, error, put = i == j, gains.errors[j], gains.inputs[i]
        end = GAIN_END * (abs(value) or float(abs(getattr(gains, name)).max()) or 1.0)
        words = "" if own else f" to {SYMBOLS.get(put, put)}"
        yield Slider(
            key=key,
            group=GAINS if own else ACROSS,
            label=f"{name} of {SYMBOLS.get(error, error)}{words}",
            value=value,
            low=0.0 if own and value >= 0.0 else -end,
            high=end,
            together=name if own else "",
        )


def _of_rows(scenario: Scenario) -> Iterator[Slider]:
    """Sliders of those `ROWS` that have a value in the scenario, or a default where it has none."""
    tables = scenario.as_dict()
    for given in ROWS:
        row = dict(given)
        absent, relative = row.pop("absent", None), row.pop("relative", False)
        top = row["key"].partition(".")[0]
        if top not in type(scenario).model_fields or (top in OF_AIRCRAFT and not scenario.aircraft):
            continue
        value = value_at(tables, places_of(row["key"], tables, absent)[0])
        if value is None and (top == "plant" or top not in tables):
            value = absent
        if isinstance(value, list) and row.get("form"):
            value = value[-1]
        if value is None or isinstance(value, list | dict):
            continue
        if not row.get("choices"):
            scale = value if relative else 1.0
            row |= {"low": min(scale * row["low"], value), "high": max(scale * row["high"], value)}
        yield Slider(value=value, **row)


def moved(scenario: Scenario, sliders: Sequence[Slider], values: Mapping[str, Any]) -> Scenario:
    """The scenario with the values of the sliders; the given one if none has moved."""
    now = checked(sliders, values)
    differ = {x.table for x in sliders if now[x.key] != x.value}
    tables, changes = scenario.as_dict(), dict[str, Any]()
    for slider in sliders:
        value, top = now[slider.key], slider.table
        if value == slider.value and not (top in differ and top not in tables):
            continue  # of a table that the scenario lacks, all keys are set
        if slider.choices and value == slider.choices[0]:
            tables = {key: table for key, table in tables.items() if key != top}
        elif slider.form:
            below = value_at(tables, slider.key.split("."))[0]
            changes[slider.key] = [-float(value) if slider.form == "both" else below, value]
        else:
            changes[slider.key] = value
    if not differ:
        return scenario
    changed = scenario_from(with_changes(tables, changes, scenario.title))
    check_scenario(changed, scenario.title)
    return changed


def checked(sliders: Sequence[Slider], values: Mapping[str, Any]) -> dict[str, float | str]:
    """Values of all sliders; a slider that the page did not send keeps its start."""
    if unknown := values.keys() - {slider.key for slider in sliders}:
        raise InputError(f"`{shown(min(unknown))}` must be a slider of the page.")
    return {x.key: x.checked(values.get(x.key, x.value)) for x in sliders}
