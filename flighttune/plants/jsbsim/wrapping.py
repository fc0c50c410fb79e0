"""What JSBSim loads of an aircraft: its own files, or a file made from them in a private folder.

That is so for aircraft of JSBSim's own set, flown as they are shipped with systems of ours put
around them, and for aircraft off the nominal. No file that is shipped is ever written to.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from xml.etree.ElementTree import Element

from flighttune.errors import PlantError
from flighttune.plants.jsbsim.aircraft import AircraftConfig
from flighttune.plants.jsbsim.mass_balance import MassBalance, open_mass_balance, weigh
from flighttune.plants.jsbsim.model_text import FileCache, ModelText, Sources, stamp
from flighttune.plants.jsbsim.off_nominal import OffNominal
from flighttune.plants.jsbsim.scaling import (
    AXES,
    COEFFICIENT,
    scale_axis,
    scale_coefficient,
    scale_thrust,
    slow_actuators,
)

CONNECTIONS = ("output", "input")
"""Elements by which JSBSim opens files and sockets on its first evaluation."""

_NOMINAL = OffNominal()


@dataclass(frozen=True, slots=True)
class ModelFolders:
    """Where JSBSim finds an aircraft's main file, its engines and its systems."""

    model: Path
    engines: Path
    systems: Path


@dataclass(frozen=True, eq=False)
class _Model:
    """What flights of an aircraft with the same things off the nominal have in common."""

    text: ModelText
    balance: MassBalance | None


_MODELS: FileCache[_Model] = FileCache()
_UNCONNECTED: FileCache[bool] = FileCache()


@contextmanager
def model_folders(config: AircraftConfig) -> Iterator[ModelFolders]:
    """Give the folders of an aircraft, for as long as JSBSim loads it.

    A wrapped aircraft's main file is read from the installed jsbsim and written to a private folder
    without its connections to files and sockets, with the systems of its ``aircraft.toml`` in front
    of its flight control. So is the main file of an aircraft off the nominal, with the factors in
    it. The files read stay as they are.

    Raises
    ------
    PlantError
        If JSBSim ships no such aircraft or a system is missing; if an aircraft of ours has
        connections; or if there is no room for the private folder.
    InputError
        If the aircraft cannot be off the nominal that way.
    """
    folders = _folders(config)
    text = main_file_text(config)
    if text is None:
        yield folders
        return
    with _private_folder(f"{config.model}.xml", text) as folder:
        yield ModelFolders(folder, folders.engines, folders.systems)


@contextmanager
def _private_folder(name: str, text: str) -> Iterator[Path]:
    """A folder that holds one file; in memory where it can, so that no flight waits for a disk."""
    place = None if "TMPDIR" in os.environ else _memory()
    folder: TemporaryDirectory[str] | None = None
    try:
        folder = TemporaryDirectory(prefix="flighttune-", dir=place, ignore_cleanup_errors=True)
        (Path(folder.name) / name).write_text(text, encoding="utf-8")
    except OSError as error:
        if folder is not None:
            folder.cleanup()
        where = place or gettempdir()
        raise PlantError(
            f"{where}: must take a folder for {name}, got {error.strerror}."
        ) from error
    with folder:
        yield Path(folder.name)


def main_file_text(config: AircraftConfig) -> str | None:
    """Return the main file that JSBSim shall load, None where that is the one in the folder.

    Raises
    ------
    PlantError, InputError
        As `model_folders`.
    """
    off = config.off_nominal or _NOMINAL
    if config.wrapping is None and off.is_nominal:
        _refuse_connections(config.folder / f"{config.model}.xml")
        return None
    scaled, coefficients = off.scaled, off.scaled_coefficients
    systems = config.wrapping and config.wrapping.systems
    key = (config.file, config.model, systems, off.loaded, tuple(scaled), tuple(coefficients))
    return _filled(_MODELS.find(key) or _made(key, config, off), off)


@lru_cache(maxsize=8)
def _filled(model: _Model, off: OffNominal) -> str:
    """The main file of one aircraft: asked for when it is checked, and again when it is flown."""
    factors = {f"{COEFFICIENT}{name}": factor for name, factor in off.scaled_coefficients.items()}
    values = factors | off.scaled | {"actuator_rate": 1.0 / off.actuator_lag}
    if model.balance is not None:
        values |= model.balance.values(off)
    return model.text.filled(values)


@cache
def _memory() -> Path | None:
    """A folder in memory, ten times as fast as one on disk; None where there is none."""
    folder = Path("/dev/shm")
    return folder if folder.is_dir() and os.access(folder, os.W_OK | os.X_OK) else None


def _folders(config: AircraftConfig) -> ModelFolders:
    if config.wrapping is None:
        folder = config.folder
        return ModelFolders(folder, folder / "Engines", folder / "Systems")
    import jsbsim

    shipped = Path(jsbsim.get_default_root_dir())
    model = shipped / "aircraft" / config.model
    return ModelFolders(model, shipped / "engine", shipped / "systems")


def _made(key: tuple[object, ...], config: AircraftConfig, off: OffNominal) -> _Model:
    """Read the files of an aircraft and put placeholders where `off` has something other than 1."""
    sources, folders = Sources(), _folders(config)
    file = folders.model / f"{config.model}.xml"
    where = "be a file of JSBSim's" if config.wrapping is None else "be shipped with jsbsim"
    root = sources.root(file, f"{config.file}: `model` must {where}")
    if config.wrapping is None:
        _refuse_connections(file)
    else:
        _wrap(root, config, file)
    balance = None
    if off.loaded:
        balance = weigh(root, config.with_off_nominal(None))
        open_mass_balance(root)
    for name in off.scaled_coefficients:
        scale_coefficient(root, name, file)
    for name in off.scaled:
        if name in AXES:
            scale_axis(root, name, file)
        elif name == "thrust":
            scale_thrust(root, folders.engines, sources, file)
        else:
            slow_actuators(root, folders.systems, sources, file)
    stamps = (*sources.stamps, stamp(config.file))
    return _MODELS.keep(key, stamps, _Model(ModelText.of(root), balance))


def _wrap(root: Element, config: AircraftConfig, file: Path) -> None:
    for tag in CONNECTIONS:
        for element in root.findall(tag):
            root.remove(element)
    first = next(
        (i for i, element in enumerate(root) if element.tag in ("system", "flight_control")), None
    )
    if first is None:
        raise PlantError(f"{file}: must have a <flight_control>, got none.")
    for system in reversed(config.wrapping.systems if config.wrapping else ()):
        path = (config.folder / system).resolve()
        if not path.is_file():
            raise PlantError(f"{config.file}: `wrapping.systems` must be files, got {system!r}.")
        root.insert(first, Element("system", file=str(path)))


def _refuse_connections(file: Path) -> None:
    if _UNCONNECTED.find(file):
        return
    sources = Sources()
    try:
        root = sources.root(file, "")
    except PlantError:
        return  # JSBSim says what is wrong with it
    for tag in CONNECTIONS:
        if root.find(tag) is not None:
            raise PlantError(f"{file}: must have no <{tag}>, got one: flighttune records its runs.")
    _UNCONNECTED.keep(file, tuple(sources.stamps), True)
