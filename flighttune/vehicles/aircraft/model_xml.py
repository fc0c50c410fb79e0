"""The XML of an aircraft: placeholders for the numbers of each flight, and our systems.

The inner loop and its actuators are put in front of every model.
"""

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, fromstring

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.files.xml import found_file, node, read_xml
from flighttune.base.units import FT, SLUG
from flighttune.vehicles.aircraft.aircraft import (
    AXES,
    SURFACES,
    AircraftConfig,
    Fault,
    OffNominal,
    Surface,
    property_name,
)

SURFACE_LAG, THROTTLE_LAG = 25.0, 5.0  # Bandwidth of the actuators, rad/s


def put_in_front(root: Element, config: AircraftConfig) -> None:
    """Put the inner loop and the actuators in front of the systems of a model."""
    inner_loop = fromstring(Path(__file__).with_name("inner_loop.xml").read_text(encoding="utf-8"))
    # JSBSim runs the systems in the order of the file, and the flight control after them.
    first = next((i for i, element in enumerate(root) if element.tag == "system"), len(root))
    # Variables of the aerodynamics that positions of surfaces replace, each once.
    replaced = (x for _, surface in config.surfaces.named() for x in surface.replaces)
    replaced = dict.fromkeys(x.removeprefix("-") for x in replaced)
    root[first:first] = [inner_loop, _actuators(config, replaced)]
    read = {name.removeprefix("ft/") for name in config.declared if name.startswith("ft/")}
    read |= replaced.keys()
    for element in root.iterfind("aerodynamics//*"):
        text = (element.text or "").strip()
        if (name := property_name(text.lstrip("-"))) in read:
            element.text = f"{'-' * text.startswith('-')}ft/{name}"


def _actuators(config: AircraftConfig, replaced: Iterable[str]) -> Element:
    channel, engines = Element("channel", name="actuators"), config.engines
    for name, surface in config.surfaces.named():
        actuator = _actuator(name, "rad", SURFACE_LAG, *map(repr, surface.travel))
        channel.append(actuator)
        output = node("output", surface.command or f"fcs/{name}-cmd-norm")
        if surface.replaces:
            continue
        if (surface.command or "").endswith("-rad"):
            actuator.append(output)
        else:
            share = node("function", _norm(name, surface))
            channel.append(node("fcs_function", share, output, name=f"ft/{name}-norm"))
    channel.extend(_read(variable, config) for variable in replaced)
    if config.surfaces.rudder is None:
        channel.append(_actuator("rudder", "rad", SURFACE_LAG, "0", "0"))
    lever = _actuator("throttle", "norm", THROTTLE_LAG, "0", "ft/limits/throttle-max")
    channel.append(lever)
    if engines.full != 1.0:
        gain = node("input", "ft/throttle-norm"), node("gain", repr(engines.full))
        lever = node("pure_gain", *gain, name="ft/throttle-lever")
        channel.append(lever)
    lever.extend(node("output", f"{engines.command}[{i}]") for i in range(engines.count))
    for i, (name, source) in enumerate(config.linked.items()):
        link = node("input", source), node("gain", "1"), node("output", name)
        channel.append(node("pure_gain", *link, name=f"ft/link-{i}"))
    declared = [node("property", name, value=repr(x)) for name, x in config.declared.items()]
    return node("system", *declared, channel, name="actuators")


def _actuator(name: str, unit: str, lag: float, low: str, high: str) -> Element:
    return node(
        "actuator",
        *(node("input", f"ft/{name}-cmd-{unit}"), node("lag", repr(lag))),
        node("clipto", node("min", low), node("max", high)),
        name=f"ft/{name}-{unit}",
    )


def _norm(name: str, surface: Surface) -> Element:
    """The position of a surface as a share of the position at full command."""
    low, high = surface.full or surface.travel
    # Below zero, and otherwise.
    cases = [
        node("quotient", node("property", f"ft/{name}-rad"), node("value", repr(full)))
        for full in ((-low, high) if low < high else (high, -low))
    ]
    below = node("lt", node("property", f"ft/{name}-rad"), node("value", "0"))
    return node("ifthen", below, *cases)


