"""Where the aircraft, scenarios and campaigns that come with flighttune lie."""

import os
from collections.abc import Iterable
from pathlib import Path

from flighttune.errors import InputError

_PACKAGE = Path(__file__).resolve().parent

TRUST_AIRCRAFT = "FLIGHTTUNE_TRUST_AIRCRAFT"
"""Set in the environment of a process that may be ended by an aircraft's files."""


def aircraft_names() -> tuple[str, ...]:
    """Return the names of the shipped aircraft, sorted."""
    folder = _shipped_folder("aircraft")
    return tuple(sorted(path.parent.name for path in folder.glob("*/aircraft.toml")))


def scenario_files() -> dict[str, Path]:
    """Return the files of the shipped scenarios by name (without ``.toml``), sorted."""
    return {path.stem: path for path in sorted(_shipped_folder("scenarios").glob("*.toml"))}


def campaign_files() -> dict[str, Path]:
    """Return the files of the shipped campaigns by name (without ``.toml``), sorted."""
    folder = _shipped_folder("scenarios") / "campaigns"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def is_trusted(folder: Path) -> bool:
    """Whether JSBSim may load an aircraft's folder in this process: a shipped one, or any."""
    ours = _shipped_folder("aircraft").resolve()
    return TRUST_AIRCRAFT in os.environ or folder.resolve().parent == ours


def aircraft_folder(name: str) -> Path:
    """Return the folder of the shipped aircraft `name`.

    Raises
    ------
    InputError
        If no aircraft of that name is shipped.
    """
    if name not in aircraft_names():
        raise InputError(
            f"`aircraft` must be one of {', '.join(aircraft_names())}, got {name!r}"
            f"{nearest_name(name, aircraft_names())}"
        )
    return _shipped_folder("aircraft") / name


def nearest_name(name: str, names: Iterable[str]) -> str:
    """The end of a message: ``; did you mean X?``, or a full stop where no name is like it."""
    from difflib import get_close_matches

    found = get_close_matches(name, list(names), n=1)
    return f"; did you mean {found[0]}?" if found else "."


def _shipped_folder(name: str) -> Path:
    """Return the folder `name` of an installed package, or of the checkout it runs from."""
    installed = _PACKAGE / "_shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
