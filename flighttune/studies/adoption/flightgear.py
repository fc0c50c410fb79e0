"""FlightGear's files about a JSBSim aircraft: its main file, and the values in them."""

import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from flighttune.base.errors import InputError, PlantError
from flighttune.base.files.budget import INCLUDED
from flighttune.base.files.table import shown
from flighttune.base.files.xml import read_xml
from flighttune.vehicles.aircraft.aircraft import absolute_name

SET = "-set.xml"  # ending of FlightGear's description of an aircraft
AERO = "/sim/aero"  # property with the name of the main file

# Maximum length of a chain of aliases.
MAX_ALIASES = 20

# Beginnings of texts that the C library reads as an integer and as a number.
_WHOLE = re.compile(r"\s*[+-]?\d{1,18}")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


class Stated(NamedTuple):
    """Values in FlightGear's files, by the paths of properties without indices of 0."""

    files: tuple[str, ...] = ()  # names of the files
    values: Mapping[str, float] = MappingProxyType({})
    differ: frozenset[str] = frozenset()  # paths with several values in the files
    # Paths below which an included file was not read, with the reason
    unread: tuple[tuple[str, str], ...] = ()

    def of(self, name: str) -> float | None:
        """The value of a property of the model; None if no file has it."""
        return self.values.get(_path(absolute_name(name)))

    def several(self, name: str) -> bool:
        """Whether the files have several values of a property."""
        return _path(absolute_name(name)) in self.differ

    def faults(self, names: Iterable[str]) -> list[str]:
        """Reasons for unread files that may have properties."""
        paths = [absolute_name(name) for name in names]
        return [why for below, why in self.unread if any(x.startswith(f"{below}/") for x in paths)]


UNSTATED = Stated()


def _path(name: str) -> str:
    return re.sub(r"\[0+\]", "", name)


def _number(text: str, kind: str) -> float:
    """The number that FlightGear reads from a text of a type: 0 unless it begins with a number."""
    if kind == "bool" and text == "true":
        return 1.0
    match = (_WHOLE if kind in ("bool", "int", "long") else _NUMBER).match(text)
    value = float(match[0]) if match else 0.0
    if kind == "bool":
        return float(value != 0.0)
    return float(np.float32(value)) if kind == "float" and abs(value) < 1e38 else value


@dataclass(eq=False)
class _Tree:
    """The properties of a description, as FlightGear reads them.

    https://wiki.flightgear.org/PropertyList_XML_files
    """

    file: Path
    texts: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)
    unread: list[tuple[str, str]] = field(default_factory=list)
    parents: set[str] = field(default_factory=set)  # paths with sublevels
    included: int = 0
    size: int = 0

    def __post_init__(self) -> None:
        self.file = Path(os.path.realpath(self.file))
        self._read(self.file, "", (), 0)

    def _read(self, file: Path, path: str, within: tuple[Path, ...], level: int) -> None:
        """Read a file into the level `path`; `within`: the files that include it."""
        self.size += file.stat().st_size
        if self.included > INCLUDED.entries or self.size > INCLUDED.size:
            raise InputError(
                f"{self.file}: must include at most {INCLUDED.entries} files with "
                f"{INCLUDED.size / 1e6:g} MB, got more."
            )
        root = read_xml(file, str(file))
        self._visit(root, path, (*within, file), level)

    def _visit(self, element: Element, path: str, within: tuple[Path, ...], level: int) -> None:
        if level > INCLUDED.depth:
            raise InputError(f"{within[-1]}: must have at most {INCLUDED.depth} levels, got more.")
        if name := element.get("include"):
            self._include(name, path, within, level)
        if target := element.get("alias"):
            self.aliases[path] = _path(absolute_name(target, path))
        if len(element):
            self.parents.add(path)
        elif path not in self.parents and path not in self.aliases:
            self.texts[path] = element.text or ""
            self.types[path] = element.get("type", "")
        counts = Counter[str]()
        for part in element:
            stated = part.get("n")
            index = counts[part.tag] if stated is None else int(_number(stated, "int"))
            counts[part.tag] = max(counts[part.tag], index + 1)
            below = f"{path}/{part.tag}{f'[{index}]' if index else ''}"
            self._visit(part, below, within, level + 1)

    def _include(self, name: str, path: str, within: tuple[Path, ...], level: int) -> None:
        """Read the file that an element includes, if it is below the aircraft's folder."""
        home = self.file.parent
        # FlightGear searches beside the file first, then in the aircraft's folder.
        own = name.removeprefix(f"Aircraft/{home.name}/")
        places = [within[-1].parent / name, *([home / own] if own != name else [])]
        files = [Path(os.path.realpath(place)) for place in places]
        inside = [file for file in files if file.is_relative_to(home)]
        file = next((file for file in inside if os.path.isfile(file)), None)
        why = "is not there" if inside else "is not in the folder of the aircraft"
        if file in within:  # it includes itself
            return
        if file is not None:
            self.included += 1
            try:
                self._read(file, path, within, level)
                return
            except PlantError as error:
                why = f"cannot be read ({str(error).removesuffix('.')})"
        self.unread.append((path, f"{shown(name)}, which {within[-1].name} includes, {why}"))

    def text(self, path: str) -> str:
        """The text of a property without surrounding blanks; empty without a text."""
        return self.texts.get(path, "").strip()

    def values(self) -> dict[str, float]:
        """Finite numbers by the paths of their properties."""
        values = {path: _number(text, self.types[path]) for path, text in self.texts.items()}
        for path, target in self.aliases.items():
            for _ in range(MAX_ALIASES):
                target = self.aliases.get(target, target)
            if target in values:
                values[path] = values[target]
        return {path: value for path, value in values.items() if math.isfinite(value)}


