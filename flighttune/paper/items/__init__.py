"""The items that can be made again: to add one, add a file and list it here."""

from flighttune.errors import InputError
from flighttune.paper.items import (
    fig3,
    fig5,
    fig6,
    fig7,
    fig8,
    fig9,
    fig10,
    fig11,
    fig12,
    fig13,
    gains,
    table2,
)
from flighttune.paper.items.base import Item

ITEMS: dict[str, Item] = {
    module.ITEM.name: module.ITEM
    for module in (
        fig3,
        gains,
        fig6,
        fig5,
        fig12,
        table2,
        fig8,
        fig7,
        fig13,
        fig9,
        fig11,
        fig10,
    )
}
"""By name, in the order of the paper."""


def chosen(names: tuple[str, ...]) -> tuple[Item, ...]:
    """Items by name in the order of the paper; all for no names.

    Raises
    ------
    InputError
        If there is no item of a name.
    """
    for name in names:
        if name not in ITEMS:
            raise InputError(f"`ITEM` must be one of {', '.join(ITEMS)}, got {name}.")
    return tuple(item for item in ITEMS.values() if not names or item.name in names)
