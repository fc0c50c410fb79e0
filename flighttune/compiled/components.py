# SPDX-License-Identifier: LGPL-2.1-or-later
"""Components of flight control: FGFCS with its channels."""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, TypeAlias
from xml.etree.ElementTree import Element

from flighttune.compiled.functions import (
    as_number,
    function,
    number,
    prop,
    table,
    value_or_property,
)
from flighttune.compiled.properties import Properties, Unsupported, canonical
from flighttune.compiled.trace import (
    Number,
    Truth,
    call,
    constrained,
    cos,
    different,
    equal,
    fabs,
    largest,
    least,
    lookup,
    negated,
    segment,
    select,
    sin,
)

# JSBSim runs its systems in this order, whatever their order in the file.
SYSTEMS = ("system", "autopilot", "flight_control")

# Size of a trigger that counts as zero.
ZERO_TRIGGER = 0.000001

_ROUNDOFF = 2.0 * 2.220446049250313e-16

# Most detents that a part passes in one step.
_PASSED = 3

_NO_PARTS = ("documentation", "description")

FILTERS = ("lag_filter", "washout_filter", "lead_lag_filter", "second_order_filter")

# A degree, in the digits of JSBSim's component for angles.
_DEGREE = 0.017453293


def name_of(element: Element) -> str:
    """The property of a component."""
    name = (element.get("name") or "").strip()
    return canonical(name if "/" in name else "fcs/" + name.lower().replace(" ", "-"))


def outputs_of(element: Element) -> list[str]:
    """Properties that a component writes, its own last."""
    further = (canonical(output.text or "") for output in element.findall("output"))
    return [*further, name_of(element)]


def inputs_of(element: Element) -> list[str]:
    """Properties that a component reads, with their signs."""
    return [(part.text or "").strip() for part in element.findall("input")]


def systems_of(root: Element) -> list[Element]:
    """The systems of a model in the order in which they run."""
    return sorted(
        (element for element in root if element.tag in SYSTEMS),
        key=lambda element: SYSTEMS.index(element.tag),
    )


def execution_rate(channel: Element) -> int:
    """Steps from one run of a channel to the next."""
    return max(1, int(float(channel.get("execrate") or 1)))


def channels_of(root: Element) -> list[Element]:
    """All channels in the order in which they run."""
    return [channel for system in systems_of(root) for channel in system.findall("channel")]


def delay_of(element: Element, dt: float) -> int:
    """Runs by which the output of a component is late; `dt` (s): time from run to run."""
    part = element.find("delay")
    if part is None:
        return 0
    frames = float(part.text or "0")
    if part.get("type", "time") != "frames":
        frames = frames / dt
    # A ring of so many places is read behind the place just written: one run less.
    return max(0, int(frames) - 1)


def written_by_channels(root: Element) -> set[str]:
    """Properties that some component writes."""
    components = (part for part in root.iterfind(".//channel/*") if part.get("name"))
    return {name for part in components for name in outputs_of(part)}


@dataclass(frozen=True)
class Part:
    """A component in its channel, at a step."""

    now: Properties
    element: Element
    dt: float  # from one run of its channel to the next, s

    @property
    def name(self) -> str:
        """Its property."""
        return name_of(self.element)

    @property
    def x(self) -> Number:
        """Its first input."""
        return prop(self.now, inputs_of(self.element)[0])

    def has(self, tag: str) -> bool:
        """Whether it has a part of a name."""
        return self.element.find(tag) is not None

    def text(self, tag: str) -> str:
        """Text of a part; empty if there is none."""
        return (self.element.findtext(tag) or "").strip()

    def number(self, tag: str, default: float = 0.0) -> Number:
        """The number in a part."""
        return number(self.now, self.text(tag)) if self.text(tag) else default

    def parameter(self, tag: str, default: Number = 0.0) -> Number:
        """The number or property in a part."""
        return value_or_property(self.now, self.text(tag)) if self.has(tag) else default

    def memory(self, kind: str) -> str:
        """The name of what the component remembers from step to step."""
        return f"_{kind}:{self.name}"

    def lagged(self, x: Number, lag: Number) -> Number:
        """A lag of first order, by the trapezoidal rule."""
        a, b = _lag_coefficients(self.dt, lag)
        before, last = self.memory("lag-in"), self.memory("lag-out")
        if self.now.trimming and self.element.tag == "actuator":
            self.now[before] = self.now[last] = x
            return x
        y = a * (x + self.now[before]) + self.now[last] * b
        self.now[before], self.now[last] = x, y
        return y

    def delayed(self, x: Number) -> Number:
        """A value some runs later."""
        names = [self.memory(f"delay{k}") for k in range(1, delay_of(self.element, self.dt) + 1)]
        if not names:
            return x
        if self.now.trimming:
            self.now.put(names, [x] * len(names))
            return x
        old = [self.now[name] for name in names]
        for name, value in zip(names, [x, *old[:-1]], strict=True):
            self.now[name] = value
        return old[-1]

    def only_known(self, *known: str) -> None:
        """Refuse parts that the compiled step does not know."""
        further = {*known, "input", "output", "clipto", *_NO_PARTS}
        if unknown := {part.tag for part in self.element} - further:
            raise Unsupported(f"<{min(unknown)}> in <{self.element.tag}>")


