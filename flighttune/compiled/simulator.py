# SPDX-License-Identifier: LGPL-2.1-or-later
"""An aircraft of JSBSim as a simulator of many flights at once: a state, and a step of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from flighttune.base.errors import InputError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.signatures import with_short_signatures
from flighttune.base.words import got
from flighttune.compiled.aircraft import CompiledStep, Start
from flighttune.compiled.dynamics import Doubles
from flighttune.compiled.face import in_lanes, sloped
from flighttune.compiled.lanes import LaneStep
from flighttune.compiled.normals import seeded
from flighttune.compiled.slopes import SLOPE

# The module that knows aircraft by name and folder, and trims them.
AIRCRAFT = "flighttune.vehicles.simulated"

# Time since the start, s.
_TIME = "simulation/sim-time-sec"

Inputs: TypeAlias = Literal["commands", "surfaces"]
Given: TypeAlias = npt.ArrayLike | Mapping[str, npt.ArrayLike]
LaneIndex: TypeAlias = int | slice | Sequence[int] | npt.NDArray[Any]


@dataclass(frozen=True)
class Trimmed:
    """Starts of flights in one kind of air: what each of them shows, by name."""

    step: CompiledStep
    starts: Sequence[Start]
    shown: Sequence[Mapping[str, float]]


class Trims(Protocol):
    """An aircraft that can be trimmed.

    `inputs` are its properties by the names of its inputs; `others` are inputs by name alone.
    """

    name: str
    inputs: Mapping[str, str]
    others: Mapping[str, str]

    def trimmed(self, n: int | None, **given: Any) -> Trimmed:
        """Flights that start in steady flight."""
        ...


def load(aircraft: str | Path, *, inputs: Inputs = "commands") -> "Aircraft":
    """An aircraft whose flights are JSBSim's own to the bit, many at once.

    The first use of an aircraft compiles its step and flies it beside JSBSim, which takes some
    seconds; the result is cached.

    Parameters
    ----------
    aircraft : str or Path
        Name of a shipped aircraft, or the folder of an adopted one.
    inputs : str
        ``commands``: roll ``phi_cmd`` (rad) and load factor ``n_z_cmd`` (1), which the inner loop
        follows while it holds the airspeed; by name also that airspeed, ``V_a_cmd`` (m/s).
        ``surfaces``: ``aileron``, ``elevator`` and ``rudder`` (rad) and ``throttle`` (0 to 1),
        without an inner loop.

    Raises
    ------
    PlantError
        If there is no such aircraft, or its step cannot be compiled to JSBSim's bits.

    Examples
    --------
    >>> aircraft = ft.compiled.load("c172p")
    >>> state = aircraft.trim(V_a=50.0, h=1000.0, n=256)
    >>> turning = aircraft.step(state, [0.3, 1.05], steps=400)
    >>> turning["phi"].shape, round(float(turning["phi"][0]), 2)
    ((256,), 0.3)
    """
    if inputs not in ("commands", "surfaces"):
        raise InputError(f"`inputs` must be commands or surfaces, got {got(inputs)}.")
    return Aircraft(import_module(AIRCRAFT).loaded(aircraft, inputs))


@with_short_signatures
class Aircraft:
    """An aircraft in machine code; `load` makes it.

    Attributes
    ----------
    name : str
        Its name.
    inputs : tuple of str, length m
        Names of its inputs, in the order of the columns of `step`.

    Examples
    --------
    >>> aircraft = ft.compiled.load("aerosonde", inputs="surfaces")
    >>> aircraft.inputs
    ('aileron', 'elevator', 'rudder', 'throttle')
    >>> state = aircraft.trim(V_a=[24.0, 26.0])
    >>> aircraft.step(state, {"throttle": 0.0}, steps=200)["V_a"] < state["V_a"]
    array([ True,  True])
    """

    def __init__(self, trims: Trims) -> None:
        self._trims = trims
        self.name, self.inputs = trims.name, tuple(trims.inputs)
        self._lanes: dict[int, tuple[CompiledStep, LaneStep]] = {}

    def __repr__(self) -> str:
        return f"<{self.name}, inputs {', '.join(self.inputs)}>"

    def trim(self, *, n: int | None = None, **given: Any) -> "State":
        """Start flights, each in steady flight.

        Every argument is one value for all flights, or n of them.

        Parameters
        ----------
        n : int, optional
            Number of flights; by default that of the values that are given.
        V_a, h : float or shape (n,), m/s and m
            Airspeed, and height above sea level; by default those of the design flight.
        chi, gamma, phi : float or shape (n,), rad
            Course clockwise from north, path angle with climb positive, roll to the right; 0.
        wind : shape (3,) or (n, 3), m/s
            Velocity of the air to north, east and down; still air by default.
        turbulence : str, optional
            ``light``, ``moderate`` or ``severe``, for all flights.
        model : str
            Its model, ``tustin`` or ``milspec``.
        gust : mapping, optional
            One 1-cosine gust for all flights, by the keys of ``[gust]``: ``axis``, ``peak_mps``,
            ``start_s``, ``length_m`` and ``hold_s``.
        seed : int or shape (n,)
            Of the turbulence; by default 0 to n - 1.
        **factors : float or shape (n,)
            Differences of the aircraft from its files, by keys of ``[plant.airframe]`` such as
            ``mass_factor``, ``lift_factor``, ``cg_aft_m`` and ``actuator_lag_factor``.

        Raises
        ------
        InputError
            If a value is not one of those, or the flight is outside of the envelope.
        TrimError
            If there is no steady flight.
        """
        return self.begin(self._trims.trimmed(n, **given))

    def begin(self, trimmed: Trimmed) -> "State":
        """Flights from their starts."""
        step, lanes = self._lanes_of(trimmed)
        names = lanes.names
        shown = {name: np.array([x[name] for x in trimmed.shown]) for name in trimmed.shown[0]}
        missing = np.full(len(trimmed.starts), np.nan)
        signals = np.stack([shown.get(name, missing) for name in names.signals], axis=1)
        arrays = (
            *(np.stack([getattr(x, key) for x in trimmed.starts]) for key in _OF_START),
            signals,
        )
        states, parameters, random, signals = map(lanes.blocks, arrays)
        flown = _Flown(states, parameters, random, signals)
        return State(self, step, lanes, len(trimmed.starts), flown, shown.__getitem__)

    def _lanes_of(self, trimmed: Trimmed) -> tuple[CompiledStep, LaneStep]:
        step = trimmed.step
        if id(step) not in self._lanes:
            self._lanes[id(step)] = step, in_lanes(step, trimmed.starts[0])
        return self._lanes[id(step)]

    def step(self, state: "State", inputs: Given = (), *, steps: int = 1) -> "State":
        """Fly every flight on with its inputs held; `state` stays as it is.

        Parameters
        ----------
        state : State
            n flights of this aircraft.
        inputs : array_like, shape (m,) or (n, m), or mapping
            Inputs in the order of `inputs`, or some by name, each a number or n of them. A name may
            also be a property of JSBSim that the step reads and does not write. What is not given
            stays as it is.
        steps : int
            Integration steps, each of the length `State.dt`.

        Returns
        -------
        State
            The flights after the last step.
        """
        return self.trace(state, inputs, of=(), steps=steps, every=max(steps, 1))[0]

    def trace(
        self,
        state: "State",
        inputs: Given = (),
        *,
        of: Sequence[str],
        steps: int = 1,
        every: int = 1,
    ) -> tuple["State", Doubles]:
        """Fly every flight on as `step` does, and keep signals on the way.

        Parameters
        ----------
        state, inputs, steps
            As in `step`.
        of : sequence of str
            Signals, such as ``phi``.
        every : int
            Integration steps between two rows; the last row may come sooner.

        Returns
        -------
        State
            The flights after the last step.
        ndarray, shape (rows, n, len(of))
            The signals after each `every` steps and after the last one.

        Examples
        --------
        >>> aircraft = ft.compiled.load("c172p")
        >>> state = aircraft.trim(n=2)
        >>> state, roll = aircraft.trace(state, [0.3, 1.0], of=["phi"], steps=400, every=20)
        >>> roll.shape, bool((roll[-1, :, 0] == state["phi"]).all())
        ((20, 2, 1), True)
        """
        for name, number in (("steps", steps), ("every", every)):
            if number < 1:
                raise InputError(f"`{name}` must be at least 1, got {got(number)}.")
        lanes, before, n = state._lanes, state._flown, len(state)
        signals = lanes.names.signals
        if unknown := [name for name in of if name not in signals]:
            raise _unknown("`of` must be signals", unknown[0], signals)
        rows = np.array([signals.index(name) for name in of], dtype=int)
        places, given = self._places(state, inputs)
        if places:
            parameters = before.parameters.copy()
            parameters[:, places] = lanes.blocks(given)
            before = replace(before, parameters=parameters)
        # Parameters do not change in a step, and the state before it is never written to.
        states, random, shown = before.states.copy(), before.random.copy(), before.shown.copy()
        fly, times = lanes.flying(states, before.parameters, random, shown), range(0, steps, every)
        traced = np.empty((len(times), len(shown), len(rows), lanes.width))
        for row, done in zip(traced, times, strict=True):
            fly(min(every, steps - done))
            np.take(shown, rows, axis=1, out=row)
        flown = _Flown(states, before.parameters, random, shown)
        kept = traced.swapaxes(2, 3).reshape(len(times), len(shown) * lanes.width, len(rows))
        return state._with(n, flown, _Properties(lanes, before, steps)), kept[:, :n]

    def _places(self, state: "State", inputs: Given) -> tuple[list[int], Doubles]:
        """Places of inputs among the parameters, and their numbers, shape (n, len(places))."""
        n, known, places = len(state), self._trims.inputs, state._lanes.names.parameters
        if not isinstance(inputs, Mapping):
            rows = numbers("inputs", inputs)
            if not rows.size:
                return [], rows
            if rows.shape not in ((len(known),), (n, len(known))):
                shapes = f"({len(known)},) or ({n}, {len(known)})"
                raise InputError(
                    f"`inputs` must have the shape {shapes}, for {', '.join(known)}, got "
                    f"{rows.shape}."
                )
            at = [places.index(property_) for property_ in known.values()]
            return at, np.broadcast_to(rows, (n, len(known)))
        found = []
        columns = np.empty((n, len(inputs)))
        for i, (name, given) in enumerate(inputs.items()):
            property_ = self._property(name)
            if property_ not in places:
                every = (*known, *self._trims.others, *places)
                raise InputError(
                    f"`inputs` must be of this step, got `{name}`{nearest_name(name, every)}"
                )
            values = numbers(name, given)
            if values.shape not in ((), (n,)):
                raise InputError(f"`{name}` must be a number or {n} of them, got {got(given)}.")
            found.append(places.index(property_))
            columns[:, i] = values
        return found, columns

    def _property(self, name: str) -> str:
        return {**self._trims.inputs, **self._trims.others}.get(name, name)

    def slopes(
        self,
        state: "State",
        inputs: Given = (),
        *,
        of: Sequence[str],
        by: Sequence[str],
        steps: int = 1,
    ) -> Doubles:
        """Slopes of signals after some steps, exact to rounding.

        Parameters
        ----------
        state, inputs, steps
            As in `step`.
        of : sequence of str
            Signals, such as ``phi``.
        by : sequence of str
            Inputs, or states and parameters by their property in JSBSim's units, at the state.

        Returns
        -------
        ndarray, shape (n, len(of), len(by))
            Derivative of each signal. A value that jumps has the slope between its jumps.
        """
        machine = sloped(state._step)
        names, lanes, n = machine.names, state._lanes, len(state)
        places = [self._sloped(name, names.signals, "`of` must be signals") for name in of]
        every = (*names.states, *names.parameters)
        sources = [self._sloped(name, every, "`by` must be inputs or properties") for name in by]
        parameters = lanes.rows(state._flown.parameters, n).copy()
        given, values = self._places(state, inputs)
        parameters[:, given] = values
        states, random = (lanes.rows(x, n) for x in (state._flown.states, state._flown.random))
        found, shown = np.empty((n, len(of), len(by))), np.zeros(len(names.signals))
        for i, (row, own) in enumerate(zip(states, parameters, strict=True)):
            stream = machine.normals(random[i].copy(), steps)
            # What flies, and the slopes of states and parameters by one of them.
            still = np.concatenate([row, 0.0 * row, own, 0.0 * own])
            for j, source in enumerate(sources):
                flown = still.copy()
                flown[source] = 1.0
                machine.fly(flown[: 2 * len(row)], flown[2 * len(row) :], steps, stream, shown)
                found[i, :, j] = shown[places]
        return found

    def _sloped(self, name: str, names: Sequence[str], must: str) -> int:
        """The place of the slope of a name among names."""
        at = f"{SLOPE}{self._property(name)}"
        if at not in names:
            known = [x.removeprefix(SLOPE) for x in names if x.startswith(SLOPE)]
            raise _unknown(must, name, (*self.inputs, *known))
        return names.index(at)


_OF_START = "states", "parameters", "random"


@dataclass(frozen=True)
class _Flown:
    """Arrays of flights, each of shape (blocks, names, lanes of a vector)."""

    states: Doubles
    parameters: Doubles
    random: npt.NDArray[np.int64]
    shown: Doubles

    @property
    def arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.states, self.parameters, self.random, self.shown

    def copy(self) -> "_Flown":
        return _Flown(*(x.copy() for x in self.arrays))


class _Properties:
    """Properties after some steps, which are flown again when one is first asked for."""

    def __init__(self, lanes: LaneStep, before: _Flown, steps: int) -> None:
        self._lanes, self._before, self._steps = lanes, before, steps
        self._shown: Doubles | None = None

    def __call__(self, name: str) -> Doubles:
        names = self._lanes.names
        at = len(names.signals) + names.properties.index(name)
        if self._shown is None:
            states, parameters, random, shown = self._before.copy().arrays
            every = len(names.signals) + len(names.properties)
            self._shown = np.empty((len(shown), every, shown.shape[2]))
            fly = self._lanes.flying(states, parameters, random, self._shown)
            fly(self._steps, properties=True)
        return self._shown[:, at].reshape(-1)


@with_short_signatures
class State:
    """Flights of an aircraft at one time; `Aircraft.trim` and `Aircraft.step` make it.

    It does not change: what is kept is a flight saved, and stepping it again flies the same bits.
    ``state["phi"]`` has a number for each flight, in SI and radians for signals such as ``chi``,
    ``gamma``, ``phi``, ``n_z``, ``V_a``, ``h``, ``north``, ``east``, ``alpha``, ``p`` and
    ``throttle``, and in JSBSim's units for its properties such as ``velocities/p-rad_sec``. Course
    and heading lie in 0 to 2 pi. ``state[3:5]`` and ``state[mask]`` are the state of some flights.

    Attributes
    ----------
    dt : float, s
        Length of an integration step.
    signals : tuple of str
        Names of its signals.

    Examples
    --------
    >>> aircraft = ft.compiled.load("aerosonde")
    >>> state = aircraft.trim(V_a=25.0, n=4, turbulence="light")
    >>> later = aircraft.step(state, [0.2, 1.0], steps=100)
    >>> len(later), later["phi"].shape, round(float(later[2]["t"][0]), 6)
    (4, (4,), 0.5)
    >>> back = later.put([1, 3], state[[1, 3]])
    >>> back["t"]
    array([0.5, 0. , 0.5, 0. ])
    """

    def __init__(
        self,
        aircraft: Aircraft,
        step: CompiledStep,
        lanes: LaneStep,
        n: int,
        flown: _Flown,
        properties: Callable[[str], Doubles],
    ) -> None:
        self.aircraft, self._step, self._lanes, self._n = aircraft, step, lanes, n
        self._flown, self._properties = flown, properties
        self.dt = step.source.dt
        self.signals = lanes.names.signals

    def __len__(self) -> int:
        return self._n

    def __repr__(self) -> str:
        return f"<{self._n} flights of {self.aircraft.name} at {self['t'].max():.3f} s>"

    @overload
    def __getitem__(self, key: str) -> Doubles: ...
    @overload
    def __getitem__(self, key: LaneIndex) -> "State": ...
    def __getitem__(self, key: str | LaneIndex) -> "Doubles | State":
        return self._values(key) if isinstance(key, str) else self._some(key)

    def _values(self, name: str) -> Doubles:
        """A signal or a property of every flight, shape (n,)."""
        name, names, flown = _TIME if name == "t" else name, self._lanes.names, self._flown
        for array, known in (
            (flown.shown, names.signals),
            (flown.states, names.states),
            (flown.parameters, names.parameters),
        ):
            if name in known:
                return array[:, known.index(name)].reshape(-1)[: self._n].copy()
        if name in names.properties:
            return self._properties(name)[: self._n].copy()
        every = (*names.signals, *names.states, *names.parameters, *names.properties)
        raise _unknown("a state has signals and properties by name", name, every)

    def _some(self, key: LaneIndex) -> "State":
        lanes = np.atleast_1d(np.arange(self._n)[key])
        if not len(lanes):
            raise InputError("a state must have at least one flight, got none.")
        rows = [self._lanes.blocks(self._lanes.rows(x, self._n)[lanes]) for x in self._flown.arrays]
        of_all = self._properties
        return self._with(len(lanes), _Flown(*rows), lambda name: of_all(name)[: self._n][lanes])

    def _with(self, n: int, flown: _Flown, properties: Callable[[str], Doubles]) -> "State":
        return State(self.aircraft, self._step, self._lanes, n, flown, properties)

    def put(self, lanes: LaneIndex, other: "State") -> "State":
        """The state with some flights exchanged for those of another state, one for each.

        That puts flights back to where they were, and starts new ones in the lanes of others.
        """
        at = np.atleast_1d(np.arange(self._n)[lanes])
        if other._lanes is not self._lanes:
            raise InputError("`other` must be a state of this aircraft in the same kind of air.")
        if len(other) not in (1, len(at)):
            raise InputError(f"`other` must have {len(at)} flights or one, got {len(other)}.")
        taken = np.broadcast_to(np.arange(len(other)), (len(at),))
        flown, width = self._flown.copy(), self._lanes.width
        for mine, others in zip(flown.arrays, other._flown.arrays, strict=True):
            mine[at // width, :, at % width] = others[taken // width, :, taken % width]
        before, new, n = self._properties, other._properties, self._n

        def properties(name: str) -> Doubles:
            values = before(name)[:n].copy()
            values[at] = new(name)[taken]
            return values

        return self._with(n, flown, properties)

    def with_seeds(self, seeds: Sequence[int] | npt.NDArray[np.integer[Any]]) -> "State":
        """The state with other turbulence from now on, by a seed for each flight."""
        if np.shape(seeds) != (self._n,):
            raise InputError(f"`seeds` must be {self._n} numbers, got {got(seeds)}.")
        random = self._lanes.blocks(np.stack([seeded(int(seed)) for seed in seeds]))
        return self._with(self._n, replace(self._flown, random=random), self._properties)

    def copy(self) -> "State":
        """A state of the same flights."""
        return self._with(self._n, self._flown.copy(), self._properties)


def numbers(name: str, given: npt.ArrayLike) -> Doubles:
    """Finite numbers that were given under a name; an InputError if they are others."""
    try:
        values = np.asarray(given)
    except ValueError:  # rows of several lengths
        values = np.asarray(None)
    if values.dtype.kind not in "fiu" and values.size:
        raise InputError(f"`{name}` must be numbers, got {got(given)}.")
    if not np.isfinite(values.astype(float)).all():
        raise InputError(f"`{name}` must be finite, got {got(given)}.")
    return values.astype(float)


def _unknown(must: str, name: str, known: Sequence[str]) -> InputError:
    return InputError(f"{must}, got `{name}`{nearest_name(name, known)}")
