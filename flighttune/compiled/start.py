# SPDX-License-Identifier: LGPL-2.1-or-later
"""The state of a flight at its start, from JSBSim: its properties, and its hidden state."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple, TypeAlias

from flighttune.compiled import turbulence
from flighttune.compiled.atmosphere import pressures
from flighttune.compiled.components import (
    FILTERS,
    channels_of,
    delay_of,
    execution_rate,
    inputs_of,
    name_of,
)
from flighttune.compiled.dynamics import FlightDynamics
from flighttune.compiled.engine_files import EngineFile, propeller_of, value_of
from flighttune.compiled.functions import is_number
from flighttune.compiled.integrators import Integrator, integrators_of
from flighttune.compiled.motion import Motion, acceleration_before, motion_reader, quaternion_from
from flighttune.compiled.pistons import power_of, supercharger_of
from flighttune.compiled.properties import Properties, Unsupported, named
from flighttune.compiled.rigid_body import (
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
from flighttune.compiled.run import Model
from flighttune.compiled.trace import Graph
from flighttune.compiled.vectors import over

Values: TypeAlias = dict[str, float]

# Samples of the inner loop that JSBSim flies: normally, behind a supercharger, and where gains
# cannot be set to zero.
_FEW, _CHARGED, _MANY = 12, 240, 2000

# Distance of a hidden pressure from that by the speed that is shown, in units of its last digit.
_ULPS = 50

# Commands in the long flight: their size as a share of their limits, and their frequency, rad/s.
_SWING, _SWEEP = 0.4, 5.0


def start_values(
    fdm: FlightDynamics,
    model: Model,
    numbers: Mapping[str, float],
    names: Sequence[str],
    swing: Callable[[float], None],
) -> Values:
    """Values of states and parameters at the start of a flight of JSBSim.

    JSBSim makes the first steps, which reveal its hidden state. `fdm` cannot fly afterwards.
    `swing` moves the commands of the flight by a share of their limits, -1 to 1.
    """
    start = _Start(fdm, model, numbers)
    later = {*QUATERNION, *QUATERNION_RATE, *ACCELERATION_1}
    values = {name: start[name] for name in names if name not in later}
    integrators, delays, dt = integrators_of(fdm, model.root), _delays(model), model.dt
    read = {name: fdm.reader(name) for part in integrators for name in part.reads(fdm)}
    read |= {name: fdm.reader(name) for name in delays}
    charged = [x for x in model.engines if x.kind == "piston" and supercharger_of(x)]
    around = filter(fdm.shows, (name for engine in charged for name in _around(engine)))
    read |= {name: fdm.reader(name) for name in around}
    few = _CHARGED if charged else _FEW
    motions: list[Motion] = []
    rows: list[Values] = []
    known, motion = all(part.fades for part in integrators), motion_reader(fdm)
    for k in range((few if known else _MANY) * fdm.steps + 1):
        if charged or not known:
            # A sum that is small beside the input shows where the input changes sign; a pressure
            # shows its last digit as it changes.
            swing(_SWING * math.sin(_SWEEP * k * dt))
        if k:
            fdm.run()
        if k <= _FEW:
            motions.append(motion())
        rows.append({name: value() for name, value in read.items()})
    for name, count in delays.items():
        # The oldest value comes out first.
        values |= {f"_delay{k}:{name}": rows[count - k + 1][name] for k in range(1, count + 1)}
    for engine in charged:
        name = f"_throttled{engine.number}"
        values[name] = _behind_throttle(values[name], engine, rows, dt)
    sums = _sums(fdm, integrators)
    for part, last in zip(integrators, sums, strict=True):
        values[f"_sum:{part.name}"] = part.settled(rows, last, dt)

    q = quaternion_from(*fdm.attitude, motions, dt)
    values |= dict(zip(QUATERNION, q, strict=True))
    values |= dict(zip(QUATERNION_RATE, quaternion_rate(q, motions[0].rates), strict=True))
    return values | dict(zip(ACCELERATION_1, acceleration_before(motions, dt), strict=True))


# Properties that decide the power of a piston engine, and states that a step has from the last one.
_STATES = "propeller-rpm", "boost-speed", "set-running", "fuel-flow-rate-pps"
_OF_ENGINE = (
    *("ram-air-factor", "air-intake-impedance-factor", "volumetric-efficiency"),
    *("friction-hp", "bsfc-lbs_hphr", "boostloss-factor"),
)
_OF_AIR = "atmosphere/P-psf", "atmosphere/T-R", "propulsion/pt-lbs_sqft"
_SHOWN = "map-pa", "power-hp"


def _around(engine: EngineFile) -> list[str]:
    """Properties that decide or show the power of a piston engine."""
    names = [f"{engine.at}/{name}" for name in (*_STATES, *_OF_ENGINE, *_SHOWN)]
    return [*names, *_OF_AIR, engine.throttle, engine.numbered("fcs/mixture-pos-norm")]


def _behind_throttle(
    shown: float, engine: EngineFile, rows: Sequence[Mapping[str, float]], dt: float
) -> float:
    """The pressure behind the throttle at the start (Pa) near that by the first row of JSBSim.

    The speed of the engine in that row is later than its pressure, and a quotient is rounded.
    """
    name, manifold, hp = (f"_throttled{engine.number}", *(f"{engine.at}/{x}" for x in _SHOWN))
    before_step = {f"{engine.at}/{state}" for state in _STATES}
    names = [x for x in _around(engine) if x in rows[0]]

    def missed(pressure: float) -> float:
        """Share by which the first wrong pressure in the manifold or power is wrong."""
        now = Properties(Graph(), dt)
        now[name], now[f"_air-flow{engine.number}"] = pressure, 0.0
        for before, row in pairwise(rows):
            for x in names:
                now[x] = before[x] if x in before_step else row[x]
            power = power_of(now, engine)
            for value, y in ((now[manifold], row[manifold]), (power, row[hp])):
                if value != y:
                    return (value - y) / y if y else math.inf
        return 0.0

    near = shown * (1.0 - missed(shown))
    agree = [x for k in range(-_ULPS, _ULPS + 1) if not missed(x := near + k * math.ulp(near))]
    if len(agree) != 1:
        raise Unsupported("a pressure behind the throttle that the first steps do not show")
    return agree[0]


def _delays(model: Model) -> dict[str, int]:
    """Components with a delay, and its number of runs, if the first steps show all of it."""
    found = {}
    for channel in channels_of(model.root):
        for element in channel:
            runs = delay_of(element, model.dt * execution_rate(channel))
            if 0 < runs < _FEW and execution_rate(channel) == 1:
                found[name_of(element)] = runs
    return found


def _sums(fdm: FlightDynamics, integrators: Sequence[Integrator]) -> list[float | None]:
    """Sums of integrators: the output with the gains set to zero; None if gains are numbers."""
    # Where no time passes, the filters of turbulence divide by zero.
    fdm.writer("atmosphere/turb-type")(0.0)
    gains = {text for part in integrators if part.fades for text in part.gains.values()}
    for name in filter(fdm.has, gains):
        fdm.writer(name)(0.0)
    fdm.evaluate_again()
    return [fdm.reader(part.name)() if part.fades else None for part in integrators]


class _Start:
    """Values by name; hidden values are computed once."""

    def __init__(self, fdm: FlightDynamics, model: Model, numbers: Mapping[str, float]) -> None:
        self._fdm, self._model = fdm, model
        self._numbers = numbers
        self._declared = declared(model)
        self.hidden: Values = (
            _rigid_body(fdm) | inertia(lambda name: fdm.reader(name)()) | turbulence.AT_REST
        )
        self.hidden |= pressures(self["atmosphere/P-sl-psf"], self["atmosphere/delta-T"])
        self.hidden["_lift"] = fdm.reader("forces/fwz-aero-lbs")()
        for engine in model.engines:
            self.hidden |= self._engine(engine)
        rates, components = _components(model)
        # The start is the end of a sample.
        self.hidden |= {f"_frames{n}": float(rate) for n, rate in enumerate(rates)}
        for part in components:
            self.hidden |= self._component(part)

    def __getitem__(self, name: str) -> float:
        if name in self.hidden:
            return self.hidden[name]
        if name.startswith("_number:"):
            return self._numbers[name.removeprefix("_number:")]
        if name.startswith("_"):
            raise KeyError(name)
        return self._fdm.value(name, self._declared.get(name, 0.0))

    def _value(self, text: str) -> float:
        """The number or property in a text."""
        text = text.strip()
        if text in self._numbers:
            return self._numbers[text]
        if is_number(text):
            return float(text)
        return -self[text[1:]] if text.startswith("-") else self[text]

    def _component(self, part: "_Component") -> Values:
        name, x = part.name, self._value(part.source) if part.source else 0.0
        if part.kind == "actuator":
            return self._actuator(part, x)
        if part.kind in ("sensor", "switch"):
            return self._late(part, x)
        y = self[name]
        past = {f"_in:{name}": x, f"_in2:{name}": x}
        if part.kind in ("pid", "integrator"):
            # The sum of an <integrator> is its output; the sum of a <pid> is found later.
            return past | {f"_sum:{name}": y}
        return past | {f"_out:{name}": y, f"_out2:{name}": y}

    def _engine(self, engine: EngineFile) -> Values:
        n, at = engine.number, engine.at
        # An engine that settles has left its trim phase before the start.
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
        """Ratio by which a supercharger raises the pressure behind the throttle."""
        if (charger := supercharger_of(engine)) is None:
            return 1.0
        rpm = self[f"{engine.at}/propeller-rpm"] * propeller_of(engine).gear_ratio
        speed = int(self[f"{engine.at}/boost-speed"])
        return ((charger.multiples[speed] - 1) / charger.speeds[speed]) * rpm + 1

    def _actuator(self, part: "_Component", x: float) -> Values:
        # During the trim the output of lag and rate limit equals the input; a clip gives its bound.
        name = part.name
        y, bounds = self[name], map(self._value, part.clip)
        y = x if part.more or y in bounds else y
        past = {f"_{kind}:{name}": y for kind in ("lag-out", "rate", "hysteresis")}
        return self._late(part, x) | past

    def _late(self, part: "_Component", x: float) -> Values:
        """A lag and a delay in the steady state of the input `x`."""
        name, y = part.name, self[part.name]
        late = {f"_delay{k}:{name}": y for k in range(1, part.runs + 1)}
        return {f"_lag-in:{name}": x, f"_lag-out:{name}": x if part.more else y, **late}


class _Component(NamedTuple):
    """A component with a past."""

    kind: str
    name: str
    source: str
    runs: int  # by which its output is late
    more: bool  # whether it does more than a lag, so that its output differs from its lag's
    clip: tuple[str, ...]


_WITH_PAST = {"actuator", "pid", "integrator", "sensor", *FILTERS}
_MORE = "gain", "bias", "deadband_width", "hysteresis_width", "quantization"


@lru_cache(maxsize=32)  # a start reads the numbers alone
def _components(model: Model) -> tuple[list[int], list[_Component]]:
    """Execution rates of the channels, and the components with a past in all of them."""
    channels = channels_of(model.root)
    rates = list(map(execution_rate, channels))
    found = []
    for rate, channel in zip(rates, channels, strict=True):
        for element in filter(lambda part: part.get("name"), channel):
            sources, kind, clip = inputs_of(element), element.tag, element.find("clipto")
            if kind != "switch" and not (kind in _WITH_PAST and sources):
                continue
            found.append(
                _Component(
                    kind,
                    name_of(element),
                    "" if kind == "switch" else sources[0],
                    delay_of(element, model.dt * rate),
                    any(element.find(tag) is not None for tag in _MORE),
                    () if clip is None else tuple(end.text or "" for end in clip),
                )
            )
    return rates, found


@lru_cache(maxsize=32)
def declared(model: Model) -> Values:
    """Properties that the files declare, with their values."""
    return {
        (part.text or "").strip(): float(value)
        for part in model.root.iter("property")
        if is_number(value := part.get("value", "0"))
    }


def _rigid_body(fdm: FlightDynamics) -> Values:
    """The derivatives that JSBSim integrates, except those of the attitude."""

    def read(names: Sequence[str]) -> list[float]:
        return [fdm.reader(name)() for name in names]

    motion = motion_reader(fdm)()
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


def inertia(value: Callable[[str], float]) -> Values:
    """Matrix of inertia and its inverse from JSBSim's properties."""
    xx, yy, zz, xy, xz, yz = (
        value(f"inertia/i{name}-slugs_ft2") for name in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    J = [[xx, -xy, xz], [-xy, yy, -yz], [xz, -yz, zz]]
    entries = [x for matrix in (J, inverse_inertia(J)) for row in matrix for x in row]
    return dict(zip((*INERTIA, *INVERSE_INERTIA), map(float, entries), strict=True))