def _lag_coefficients(dt: float, lag: Number) -> tuple[Number, Number]:
    denominator = 2.00 + dt * lag
    return dt * lag / denominator, (2.00 - dt * lag) / denominator


Component: TypeAlias = Callable[[Part], Number]


def run_channels(now: Properties, root: Element) -> None:
    """Every component of every channel."""
    written = written_by_channels(root)
    for n, channel in enumerate(channels_of(root)):
        switch, rate = channel.get("execute"), execution_rate(channel)
        runs: Truth = different(prop(now, switch), 0.0) if switch else True
        if rate > 1 and not now.trimming:
            # It runs in the last of so many steps.
            count = now[f"_frames{n}"]
            count = select(count >= rate, 0.0, count) + 1.0
            now[f"_frames{n}"] = select(runs, count, now[f"_frames{n}"])
            runs = runs & (count >= rate)
        before = dict(now.now)
        for element in channel:
            _run(Part(now, element, now.dt * rate), written)
        if not isinstance(runs, bool):
            now.keep_unless(runs, before)


def _run(part: Part, written: set[str]) -> None:
    now, element = part.now, part.element
    if element.tag in _NO_PARTS:
        return
    if element.tag == "distributor":
        _distribute(part)
        return
    if element.tag not in _COMPONENTS:
        raise Unsupported(f"the component <{element.tag}>")
    names, in_flight = outputs_of(element), not now.trimming
    if (
        element.tag == "kinematic"
        and in_flight
        and inputs_of(element)[0].lstrip("-") not in written
    ):
        # Nothing moves its command in flight: it stays where the trim put it.
        y = now[names[0]]
    else:
        y = _COMPONENTS[element.tag](part)
    y = _clipped(part, y)
    for name in names:
        now[name] = y


def _clipped(part: Part, x: Number) -> Number:
    clip = part.element.find("clipto")
    if clip is None or clip.find("min") is None or clip.find("max") is None:
        return x
    low, high = (value_or_property(part.now, clip.findtext(end) or "") for end in ("min", "max"))
    if clip.get("type") == "cyclic":
        y = call("fmod", x - low, high - low) + low
        return select(y < low, y + (high - low), y)
    # Bounds in the wrong order are no bounds.
    y = select(high - low < 0.0, x, constrained(low, x, high))
    if part.element.tag == "actuator":
        at_stop = ((y >= high) & different(high, 0.0)) | ((y <= low) & different(low, 0.0))
        part.now[f"{part.name}/saturated"] = as_number(at_stop)
    return y


def _fcs_function(part: Part) -> Number:
    (operation,) = part.element.findall("function")
    y = function(part.now, operation)
    return y * part.x if inputs_of(part.element) else y


def _summer(part: Part) -> Number:
    start: Number = 0.0
    inputs = (prop(part.now, name) for name in inputs_of(part.element))
    return reduce(operator.add, inputs, start) + part.number("bias")


def _pure_gain(part: Part) -> Number:
    return part.parameter("gain", 1.0) * part.x


