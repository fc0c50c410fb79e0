"""Folders of aircraft, and the scenarios and campaigns that come with flighttune."""

import os
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from flighttune.base.errors import InputError
from flighttune.base.files.whole import check_whole

_PACKAGE = Path(__file__).resolve().parents[2]

# JSON schemas of scenarios, campaigns, aircraft and rates, which editors of TOML read.
SCHEMAS = _PACKAGE / "base" / "schemas"

# Environment variable with the folder of the user's aircraft.
OWN_AIRCRAFT = "FLIGHTTUNE_AIRCRAFT"

# Set in the environment of a process that may crash on the files of an aircraft.
TRUST_AIRCRAFT = "FLIGHTTUNE_TRUST_AIRCRAFT"


def aircraft_names() -> tuple[str, ...]:
    """Return the names of the shipped aircraft, sorted."""
    folder = _shipped_folder("aircraft")
    return tuple(sorted(path.parent.name for path in folder.glob("*/aircraft.toml")))


def aircraft_places() -> tuple[Path, ...]:
    """Folders in which an aircraft is looked for by its name, in this order."""
    # Not `Path.home`, which fails for users without a home, as containers have them.
    data = os.environ.get("XDG_DATA_HOME") or os.path.expanduser("~/.local/share")
    personal = os.environ.get(OWN_AIRCRAFT) or Path(data) / "flighttune" / "aircraft"
    return Path("aircraft"), Path(personal), _shipped_folder("aircraft")


def aircraft_folders() -> dict[str, Path]:
    """Return the folders of the aircraft by name, sorted; of two with one name the first counts."""
    folders = {}
    for place in aircraft_places():
        for file in place.glob("*/aircraft.toml"):
            folders.setdefault(file.parent.name, file.parent)
    return dict(sorted(folders.items()))


def listed_files() -> dict[str, Path]:
    """Return the files of the shipped scenarios that are listed, by name (without ``.toml``)."""
    return _files_of("")


def scenario_files() -> dict[str, Path]:
    """Return the files of all shipped scenarios by name: listed scenarios first, then studies."""
    return listed_files() | _files_of("studies")


def campaign_files() -> dict[str, Path]:
    """Return the files of the shipped campaigns by name (without ``.toml``), sorted."""
    return _files_of("campaigns")


def _files_of(folder: str) -> dict[str, Path]:
    files = sorted((_shipped_folder("scenarios") / folder).glob("*.toml"))
    return {file.stem: file for file in files}


def is_trusted(folder: Path) -> bool:
    """Whether JSBSim may load an aircraft's folder in this process: a shipped one, or any."""
    return TRUST_AIRCRAFT in os.environ or is_shipped(folder)


def is_shipped(folder: Path) -> bool:
    """Whether a folder belongs to an aircraft that comes with flighttune."""
    return folder.resolve().parent == _shipped_folder("aircraft").resolve()


def aircraft_folder(name: str) -> Path:
    """Return the folder of the aircraft `name`, found in one of `aircraft_places`."""
    if Path(name).name == name:
        for place in aircraft_places():
            check_whole(place / name)
            if os.path.isfile(place / name / "aircraft.toml"):  # False where access is denied
                return (place / name).resolve()
    from flighttune.base.files.load import ENDINGS, LOG  # pydantic, which `--help` does without

    names = list(aircraft_folders())
    model = next((model for model in models_of_jsbsim() if model.lower() == name.lower()), "")
    made = f"; `flighttune adopt {model}` makes it." if model else nearest_name(name, names)
    if ENDINGS.get(Path(name).suffix.lower()) == LOG:
        made = f": `flighttune identify {name} --out mine.json` makes a model of a log."
    here = os.path.isfile(Path(name) / "aircraft.toml")  # a name is not looked for here
    raise InputError(
        f"`aircraft` must be one of {', '.join(names)}, a folder in ./aircraft, or the path of a "
        f"folder with an aircraft.toml, got {name!r}"
        + (f"; the folder of this name is ./{name}." if here else made)
    )


def models_of_jsbsim() -> list[str]:
    """Names of the models in JSBSim's own set."""
    place = find_spec("jsbsim")  # its import is slow
    assert place is not None  # it is always installed
    files = Path(place.origin or "").parent.glob("aircraft/*/*.xml")
    return sorted((file.stem for file in files if file.stem == file.parent.name), key=str.lower)


def nearest_name(name: str, names: Iterable[str]) -> str:
    """The end of a message: ``; did you mean X?``, or a full stop where no name is like it."""
    from difflib import get_close_matches

    close = get_close_matches(name, list(names), n=1)
    return f"; did you mean {close[0]}?" if close else "."


@cache
def _shipped_folder(name: str) -> Path:
    """Return the folder `name` of an installed package, or of the checkout it runs from."""
    installed = _PACKAGE / "_shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
