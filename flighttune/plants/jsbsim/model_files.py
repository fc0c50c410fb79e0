"""The files of an aircraft that JSBSim loads: its own, or a main file made in a private folder.

A main file is made for an aircraft of JSBSim's own set, with systems of ours in front of its flight
control, and for an aircraft off the nominal. Shipped files are never written to.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from tempfile import gettempdir
from typing import TypeAlias
from xml.etree.ElementTree import Element

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.aircraft.model_xml import (
    AXES,
    COEFFICIENT,
    MassBalance,
    filled,
    open_mass_balance,
    read_xml,
    scale_axis,
    scale_coefficient,
    scale_thrust,
    slow_actuators,
    template_of,
)
from flighttune.aircraft.off_nominal import OffNominal
from flighttune.errors import PlantError
from flighttune.file_lock import scratch_folder

CONNECTIONS = ("output", "input")
"""Elements by which JSBSim opens files and sockets on its first evaluation."""

_NOMINAL = OffNominal()

Weigh: TypeAlias = Callable[[AircraftConfig], MassBalance]
"""Weighs an aircraft in JSBSim: handed in, because loading an aircraft needs this module."""


@dataclass(frozen=True, slots=True)
class ModelFolders:
    """Where JSBSim finds an aircraft's main file, its engines and its systems."""

    model: Path
    engines: Path
    systems: Path


@dataclass(frozen=True, slots=True)
class _Source:
    """What a template is made of; equal while the files and what is off the nominal are the same.

    Attributes
    ----------
    config : AircraftConfig
    weigh : callable
    steps : int
        Integration steps in a sample of the inner loop.
    key : tuple
        Main file, systems, whether mass or inertia differ, names of the factors.
    stamps : tuple of (path, int, int)
        Files with the time of their last change and their size.
    """

    config: AircraftConfig = field(compare=False)
    weigh: Weigh = field(compare=False)
    steps: int
    key: tuple[object, ...]
    stamps: tuple[tuple[Path, int, int], ...]

    @classmethod
    def of(cls, config: AircraftConfig, off: OffNominal, weigh: Weigh, steps: int) -> "_Source":
        """What the template of an aircraft that is `off` the nominal is made of."""
        systems = config.wrapping.systems if config.wrapping else ()
        file = _folders(config).model / f"{config.model}.xml"
        files = (file, config.file, *(config.folder / one for one in systems))
        found = {path for path in files if path.is_file()} | set(config.folder.rglob("*.xml"))
        states = [(path, path.stat()) for path in sorted(found)]
        return cls(
            config,
            weigh,
            steps,
            (file, systems, off.loaded, tuple(off.scaled), tuple(off.scaled_coefficients)),
            tuple((path, state.st_mtime_ns, state.st_size) for path, state in states),
        )


@contextmanager
def model_folders(config: AircraftConfig, weigh: Weigh, steps: int = 1) -> Iterator[ModelFolders]:
    """Give the folders of an aircraft, for as long as JSBSim loads it.

    A wrapped aircraft's main file is read from the installed jsbsim and written to a private folder
    without its connections to files and sockets, with the systems of its ``aircraft.toml`` in front
    of its flight control. So is the main file of an aircraft off the nominal, with the factors in
    it, and of one with several integration `steps` in a sample of its inner loop. The files read
    stay as they are.

    Raises
    ------
    PlantError
        If JSBSim ships no such aircraft or a system is missing; if an aircraft of ours has
        connections; or if there is no room for the private folder.
    InputError
        If the aircraft cannot be off the nominal that way.
    """
    folders = _folders(config)
    text = main_file_text(config, weigh, steps)
    if text is None:
        yield folders
        return
    with _private_folder(f"{config.model}.xml", text) as folder:
        yield ModelFolders(folder, folders.engines, folders.systems)


@contextmanager
def _private_folder(name: str, text: str) -> Iterator[Path]:
    """A folder that holds one file; in memory where it can, so that no flight waits for a disk."""
    place = None if "TMPDIR" in os.environ else _memory()
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(scratch_folder(place))
            (folder / name).write_text(text, encoding="utf-8")
        except OSError as error:
            where = place or gettempdir()
            raise PlantError(
                f"{where}: must take a folder for {name}, got {error.strerror}."
            ) from error
        yield folder


def main_file_text(config: AircraftConfig, weigh: Weigh, steps: int = 1) -> str | None:
    """Return the main file that JSBSim shall load, None where that is the one in the folder.

    Raises
    ------
    PlantError, InputError
        As `model_folders`.
    """
    off = config.off_nominal or _NOMINAL
    if config.wrapping is None and off.is_nominal and steps == 1:
        _refuse_connections(config.folder / f"{config.model}.xml")
        return None
    template, balance = _template(_Source.of(config, off, weigh, steps))
    factors = {f"{COEFFICIENT}{name}": factor for name, factor in off.scaled_coefficients.items()}
    values = factors | off.scaled | {"actuator_rate": 1.0 / off.actuator_lag}
    return filled(template, values | balance.values(off) if balance else values)


@cache
def _memory() -> Path | None:
    """A folder in memory, ten times as fast as one on disk; None if the system has none."""
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


@lru_cache(maxsize=32)
def _template(source: _Source) -> tuple[str, MassBalance | None]:
    """Main file with placeholders where something is off the nominal; what weighs the aircraft."""
    config, folders = source.config, _folders(source.config)
    off = config.off_nominal or _NOMINAL
    file = folders.model / f"{config.model}.xml"
    where = "be a file of JSBSim's" if config.wrapping is None else "be shipped with jsbsim"
    root = read_xml(file, f"{config.file}: `model` must {where}")
    if config.wrapping is None:
        _refuse_connections(file)
    else:
        _wrap(root, config, file)
    if source.steps > 1:
        _slow_computer(root, source.steps, folders.systems)
    balance = None
    if off.loaded:
        balance = source.weigh(config.with_off_nominal(None))
        open_mass_balance(root)
    for name in off.scaled_coefficients:
        scale_coefficient(root, name, file)
    for name in off.scaled:
        if name in AXES:
            scale_axis(root, name, file)
        elif name == "thrust":
            scale_thrust(root, folders.engines, file)
        else:
            slow_actuators(root, folders.systems, file)
    return template_of(root), balance


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


def _slow_computer(root: Element, steps: int, systems: Path) -> None:
    """Let the channels with an ``execrate`` wait for so many integration steps between samples."""
    for i, system in enumerate(root):
        if system.tag != "system":
            continue
        file = systems / Path(system.get("file", "")).with_suffix(".xml")
        inline = read_xml(file, str(file)) if "file" in system.attrib else system
        channels = [one for one in inline.iter("channel") if one.get("execrate", "").isdigit()]
        for channel in channels:
            channel.set("execrate", str(steps * int(channel.attrib["execrate"])))
        if channels:
            root[i] = inline


def _refuse_connections(file: Path) -> None:
    try:
        state = file.stat()
    except OSError:
        return  # JSBSim says what is wrong with it
    tag = _connection(file, state.st_mtime_ns, state.st_size)
    if tag:
        raise PlantError(f"{file}: must have no <{tag}>, got one: flighttune records its runs.")


@lru_cache(maxsize=32)
def _connection(file: Path, *_stamp: int) -> str:
    """The first connection in a main file; empty without one, or if the file is no XML."""
    try:
        root = read_xml(file, "")
    except PlantError:
        return ""  # JSBSim says what is wrong with it
    return next((tag for tag in CONNECTIONS if root.find(tag) is not None), "")