def _read(variable: str, config: AircraftConfig) -> Element:
    """The function that replaces a flight-control position in the aerodynamics."""
    # For an elevon this is the sum of the positions of aileron and elevator.
    parts = Element("sum")
    for name, surface in config.surfaces.named():
        for sign in (sign for sign in ("", "-") if f"{sign}{variable}" in surface.replaces):
            if variable.endswith("-norm"):
                parts.append(node("product", node("value", f"{sign}1"), _norm(name, surface)))
                continue
            low, high = surface.full or surface.travel
            unit = math.degrees(1.0) if variable.endswith("deg") else 1.0
            factor = math.copysign(unit, high - low) * (-1.0 if sign else 1.0)
            size = node("property", f"ft/{name}-rad")
            size = node("abs", size) if "/mag-" in variable else size
            parts.append(node("product", node("value", repr(factor)), size))
    return node("fcs_function", node("function", parts), name=f"ft/{variable}")


_PLACEHOLDER = re.compile(r"\{\{(.+?)\*(.+?)\}\}")
_HEAD = '<?xml version="1.0" encoding="utf-8"?>\n'


def placeholder(name: str, base: float = 1.0) -> str:
    """Placeholder for the value of `name` times `base`, the number in the aircraft's file."""
    return f"{{{{{name}*{base!r}}}}}"


def template_of(root: ElementTree.Element) -> str:
    """Text of an element tree with its placeholders."""
    return _HEAD + ElementTree.tostring(root, encoding="unicode")


def strip_text(root: ElementTree.Element) -> None:
    """Remove what JSBSim reads without use: blank text, and descriptions of functions."""
    for element in root.iter():
        for text in [part for part in element if part.tag in _NOT_OPERATIONS]:
            element.remove(text)
        if not (element.text or "").strip():
            element.text = None
        element.tail = None


def filled(template: str, values: Mapping[str, float]) -> str:
    """Text with `values` in its placeholders, exact to the last bit."""
    return _PLACEHOLDER.sub(lambda match: repr(_number(match, values)), template)


def numbers_in(template: str, values: Mapping[str, float]) -> dict[str, float]:
    """The number of each placeholder of a text, by the placeholder."""
    return {match[0]: _number(match, values) for match in _PLACEHOLDER.finditer(template)}


def _number(match: re.Match[str], values: Mapping[str, float]) -> float:
    return values[match[1]] * float(match[2])


# Names of the actuators of the surfaces.
SURFACE_ACTUATORS = tuple(f"ft/{name}-rad" for name in SURFACES)

# Prefix of the properties of failures in flight.
FAULT = "ft/fault/"

# Share of the mass that slides when the centre of gravity moves in flight.
BALLAST = 0.1

# Prefix of the placeholder of a factor on a single function.
COEFFICIENT = "coefficient "

# Numbers proportional to the thrust of engines without a propeller.
_THRUST_OF = {"electric_engine": ("power",), "turbine_engine": ("milthrust", "maxthrust")}

# Diameter beyond every aeroplane's propeller, ft.
WIDEST_PROPELLER = 30.0

_NOT_OPERATIONS = ("description", "documentation")


def scale_axis(root: Element, key: str, file: Path, by: str = "") -> None:
    """Multiply all functions of the axis of `key`, one of `AXES`, by a property or placeholder."""
    axes, wanted = root.findall("aerodynamics/axis"), key.partition("_")[0].upper()
    functions = [f for axis in axes if axis.get("name") == wanted for f in axis.iter("function")]
    if not functions:
        names = ", ".join(dict.fromkeys(axis.get("name", "?") for axis in axes))
        raise InputError(
            f"`{key}_factor` must be left out: {file} has no {wanted} axis, only {names}."
        )
    for function in functions:
        _multiply_function(function, by or placeholder(key))


