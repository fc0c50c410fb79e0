"""Labels of plants in tables, plots and files, and the aircraft behind a label."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def plant_label(kind: str, aircraft: str | None = None, name: str | None = None) -> str:
    """Label of a plant: ``kind``, ``kind:aircraft``, and ``:name`` behind it where it has one.

    A plant of the user's is called by its name alone.

    `kind` is that in the scenario; `name` distinguishes the plant from another one of the same kind
    and aircraft.
    """
    if kind == "python" and name:
        return name
    return ":".join(part for part in (kind, Path(aircraft).name if aircraft else "", name) if part)


def goes_by(label: str, plant: str | None) -> bool:
    """Whether ``plant`` of a ``[[expect]]`` (a label, a kind, or None for all) is about a label."""
    return plant in (None, label, label.partition(":")[0])


def aircraft_of(label: str, tables: Sequence[Mapping[str, Any]]) -> str | None:
    """The aircraft of a label; None for a plant that is none.

    `label` is one of `plant_label`; `tables` are the ``[[plant]]`` tables of the scenario flown, as
    plain values.
    """
    for table in tables:
        if label_of(table) == label:
            return table.get("aircraft")
    kind, _, aircraft = label.partition(":")
    return aircraft or None if kind == "jsbsim" else None


def label_of(table: Mapping[str, Any]) -> str:
    """Label of a ``[[plant]]`` table given as plain values."""
    return plant_label(table.get("kind", ""), table.get("aircraft"), table.get("name"))