def _scheduled_gain(part: Part) -> Number:
    (scheduled,) = part.element.findall("table")
    return part.parameter("gain", 1.0) * table(part.now, scheduled) * part.x


def _aerosurface_scale(part: Part) -> Number:
    x = part.x

    def limits(tag: str) -> tuple[Number, Number]:
        of = part.element.find(tag)
        if of is None or of.find("min") is None or of.find("max") is None:
            return -1.0, 1.0
        low, high = (number(part.now, of.findtext(end) or "") for end in ("min", "max"))
        return low, high

    (in_min, in_max), (out_min, out_max) = limits("domain"), limits("range")
    if part.text("zero_centered") not in ("0", "false"):
        above, below = (x / in_max) * out_max, (x / in_min) * out_min
        y = select(equal(x, 0.0), 0.0, select(x > 0.0, above, below))
    else:
        y = out_min + ((x - in_min) / (in_max - in_min)) * (out_max - out_min)
    return y * part.parameter("gain", 1.0)


def _sensor(part: Part) -> Number:
    part.only_known("lag", "gain", "bias", "delay", "quantization")
    x = part.x
    if part.has("lag"):
        x = part.lagged(x, part.number("lag"))
    if part.has("gain"):
        x = x * part.number("gain")
    x = part.delayed(x + part.number("bias"))
    quantization = part.element.find("quantization")
    if quantization is None:
        return x
    low, high, bits = (float(quantization.findtext(tag) or 0) for tag in ("min", "max", "bits"))
    if not bits:
        return x
    grain = (high - low) / 2 ** int(bits)
    x = select(x < low, low, x)
    x = select(x > high, high, x)
    return call("trunc", (x - low) / grain) * grain + low


def _deadband(part: Part) -> Number:
    half, x, gain = 0.5 * part.parameter("width"), part.x, part.number("gain", 1.0)
    inside = select(x > half, (x - half) * gain, 0.0)
    return select(x < -half, (x + half) * gain, inside)


def _actuator(part: Part) -> Number:
    part.only_known("lag", "rate_limit", "deadband_width", "hysteresis_width", "bias", "delay")
    x = part.x
    if part.has("lag"):
        x = part.lagged(x, part.parameter("lag"))
    if part.has("rate_limit"):
        x = _rate_limited(part, x)
    if part.has("deadband_width"):
        half = part.number("deadband_width") / 2.0
        x = select(x < -half, x + half, select(x > half, x - half, 0.0))
    if part.has("hysteresis_width"):
        x = _with_hysteresis(part, x)
    return part.delayed(x + part.number("bias"))


def _rate_limited(part: Part, x: Number) -> Number:
    up: Number | None = None
    down: Number | None = None
    for limit in part.element.findall("rate_limit"):
        value, sense = value_or_property(part.now, limit.text or ""), limit.get("sense", "")[:4]
        up = up if sense == "decr" else value
        down = down if sense == "incr" else value
    name, dt = part.memory("rate"), part.dt
    if part.now.trimming:
        part.now[name] = x
        return x
    before = part.now[name]
    delta, y = x - before, x
    if up is not None:
        y = select(delta > dt * up, before + up * dt, y)
    if down is not None:
        y = select(delta < dt * -down, before + -down * dt, y)
    part.now[name] = y
    return y


def _with_hysteresis(part: Part, x: Number) -> Number:
    name, half = part.memory("hysteresis"), 0.5 * part.number("hysteresis_width")
    if part.now.trimming:
        part.now[name] = x
        return x
    before = part.now[name]
    falling = select(x < before, least(before, x + half), x)
    y = select(x > before, largest(before, x - half), falling)
    part.now[name] = y
    return y


def integrator_kind(element: Element) -> str:
    """The rule by which a component integrates; empty if it does not."""
    part = element.find("ki" if element.tag == "pid" else "c1")
    if part is None:
        return ""
    return part.get("type") or ("ab2" if element.tag == "pid" else "trap")


