# SPDX-License-Identifier: LGPL-2.1-or-later
"""Engines and thrusters of a model as their files describe them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from flighttune.vehicles.compiled.functions import PLACEHOLDER
from flighttune.vehicles.compiled.properties import Unsupported
from flighttune.vehicles.compiled.tables import Table1, Table2, numbers, table_1, table_2
from flighttune.vehicles.compiled.vectors import Matrix

_FEET = {"FT": 1.0, "IN": 1.0 / 12.0, "M": 3.2808399}
_SLUG_FT2 = {"SLUG*FT2": 1.0, "KG*M2": 0.73756215}
_LEAST_INERTIA, _LEAST_DIAMETER, _LEAST_RATIO = 1e-06, 0.001, 0.001


@dataclass(frozen=True)
class EngineFile:
    """An engine: its place among the others, its motor, and what pushes."""

    number: int
    motor: Element
    thruster: Element  # the part that names the thruster, with its place and direction
    pusher: Element
    orientation: Matrix  # from the axes of the thruster to those of the body

    @property
    def kind(self) -> str:
        """Kind of the motor, such as ``piston``."""
        return self.motor.tag.removesuffix("_engine")

    @property
    def at(self) -> str:
        """Beginning of the properties of the engine."""
        return f"propulsion/engine[{self.number}]"

    def numbered(self, name: str) -> str:
        """A property of which each engine has one."""
        return f"{name}[{self.number}]"


def engines_of(root: Element) -> tuple[EngineFile, ...]:
    """All engines of a main file with its parts in it."""
    return tuple(_engine(n, part) for n, part in enumerate(root.findall("propulsion/engine")))


def _engine(number: int, part: Element) -> EngineFile:
    (thruster,) = part.findall("thruster")
    motor = next(x for x in part if x.tag.endswith("engine") or x.tag == "brushless_dc_motor")
    kinds = ("direct", "propeller", "nozzle", "rotor")
    pusher = next(x for x in thruster if x.tag in kinds)
    if thruster.find("pointing") is not None:
        raise Unsupported("a thruster with <pointing>")
    return EngineFile(number, motor, thruster, pusher, _orientation(thruster.find("orient")))


def _orientation(element: Element | None) -> Matrix:
    """Rotation from the axes of a thruster to those of the body."""
    angle = dict.fromkeys(("roll", "pitch", "yaw"), 0.0)
    if element is not None:
        unit = math.pi / 180.0 if element.get("unit") == "DEG" else 1.0
        angle |= {name: value_of(element, name, 0.0) * unit for name in angle}
    cp, sp = math.cos(angle["pitch"]), math.sin(angle["pitch"])
    cr, sr = math.cos(angle["roll"]), math.sin(angle["roll"])
    cy, sy = math.cos(angle["yaw"]), math.sin(angle["yaw"])
    return [
        [cp * cy, sr * sp * cy - cr * sy, cr * cy * sp + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sy * sp - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]


def value_of(element: Element, tag: str, default: float) -> float:
    """The number in a part of an element."""
    text = (element.findtext(tag) or "").strip()
    return float(text) if text else default


def text_of(element: Element, tag: str, default: float) -> str:
    """The text of a number that may differ from flight to flight."""
    text = (element.findtext(tag) or "").strip()
    return text if text.startswith(PLACEHOLDER) else repr(float(text) if text else default)


@dataclass(frozen=True)
class PropellerFile:
    """A propeller: numbers of its file in feet and slugs, and its tables."""

    diameter: float
    inertia: float
    gear_ratio: float
    thrust_factor: str
    power_factor: float
    sense: float
    p_factor: float
    moment_sign: float
    # Lowest and highest blade angle (deg) and speed (1/min) of a propeller of constant speed
    pitch: tuple[float, float, float, float] | None
    tables: dict[str, Table1 | Table2]


def propeller_of(engine: EngineFile) -> PropellerFile:
    """The propeller of an engine."""
    part, thruster = engine.pusher, engine.thruster
    diameter, inertia = part.find("diameter"), part.find("ixx")
    if diameter is None or inertia is None:
        raise Unsupported("a propeller without diameter or inertia")
    feet = _FEET[diameter.get("unit", "FT")] * float(diameter.text or "")
    slugs = _SLUG_FT2[inertia.get("unit", "SLUG*FT2")] * float(inertia.text or "")
    return PropellerFile(
        diameter=max(feet, _LEAST_DIAMETER),
        inertia=max(slugs, _LEAST_INERTIA),
        gear_ratio=max(value_of(part, "gearratio", 1.0), _LEAST_RATIO),
        thrust_factor=text_of(part, "ct_factor", 1.0),
        power_factor=value_of(part, "cp_factor", 1.0),
        sense=1.0 if value_of(thruster, "sense", 1.0) >= 0.0 else -1.0,
        p_factor=value_of(thruster, "p_factor", 0.0),
        moment_sign=-1.0 if float(part.get("version", "0")) > 1.0 else 1.0,
        pitch=_pitch(part),
        tables={table.get("name", ""): _table(table) for table in part.findall("table")},
    )


def _pitch(part: Element) -> tuple[float, float, float, float] | None:
    low, high, least, most = (
        value_of(part, tag, 0.0) for tag in ("minpitch", "maxpitch", "minrpm", "maxrpm")
    )
    if low == high:
        return None
    governed = 1.0 if part.find("maxrpm") is not None else 0.0
    if not int(value_of(part, "constspeed", governed)):
        raise Unsupported("a propeller of manual pitch")
    return low, high, least, most


def _table(element: Element) -> Table1 | Table2:
    text = element.findtext("tableData") or ""
    pairs = all(len(row) == 2 for row in numbers(text))
    read: Callable[[str], Table1 | Table2] = table_1 if pairs else table_2
    return read(text)
