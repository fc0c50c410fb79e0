"""Where the aircraft and scenarios that come with flighttune lie."""

from pathlib import Path

from flighttune.errors import InputError

_PACKAGE = Path(__file__).resolve().parent


def aircraft_names() -> tuple[str, ...]:
    """Return the names of the shipped aircraft, sorted."""
    return tuple(sorted(path.parent.name for path in _room("aircraft").glob("*/aircraft.toml")))


def scenario_names() -> tuple[str, ...]:
    """Return the names of the shipped scenarios (without ``.toml``), sorted."""
    return tuple(sorted(path.stem for path in _room("scenarios").glob("*.toml")))


def aircraft_folder(name: str) -> Path:
    """Return the folder of the shipped aircraft `name`.

    Raises
    ------
    InputError
        If no aircraft of that name is shipped.
    """
    return _find("aircraft", name, aircraft_names()) / name


def scenario_file(name: str) -> Path:
    """Return the file of the shipped scenario `name`, written with or without ``.toml``.

    Raises
    ------
    InputError
        If no scenario of that name is shipped.
    """
    stem = name.removesuffix(".toml")
    return _find("scenarios", stem, scenario_names()) / f"{stem}.toml"


def _find(room: str, name: str, names: tuple[str, ...]) -> Path:
    if name not in names:
        kind = room.removesuffix("s")
        raise InputError(f"`{kind}` must be one of {', '.join(names)}, got {name!r}.")
    return _room(room)


def _room(name: str) -> Path:
    """Return the folder `name` of an installed package, or of the checkout it runs from."""
    installed = _PACKAGE / "_shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
