# SPDX-License-Identifier: LGPL-2.1-or-later
"""Components of flight control: FGFCS with its channels."""

import math
import operator
from collections.abc import Callable
from functools import reduce
from typing import Any, TypeAlias
from xml.etree.ElementTree import Element

from flighttune.vehicles.compiled.functions import (
    as_number,
    function,
    number,
    prop,
    table,
    value_or_property,
)
from flighttune.vehicles.compiled.properties import Properties, Unsupported, canonical
from flighttune.vehicles.compiled.trace import (
    Number,
    Truth,
    constrained,
    different,
    equal,
    fabs,
    lookup,
    segment,
    select,
)

# JSBSim runs its systems in this order, whatever that in the file.
SYSTEMS = ("system", "autopilot", "flight_control")

# Size of a trigger that counts as zero.
ZERO_TRIGGER = 0.000001

_ROUNDOFF = 2.0 * 2.220446049250313e-16

# Most detents that a part passes in one step.
_PASSED = 3

Component: TypeAlias = Callable[[Properties, Element, float], Number]


def name_of(element: Element) -> str:
    """The property of a component."""
    name = (element.get("name") or "").strip()
    return canonical(name if "/" in name else "fcs/" + name.lower().replace(" ", "-"))


def outputs_of(element: Element) -> list[str]:
    """Properties that a component writes."""
    return [
        name_of(element),
        *(canonical(output.text or "") for output in element.findall("output")),
    ]


def inputs_of(element: Element) -> list[str]:
    """Properties that a component reads, with their signs."""
    return [(part.text or "").strip() for part in element.findall("input")]


def systems_of(root: Element) -> list[Element]:
    """The systems of a model in the order in which they run."""
    return sorted(
        (element for element in root if element.tag in SYSTEMS),
        key=lambda element: SYSTEMS.index(element.tag),
    )


def written_by_channels(root: Element) -> set[str]:
    """Properties that some component writes."""
    components = (part for part in root.iterfind(".//channel/*") if part.get("name"))
    return {name for part in components for name in outputs_of(part)}


def run_channels(now: Properties, root: Element, dt: float) -> None:
    """Every component of every channel."""
    written = written_by_channels(root)
    for system in systems_of(root):
        for channel in system.findall("channel"):
            if channel.get("execute"):
                raise Unsupported("a channel with `execute`")
            for element in channel:
                _run(now, element, dt, written)


def _run(now: Properties, element: Element, dt: float, written: set[str]) -> None:
    if element.tag in ("documentation", "description"):
        return
    if element.tag not in _COMPONENTS:
        raise Unsupported(f"the component <{element.tag}>")
    if element.tag == "kinematic" and inputs_of(element)[0].lstrip("-") not in written:
        # Nothing moves its command in flight: it stays where the trim put it.
        y = now[_first_output(element)]
    else:
        y = _COMPONENTS[element.tag](now, element, dt)
    y = _clipped(now, element, y)
    for name in reversed(outputs_of(element)):
        now[name] = y


def _first_output(element: Element) -> str:
    return outputs_of(element)[1] if element.find("output") is not None else name_of(element)


