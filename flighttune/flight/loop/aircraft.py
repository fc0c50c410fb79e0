"""A JSBSim aircraft flown by its compiled step, or by JSBSim where it has none: same bits."""

import math
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from flighttune.base.errors import FlightTuneError
from flighttune.base.units import FT, G_0
from flighttune.control.controller import FlightCondition
from flighttune.flight.loop.batch import (
    ALPHA,
    BESIDE,
    BEYOND,
    CHI,
    GOES_ON,
    HEIGHT,
    LIFT,
    N_Z_SEEN,
    PSI,
    THETA,
    V_FPS,
    Motion,
)
from flighttune.vehicles.plants.base import Stop, WrappedPlant
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.signals import left_envelope
from flighttune.vehicles.plants.weather import WIND, Weather, WindNumbers

if TYPE_CHECKING:
    from flighttune.compiled.aircraft import CompiledStep
    from flighttune.vehicles.plants.jsbsim.fdm import Fdm
    from flighttune.vehicles.plants.jsbsim.model_files import Unchanged

P = TypeVar("P", bound=WrappedPlant | JSBSimPlant)

_G_0_FPS2 = G_0 / FT

# The compiled step knows air and forces up to the tropopause, m above sea level, and down to where
# parts may touch the ground before the next check, in air that moves so fast, m/s.
CEILING, MOVING_AIR = 10_900.0, 50.0

WIND_PROPERTIES = tuple(f"atmosphere/gust-{axis}-fps" for axis in ("north", "east", "down"))

# Beginning of the reason why JSBSim flies an aircraft whose step may be compiled
UNKNOWN = "its loop does not know"

# Other reasons, which concern one flight
OTHER_LAW = "laws other than the paper's and the exact one are not compiled"
LOW = "flights near the ground are not compiled"
HIGH = f"flights above {CEILING / 1000.0:g} km are not compiled"
NOT_FINITE = "its commands or signals are not finite"

# Rows of random numbers drawn at a time
DRAWN = 64


