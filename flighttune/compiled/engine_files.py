# SPDX-License-Identifier: LGPL-2.1-or-later
"""Engines and thrusters of a model as their files describe them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from flighttune.compiled.functions import PLACEHOLDER, function, hidden_function
from flighttune.compiled.properties import Properties, Unsupported
from flighttune.compiled.tables import Table1, Table2, numbers, table_1, table_2
from flighttune.compiled.trace import Number
from flighttune.compiled.vectors import Matrix

# Factors of units from the one given to the one that JSBSim computes with.
_UNITS = {
    "FT": {"M": 3.2808399, "CM": 0.032808399, "KM": 3280.8399, "IN": 1.0 / 12.0},
    "IN": {"FT": 12.0, "M": 3.2808399 * 12.0},
    "FT2": {"M2": 3.2808399 * 3.2808399, "IN2": 1.0 / 144.0},
    "IN3": {"CC": 1.0 / 16.387064, "FT3": 1728.0, "LTR": 61.0237441},
    "SLUG*FT2": {"KG*M2": 1.0 / 1.35594},
    "LBS": {"N": 0.22482, "KG": 1.0 / 0.45359237},
    "LBS/SEC": {"KG/SEC": 1.0 / 0.45359237},
    "HP": {"WATTS": 0.001341022},
    "WATTS": {"HP": 1.0 / 0.001341022},
    "INHG": {"PSI": 2.03625437, "ATM": 29.9246899, "PA": 1.0 / 3386.0},
    "PA": {"INHG": 3386.0},
    "PSI": {"INHG": 1.0 / 2.03625437},
    "LBS/HP*HR": {"KG/KW*HR": 1.0 / 0.6083},
    "RPM": {},
}
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

    @property
    def throttle(self) -> str:
        """The property of its throttle lever."""
        return self.numbered("fcs/throttle-pos-norm")

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


def factor_of(element: Element, tag: str, unit: str) -> float:
    """Factor from the unit of a part to the one that JSBSim computes with."""
    part = element.find(tag)
    given = "" if part is None else part.get("unit", "")
    if given in ("", unit):
        return 1.0
    if given not in _UNITS[unit]:
        raise Unsupported(f'<{tag}> in "{given}"')
    return _UNITS[unit][given]


def value_in(element: Element, tag: str, unit: str, default: float) -> float:
    """The number in a part of an element, in a unit."""
    return value_of(element, tag, default) * factor_of(element, tag, unit)


def table_in(element: Element, name: str) -> Table1 | Table2 | None:
    """The table of a name in an element."""
    tables = (part for part in element.findall("table") if part.get("name") == name)
    found = next(tables, None)
    return None if found is None else _table(found)


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
    # Lowest and highest blade angle (deg) and speed (1/min); None for fixed blades
    pitch: tuple[float, float, float, float] | None
    governed: bool  # whether a governor keeps its speed
    tables: dict[str, Table1 | Table2]


def propeller_of(engine: EngineFile) -> PropellerFile:
    """The propeller of an engine."""
    part, thruster = engine.pusher, engine.thruster
    return PropellerFile(
        diameter=max(value_in(part, "diameter", "FT", 0.0), _LEAST_DIAMETER),
        inertia=max(value_in(part, "ixx", "SLUG*FT2", 0.0), _LEAST_INERTIA),
        gear_ratio=max(value_of(part, "gearratio", 1.0), _LEAST_RATIO),
        thrust_factor=text_of(part, "ct_factor", 1.0),
        power_factor=value_of(part, "cp_factor", 1.0),
        sense=1.0 if value_of(thruster, "sense", 1.0) >= 0.0 else -1.0,
        p_factor=value_of(thruster, "p_factor", 0.0),
        moment_sign=-1.0 if float(part.get("version", "0")) > 1.0 else 1.0,
        pitch=_pitch(part),
        governed=bool(int(value_of(part, "constspeed", float(part.find("maxrpm") is not None)))),
        tables={table.get("name", ""): _table(table) for table in part.findall("table")},
    )


def _pitch(part: Element) -> tuple[float, float, float, float] | None:
    low, high, least, most = (
        value_of(part, tag, 0.0) for tag in ("minpitch", "maxpitch", "minrpm", "maxrpm")
    )
    return None if low == high else (low, high, least, most)


def _table(element: Element) -> Table1 | Table2:
    text = element.findtext("tableData") or ""
    pairs = all(len(row) == 2 for row in numbers(text))
    read: Callable[[str], Table1 | Table2] = table_1 if pairs else table_2
    return read(text)


def functions_of(now: Properties, engine: EngineFile, known: tuple[str, ...]) -> dict[str, Number]:
    """Values of an engine's functions; those that are `known` are shown below the engine."""
    values = {}
    for part in engine.motor.findall("function"):
        if part.get("type") not in (None, "pre"):
            raise Unsupported(f'a function of type "{part.get("type")}" of an engine')
        name = (part.get("name") or "").strip()
        if name in known:
            values[name] = now[f"{engine.at}/{name}"] = hidden_function(now, part)
        else:
            values[name] = function(now, part)
    return values
