"""The items that can be made again: to add one, describe it in ``items.toml`` and list it here."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

from flighttune.errors import InputError
from flighttune.paper import parameters as printed
from flighttune.paper.items import gains, histories, oscillator, trends
from flighttune.paper.items.base import Assumption, Item
from flighttune.shipped import nearest_name

# Maker of each item, in the order of the paper.
MAKERS = {
    "fig3": oscillator.fig3,
    "gains": gains.gains,
    "fig6": gains.fig6,
    "fig5": histories.fig5,
    "fig12": histories.fig12,
    "table2": gains.table2,
    "fig8": histories.fig8,
    "fig7": trends.fig7,
    "fig13": trends.fig13,
    "fig9": trends.fig9,
    "fig11": histories.fig11,
    "fig10": trends.fig10,
}


def _described() -> dict[str, Item]:
    """Each maker with its text from ``items.toml``."""
    text = tomllib.loads(Path(__file__).with_name("items.toml").read_text(encoding="utf-8"))
    assumptions = {
        name: Assumption(**{key: words.format(**vars(printed)) for key, words in entry.items()})
        for name, entry in text["assumption"].items()
    }
    items = {}
    for name, make in MAKERS.items():
        entry = text["item"][name]
        entry["parameters"] = [text["parameter"][key] for key in entry["parameters"]]
        entry["assumed"] = [assumptions[key] for key in entry["assumed"]]
        items[name] = Item(name=name, make=make, **entry)
    return items


# By name, in the order of the paper.
ITEMS = _described()


def chosen(names: Sequence[str]) -> tuple[Item, ...]:
    """Items by name in the order of the paper; all for no names."""
    for name in names:
        if name not in ITEMS:
            names_of_items = ", ".join(ITEMS)
            raise InputError(
                f"`ITEM` must be one of {names_of_items}, got {name}{nearest_name(name, ITEMS)}"
            )
    return tuple(item for item in ITEMS.values() if not names or item.name in names)
