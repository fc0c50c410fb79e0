# SPDX-License-Identifier: LGPL-2.1-or-later
"""An aircraft at its start, evaluated by machine code in place of JSBSim, to the bit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from flighttune.base.errors import PlantError
from flighttune.compiled import masses, trimming, turbulence
from flighttune.compiled.atmosphere import pressures
from flighttune.compiled.components import channels_of, execution_rate
from flighttune.compiled.engine_files import propeller_of, value_of
from flighttune.compiled.model import Source
from flighttune.compiled.properties import Unsupported, canonical
from flighttune.compiled.run import Model
from flighttune.compiled.settling import (
    AT_REST,
    ELAPSED,
    MAX_SEARCH,
    ROW,
    SAMPLES,
    SHARE,
    THRUST,
    UNCHANGED,
    BeforeFlight,
)
from flighttune.compiled.start import declared, inertia
from flighttune.compiled.step import MachineStep

# Initial state that a write goes to: its kind and axis
_WRITES = {
    **{f"ic/{x}-fps": (trimming.BODY, float(i)) for i, x in enumerate("uvw")},
    **{name: (trimming.ANGLE, float(i)) for i, name in enumerate(trimming.ANGLES)},
    **{f"ic/v{x}-fps": (trimming.LOCAL, float(i)) for i, x in enumerate("ned")},
}
_RATES = {f"ic/{x}-rad_sec": name for x, name in zip("pqr", trimming.RATES, strict=True)}
_HEIGHT = "ic/h-sl-ft"

# Properties that decide nothing before the first step, or of which the step has its own numbers.
_LATER = ("simulation/randomseed", "atmosphere/psiw-rad", "atmosphere/turb", "atmosphere/cosine")


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """What JSBSim shows of an aircraft that it has loaded.

    Attributes
    ----------
    before, after : dict
        All properties before and after the first evaluation.
    writable, moved : sequence of str
        Those that can be written, and those that a start moved later.
    """

    before: dict[str, float]
    after: dict[str, float]
    writable: Sequence[str]
    moved: Sequence[str] = ()


@dataclass(frozen=True, eq=False)  # a key of caches
class Evaluation:
    """An aircraft before its flight by machine code, whatever the numbers of its flights."""

    source: Source
    model: Model
    loaded: Loaded
    code: BeforeFlight
    write: MachineStep
    names: dict[str, list[str]] = field(default_factory=dict)  # of properties by their beginning


class Memory:
    """JSBSim's memory of an aircraft before its flight; what it does there is machine code.

    `numbers` are those of the flight, by placeholder.
    """

    def __init__(self, evaluation: Evaluation, numbers: Mapping[str, float]) -> None:
        self._evaluation, self._loaded = evaluation, evaluation.loaded
        self.numbers, self._declared = numbers, declared(evaluation.model)
        self._others: dict[str, float] = {}
        self._known = self._of_flight()
        names = evaluation.code.names
        self._at = {name: i for i, name in enumerate((*names.parameters, *names.states))}
        # All numbers of the aircraft, in the order of `_at`; those of the initial state come first.
        self._row = np.array(
            [*map(self._after, names.parameters), *map(self._before, names.states)]
        )
        self._initial = self._row[: len(trimming.STATE)]
        self._angles = np.zeros(len(trimming.ANGLES))
        self._pending: list[tuple[float, float, float]] = []
        self._row_at, self._functions = self._row.ctypes.data, evaluation.code.functions

    @property
    def _file(self) -> Path:
        return self._evaluation.source.file

    def _of_flight(self) -> dict[str, float]:
        """Numbers of this flight, and what follows from them."""
        model, numbers, values = self._evaluation.model, self.numbers, self._loaded.after
        known = {f"_number:{name}": x for name, x in numbers.items()}
        known |= {trimming.RADIUS: model.planet.radius, **turbulence.AT_REST}
        known |= pressures(values["atmosphere/P-sl-psf"], values["atmosphere/delta-T"])
        if masses.is_open(model.root):
            known |= masses.mass_properties(model.root, numbers, values.get)
        else:
            known |= inertia(values.__getitem__)
        for engine in model.engines:
            n = engine.number
            # JSBSim has loaded it at full throttle.
            known |= {f"_first{n}": 1.0, f"_n2-norm{n}": 0.0, f"_lever{n}": 1.0}
            if engine.kind == "piston":
                known[f"_throttled{n}"] = self._loaded.before[canonical(f"{engine.at}/map-pa")]
        for n, channel in enumerate(channels_of(model.root)):
            known[f"_frames{n}"] = float(execution_rate(channel))
        return known | dict.fromkeys((*ROW, *trimming.WRITE), 0.0) | trimming.AT_REST

    def _before(self, name: str) -> float:
        """A value before the first evaluation."""
        if name in self._known or name.startswith("_"):
            return self._known.get(name, 0.0)
        return self._loaded.before.get(name, self._declared.get(name, 0.0))

    def _after(self, name: str) -> float:
        """A value that nothing moves before a flight."""
        if name in self._known:
            return self._known[name]
        if name.startswith("_"):
            raise Unsupported(f"the number {name} in a trim")
        return self._loaded.after.get(name, self._declared.get(name, 0.0))

    def _constant(self, name: str) -> float:
        """A property that nothing has moved."""
        if name in self._known or name in self._others:
            return self._others[name] if name in self._others else self._known[name]
        if name in self._loaded.moved or name.startswith(("_", "inertia/")):
            raise Unsupported(f"the property {name} in a trim")
        if name not in self._loaded.after:
            raise PlantError(f"{self._file}: must have the property `{name}`, got none.")
        return self._loaded.after[name]

    def evaluate(self) -> None:
        """Put the aircraft into the state of the ``ic/`` properties and evaluate its forces."""
        self._write()
        self._do("evaluate", 1)

    def run_still(self, samples: int, rate: float, still: float = 0.0) -> bool:
        """Let samples of the inner loop pass, at `rate` (1/s), while the aircraft stays still."""
        given = {ELAPSED: 1.0 / rate, SHARE: still, SAMPLES: 0.0, AT_REST: 0.0}
        for name, value in given.items():
            self._row[self._at[name]] = value
        self._do("hold", samples)
        self._row[self._at["simulation/sim-time-sec"]] = 0.0
        return bool(self._row[self._at[AT_REST]])

    def search_thrust(self) -> None:
        """Search for a steady thrust of each engine, as JSBSim does."""
        self._row[self._at[THRUST]] = 0.0
        for engine in self._evaluation.model.engines:
            self._row[self._at[UNCHANGED]] = 0.0
            self._do(f"search{engine.number}", MAX_SEARCH)

    def _do(self, function: str, steps: int) -> None:
        self._functions[function](self._row_at, None, steps, None, None, 0)

    def start_engine(self, i: int) -> None:
        """Start one engine: JSBSim turns that of a propeller at twice its idle speed."""
        engine = self._evaluation.model.engines[i]
        if engine.kind != "piston" or engine.pusher.tag != "propeller":
            raise Unsupported(f"engine {i + 1}, which stands in a trim")
        gear = propeller_of(engine).gear_ratio
        speed = 2.0 * value_of(engine.motor, "idlerpm", 600.0) / gear
        running = {"propeller-rpm": speed, "engine-rpm": speed * gear, "set-running": 1.0}
        for name, value in running.items():
            self._row[self._at[canonical(f"{engine.at}/{name}")]] = value

    def _write(self) -> None:
        """Write to the initial state what was given since the last evaluation."""
        if given := self._pending:
            self._evaluation.write.fly(
                self._initial, self._initial, len(given), np.array(given), self._angles
            )
            given.clear()

    def _angle(self, i: int) -> float:
        self._write()
        return self._angles.item(i)

    def reader(self, name: str) -> Callable[[], float]:
        """Return a function that reads the property `name`."""
        name = canonical(name)
        if name in self._at:
            return partial(self._row.item, self._at[name])
        if name in trimming.ANGLES:
            return partial(self._angle, trimming.ANGLES.index(name))
        if name in self._others:
            return partial(self._others.__getitem__, name)
        return partial(float, self._constant(name))

    def writer(self, name: str) -> Callable[[float], bool]:
        """Return a function that writes the property `name`."""
        name = canonical(name)
        if name in _WRITES:
            return partial(self._write_initial, *_WRITES[name])
        if name == _HEIGHT:
            return self._write_height
        name = _RATES.get(name, name)
        if name in self._at:
            return partial(self._put, self._at[name])
        if not name.startswith(_LATER):
            self._constant(name)
            if name not in self._loaded.writable:
                raise PlantError(f"{self._file}: property `{name}` must be writable.")
        return partial(self._write_other, name)

    def _put(self, place: int, value: float) -> bool:
        self._row[place] = value
        return True

    def _write_other(self, name: str, value: float) -> bool:
        self._others[name] = value
        return True

    def _write_initial(self, kind: float, axis: float, value: float) -> bool:
        self._pending.append((kind, axis, value))
        return True

    def _write_height(self, h: float) -> bool:
        at, planet = self._at[trimming.RADIUS], self._evaluation.model.planet.radius
        before = self._row[at]
        # JSBSim scales the position, which rounds.
        self._row[at] = before * ((planet + h) / before)
        return True

    def names(self, beginning: str) -> list[str]:
        """Names of the properties that begin so."""
        known = self._evaluation.names
        if beginning not in known:
            known[beginning] = [x for x in self._loaded.after if x.startswith(beginning)]
        return known[beginning]

    def has(self, name: str) -> bool:
        """Whether there is a property of that name that can be written."""
        return canonical(name) in self._loaded.writable

    def shows(self, name: str) -> bool:
        """Whether there is a property of that name."""
        name = canonical(name)  # JSBSim's list leaves out what a model declares
        return name in self._loaded.after or (name in self._at and not name.startswith("_"))

    def value(self, name: str, default: float) -> float:
        """The value of a property; a default where there is none of that name."""
        return self.reader(name)() if self.shows(name) else default

    def start_values(self, names: Sequence[str]) -> dict[str, float]:
        """Values of states and parameters of a step at the start of its flight."""
        return {name: self._start_value(name) for name in names}

    def _start_value(self, name: str) -> float:
        if name in self._at:
            return float(self._row[self._at[name]])
        if name in self._known or name in self._others or name in self._loaded.after:
            return self._constant(name)
        if name.startswith("_"):
            raise Unsupported(f"the number {name} in a trim")
        return self._declared.get(name, 0.0)