def integrand(kind: str, x: Any, before: Any, earlier: Any = 0.0) -> Any:
    """Increment of an integrator in a step, from its input now and in the previous steps."""
    if kind == "rect":
        return x
    if kind == "trap":
        return 0.5 * (x + before)
    if kind == "ab3":
        return (23.0 * x - 16.0 * before + 5.0 * earlier) / 12.0
    # Any other name stands for the second rule of Adams and Bashforth.
    return 1.5 * x - 0.5 * before if kind else 0.0


def _pid(part: Part) -> Number:
    now, kind = part.now, integrator_kind(part.element)
    third = kind == "ab3"
    x, before = part.x, now[part.memory("in")]
    earlier = now[part.memory("in2")] if third else 0.0
    slope = prop(now, part.text("pvdot")) if part.has("pvdot") else (x - before) / part.dt
    delta, total = integrand(kind, x, before, earlier), now[part.memory("sum")]
    if trigger := part.text("trigger"):
        test = prop(now, trigger)
        delta = select(fabs(test) < ZERO_TRIGGER, delta, 0.0)
        total = select(test < 0.0, 0.0, total)
        earlier = select(test < 0.0, 0.0, before)
    else:
        earlier = before
    if third:
        now[part.memory("in2")] = earlier
    gain = part.parameter("ki" if part.element.tag == "pid" else "c1")
    total = total + gain * part.dt * delta
    now[part.memory("sum")], now[part.memory("in")] = total, x
    k_p, damped = part.parameter("kp"), part.parameter("kd") * slope
    if part.element.get("type") == "standard":
        return k_p * (x + total + damped)
    return k_p * x + total + damped


def _kinematic(part: Part) -> Number:
    """A part that goes from detent to detent at the rates between them."""
    settings = part.element.findall("traverse/setting")
    detents = [float(setting.findtext("position") or "nan") for setting in settings]
    times = [float(setting.findtext("time") or "nan") for setting in settings]
    y, x = part.now[outputs_of(part.element)[0]], part.x
    if not part.has("noscale"):
        x = x * detents[-1]
    x = constrained(detents[0], x, detents[-1])
    if part.now.trimming:
        return x
    left: Number = part.dt
    for _ in range(min(_PASSED, len(detents) - 1)):
        y, left = _moved(detents, times, x, y, left)
    return y


def _moved(
    detents: Sequence[float], times: Sequence[float], x: Number, y: Number, left: Number
) -> tuple[Number, Number]:
    """The place after moving between two detents, and the time of the step that is left."""
    a, b = fabs(x), fabs(y)
    moving: Truth = fabs(x - y) > _ROUNDOFF * select(a < b, b, a)
    moving = moving & (left > 0.0)
    down = x < y
    up_to = [detents[0], *(math.nextafter(d, -math.inf) for d in detents[1:-1]), detents[-1]]
    i, j = segment(detents, y), segment(up_to, y)

    def at(values: Sequence[float], by: int) -> Number:
        return select(down, lookup(values, i, by), lookup(values, j, by))

    low, high, time = at(detents, 0), at(detents, 1), at(times, 1)
    rate = (high - low) / time
    goal = constrained(low, x, high)
    needed = fabs((goal - y) / rate)
    short = left < needed
    further = select(y < x, y + left * rate, y - left * rate)
    reached = select(time <= 0.0, x, select(short, further, goal))
    spent = select(time <= 0.0, left, select(short, left, needed))
    return select(moving, reached, y), select(moving, left - spent, left)


def _filter(part: Part) -> Number:
    """A filter of first or second order, by the trapezoidal rule."""
    now, kind, dt = part.now, part.element.tag, part.dt
    c = [part.parameter(f"c{k}") for k in range(7)]
    x, x_1, y_1 = part.x, now[part.memory("in")], now[part.memory("out")]
    if kind == "lag_filter":
        a, b = _lag_coefficients(dt, c[1])
        y = (x + x_1) * a + y_1 * b
    elif kind == "washout_filter":
        denominator = 2.00 + dt * c[1]
        a, b = 2.00 / denominator, (2.00 - dt * c[1]) / denominator
        y = x * a - x_1 * a + y_1 * b
    elif kind == "lead_lag_filter":
        denominator = 2.00 * c[3] + dt * c[4]
        a = (2.00 * c[1] + dt * c[2]) / denominator
        b = (dt * c[2] - 2.00 * c[1]) / denominator
        y = x * a + x_1 * b + y_1 * ((2.00 * c[3] - dt * c[4]) / denominator)
    else:
        y = _second_order(part, c, (x, x_1, y_1))
    if now.trimming:
        # The first run after loading sees no input.
        runs = different(now[part.memory("begun")], 0.0)
        x, y, now[part.memory("begun")] = select(runs, x, 0.0), select(runs, y, 0.0), 1.0
    now[part.memory("in")], now[part.memory("out")] = x, y
    return y