def stated_beside(main: Path) -> Stated:
    """Values from descriptions of a main file, in its folder or above."""
    main = Path(os.path.realpath(main))
    trees = []
    for folder in (main.parent, main.parent.parent):
        for file in sorted(folder.glob(f"*{SET}")):
            try:
                tree = _Tree(file) if os.path.isfile(file) else None  # a pipe would wait
            except (PlantError, InputError, OSError):  # it describes something else
                continue
            if tree and _kind(tree) == "jsb" and _named(tree) == main:
                trees.append(tree)
    return _agreed(trees)


def of_flightgear(path: Path) -> tuple[Path, Stated]:
    """The main file that one or all descriptions of a folder name, and their values.

    A folder without descriptions may have a single main file.
    """
    if not os.path.exists(path):
        raise InputError(f"{path}: must be a file or folder of FlightGear's, got no such file.")
    files = sorted(path.glob(f"*{SET}")) if os.path.isdir(path) else [path]
    trees = [_Tree(file) for file in files if file.is_file()]  # a pipe would wait
    named = [tree for tree in trees if _kind(tree) == "jsb"]
    mains = [] if named else _mains(path)
    if len(mains) == 1:
        return mains[0], UNSTATED
    other = ", ".join(sorted({shown(_kind(tree)) for tree in trees if _kind(tree)}))
    if other and not (named or mains):
        raise InputError(f"{path}: its flight model must be JSBSim's (jsb), got {other}.")
    if len({tree.text(AERO) for tree in named}) != 1:
        several = ", ".join(file.name for file in [*(tree.file for tree in named), *mains])
        got = several or next(filter(None, _faults(path, trees)), "none")
        raise InputError(f"{path}: must hold one aircraft of JSBSim's, got {got}.")
    file, aero = path if os.path.isfile(path) else path / named[0].file.name, named[0].text(AERO)
    main = file.parent / f"{aero}.xml"
    inside = Path(os.path.realpath(main)).is_relative_to(os.path.realpath(file.parent))
    if not (inside and os.path.isfile(main)):
        raise InputError(f'{file}: `aero` must name a file in its folder, got "{shown(aero)}".')
    return main, _agreed(named)


def _mains(folder: Path) -> list[Path]:
    """Main files in a folder; only the file with the folder's name, if it exists."""
    mains = [file for file in sorted(folder.glob("*.xml")) if _is_main(file)]
    return [file for file in mains if file.stem == folder.resolve().name] or mains


def _faults(path: Path, trees: Iterable[_Tree]) -> Iterator[str]:
    """Reasons for a missing main file."""
    yield from (_fault(file) for file in sorted(path.glob("*.xml")) if file.is_file())
    yield from (f"{file.name}, whose ending must be .xml" for file in sorted(path.glob("*.XML")))
    yield from (why for tree in trees for below, why in tree.unread if below in ("", "/sim"))


def _kind(tree: _Tree) -> str:
    return tree.text("/sim/flight-model")


def _named(tree: _Tree) -> Path:
    """The main file that a description names."""
    return Path(os.path.realpath(tree.file.parent / f"{tree.text(AERO)}.xml"))


def _agreed(trees: Iterable[_Tree]) -> Stated:
    """Values on which all descriptions agree."""
    names, values, differ = [], dict[str, float](), set[str]()
    unread: list[tuple[str, str]] = []
    for tree in trees:
        names.append(tree.file.name)
        unread += [fault for fault in tree.unread if fault not in unread]
        for path, value in tree.values().items():
            if values.setdefault(path, value) != value:
                differ.add(path)
    kept = {path: value for path, value in values.items() if path not in differ}
    return Stated(tuple(names), kept, frozenset(differ), tuple(unread))


def _is_main(file: Path) -> bool:
    try:
        # reading a pipe would wait
        return os.path.isfile(file) and read_xml(file, str(file)).tag == "fdm_config"
    except PlantError:  # it cannot be read and describes something else
        return False


def _fault(file: Path) -> str:
    """Why a file cannot be read; empty if it can."""
    try:
        read_xml(file, str(file))
    except PlantError as error:
        return str(error).removesuffix(".")
    return ""
