# SPDX-License-Identifier: LGPL-2.1-or-later
"""The aircraft that JSBSim loads, read for the compiled step: one main file with all its parts."""

import os
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, fromstring

from flighttune.base.errors import PlantError
from flighttune.base.files.budget import XML, file_bytes
from flighttune.base.files.xml import CONNECTIONS, found_file, parts_of, read_xml
from flighttune.compiled.engine_files import EngineFile, engines_of
from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.rigid_body import Planet
from flighttune.compiled.run import Model
from flighttune.compiled.trace import Number

# Feet in a metre and cubic feet in a cubic metre, as JSBSim converts them.
_FEET, _CUBIC_FEET = 3.2808399, 35.3146667

# What a flight shows after a step, by name, from the properties then and the engines.
Signals: TypeAlias = Callable[[Properties, Sequence[EngineFile]], Mapping[str, Number]]


class Air(NamedTuple):
    """What a step is compiled for: a kind of turbulence, and whether there is a gust."""

    turbulence: Literal["tustin", "milspec"] | None = None
    gust: bool = False


@dataclass(frozen=True, kw_only=True)
class Source:
    """Text of an aircraft's main file, with placeholders where flights differ, and its parts.

    Sources are equal if they have the same text and files, whatever the numbers of their flights.

    Attributes
    ----------
    template : str
        The text; a placeholder stands in two braces.
    numbers : mapping
        The numbers of a flight, by placeholder.
    file, folders : Path and sequence of Path
        The main file, and where the parts that it names are looked for.
    dt : float, s
        Integration step.
    signals : callable
        What a flight shows.
    stated : tuple of str
        All that `signals` and checks of the step depend on beside the text and the parts.
    key : hashable
        Equal as long as the files have not changed.
    """

    template: str
    numbers: Mapping[str, float] = field(compare=False)
    file: Path = field(compare=False)
    folders: Sequence[Path] = field(compare=False)
    dt: float
    signals: Signals = field(compare=False)
    stated: tuple[str, ...]
    key: Hashable

    def parts(self) -> list[tuple[str, bytes]]:
        """Names and contents of all files that belong to the model, the main file first."""
        found: dict[str, bytes] = {}
        pending = [fromstring(self.template)]
        while pending:
            for file in parts_of(pending.pop(), self.folders, self.file):
                if str(file) not in found and os.path.isfile(file):
                    found[str(file)] = file_bytes(file, XML, PlantError)
                    pending.append(read_xml(file, str(file)))
        parts = [(Path(name).name, text) for name, text in found.items()]
        return [("", self.template.encode()), *sorted(parts)]

    def model(self, air: Air) -> Model:
        """The aircraft as one step flies it."""
        root = fromstring(self.template)
        _put_in(root, self.folders, self.file)
        engines, planet = engines_of(root), _planet(root)
        return Model(root, engines, planet, self.dt, air.turbulence or "", air.gust)


def _put_in(root: Element, folders: Sequence[Path], file: Path) -> None:
    """Put every part that is a file of its own in its place."""
    for element in list(root.iter()):
        name = element.get("file")
        if not name or element.tag in CONNECTIONS:
            continue
        path = found_file(name, folders, file)
        part = read_xml(path, str(path))
        if part.tag == element.tag:
            element.extend(part)
            _put_in(part, folders, file)
        else:  # engines and thrusters hold what their files hold
            element.insert(0, part)


def _planet(root: Element) -> Planet:
    planet = root.find("planet")
    if planet is None:
        raise Unsupported("a main file without a planet")
    radii = {float(planet.findtext(f"{axis}_axis") or "nan") for axis in ("semimajor", "semiminor")}
    if len(radii) > 1:
        raise Unsupported("an Earth that is no sphere")
    return Planet(radii.pop() * _FEET, float(planet.findtext("GM") or "nan") * _CUBIC_FEET)