def _text(element: Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _parameter(now: Properties, element: Element, tag: str, default: Number = 0.0) -> Number:
    """The number or property in a part of a component."""
    part = element.find(tag)
    return default if part is None else value_or_property(now, part.text or "")


def _bounds(now: Properties, element: Element) -> tuple[Number, Number] | None:
    clip = element.find("clipto")
    if clip is None:
        return None
    if clip.get("type") == "cyclic":
        raise Unsupported("a cyclic clip")
    return _parameter(now, clip, "min"), _parameter(now, clip, "max")


def _clipped(now: Properties, element: Element, x: Number) -> Number:
    bounds = _bounds(now, element)
    if bounds is None:
        return x
    low, high = bounds
    y = constrained(low, x, high)
    if element.tag == "actuator":
        at_stop = ((y >= high) & different(high, 0.0)) | ((y <= low) & different(low, 0.0))
        now[f"{name_of(element)}/saturated"] = as_number(at_stop)
    return y


def _only_known(element: Element, *known: str) -> None:
    unknown = {part.tag for part in element} - {*known, "input", "output", "clipto"}
    if unknown := unknown - {"documentation", "description"}:
        raise Unsupported(f"<{min(unknown)}> in <{element.tag}>")


def _fcs_function(now: Properties, element: Element, dt: float) -> Number:
    (part,) = element.findall("function")
    y = function(now, part)
    sources = inputs_of(element)
    return y * prop(now, sources[0]) if sources else y


def _summer(now: Properties, element: Element, dt: float) -> Number:
    start: Number = 0.0
    total = reduce(operator.add, (prop(now, name) for name in inputs_of(element)), start)
    return total + number(now, _text(element, "bias") or "0")


def _pure_gain(now: Properties, element: Element, dt: float) -> Number:
    return _parameter(now, element, "gain", 1.0) * prop(now, inputs_of(element)[0])


def _scheduled_gain(now: Properties, element: Element, dt: float) -> Number:
    (scheduled,) = element.findall("table")
    gain = _parameter(now, element, "gain", 1.0) * table(now, scheduled)
    return gain * prop(now, inputs_of(element)[0])


def _aerosurface_scale(now: Properties, element: Element, dt: float) -> Number:
    x = prop(now, inputs_of(element)[0])

    def limits(tag: str) -> tuple[Number, Number]:
        part = element.find(tag)
        if part is None:
            return -1.0, 1.0
        return number(now, _text(part, "min") or "-1"), number(now, _text(part, "max") or "1")

    (in_min, in_max), (out_min, out_max) = limits("domain"), limits("range")
    if _text(element, "zero_centered") not in ("0", "false"):
        above, below = (x / in_max) * out_max, (x / in_min) * out_min
        y = select(equal(x, 0.0), 0.0, select(x > 0.0, above, below))
    else:
        y = out_min + ((x - in_min) / (in_max - in_min)) * (out_max - out_min)
    return y * _parameter(now, element, "gain", 1.0)


def _sensor(now: Properties, element: Element, dt: float) -> Number:
    _only_known(element, "delay")
    x, name = prop(now, inputs_of(element)[0]), name_of(element)
    frames = int(float(_text(element, "delay") or "0") / dt)
    # A ring of so many places is read behind the place just written: it delays by one step less.
    if frames < 2:
        return x
    old = [now[f"_delay{k}:{name}"] for k in range(1, frames)]
    for k, value in enumerate([x, *old[:-1]], 1):
        now[f"_delay{k}:{name}"] = value
    return old[-1]


def _deadband(now: Properties, element: Element, dt: float) -> Number:
    half = 0.5 * _parameter(now, element, "width")
    x, gain = prop(now, inputs_of(element)[0]), number(now, _text(element, "gain") or "1")
    inside = select(x > half, (x - half) * gain, 0.0)
    return select(x < -half, (x + half) * gain, inside)


def _actuator(now: Properties, element: Element, dt: float) -> Number:
    _only_known(element, "lag", "rate_limit", "bias")
    x, name = prop(now, inputs_of(element)[0]), name_of(element)
    if element.find("lag") is not None:
        lag = _parameter(now, element, "lag")
        denominator = 2.00 + dt * lag
        a, b = dt * lag / denominator, (2.00 - dt * lag) / denominator
        y = a * (x + now[f"_lag-in:{name}"]) + now[f"_lag-out:{name}"] * b
        now[f"_lag-in:{name}"], now[f"_lag-out:{name}"] = x, y
        x = y
    if element.find("rate_limit") is not None:
        x = _rate_limited(now, element, x, dt)
    return x + number(now, _text(element, "bias") or "0")


def _rate_limited(now: Properties, element: Element, x: Number, dt: float) -> Number:
    up: Number | None = None
    down: Number | None = None
    for part in element.findall("rate_limit"):
        limit, sense = value_or_property(now, part.text or ""), part.get("sense", "")[:4]
        up = up if sense == "decr" else limit
        down = down if sense == "incr" else limit
    name = f"_rate:{name_of(element)}"
    before = now[name]
    delta, y = x - before, x
    if up is not None:
        y = select(delta > dt * up, before + up * dt, y)
    if down is not None:
        y = select(delta < dt * -down, before + -down * dt, y)
    now[name] = y
    return y


def integrator_kind(element: Element) -> str:
    """The rule by which a component integrates; empty if it does not."""
    part = element.find("ki" if element.tag == "pid" else "c1")
    if part is None:
        return ""
    return part.get("type") or ("ab2" if element.tag == "pid" else "trap")


def integrand(kind: str, x: Any, before: Any) -> Any:
    """What an integrator adds up in a step."""
    if kind == "ab2":
        return 1.5 * x - 0.5 * before
    if kind not in ("", "rect", "trap"):
        raise Unsupported(f'an integrator of type "{kind}"')
    return {"": 0.0, "rect": x, "trap": 0.5 * (x + before)}[kind]


def _pid(now: Properties, element: Element, dt: float) -> Number:
    if element.find("pvdot") is not None or element.get("type") == "standard":
        raise Unsupported("a <pid> with `pvdot` or of the standard type")
    name, kind = name_of(element), integrator_kind(element)
    x, before = prop(now, inputs_of(element)[0]), now[f"_in:{name}"]
    delta, total = integrand(kind, x, before), now[f"_sum:{name}"]
    if trigger := _text(element, "trigger"):
        test = prop(now, trigger)
        delta = select(fabs(test) < ZERO_TRIGGER, delta, 0.0)
        total = select(test < 0.0, 0.0, total)
    gain = _parameter(now, element, "ki" if element.tag == "pid" else "c1")
    total = total + gain * dt * delta
    damped = _parameter(now, element, "kd") * ((x - before) / dt)
    now[f"_sum:{name}"], now[f"_in:{name}"] = total, x
    return _parameter(now, element, "kp") * x + total + damped


def _kinematic(now: Properties, element: Element, dt: float) -> Number:
    """A part that goes from detent to detent at the rates between them."""
    settings = element.findall("traverse/setting")
    detents = [float(_text(setting, "position")) for setting in settings]
    times = [float(_text(setting, "time")) for setting in settings]
    y, x = now[_first_output(element)], prop(now, inputs_of(element)[0])
    if element.find("noscale") is None:
        x = x * detents[-1]
    x = constrained(detents[0], x, detents[-1])
    left: Number = dt
    for _ in range(min(_PASSED, len(detents) - 1)):
        y, left = _moved(detents, times, x, y, left)
    return y


def _moved(
    detents: list[float], times: list[float], x: Number, y: Number, left: Number
) -> tuple[Number, Number]:
    """The place after moving between two detents, and the time of the step that is left."""
    a, b = fabs(x), fabs(y)
    moving: Truth = fabs(x - y) > _ROUNDOFF * select(a < b, b, a)
    moving = moving & (left > 0.0)
    down = x < y
    up_to = [detents[0], *(math.nextafter(d, -math.inf) for d in detents[1:-1]), detents[-1]]
    i, j = segment(detents, y), segment(up_to, y)

    def at(values: list[float], by: int) -> Number:
        return select(down, lookup(values, i, by), lookup(values, j, by))

    low, high, time = at(detents, 0), at(detents, 1), at(times, 1)
    rate = (high - low) / time
    goal = constrained(low, x, high)
    needed = fabs((goal - y) / rate)
    short = left < needed
    part = select(y < x, y + left * rate, y - left * rate)
    reached = select(time <= 0.0, x, select(short, part, goal))
    spent = select(time <= 0.0, left, select(short, left, needed))
    return select(moving, reached, y), select(moving, left - spent, left)


def _first_order(now: Properties, element: Element, dt: float) -> Number:
    name, c = name_of(element), [number(now, _text(element, f"c{k}") or "0") for k in range(7)]
    x, before, y = prop(now, inputs_of(element)[0]), now[f"_in:{name}"], now[f"_out:{name}"]
    if element.tag == "lag_filter":
        denominator = 2.00 + dt * c[1]
        a, b = dt * c[1] / denominator, (2.00 - dt * c[1]) / denominator
        y = x * a + before * a + y * b
    elif element.tag == "washout_filter":
        denominator = 2.00 + dt * c[1]
        a, b = 2.00 / denominator, (2.00 - dt * c[1]) / denominator
        y = x * a - before * a + y * b
    else:
        denominator = 2.00 * c[3] + dt * c[4]
        a = (2.00 * c[1] + dt * c[2]) / denominator
        b = (dt * c[2] - 2.00 * c[1]) / denominator
        y = x * a + before * b + y * ((2.00 * c[3] - dt * c[4]) / denominator)
    now[f"_in:{name}"], now[f"_out:{name}"] = x, y
    return y


_COMPARISONS: dict[str, Callable[[Number, Number], Truth]] = {
    **dict.fromkeys(("EQ", "=="), equal),
    **dict.fromkeys(("NE", "!="), different),
    **dict.fromkeys(("GT", ">"), operator.gt),
    **dict.fromkeys(("GE", ">="), operator.ge),
    **dict.fromkeys(("LT", "<"), operator.lt),
    **dict.fromkeys(("LE", "<="), operator.le),
}


def _condition(now: Properties, element: Element) -> Truth:
    parts = [_condition(now, part) for part in element if part.tag == element.tag]
    texts = (text for text in (element.text, *(part.tail for part in element)) if text)
    for line in (line.strip() for text in texts for line in text.splitlines() if line.strip()):
        a, relation, b = line.split()
        compare = _COMPARISONS[relation.upper()]
        parts.append(compare(prop(now, a), value_or_property(now, b)))
    if element.get("logic", "AND") == "OR":
        return reduce(operator.or_, parts, False)
    return reduce(operator.and_, parts, True)


def _switch(now: Properties, element: Element, dt: float) -> Number:
    """The value of the first test that holds, or the default."""
    if element.find("delay") is not None:
        raise Unsupported("a <switch> with a delay")
    default = element.find("default")
    y = 0.0 if default is None else value_or_property(now, default.get("value", ""))
    for test in reversed(element.findall("test")):
        y = select(_condition(now, test), value_or_property(now, test.get("value", "")), y)
    return y


_COMPONENTS: dict[str, Component] = {
    "fcs_function": _fcs_function,
    "summer": _summer,
    "pure_gain": _pure_gain,
    "scheduled_gain": _scheduled_gain,
    "aerosurface_scale": _aerosurface_scale,
    "sensor": _sensor,
    "deadband": _deadband,
    "actuator": _actuator,
    "pid": _pid,
    "integrator": _pid,
    "kinematic": _kinematic,
    "lag_filter": _first_order,
    "washout_filter": _first_order,
    "lead_lag_filter": _first_order,
    "switch": _switch,
}
