# SPDX-License-Identifier: LGPL-2.1-or-later
"""The aircraft that JSBSim loads, read for the compiled step: one main file with all its parts."""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring

from flighttune.base.errors import PlantError
from flighttune.base.files.budget import XML, file_bytes
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.aircraft.model_xml import found_file, read_xml
from flighttune.vehicles.compiled.engine_files import engines_of
from flighttune.vehicles.compiled.properties import Unsupported
from flighttune.vehicles.compiled.rigid_body import Planet
from flighttune.vehicles.compiled.run import Model
from flighttune.vehicles.plants.jsbsim import model_files
from flighttune.vehicles.plants.jsbsim.fdm import weigh
from flighttune.vehicles.plants.weather import TurbulenceModel

# Feet in a metre and cubic feet in a cubic metre, as JSBSim converts them.
_FEET, _CUBIC_FEET = 3.2808399, 35.3146667

_PLACEHOLDER = re.compile(r"\{\{(.+?)\*(.+?)\}\}")


class Air(NamedTuple):
    """What a step is compiled for: a kind of turbulence, and whether there is a gust."""

    turbulence: TurbulenceModel | None = None
    gust: bool = False


class Source:
    """Text of an aircraft's main file, with placeholders where flights differ, and its parts.

    `files` are those of an aircraft that JSBSim has loaded just now, by default looked at again.
    `numbers` are those of this flight, by placeholder; `stated` is what the step has of
    ``aircraft.toml`` beside the model.
    """

    def __init__(
        self, config: AircraftConfig, steps: int, files: model_files.Unchanged | None = None
    ) -> None:
        files = files or model_files.unchanged(config)
        self.config, self.steps, self.files = config, steps, files
        self.template, values = model_files.template_and_values(files, weigh, steps)
        self.folders = model_files.folders_of(files)
        self.numbers = {
            match[0]: values[match[1]] * float(match[2])
            for match in _PLACEHOLDER.finditer(self.template)
        }
        engines = config.engines
        # The fingerprint is that of the model: rate, lowest throttle and thrust are not in it.
        stated = config.inner_loop_rate, steps, engines.throttle[0], engines.thrust
        self.stated = (config.fingerprint, *map(repr, stated))
        self._key = files.key, self.template, self.stated

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        """Whether both have the same text and files, whatever the numbers."""
        return isinstance(other, Source) and self._key == other._key

    def parts(self) -> list[tuple[str, bytes]]:
        """Names and contents of all files that belong to the model, the main file first."""
        found: dict[str, bytes] = {}
        pending = [fromstring(self.template)]
        while pending:
            for file in _parts_of(pending.pop(), self.folders.parts, self.folders.file):
                if str(file) not in found and os.path.isfile(file):
                    found[str(file)] = file_bytes(file, XML, PlantError)
                    pending.append(read_xml(file, str(file)))
        parts = [(Path(name).name, text) for name, text in found.items()]
        return [("", self.template.encode()), *sorted(parts)]

    def model(self, air: Air) -> Model:
        """The aircraft as one step flies it."""
        root = fromstring(self.template)
        _put_in(root, self.folders.parts, self.folders.file)
        engines, planet = engines_of(root), _planet(root)
        return Model(root, engines, planet, self.dt, air.turbulence or "", air.gust)

    @property
    def dt(self) -> float:
        """Integration step, s."""
        return 1.0 / (self.config.inner_loop_rate * self.steps)


def _parts_of(root: Element, folders: Sequence[Path], file: Path) -> Iterator[Path]:
    for element in root.iter():
        if element.get("file") and element.tag not in model_files.CONNECTIONS:
            yield found_file(element.attrib["file"], folders, file)


def _put_in(root: Element, folders: Sequence[Path], file: Path) -> None:
    """Put every part that is a file of its own in its place."""
    for element in list(root.iter()):
        name = element.get("file")
        if not name or element.tag in model_files.CONNECTIONS:
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
