"""Where the aircraft, scenarios and campaigns that come with flighttune lie."""

from pathlib import Path

from flighttune.errors import InputError

_PACKAGE = Path(__file__).resolve().parent


def aircraft_names() -> tuple[str, ...]:
    """Return the names of the shipped aircraft, sorted."""
    return tuple(sorted(path.parent.name for path in _room("aircraft").glob("*/aircraft.toml")))


def scenario_names() -> tuple[str, ...]:
    """Return the names of the shipped scenarios (without ``.toml``), sorted."""
    return tuple(sorted(path.stem for path in _room("scenarios").glob("*.toml")))


def campaign_names() -> tuple[str, ...]:
    """Return the names of the shipped campaigns (without ``.toml``), sorted."""
    return tuple(sorted(path.stem for path in _room("scenarios").glob("campaigns/*.toml")))


def aircraft_folder(name: str) -> Path:
    """Return the folder of the shipped aircraft `name`.

    Raises
    ------
    InputError
        If no aircraft of that name is shipped.
    """
    folder = _room("aircraft") / name
    if Path(name).name != name or not (folder / "aircraft.toml").is_file():
        _known("aircraft", name, aircraft_names(), folder)
    return folder


def scenario_file(name: str) -> Path:
    """Return the file of the shipped scenario `name`, written with or without ``.toml``.

    Raises
    ------
    InputError
        If no scenario of that name is shipped.
    """
    stem = name.removesuffix(".toml")
    return _known("scenario", stem, scenario_names(), _room("scenarios")) / f"{stem}.toml"


def campaign_file(name: str) -> Path:
    """Return the file of the shipped campaign `name`, written with or without ``.toml``.

    Raises
    ------
    InputError
        If no campaign of that name is shipped.
    """
    stem = name.removesuffix(".toml")
    folder = _room("scenarios") / "campaigns"
    return _known("campaign", stem, campaign_names(), folder) / f"{stem}.toml"


def _known(kind: str, name: str, names: tuple[str, ...], folder: Path) -> Path:
    if name not in names:
        raise InputError(f"`{kind}` must be one of {', '.join(names)}, got {name!r}.")
    return folder


def _room(name: str) -> Path:
    """Return the folder `name` of an installed package, or of the checkout it runs from."""
    installed = _PACKAGE / "_shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
