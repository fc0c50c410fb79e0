"""Aircraft of JSBSim's own set, flown as they are shipped, with systems of ours put around them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from flighttune.errors import PlantError
from flighttune.plants.jsbsim.aircraft import AircraftConfig

CONNECTIONS = ("output", "input")
"""Elements by which JSBSim opens files and sockets on its first evaluation."""


@dataclass(frozen=True, slots=True)
class ModelFolders:
    """Where JSBSim finds an aircraft's main file, its engines and its systems."""

    model: Path
    engines: Path
    systems: Path


@contextmanager
def model_folders(config: AircraftConfig) -> Iterator[ModelFolders]:
    """Give the folders of an aircraft, for as long as JSBSim loads it.

    A wrapped aircraft's main file is read from the installed jsbsim and written to a private folder
    without its connections to files and sockets, with the systems of its ``aircraft.toml`` in front
    of its flight control. The installed file stays as it is.

    Raises
    ------
    PlantError
        If JSBSim ships no such aircraft or a system is missing; or if an aircraft of ours has
        connections.
    """
    if config.wrapping is None:
        _refuse_connections(config.folder / f"{config.model}.xml")
        folder = config.folder
        yield ModelFolders(folder, folder / "Engines", folder / "Systems")
        return
    import jsbsim

    shipped = Path(jsbsim.get_default_root_dir())
    tree = _wrapped(config, shipped / "aircraft" / config.model / f"{config.model}.xml")
    with TemporaryDirectory(prefix="flighttune-") as name:
        folder = Path(name)
        tree.write(folder / f"{config.model}.xml", encoding="utf-8", xml_declaration=True)
        yield ModelFolders(folder, shipped / "engine", shipped / "systems")


def _wrapped(config: AircraftConfig, file: Path) -> "ElementTree.ElementTree[ElementTree.Element]":
    try:
        tree = ElementTree.parse(file)
    except (OSError, ElementTree.ParseError) as error:
        raise PlantError(f"{config.file}: `model` must be shipped with jsbsim: {error}.") from error
    root = tree.getroot()
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
        root.insert(first, ElementTree.Element("system", file=str(path)))
    return tree


def _refuse_connections(file: Path) -> None:
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError):
        return  # JSBSim says what is wrong with it
    for tag in CONNECTIONS:
        if root.find(tag) is not None:
            raise PlantError(f"{file}: must have no <{tag}>, got one: flighttune records its runs.")
