# SPDX-License-Identifier: LGPL-2.1-or-later
"""An aircraft at its start, evaluated by machine code in place of JSBSim, to the bit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NoReturn

import numpy as np

from flighttune.base.errors import PlantError
from flighttune.vehicles.compiled import masses, trimming, turbulence
from flighttune.vehicles.compiled.atmosphere import pressures
from flighttune.vehicles.compiled.components import channels_of, execution_rate
from flighttune.vehicles.compiled.model import Source
from flighttune.vehicles.compiled.properties import Unsupported, canonical
from flighttune.vehicles.compiled.run import Model
from flighttune.vehicles.compiled.start import declared, inertia
from flighttune.vehicles.compiled.step import MachineStep
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

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


class LoadedFdm(Fdm):
    """An aircraft whose properties are read before and after its first evaluation."""

    loaded: Loaded | None = None

    def evaluate(self) -> None:
        """Evaluate, as `Fdm` does."""
        if self.loaded is not None:
            super().evaluate()
            return
        before = self.shown()
        super().evaluate()
        writable = tuple(filter(self.has, before))
        self.loaded = Loaded(before=before, after=self.shown(), writable=writable)

    def shown(self) -> dict[str, float]:
        """All properties."""
        return {name: self.value(name, 0.0) for name in sorted(self.names("")) if self.shows(name)}

    @property
    def known(self) -> Loaded:
        """What was read."""
        if self.loaded is None:
            raise PlantError(f"{self.config.file}: JSBSim must have evaluated the aircraft.")
        return self.loaded


@dataclass(frozen=True)
class Evaluation:
    """An aircraft that machine code evaluates, whatever the numbers of its flights."""

    model: Model
    own_flight_control: bool
    loaded: Loaded
    evaluate: MachineStep
    write: MachineStep
    names: dict[str, list[str]] = field(default_factory=dict)  # of properties by their beginning


class EvaluatedFdm(Fdm):
    """An aircraft before its first step, whose evaluations are machine code."""

    def __init__(self, evaluation: Evaluation, source: Source, *, ground: float) -> None:
        config = source.config
        self.files, self.config, self.steps, self.ground = (
            source.files,
            config,
            source.steps,
            ground,
        )
        self.engine_settles, self.electric, self.light = 0.0, False, False
        self.own_flight_control = evaluation.own_flight_control
        self.rate = config.inner_loop_rate * source.steps
        self.attitude = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.run = self._refuse
        self._loaded, self._model = evaluation.loaded, str(config.file)
        self._evaluation, self._numbers = evaluation, source.numbers
        self._declared = declared(evaluation.model)
        self._others: dict[str, float] = {}
        self._known = self._of_flight()
        names = evaluation.evaluate.names
        self._states = np.array([self._before(name) for name in names.states])
        self._parameters = np.array([self._after(name) for name in names.parameters])
        self._shown = np.zeros(len(names.properties))
        self._states_at, self._parameters_at, self._shown_at = (
            {name: i for i, name in enumerate(group)}
            for group in (names.states, names.parameters, names.properties)
        )
        self._initial = np.array([trimming.AT_REST[name] for name in trimming.STATE])
        self._angles = np.zeros(len(trimming.ANGLES))
        self._pending: list[tuple[float, float, float]] = []
        first = self._parameters_at[trimming.STATE[0]]
        self._ic = slice(first, first + len(trimming.STATE))
        self._places = tuple(x.ctypes.data for x in (self._states, self._parameters, self._shown))
        engines = range(config.engines.count)
        thrusts = [f"propulsion/engine[{i}]/thrust-lbs" for i in engines]
        if engines and config.engines.thrust:
            thrusts = [config.engines.thrust]
        self.thrusts = list(map(self.reader, thrusts))
        self.evaluate()

    def _of_flight(self) -> dict[str, float]:
        """Numbers of this flight, and what follows from them."""
        model, numbers, values = self._evaluation.model, self._numbers, self._loaded.after
        known = {f"_number:{name}": x for name, x in numbers.items()}
        known |= {trimming.RADIUS: model.planet.radius, **turbulence.AT_REST}
        known |= pressures(values["atmosphere/P-sl-psf"], values["atmosphere/delta-T"])
        if masses.is_open(model.root):
            known |= masses.mass_properties(model.root, numbers, values.get)
        else:
            known |= inertia(values.__getitem__)
        for n in range(len(model.engines)):
            known |= {f"_first{n}": 1.0, f"_n2-norm{n}": 0.0}
        for n, channel in enumerate(channels_of(model.root)):
            known[f"_frames{n}"] = float(execution_rate(channel))
        return known | trimming.AT_REST

    def _before(self, name: str) -> float:
        """A value before the first evaluation."""
        if name in self._known or name.startswith("_"):
            return self._known.get(name, 0.0)
        return self._loaded.before.get(name, self._declared.get(name, 0.0))

    def _after(self, name: str) -> float:
        """A value that no evaluation moves."""
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
            raise PlantError(f"{self._model}: must have the property `{name}`, got none.")
        return self._loaded.after[name]

    def evaluate(self) -> None:
        """Put the aircraft into the state of the ``ic/`` properties and evaluate its forces."""
        self._write()
        self._parameters[self._ic] = self._initial
        states, parameters, shown = self._places
        self._evaluation.evaluate.functions[0](states, parameters, 1, None, shown, 2)

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
        for places, values in (
            (self._shown_at, self._shown),
            (self._parameters_at, self._parameters),
        ):
            if name in places:
                return partial(values.item, places[name])
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
        places = [
            (values, at[name])
            for values, at in (
                (self._shown, self._shown_at),
                (self._states, self._states_at),
                (self._parameters, self._parameters_at),
            )
            if name in at
        ]
        if places:
            return partial(_put, places)
        if not name.startswith(_LATER):
            self._constant(name)
            if name not in self._loaded.writable:
                raise PlantError(f"{self._model}: property `{name}` must be writable.")
        return partial(self._write_other, name)

    def _write_other(self, name: str, value: float) -> bool:
        self._others[name] = value
        return True

    def _write_initial(self, kind: float, axis: float, value: float) -> bool:
        self._pending.append((kind, axis, value))
        return True

    def _write_height(self, h: float) -> bool:
        before = self._parameters[self._parameters_at[trimming.RADIUS]]
        radius = self._evaluation.model.planet.radius + h
        # JSBSim scales the position, which rounds.
        self._parameters[self._parameters_at[trimming.RADIUS]] = before * (radius / before)
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
        return canonical(name) in self._loaded.after

    def value(self, name: str, default: float) -> float:
        """The value of a property; a default where there is none of that name."""
        return self.reader(name)() if self.shows(name) else default

    def start_values(self, names: Sequence[str]) -> dict[str, float]:
        """Values of states and parameters of a step at the start of its flight."""
        return {name: self._start_value(name) for name in names}

    def _start_value(self, name: str) -> float:
        if name.startswith(("_first", "_n2-norm", "_frames")):
            return self._known[name]
        if name in self._shown_at:
            return float(self._shown[self._shown_at[name]])
        if name in self._parameters_at:
            return float(self._parameters[self._parameters_at[name]])
        if name in self._known or name in self._others or name in self._loaded.after:
            return self._constant(name)
        if name.startswith("_"):
            raise Unsupported(f"the number {name} in a trim")
        return self._declared.get(name, 0.0)

    def _refuse(self) -> NoReturn:
        raise PlantError(f"{self._model}: an aircraft of machine code has no steps here.")

    def settle_engine(self) -> None:
        """Nothing: its engines settle at once."""

    def start_engines(self) -> None:
        """Nothing: they run."""

    def abandon(self) -> None:
        """Nothing: there is no instance of JSBSim."""


def _put(places: Sequence[tuple[Any, int]], value: float) -> bool:
    for values, i in places:
        values[i] = value
    return True