def scale_coefficient(root: Element, name: str, file: Path) -> None:
    """Multiply the single function, or part, with this `name` or last part of a name."""
    named = [
        (parent, i, child.get("name", "").strip())
        for aerodynamics in root.iterfind("aerodynamics")
        for parent in aerodynamics.iter()
        for i, child in enumerate(parent)
        if child.get("name") and child.tag != "axis"
    ]
    functions = [part for part in named if name in (part[2], part[2].rpartition("/")[2])]
    if len(functions) != 1:
        choices = ", ".join(full for _, _, full in functions)
        short = [full.rpartition("/")[2] for _, _, full in named]
        hint = f", it means {choices}." if choices else nearest_name(name, short)
        raise InputError(
            f"`coefficient_factors.{name}` must be a named aerodynamic function of {file}{hint}"
        )
    parent, i, _ = functions[0]
    factor = placeholder(f"{COEFFICIENT}{name}")
    if parent[i].tag == "function":
        _multiply_function(parent[i], factor)
    else:
        _multiply(parent, i, factor)


def scale_thrust(root: Element, folders: Sequence[Path], file: Path) -> None:
    """Multiply the thrust of every engine, by its propeller or directly."""
    for engine in root.iterfind("propulsion/engine"):
        # The files of engines and thrusters are searched in `folders`, in this order, and put into
        # the main file.
        motor = _inlined(engine, folders)
        thruster = engine.find("thruster")
        thruster_kind = None if thruster is None else _inlined(thruster, folders)
        if thruster_kind is not None and thruster_kind.tag == "propeller":
            if (factor := thruster_kind.find("ct_factor")) is None:
                factor = SubElement(thruster_kind, "ct_factor")
            factor.text = placeholder("thrust", float(factor.text or 1.0))
            continue
        numbers = [n for tag in _THRUST_OF.get(motor.tag, ()) for n in motor.findall(tag)]
        if not numbers:
            raise InputError(
                f"`thrust_factor` must be left out: {file} has a <{motor.tag}> without a "
                "propeller; known are electric and turbine engines, and propellers."
            )
        for number in numbers:
            number.text = placeholder("thrust", float(number.text or 0.0))


def in_inches(propeller: Element) -> bool:
    """Whether a diameter without a unit would be too large for a propeller in JSBSim's feet."""
    diameters = (x for x in propeller.iterfind("diameter") if "unit" not in x.attrib)
    with suppress(ValueError):
        return any(float(x.text or "") > WIDEST_PROPELLER for x in diameters)
    return False


def mend_engines(root: Element, folders: Sequence[Path], *, off: bool) -> None:
    """Add the unit to diameters of propellers, and remove the thrust of turbines that are `off`."""
    for holder in root.findall("propulsion//*[@file]"):
        file = found_file(holder.attrib["file"], folders, folders[0])
        if not os.path.isfile(file):  # JSBSim names the missing file
            continue
        part = read_xml(file, str(file))
        if part.tag == "propeller" and in_inches(part):
            for diameter in part.iterfind("diameter"):
                diameter.set("unit", "IN")
        elif part.tag == "turbine_engine" and off:
            # Without time steps JSBSim gives a turbine idle thrust.
            for thrust in part.iterfind("milthrust"):
                thrust.text = "0"
        else:
            continue
        del holder.attrib["file"]
        holder.insert(0, part)


def slow_actuators(root: Element) -> None:
    """Multiply the time constants of the surface actuators."""
    for name in SURFACE_ACTUATORS:
        lag = _only(root, f"system/channel/actuator[@name='{name}']/lag")
        lag.text = placeholder("actuator_rate", SURFACE_LAG)


