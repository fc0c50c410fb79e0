"""The systems of ours in front of any model: the inner loop, and the actuators behind it."""

import math
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, fromstring

from flighttune.aircraft.aircraft import AircraftConfig, Surface

INNER_LOOP = Path(__file__).with_name("inner_loop.xml")

SURFACE_LAG, THROTTLE_LAG = 25.0, 5.0  # Bandwidth of the actuators, rad/s


def put_in_front(root: Element, config: AircraftConfig) -> None:
    """Put the inner loop and the actuators in front of the systems of a model.

    `root`: main file of the model. Its aerodynamics are changed where a surface `replaces` what
    they read.
    """
    inner_loop = fromstring(INNER_LOOP.read_text(encoding="utf-8"))
    # JSBSim runs the systems in the order of the file, and the flight control after them.
    first = next((i for i, element in enumerate(root) if element.tag == "system"), len(root))
    root[first:first] = [inner_loop, _actuators(config)]
    read = {variable for _, surface in config.surfaces.named() for variable in surface.replaces}
    read |= {name.removeprefix("ft/") for name in config.declared if name.startswith("ft/fcs/")}
    for element in root.iterfind("aerodynamics//*"):
        text = (element.text or "").strip()
        if text.lstrip("-") in read:
            element.text = text.replace("fcs/", "ft/fcs/", 1)


def _actuators(config: AircraftConfig) -> Element:
    system = Element("system", name="actuators")
    for name, value in config.declared.items():
        SubElement(system, "property", value=repr(value)).text = name
    channel = SubElement(system, "channel", name="actuators")
    for name, surface in config.surfaces.named():
        command = surface.command or f"fcs/{name}-cmd-norm"
        actuator = _actuator(name, "rad", SURFACE_LAG, tuple(map(repr, surface.travel)))
        channel.append(actuator)
        for replaced in surface.replaces:
            channel.append(_read(f"ft/{replaced}", name, surface))
        if surface.replaces:
            continue
        if command.endswith("-rad"):
            SubElement(actuator, "output").text = command
        else:
            function = _normed(f"ft/{name}-norm", name, surface)
            SubElement(function, "output").text = command
            channel.append(function)
    if config.surfaces.rudder is None:
        channel.append(_actuator("rudder", "rad", SURFACE_LAG, ("0", "0")))
    throttle = _actuator("throttle", "norm", THROTTLE_LAG, ("0", "ft/limits/throttle-max"))
    channel.append(throttle)
    if config.engines.full != 1.0:
        throttle = SubElement(channel, "pure_gain", name="ft/throttle-lever")
        SubElement(throttle, "input").text = "ft/throttle-norm"
        SubElement(throttle, "gain").text = repr(config.engines.full)
    for i in range(config.engines.count):
        SubElement(throttle, "output").text = f"{config.engines.command}[{i}]"
    for i, (name, source) in enumerate(config.linked.items()):
        link = SubElement(channel, "pure_gain", name=f"ft/link-{i}")
        SubElement(link, "input").text = source
        SubElement(link, "gain").text = "1"
        SubElement(link, "output").text = name
    return system


def _actuator(name: str, unit: str, lag: float, stops: tuple[str, ...]) -> Element:
    actuator = Element("actuator", name=f"ft/{name}-{unit}")
    SubElement(actuator, "input").text = f"ft/{name}-cmd-{unit}"
    SubElement(actuator, "lag").text = repr(lag)
    clip = SubElement(actuator, "clipto")
    for tag, stop in zip(("min", "max"), stops, strict=True):
        SubElement(clip, tag).text = stop
    return actuator


def _normed(function: str, name: str, surface: Surface) -> Element:
    """The command that brings a surface to the position of its actuator."""
    low, high = surface.travel if surface.full is None else surface.full
    element = Element("fcs_function", name=function)
    choice = SubElement(SubElement(element, "function"), "ifthen")
    position = f"ft/{name}-rad"
    below = SubElement(choice, "lt")
    SubElement(below, "property").text = position
    SubElement(below, "value").text = "0"
    for full in (-low, high) if low < high else (high, -low):
        quotient = SubElement(choice, "quotient")
        SubElement(quotient, "property").text = position
        SubElement(quotient, "value").text = repr(full)
    return element


def _read(function: str, name: str, surface: Surface) -> Element:
    """Variables that the aerodynamics read instead of a position that flight control commands."""
    if function.endswith("-norm"):
        return _normed(function, name, surface)
    low, high = surface.travel if surface.full is None else surface.full
    unit = math.degrees(1.0) if function.endswith("-deg") else 1.0
    element = Element("fcs_function", name=function)
    product = SubElement(SubElement(element, "function"), "product")
    SubElement(product, "value").text = repr(math.copysign(unit, high - low))
    size = SubElement(product, "abs") if "/mag-" in function else product
    SubElement(size, "property").text = f"ft/{name}-rad"
    return element
