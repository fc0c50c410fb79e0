# SPDX-License-Identifier: LGPL-2.1-or-later
"""The state of a flight at its start, from JSBSim: what it shows, and what it keeps to itself."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.vehicles.compiled import turbulence
from flighttune.vehicles.compiled.atmosphere import pressures
from flighttune.vehicles.compiled.components import (
    FILTERS,
    ZERO_TRIGGER,
    channels_of,
    delay_of,
    execution_rate,
    inputs_of,
    integrand,
    integrator_kind,
    name_of,
)
from flighttune.vehicles.compiled.engine_files import EngineFile, propeller_of, value_of
from flighttune.vehicles.compiled.functions import is_number
from flighttune.vehicles.compiled.pistons import supercharger_of
from flighttune.vehicles.compiled.properties import INERTIAL_RATES, INERTIAL_VELOCITY, named
from flighttune.vehicles.compiled.rigid_body import (
    ACCELERATION_1,
    ANGULAR_ACCELERATION,
    BODY_ACCELERATION,
    INERTIA,
    INERTIAL_ACCELERATION,
    INVERSE_INERTIA,
    QUATERNION,
    QUATERNION_RATE,
    VELOCITY_1,
    VELOCITY_2,
    VELOCITY_RATE,
    inverse_inertia,
    quaternion_rate,
)
from flighttune.vehicles.compiled.run import Model
from flighttune.vehicles.compiled.vectors import matrix_of, over, quaternion_of
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

Values: TypeAlias = dict[str, float]

# Doubles on each side of a guess that are tried, for quaternions and for an acceleration; samples
# of the inner loop by which they are told apart.
_NEAR, _TRIED, _FAR, _FEW, _MANY = 4, 64, 2048, 12, 2000

# Frequency at which roll and load factor are moved meanwhile, rad/s.
_SWEEP = 5.0


def start_values(
    fdm: Fdm, model: Model, numbers: Mapping[str, float], names: Sequence[str]
) -> Values:
    """Values of states and parameters at the start of a flight of JSBSim.

    JSBSim makes its first steps, which show what it keeps to itself: the flight of `fdm` is over.
    """
    start = _Start(fdm, model, numbers)
    later = {*QUATERNION, *QUATERNION_RATE, *ACCELERATION_1}
    values = {name: start[name] for name in names if name not in later}
    integrators, delays, dt = _integrators(fdm, model.root), _delays(model), model.dt
    read = {name: fdm.reader(name) for part in integrators for name in part.reads(fdm)}
    read |= {name: fdm.reader(name) for name in delays}
    motions: list[Motion] = []
    rows: list[Values] = []
    known = all(part.fades for part in integrators)
    commands = [fdm.writer(name) for name in (properties.PHI_CMD, properties.N_Z_CMD)]
    (_, phi), (low, high) = fdm.config.limits.phi, fdm.config.limits.n_z
    for k in range((_FEW if known else _MANY) * fdm.steps + 1):
        if not known:  # what is small beside the input shows where that changes its sign
            swing = 0.4 * math.sin(_SWEEP * k * dt)
            commands[0](phi * swing)
            commands[1](1.0 + min(high - 1.0, 1.0 - low) * swing)
        if k:
            fdm.run()
        if k <= _FEW:
            motions.append(motion_of(fdm))
        rows.append({name: value() for name, value in read.items()})
    for name, count in delays.items():
        # The oldest comes out first.
        values |= {f"_delay{k}:{name}": rows[count - k + 1][name] for k in range(1, count + 1)}
    sums = _sums(fdm, integrators)
    for part, last in zip(integrators, sums, strict=True):
        values[f"_sum:{part.name}"] = part.settled(rows, last, dt)
    q = quaternion_from(motions, dt)
    values |= dict(zip(QUATERNION, q, strict=True))
    values |= dict(zip(QUATERNION_RATE, quaternion_rate(q, motions[0].rates), strict=True))
    return values | dict(zip(ACCELERATION_1, acceleration_before(motions, dt), strict=True))


def _delays(model: Model) -> dict[str, int]:
    """Components whose output is late, and by how many runs: no more than JSBSim shows."""
    found = {}
    for channel in channels_of(model.root):
        for element in channel:
            runs = delay_of(element, model.dt * execution_rate(channel))
            if 0 < runs < _FEW and execution_rate(channel) == 1:
                found[name_of(element)] = runs
    return found


def _sums(fdm: Fdm, integrators: Sequence["_Integrator"]) -> list[float | None]:
    """Sums of integrators: what they show without their gains; None where those are numbers."""
    # Where no time passes, the filters of turbulence divide by zero.
    fdm.writer("atmosphere/turb-type")(0.0)
    gains = {text for part in integrators if part.fades for text in part.gains.values()}
    for name in filter(fdm.has, gains):
        fdm.writer(name)(0.0)
    fdm.evaluate_again()
    return [fdm.reader(part.name)() if part.fades else None for part in integrators]


@dataclass(frozen=True)
class _Integrator:
    """A PID, whose sum JSBSim hides."""

    name: str
    gains: Mapping[str, str]  # number or property by ``kp``, ``ki`` and ``kd``
    fades: bool  # whether all gains can be taken away
    source: str
    trigger: str
    slope: str  # property of the slope of its input; empty if it computes that
    kind: str
    standard: bool  # whether the proportional gain multiplies all
    rate: int  # steps from one run to the next

    def reads(self, fdm: Fdm) -> list[str]:
        """Properties that it reads and shows."""
        names = self.name, self.source.lstrip("-"), self.trigger, self.slope, *self.gains.values()
        return [name for name in names if name and fdm.shows(name)]

    def _gain(self, tag: str, row: Mapping[str, float]) -> float:
        text = self.gains.get(tag, "0")
        return row[text] if text in row else float(text)

    def settled(self, rows: Sequence[Mapping[str, float]], last: float | None, dt: float) -> float:
        """The sum before the steps whose properties are `rows`, at whose end it is `last`."""
        rows, dt = rows[:: self.rate], dt * self.rate
        k_p, k_i, k_d = (self._gain(tag, rows[0]) for tag in ("kp", "ki", "kd"))
        sign = -1.0 if self.source.startswith("-") else 1.0
        inputs = [sign * row[self.source.lstrip("-")] for row in rows]
        shown = [row[self.name] for row in rows]
        changes = [0.0]
        for row, before, x in zip(rows[1:], inputs[:-1], inputs[1:], strict=True):
            stays = bool(self.trigger) and abs(row[self.trigger]) >= ZERO_TRIGGER
            changes.append(k_i * dt * (0.0 if stays else integrand(self.kind, x, before)))
        slopes = [0.0, *((b - a) / dt for a, b in pairwise(inputs))]
        if self.slope:
            slopes = [row[self.slope] for row in rows]
        # It is empty while disengaged, and runs once or twice with the loop engaged.
        once = k_i * dt * inputs[0]
        at = 1 if k_d else 0  # the slope at the start is not known
        of_input = 1.0 if self.standard else k_p
        near = shown[at] / (k_p if self.standard else 1.0) - of_input * inputs[at]
        near -= k_d * slopes[at] + sum(changes[: at + 1])
        likely = [once, once + once, 0.0]
        guesses = [*likely, *neighbours(once, _TRIED)]
        if last is not None:
            guesses += neighbours(last - sum(changes), _TRIED)
        further = near + math.ulp(near) * np.arange(-_FAR, _FAR + 1)
        sums = totals = np.concatenate((guesses, further))
        left = np.arange(len(sums))
        # Those remain that give what JSBSim shows, for as long as one does.
        rows_shown = zip(inputs, changes, slopes, shown, strict=True)
        for k, (x, change, slope, y) in enumerate(rows_shown):
            totals = totals + change
            output = of_input * x + totals + k_d * slope
            same = (k_p * output if self.standard else output) == y
            if same.any() and k >= at:
                left, totals = left[same], totals[same]
        if last is not None and (totals == last).any():
            left = left[totals == last]
        return float(sums[left[0] if left[0] < len(likely) else left[len(left) // 2]])


def _integrators(fdm: Fdm, root: Element) -> list[_Integrator]:
    found = []
    pids = ((channel, pid) for channel in channels_of(root) for pid in channel.findall("pid"))
    for channel, element in pids:
        texts = {tag: (element.findtext(tag) or "").strip() for tag in ("kp", "ki", "kd")}
        gains = {tag: text for tag, text in texts.items() if text}
        numbers = [float(text) for text in gains.values() if is_number(text)]
        if not all(is_number(text) or fdm.has(text) for text in gains.values()):
            continue
        (source,) = inputs_of(element)
        found.append(
            _Integrator(
                name_of(element),
                gains,
                not any(numbers),
                source,
                (element.findtext("trigger") or "").strip(),
                (element.findtext("pvdot") or "").strip(),
                integrator_kind(element),
                element.get("type") == "standard",
                execution_rate(channel),
            )
        )
    return found


class _Start:
    """Values by name; those that JSBSim hides are worked out once."""

    def __init__(self, fdm: Fdm, model: Model, numbers: Mapping[str, float]) -> None:
        self._fdm, self._model = fdm, model
        self._numbers = numbers
        self._declared = {
            (part.text or "").strip(): float(value)
            for part in model.root.iter("property")
            if is_number(value := part.get("value", "0"))
        }
        self.hidden: Values = _rigid_body(fdm) | _inertia(fdm) | turbulence.AT_REST
        self.hidden |= pressures(self["atmosphere/P-sl-psf"], self["atmosphere/delta-T"])
        self.hidden["_lift"] = fdm.reader("forces/fwz-aero-lbs")()
        for engine in model.engines:
            self.hidden |= self._engine(engine)
        for n, channel in enumerate(channels_of(model.root)):
            # The start falls on the end of a sample.
            self.hidden[f"_frames{n}"] = float(execution_rate(channel))
            self._dt = model.dt * execution_rate(channel)
            for element in channel:
                self.hidden |= self._component(element)

    def __getitem__(self, name: str) -> float:
        if name in self.hidden:
            return self.hidden[name]
        if name.startswith("_number:"):
            return self._numbers[name.removeprefix("_number:")]
        if name.startswith("_"):
            raise KeyError(name)
        if not self._fdm.shows(name):
            return self._declared.get(name, 0.0)
        return self._fdm.reader(name)()

    def _value(self, text: str) -> float:
        """The number or property in a text."""
        text = text.strip()
        if text in self._numbers:
            return self._numbers[text]
        if is_number(text):
            return float(text)
        return -self[text[1:]] if text.startswith("-") else self[text]

    def _component(self, element: Element) -> Values:
        sources, name = inputs_of(element), name_of(element)
        kind = element.tag
        if not element.get("name") or not (sources or kind == "switch"):
            return {}
        if kind == "actuator":
            return self._actuator(element, self._value(sources[0]))
        if kind in ("pid", "integrator"):
            return self._integrator(element, self._value(sources[0]))
        if kind in FILTERS:
            x, y = self._value(sources[0]), self[name]
            return {f"_in:{name}": x, f"_in2:{name}": x, f"_out:{name}": y, f"_out2:{name}": y}
        if kind in ("sensor", "switch"):
            return self._late(element, self._value(sources[0]) if kind == "sensor" else 0.0)
        return {}

    def _engine(self, engine: EngineFile) -> Values:
        n, at = engine.number, engine.at
        # A flight control whose engine settles has left the phase of the trim before the start.
        values = {f"_first{n}": float(not self._fdm.engine_settles), f"_augmented{n}": 0.0}
        idle = value_of(engine.motor, "idlen2", 60.0)
        most = value_of(engine.motor, "maxn2", 100.0)
        settled = self._fdm.engine_settles and engine.kind == "turbine"
        values[f"_n2-norm{n}"] = (self[f"{at}/n2"] - idle) / (most - idle) if settled else 0.0
        values |= {f"_limited{n}": 0.0, f"_propellant{n}": 0.0, f"_air-flow{n}": 0.0}
        values[f"_lever{n}"] = self[engine.numbered("fcs/throttle-pos-norm")]
        if engine.kind == "piston":
            values[f"_throttled{n}"] = self[f"{at}/map-pa"] / self._boost(engine)
        return values

    def _boost(self, engine: EngineFile) -> float:
        """By how much a supercharger raises the pressure behind the throttle."""
        if (charger := supercharger_of(engine)) is None:
            return 1.0
        rpm = self[f"{engine.at}/propeller-rpm"] * propeller_of(engine).gear_ratio
        speed = int(self[f"{engine.at}/boost-speed"])
        return ((charger.multiples[speed] - 1) / charger.speeds[speed]) * rpm + 1

    def _actuator(self, element: Element, x: float) -> Values:
        # While JSBSim trims, lag and rate limit pass their input on; a clip shows its bound.
        name = name_of(element)
        y, clip = self[name], element.find("clipto")
        bounds = [] if clip is None else [self._value(end.text or "") for end in clip]
        y = x if y in bounds or _changes_more(element) else y
        past = {f"_{kind}:{name}": y for kind in ("lag-out", "rate", "hysteresis")}
        return self._late(element, x) | past

    def _late(self, element: Element, x: float) -> Values:
        """A lag and a delay whose input has been `x`."""
        name = name_of(element)
        y = self[name]
        runs = delay_of(element, self._dt)
        late = {f"_delay{k}:{name}": y for k in range(1, runs + 1)}
        last = x if _changes_more(element) else y
        return {f"_lag-in:{name}": x, f"_lag-out:{name}": last, **late}

    def _integrator(self, element: Element, x: float) -> Values:
        def parameter(tag: str) -> float:
            part = element.find(tag)
            return 0.0 if part is None else self._value(part.text or "")

        name = name_of(element)
        y, k_p, k_i = self[name], parameter("kp"), parameter("ki") or parameter("c1")
        # It is emptied while disengaged, then runs twice with the loop engaged.
        once = k_i * self._model.dt * x
        near = y - k_p * x
        candidates = (once + once, 0.0, *neighbours(near, 4))
        found = (s for s in candidates if k_p * x + s == y and (k_p == 0.0 or s != near))
        return {f"_in:{name}": x, f"_in2:{name}": x, f"_sum:{name}": next(found, near)}


def _rigid_body(fdm: Fdm) -> Values:
    """The derivatives by which JSBSim integrates, but for those of the attitude."""

    def read(names: Sequence[str]) -> list[float]:
        return [fdm.reader(name)() for name in names]

    motion = motion_of(fdm)
    force, (mass,) = read(named("forces/fb{}-total-lbs")), read(["inertia/mass-slugs"])
    groups = {
        tuple(VELOCITY_1): motion.velocity,
        tuple(VELOCITY_2): motion.velocity,
        tuple(INERTIAL_ACCELERATION): motion.acceleration,
        tuple(BODY_ACCELERATION): over(force, mass),
        tuple(ANGULAR_ACCELERATION): read(named("accelerations/{}dot-rad_sec2", "pqr")),
        tuple(VELOCITY_RATE): read(named("accelerations/{}dot-ft_sec2", "uvw")),
    }
    return {
        name: float(x)
        for names, values in groups.items()
        for name, x in zip(names, values, strict=True)
    }


def _inertia(fdm: Fdm) -> Values:
    xx, yy, zz, xy, xz, yz = (
        fdm.reader(f"inertia/i{name}-slugs_ft2")() for name in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    J = [[xx, -xy, xz], [-xy, yy, -yz], [xz, -yz, zz]]
    entries = [x for matrix in (J, inverse_inertia(J)) for row in matrix for x in row]
    return dict(zip((*INERTIA, *INVERSE_INERTIA), map(float, entries), strict=True))


def _changes_more(element: Element) -> bool:
    """Whether a component does more to its input than a lag: its output is not that of the lag."""
    parts = "gain", "bias", "deadband_width", "hysteresis_width", "quantization"
    return any(element.find(tag) is not None for tag in parts)


def neighbours(x: float, count: int) -> list[float]:
    """A double and those next to it, the nearest first."""
    near = [x]
    up = down = x
    for _ in range(count):
        up, down = math.nextafter(up, math.inf), math.nextafter(down, -math.inf)
        near += [up, down]
    return near


@dataclass(frozen=True)
class Motion:
    """What JSBSim shows of the rigid body at an instant."""

    rotation: FloatArray  # shape (3, 3): from the Earth to the body
    rates: list[float]
    velocity: list[float]
    acceleration: list[float]


def motion_of(fdm: Fdm) -> Motion:
    """The motion now."""
    names = INERTIAL_RATES, INERTIAL_VELOCITY, named("accelerations/{}idot-ft_sec2", "uvw")
    return Motion(fdm.earth_to_body(), *([fdm.reader(x)() for x in group] for group in names))


def quaternion_from(motions: Sequence[Motion], dt: float) -> list[float]:
    """The quaternion that gives the rotations of JSBSim to the bit, now and in the steps after."""
    guess = [float(x) for x in quaternion_of(motions[0].rotation.tolist())]
    found = [_nearest(guess, _NEAR // 2, motions, dt)]
    if found[0][1]:  # not exact: it lies further away
        found.append(_nearest(guess, _NEAR, motions, dt))
    return min(found, key=itemgetter(1))[0]


def _nearest(
    guess: Sequence[float], count: int, motions: Sequence[Motion], dt: float
) -> tuple[list[float], int]:
    """The best quaternion near a guess, and how many entries of its first rotation are wrong."""
    # All combinations of near doubles, a column each; arithmetic of NumPy is that of JSBSim.
    near = np.meshgrid(*(neighbours(x, count) for x in guess), indexing="ij")
    starts = now = np.array([values.ravel() for values in near])
    first: int | None = None
    for motion in motions:
        wrong = np.zeros(now.shape[1], dtype=int)
        for row, wanted in zip(matrix_of(list(now)), motion.rotation, strict=True):
            for a, b in zip(row, wanted, strict=True):
                wrong += np.not_equal(a, b)
        fewest = int(wrong.min())
        first = fewest if first is None else first
        starts, now = starts[:, wrong == fewest], now[:, wrong == fewest]
        moved = now + dt * np.array(quaternion_rate(list(now), motion.rates))
        now = _normalized(moved)
    return starts[:, 0].tolist(), first or 0


def _normalized(q: FloatArray) -> FloatArray:
    """Quaternions of length 1, a column each."""
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    keep = np.abs(length - 1.0) < 1e-10
    return np.where(keep, q, q * (1.0 / length))


def acceleration_before(motions: Sequence[Motion], dt: float) -> list[float]:
    """The acceleration before the start with which JSBSim makes its first step, to the bit."""
    found = []
    before, after = motions[0], motions[1]
    for v_0, a_0, v_1 in zip(before.velocity, before.acceleration, after.velocity, strict=True):
        wanted = (1.5 * a_0 - (v_1 - v_0) / dt) / 0.5
        # Any that gives the velocity after the step will do: it is not used again.
        near = (
            a_1
            for a_1 in (a_0, *neighbours(wanted, _TRIED))
            if v_0 + dt * (1.5 * a_0 - 0.5 * a_1) == v_1
        )
        found.append(next(near, a_0))
    return found