def add_fault(root: Element, fault: Fault, config: AircraftConfig, file: Path) -> None:
    """Add properties for failures in flight to the main file."""
    system = _only(root, "system[@name='actuators']")
    channel = _only(system, "channel")
    values = {name: 1.0 for name in fault.factors if name != "actuator_lag"}
    for name in (name for name in AXES if name in fault.factors):
        scale_axis(root, name, file, f"{FAULT}{name}")
    if "actuator_lag" in fault.factors:
        for name in SURFACE_ACTUATORS:
            _only(channel, f"actuator[@name='{name}']/lag").text = f"{FAULT}actuator_rate"
        values["actuator_rate"] = SURFACE_LAG  # a start writes that of its aircraft
    if fault.V_a_bias_mps:
        values["V_a-bias"] = 0.0
        largest = _only(root, ".//fcs_function[@name='ft/V_a-mps']/function/max")
        largest[0] = node("sum", node("property", f"{FAULT}V_a-bias"), largest[0])
    ended = fault.ended_s is not None
    if "throttle" in fault.factors or ended:
        values.setdefault("throttle", 1.0)
        _loosen_throttle(channel)
    cut = ended and fault.ended_by == "cut"
    moved = [name for name, _ in config.surfaces.named()] if cut else []
    for name in dict.fromkeys([*fault.stuck, *moved]):
        surface = getattr(config.surfaces, name)
        if surface is None:
            raise InputError(f"`{name}_stuck_deg` must be left out: {config.file} has no {name}.")
        clip = _only(channel, f"actuator[@name='ft/{name}-rad']/clipto")
        for end, stop in zip(clip, surface.travel, strict=True):
            end.text = f"{FAULT}{name}-{end.tag}"
            values[f"{name}-{end.tag}"] = stop
    for name, value in values.items():
        system.insert(0, node("property", f"{FAULT}{name}", value=repr(value)))


def _loosen_throttle(channel: Element) -> None:
    """Put a factor between the throttle and the lever or engines."""
    throttle = _only(channel, "actuator[@name='ft/throttle-norm']")
    factors = (node("property", name) for name in (f"{FAULT}throttle", "ft/throttle-norm"))
    product = node("function", node("product", *factors))
    reaching = node("fcs_function", product, name=f"{FAULT}throttle-reaching")
    lever = channel.find("pure_gain[@name='ft/throttle-lever']")
    if lever is not None:
        _only(lever, "input").text = f"{FAULT}throttle-reaching"
    else:
        for output in throttle.findall("output"):
            throttle.remove(output)
            reaching.append(output)
    channel.insert(list(channel).index(throttle) + 1, reaching)


def _only(root: Element, path: str) -> Element:
    """The one element at a path of our own systems."""
    (element,) = root.iterfind(path)
    return element


def _inlined(holder: Element, folders: Sequence[Path]) -> Element:
    """Put the file that `holder` names into it, and return the inserted element."""
    name = holder.attrib.pop("file", None)
    if name is None:
        return holder[0]
    read = read_xml(found_file(name, folders, folders[0]), f"{folders[0]}")
    holder.insert(0, read)
    return read


def _multiply_function(function: Element, factor: str) -> None:
    (last,) = [i for i, part in enumerate(function) if part.tag not in _NOT_OPERATIONS][-1:]
    _multiply(function, last, factor)


def _multiply(parent: Element, i: int, factor: str) -> None:
    kind = "property" if factor.startswith(FAULT) else "value"
    parent[i] = node("product", node(kind, factor), parent[i])


_KG_M2 = SLUG * FT * FT
_INCHES = 12.0

# Position of each moment and product of inertia in the matrix.
INERTIAS = {
    "ixx": (0, 0),
    "iyy": (1, 1),
    "izz": (2, 2),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyz": (1, 2),
}

# Tolerance of the triangle inequality for rounding, as a share of the largest inertia.
_TRIANGLE = 1e-9


class Body(NamedTuple):
    """Weight (lbf), centre of gravity (ft: aft, right, up) and inertia about it (slug ft^2, body).

    The inertia is a tensor: its products have a minus sign.
    """

    weight: float
    cg: FloatArray
    inertia: FloatArray