def _second_order(part: Part, c: Sequence[Number], values: tuple[Number, ...]) -> Number:
    now, dt, (x, x_1, y_1) = part.now, part.dt, values
    x_2, y_2 = now[part.memory("in2")], now[part.memory("out2")]
    denominator = 4.0 * c[4] + 2.0 * c[5] * dt + c[6] * dt * dt
    a = (4.0 * c[1] + 2.0 * c[2] * dt + c[3] * dt * dt) / denominator
    b = (2.0 * c[3] * dt * dt - 8.0 * c[1]) / denominator
    e = (4.0 * c[1] - 2.0 * c[2] * dt + c[3] * dt * dt) / denominator
    f = (2.0 * c[6] * dt * dt - 8.0 * c[4]) / denominator
    g = (4.0 * c[4] - 2.0 * c[5] * dt + c[6] * dt * dt) / denominator
    now[part.memory("in2")], now[part.memory("out2")] = x_1, y_1
    return x * a + x_1 * b + x_2 * e - y_1 * f - y_2 * g


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
        parts.append(compare(value_or_property(now, a), value_or_property(now, b)))
    if element.get("logic", "AND") == "OR":
        return reduce(operator.or_, parts, False)
    return reduce(operator.and_, parts, True)


def _switch(part: Part) -> Number:
    """The value of the first test that holds, or the default."""
    default = part.element.find("default")
    y = 0.0 if default is None else value_or_property(part.now, default.get("value", ""))
    for test in reversed(part.element.findall("test")):
        value = value_or_property(part.now, test.get("value", ""))
        y = select(_condition(part.now, test), value, y)
    return part.delayed(y)


def _angle(part: Part) -> Number:
    """The angle from one direction to another, in -pi to pi."""

    def direction(tag: str) -> tuple[Number, Number]:
        of = part.element.find(tag)
        unit = _DEGREE if of is not None and of.get("unit") == "DEG" else 1.0
        angle = prop(part.now, part.text(tag)) * unit
        return cos(angle), sin(angle)

    (x_1, y_1), (x_2, y_2) = direction("source_angle"), direction("target_angle")
    cosine = least(x_1 * x_2 + y_1 * y_2, 1.0)
    unit = 180.0 / math.pi if part.element.get("unit") == "DEG" else 1.0
    size = call("acos", largest(-1.0, cosine)) * unit
    return select(x_1 * y_2 >= x_2 * y_1, size, -size)


def _distribute(part: Part) -> None:
    """Write properties in the cases that hold: in all of them, or in the first."""
    now, exclusive = part.now, part.element.get("type") == "exclusive"
    done: Truth = False
    for case in part.element.findall("case"):
        test = case.find("test")
        holds = True if test is None else _condition(now, test)
        if exclusive and test is not None:
            holds, done = holds & negated(done), done | holds
        for place in case.findall("property"):
            name, value = place.text or "", value_or_property(now, place.get("value", ""))
            now[name] = select(holds, value, now[name])


_COMPONENTS: dict[str, Component] = {
    "fcs_function": _fcs_function,
    "summer": _summer,
    "pure_gain": _pure_gain,
    "scheduled_gain": _scheduled_gain,
    "aerosurface_scale": _aerosurface_scale,
    "sensor": _sensor,
    "deadband": _deadband,
    "actuator": _actuator,
    "kinematic": _kinematic,
    "switch": _switch,
    "angle": _angle,
    **dict.fromkeys(("pid", "integrator"), _pid),
    **dict.fromkeys(FILTERS, _filter),
}