class CompiledAircraft(WrappedPlant):
    """A JSBSim plant that flies by its compiled step after the start, if it has one.

    `compiles`, set before the start, says whether it should. `refused` says why JSBSim flies
    instead.
    """

    def __init__(self, plant: JSBSimPlant) -> None:
        super().__init__(plant, ())
        self.plant, self.refused, self.compiles = plant, "", False
        self._motion: Motion | None = None
        self._given: list[tuple[float, ...]] = []
        self._clock = 0

    def start(self, condition: FlightCondition) -> None:
        """Put the aircraft into `condition` at t = 0, as the plant does."""
        if not self.compiles:
            self.start_in_jsbsim(condition)
            return
        from flighttune.vehicles.plants.jsbsim.model_files import unchanged

        files = unchanged(self.plant.config)
        kept = _kept_start(self.plant.key_of_start(condition, files))
        if not kept:
            start = self._compiled_start(condition, files)
            if start is None:
                return
            kept.append(start)
        self._begin(condition, kept[0])

    def _compiled_start(self, condition: FlightCondition, files: "Unchanged") -> "KeptStart | None":
        """The start of a compiled flight; None if JSBSim flies, and has started."""
        plant, weather = self.plant, self.plant.weather or Weather()
        if plant.steps > 1:
            self.refused = f"{UNKNOWN} several integration steps in a sample of the inner loop"
            self.start_in_jsbsim(condition)
            return None
        from flighttune.compiled.face import Refusal
        from flighttune.compiled.properties import Unsupported
        from flighttune.vehicles.plants.jsbsim import steps

        turbulence = weather.turbulence
        step = steps.compiled(
            plant.config,
            turbulence=None if turbulence is None else turbulence.model,
            gust=weather.gust is not None,
            files=files,
        )
        if isinstance(step, Refusal):
            self.refused = step.reason
            self.start_in_jsbsim(condition)
            return None
        fdm = steps.evaluated(plant.config, ground=plant.ground, files=files)
        if fdm is not None:
            # JSBSim says what is wrong with a start that fails.
            with suppress(FlightTuneError, NotCompiled, Unsupported):
                plant.start(condition, fdm)
                return KeptStart(step, motion_of(plant, step, weather), plant.observe())
        self.start_in_jsbsim(condition)
        first = plant.observe()
        try:
            return KeptStart(step, motion_of(plant, step, weather), first)
        except (NotCompiled, Unsupported) as what:
            self.refused = f"{UNKNOWN} {what}"
            self.start_in_jsbsim(condition)
            return None

    def _begin(self, condition: FlightCondition, start: "KeptStart") -> None:
        """Begin a compiled flight at its start."""
        self._condition, self._clock, self._given = condition, 0, []
        self._step, self._first = start.step, list(start.first)
        arrays = {k: x for k, x in start.motion._asdict().items() if isinstance(x, np.ndarray)}
        self._motion = start.motion._replace(**{k: x.copy() for k, x in arrays.items()})

    @property
    def sloped(self) -> tuple[Any, Any]:
        """Functions of the compiled step with slopes; they need this aircraft to stay alive."""
        from flighttune.compiled.face import sloped

        self._with_slopes = sloped(self._step)
        return self._with_slopes.functions

    def start_in_jsbsim(self, condition: FlightCondition) -> None:
        """Start the plant, and let JSBSim fly it to its end."""
        self.plant.start(condition)
        self._motion, self._observe = None, self.plant.observe

    @property
    def compiled(self) -> bool:
        """Whether the compiled step flies."""
        return self._motion is not None

    def sampled(self, dt: float) -> tuple[tuple[Any, Any], Motion]:
        """The functions of the compiled step, and its motion for samples of `dt` (s)."""
        assert self._motion is not None  # it is compiled
        motion = self._motion._replace(steps=self.plant.count_steps(dt))
        return self._step.functions, motion

    def sensed(self, motion: Motion, first: int, until: int) -> tuple[Motion, int]:
        """A motion with the errors of its sensors from a sample on, and the sample they reach.

        That is `until` at most.
        """
        if (drawn := self.plant.errors) is None:
            return motion, until
        errors = drawn.reach((first + 1) * motion.steps - 1)
        return motion._replace(errors=errors), min(until, len(errors) // motion.steps)

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        return self._observe() if self._motion is None else self._shown()

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did."""
        motion = self._motion
        if motion is None:
            return self.plant.advance(phi_cmd, n_z_cmd, duration, *n_x)
        commands = phi_cmd, n_z_cmd, *n_x
        self._given.append((phi_cmd, n_z_cmd, duration, *n_x))
        if not (math.isfinite(phi_cmd) and math.isfinite(n_z_cmd)):
            self.refused = NOT_FINITE
            return self._replay()
        for place, command in zip(motion.commands, commands, strict=False):
            motion.parameters[place] = command
        steps = self.plant.count_steps(duration)
        if self.plant.errors is not None:
            motion = motion._replace(errors=self.plant.errors.reach(self._clock + steps - 1))
        from flighttune.flight.loop.compiled import fly_sample

        how, flown = fly_sample(*self._step.functions, motion, self._clock, steps)
        self._clock += flown
        return None if how == GOES_ON else self.stop(how, self._clock) or self._replay()

    def stop(self, how: int, steps: int) -> Stop | None:
        """Why a flight ended after so many integration steps; None if JSBSim must find out."""
        motion = self._motion
        if motion is None:
            return None
        shown, m = motion.shown.tolist(), motion.signals
        if how == BEYOND:
            low, high = shown[m + HEIGHT] <= motion.floor, shown[m + HEIGHT] >= motion.ceiling
            self.refused = LOW if low else HIGH if high else NOT_FINITE
            return None
        state = {"alpha": shown[ALPHA], "V_a": shown[m + V_FPS] * FT, "theta": shown[THETA]}
        state["n_z"] = shown[m + LIFT] / motion.weight
        if not all(map(math.isfinite, shown)):
            self.refused = NOT_FINITE
            return None
        why = left_envelope(self.plant.config, state, shown[properties.SIGNALS.index("throttle")])
        if why is None:
            return None
        t = float(np.cumsum(np.full(steps, 1.0 / self.plant.rate))[-1])
        return Stop(why[0], f"t = {t:.3f} s: {why[1]}")

    @property
    def n_z_followed(self) -> Callable[[], float]:
        """A reader of the load factor that the inner loop follows."""
        return self._followed

    def _followed(self) -> float:
        """The load factor that the inner loop sees, one step of its computer old."""
        if (motion := self._motion) is None:
            return self.plant.n_z_followed()
        return float(motion.shown[motion.signals + N_Z_SEEN])

    def _shown(self) -> tuple[float, ...]:
        """Signals of the last step; course and heading are unwrapped."""
        motion = self._motion
        assert motion is not None  # JSBSim is observed by its own function
        if self._clock:
            shown, m = motion.shown.tolist(), motion.signals
            signals = shown[:m] + shown[m + BESIDE : m + BESIDE + motion.further]
            for i in (CHI, PSI):
                before = self._first[i]
                signals[i] = before + math.remainder(signals[i] - before, math.tau)
            self._first = signals
        return tuple(self._first)

    def _replay(self) -> Stop | None:
        """Repeat the flight so far in JSBSim, which then continues it."""
        self.start_in_jsbsim(self._condition)
        stop = None
        for phi_cmd, n_z_cmd, duration, *n_x in self._given:
            self._observe()  # course and heading follow sample by sample
            stop = self.plant.advance(phi_cmd, n_z_cmd, duration, *n_x)
        return stop


class KeptStart(NamedTuple):
    """The start of a flight, which flies a copy of this motion."""

    step: "CompiledStep"
    motion: Motion
    first: tuple[float, ...]  # signals


@lru_cache(maxsize=64)
def _kept_start(_key: Hashable) -> list[KeptStart]:
    """A list for the start with this key: searches fly many gains from the same start."""
    return []


def inside(plant: object, kind: type[P]) -> P | None:
    """The aircraft of that kind inside a plant, if there is one."""
    while isinstance(plant, WrappedPlant) and not isinstance(plant, kind):
        plant = plant.plant
    return plant if isinstance(plant, kind) else None


class NotCompiled(Exception):
    """JSBSim must fly this flight although its step is compiled."""


def motion_of(plant: JSBSimPlant, step: "CompiledStep", weather: Weather) -> Motion:
    """The motion of a plant after its start, for its compiled step."""
    from flighttune.vehicles.plants.jsbsim.steps import start_of

    fdm, config, names = plant.fdm, plant.config, step.names
    assert fdm is not None  # it was started
    places = {name: -1 - i for i, name in enumerate(names.states)}
    places |= {name: i for i, name in enumerate(names.parameters)}

    def place(name: str) -> int:
        if name not in places:
            raise NotCompiled(f"the property {name}")
        return places[name]

    changes = [
        (math.ceil(at * plant.rate - 1e-6), place(name), value)
        for at, name, value in plant.changes()
    ]
    changes.sort()
    at, where, to = zip(*changes, strict=True) if changes else ((), (), ())
    h_ft, weight = fdm.reader("position/h-sl-ft")(), fdm.reader("inertia/mass-slugs")() * _G_0_FPS2
    shown = np.zeros(len(names.signals))
    guarded = len(properties.SIGNALS)
    shown[guarded + HEIGHT], shown[guarded + N_Z_SEEN] = h_ft, plant.n_z_followed()
    unchecked = plant.guarded_steps / plant.rate  # longest time between two checks, s
    e, wind = config.envelope, weather.deterministic(0.0, h_ft * FT + fdm.ground)
    start = start_of(step, plant)
    turbulent = weather.turbulence is not None
    windy = weather.changes
    moving = weather.numbers if windy else WindNumbers(())
    low, high = (
        np.array([e.alpha[i], e.V_a[i] / FT, e.n_z[i] * weight, e.theta[i]]) for i in (0, 1)
    )
    return Motion(
        states=start.states,
        parameters=start.parameters,
        shown=shown,
        signals=guarded,
        further=len(plant.signals) - guarded,
        commands=tuple(
            place(name) for name in (properties.PHI_CMD, properties.N_Z_CMD, properties.N_X_CMD)
        ),
        steps=0,
        between=plant.guarded_steps,
        low=low,
        high=high,
        weight=weight,
        floor=(e.V_a[1] + MOVING_AIR) / FT * unchecked + _lowest_reach(fdm),
        ceiling=(CEILING - fdm.ground) / FT,
        stream=np.empty((DRAWN if turbulent else 1, 4 if turbulent else 0)),
        random=start.random,
        errors=np.empty((0, len(properties.ERRORS))),
        error_places=tuple(map(place, properties.ERRORS)),
        change_at=np.array(at, dtype=np.int64),
        change_place=np.array(where, dtype=np.int64),
        change_to=np.array(to, dtype=float),
        changed=np.zeros(1, dtype=np.int64),
        air=WindNumbers(*(np.reshape(rows, (-1, 1 + len(WIND))) for rows in moving)),
        wind_places=tuple(place(name) for name in WIND_PROPERTIES) if windy else (0, 0, 0),
        wind=np.array([*(x / FT for x in wind), 0.0, 0.0, 0.0, h_ft]),
        ground=fdm.ground,
        rate=plant.rate,
    )


def _lowest_reach(fdm: "Fdm") -> float:
    """Distance from the centre of gravity, in any attitude, of what may touch the ground, ft."""
    cg = [fdm.reader(f"inertia/cg-{axis}-in")() for axis in "xyz"]
    contacts = [name for kind in ("gear/unit", "contact/unit") for name in fdm.names(kind)]
    units = [name.removesuffix("x-position") for name in contacts if name.endswith("/x-position")]
    places = [[fdm.reader(f"{unit}{axis}-position")() for axis in "xyz"] for unit in units]
    return max((math.dist(place, cg) / 12.0 for place in places), default=0.0)
