"""Where factors go in the main file of an aircraft: aerodynamics, engines, surface actuators."""

import difflib
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from flighttune.errors import InputError
from flighttune.plants.jsbsim.model_text import Sources, placeholder

AXES = {
    "lift": "LIFT", "drag": "DRAG", "side_force": "SIDE",
    "roll_moment": "ROLL", "pitch_moment": "PITCH", "yaw_moment": "YAW",
}  # fmt: skip
"""JSBSim's axis for each factor on aerodynamics as a whole."""

SURFACE_ACTUATORS = tuple(f"fcs/{name}-actuator" for name in ("aileron", "elevator", "rudder"))
"""Names by which the inner loop knows the actuators of the surfaces."""

COEFFICIENT = "coefficient "
"""What the placeholder of a factor on a single function begins with."""

_THRUST_OF = {"electric_engine": ("power",), "turbine_engine": ("milthrust", "maxthrust")}
"""Numbers proportional to the thrust of engines that push without a propeller."""

_NOT_OPERATIONS = ("description", "documentation")


def scale_axis(root: Element, key: str, file: Path) -> None:
    """Multiply every function of the axis that belongs to `key`.

    Parameters
    ----------
    root : Element
        Main file of the aircraft.
    key : str
        One of `AXES`; the factor is its placeholder.
    file : path
        Where the main file stands.

    Raises
    ------
    InputError
        If the aircraft has no such axis.
    """
    axes = root.findall("aerodynamics/axis")
    functions = [f for axis in axes if axis.get("name") == AXES[key] for f in axis.iter("function")]
    if not functions:
        names = ", ".join(dict.fromkeys(axis.get("name", "?") for axis in axes))
        raise InputError(
            f"`{key}_factor` must be left out: {file} has no {AXES[key]} axis, only {names}."
        )
    for function in functions:
        _multiply_function(function, placeholder(key))


def scale_coefficient(root: Element, name: str, file: Path) -> None:
    """Multiply the one aerodynamic function, or named part of one, that is called `name`.

    Parameters
    ----------
    root : Element
        Main file of the aircraft.
    name : str
        Name in the file, or its part behind the last slash.
    file : path
        Where the main file stands.

    Raises
    ------
    InputError
        If there is none or more than one.
    """
    named = list(_named(root))
    found = [one for one in named if name in (one[2], one[2].rpartition("/")[2])]
    if len(found) != 1:
        raise InputError(f"`coefficient_factors.{name}` must be {_one_of(name, named, file)}")
    parent, i, _ = found[0]
    if parent[i].tag == "function":
        _multiply_function(parent[i], placeholder(f"{COEFFICIENT}{name}"))
    else:
        _multiply(parent, i, placeholder(f"{COEFFICIENT}{name}"))


def scale_thrust(root: Element, engines: Path, sources: Sources, file: Path) -> None:
    """Multiply the thrust of every engine: of its propeller, or of what pushes directly.

    Parameters
    ----------
    root : Element
        Main file of the aircraft; the files of engines and thrusters are put into it.
    engines : path
        Folder of those.
    sources : Sources
        Takes note of them.
    file : path
        Where the main file stands.

    Raises
    ------
    InputError
        If it is not known how.
    PlantError
        If the file of an engine or thruster cannot be read.
    """
    for engine in root.iterfind("propulsion/engine"):
        motor = _inlined(engine, engines, sources)
        thruster = engine.find("thruster")
        thruster_kind = None if thruster is None else _inlined(thruster, engines, sources)
        if thruster_kind is not None and thruster_kind.tag == "propeller":
            factor = thruster_kind.find("ct_factor")
            if factor is None:
                factor = SubElement(thruster_kind, "ct_factor")
                factor.text = "1"
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


def slow_actuators(root: Element, systems: Path, sources: Sources, file: Path) -> None:
    """Multiply the time constants of the surface actuators.

    Parameters
    ----------
    root : Element
        Main file of the aircraft; systems with such an actuator are put into it.
    systems : path
        Folder of those.
    sources : Sources
        Takes note of them.
    file : path
        Where the main file stands.

    Raises
    ------
    InputError
        If none of them has a lag.
    PlantError
        If the file of a system cannot be read.
    """
    for i, system in enumerate(root):
        if system.tag == "system" and system.get("file"):
            read = sources.root(_file(systems, system.get("file", "")), str(file))
            if list(_lags(read)):
                root[i] = read
    lags = list(_lags(root))
    if not lags:
        raise InputError(
            f"`actuator_lag_factor` must be left out: {file} gives none of "
            f"{', '.join(SURFACE_ACTUATORS)} a number for its <lag>."
        )
    for lag in lags:
        lag.text = placeholder("actuator_rate", float(lag.text or 0.0))


def _lags(root: Element) -> Iterator[Element]:
    for actuator in root.iter("actuator"):
        lag = actuator.find("lag")
        if actuator.get("name") in SURFACE_ACTUATORS and lag is not None and _is_number(lag.text):
            yield lag


def _is_number(text: str | None) -> bool:
    try:
        return text is not None and bool(float(text))
    except ValueError:
        return False


def _named(root: Element) -> Iterator[tuple[Element, int, str]]:
    """Parent, place and name of everything in the aerodynamics that has a name and a value."""
    for aerodynamics in root.iterfind("aerodynamics"):
        for parent in aerodynamics.iter():
            for i, child in enumerate(parent):
                name = child.get("name")
                if name and child.tag != "axis":
                    yield parent, i, name.strip()


def _one_of(name: str, named: list[tuple[Element, int, str]], file: Path) -> str:
    names = [full for _, _, full in named]
    meant = [full for full in names if full.rpartition("/")[2] == name]
    if meant:
        return f"one function of {file}: it means {', '.join(meant)}."
    short = {full.rpartition("/")[2]: full for full in names}
    close = difflib.get_close_matches(name, short, n=1)
    hint = f"did you mean `{close[0]}`?" if close else f"it has {', '.join(list(short))}."
    return f"a named aerodynamic function of {file}; {hint}"


def _inlined(holder: Element, folder: Path, sources: Sources) -> Element:
    """Put the file that `holder` names into it, and return what was in that file."""
    name = holder.attrib.pop("file", None)
    if name is None:
        return holder[0]
    read = sources.root(_file(folder, name), str(folder))
    holder.insert(0, read)
    return read


def _file(folder: Path, name: str) -> Path:
    path = folder / name
    return path if path.suffix == ".xml" else path.with_name(f"{path.name}.xml")


def _multiply_function(function: Element, factor: str) -> None:
    (last,) = [i for i, part in enumerate(function) if part.tag not in _NOT_OPERATIONS][-1:]
    _multiply(function, last, factor)


def _multiply(parent: Element, i: int, factor: str) -> None:
    product = Element("product")
    SubElement(product, "value").text = factor
    product.append(parent[i])
    parent[i] = product