class MassBalance(NamedTuple):
    """The mass of the whole aircraft in JSBSim, and its settable part."""

    # The aircraft with load and fuel, and without
    whole: Body
    empty: Body
    pounds_per_slug: float  # lbf of weight in a slug of mass, as JSBSim converts

    def values(self, off: OffNominal) -> dict[str, float]:
        """Numbers of the empty aircraft (lbf, in, slug ft^2) with which the whole meets `off`."""
        weight = off.mass_factor * self.whole.weight
        empty_weight = self.empty.weight + weight - self.whole.weight
        ballast = BALLAST * weight if off.slides else 0.0
        if not empty_weight > ballast:
            lowest = 1.0 - self.empty.weight / self.whole.weight
            raise InputError(
                f"`mass_factor` must be above {lowest:.3g}, what load and fuel weigh, "
                f"got {off.mass_factor:g}."
            )
        cg = self.whole.cg + np.array([1.0, 1.0, -1.0]) * off.cg_shift / FT
        # About one point (the nominal centre of gravity) moments and inertias add up. Load and fuel
        # are unchanged, and the empty aircraft makes up the difference.
        nominal, empty = self.whole.cg, self.empty
        load_moment = self.whole.weight * nominal - empty.weight * empty.cg
        load_inertia = self.whole.inertia - empty.inertia
        load_inertia = load_inertia - self._offset(empty.weight, empty.cg - nominal)
        empty_weight -= ballast
        load_moment = load_moment + ballast * cg
        load_inertia = load_inertia + self._offset(ballast, cg - nominal)
        empty_cg = (weight * cg - load_moment) / empty_weight
        inertia = self._inertia(off) + self._offset(weight, cg - nominal) - load_inertia
        inertia = inertia - self._offset(empty_weight, empty_cg - nominal)
        values = {name: float(inertia[place]) for name, place in INERTIAS.items()}
        # By default JSBSim inverts the signs of all three products; with the attribute set by
        # `open_mass_balance` only the sign of xz.
        values["ixz"] = -values["ixz"]
        for part, place in (("cg", empty_cg), ("ballast", cg)):
            names = (f"{part}_{axis}" for axis in "xyz")
            values |= dict(zip(names, (place * _INCHES).tolist(), strict=True))
        return {**values, "emptywt": empty_weight, "ballast": ballast}

    def _offset(self, weight: float, distance: FloatArray) -> FloatArray:
        """Inertia of a point at `distance` (ft: aft, right, up), body axes."""
        x = np.array([-1.0, 1.0, -1.0]) * distance
        return weight / self.pounds_per_slug * (x @ x * np.eye(3) - np.outer(x, x))

    def _inertia(self, off: OffNominal) -> FloatArray:
        """Inertia of the whole aircraft; refuses an impossible inertia."""
        scaled, factors = self.whole.inertia.copy(), off.inertia_factors
        for name, factor in factors.items():
            i, j = INERTIAS[name]
            scaled[i, j] = scaled[j, i] = factor * self.whole.inertia[i, j]
        least, middle, largest = np.linalg.eigvalsh(scaled)
        a, b, c = np.linalg.eigvalsh(self.whole.inertia)
        sum_needed = min(1.0, (a + b) / c)  # some original aircraft violate the inequality
        possible = least > 0.0 and least + middle >= (sum_needed - _TRIANGLE) * largest
        if factors and not possible:
            moments = ", ".join(f"{value * _KG_M2:.4g}" for value in (least, middle, largest))
            raise InputError(
                f"{' and '.join(f'`{name}_factor`' for name in factors)} must leave principal "
                "inertias of which none is larger than the two others together, got "
                f"{moments} kg m2."
            )
        return scaled


def open_mass_balance(root: Element, *, slides: bool = False) -> None:
    """Put placeholders for the mass of the empty aircraft and of the sliding part."""

    def location(name: str, part: str) -> Element:
        axes = (node(axis, placeholder(f"{part}_{axis}")) for axis in "xyz")
        return node("location", *axes, name=name, unit="IN")

    (balance,) = root.findall("mass_balance")
    for element in balance.findall("*"):
        if element.tag in (*INERTIAS, "emptywt", "location"):
            balance.remove(element)
    balance.set("negated_crossproduct_inertia", "false")
    balance.extend(node(name, placeholder(name), unit="SLUG*FT2") for name in INERTIAS)
    balance.append(node("emptywt", placeholder("emptywt"), unit="LBS"))
    balance.append(location("CG", "cg"))
    if slides:
        weight = node("weight", placeholder("ballast"), unit="LBS")
        balance.append(node("pointmass", weight, location("ballast", "ballast"), name="ballast"))
