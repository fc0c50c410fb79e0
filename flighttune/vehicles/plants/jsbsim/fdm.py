"""One JSBSim instance, built once and kept quiet: names are checked, errors translated."""

import ctypes
import math
import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import FrameType
from typing import Any, TypeAlias

import jsbsim
import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import PlantError
from flighttune.vehicles.aircraft.aircraft import PROPERTY_NAME, AircraftConfig
from flighttune.vehicles.aircraft.model_xml import INERTIAS, Body, MassBalance
from flighttune.vehicles.plants.jsbsim import model_files
from flighttune.vehicles.plants.jsbsim.properties import THROTTLE

_ANSI_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_KEPT_RECORDS = 200
_NAME = re.compile(PROPERTY_NAME)


@lru_cache(maxsize=4096)
def _is_name(name: str) -> bool:
    return bool(_NAME.fullmatch(name.removeprefix("/")))


class QuietLogger(jsbsim.FGLogger):
    """Logger that writes nowhere and keeps the errors of each thread."""

    def __init__(self) -> None:
        self._thread = threading.local()

    def set_level(self, level: Any) -> None:
        """Begin a record."""
        self._thread.level, self._thread.text = int(level), ""

    def file_location(self, filename: str, line: int) -> None:
        """Take the place in the XML that the record is about."""
        self._thread.text += f"{filename}:{line}: "

    def message(self, message: str) -> None:
        """Take a piece of text."""
        self._thread.text += message

    def format(self, format: Any) -> None:
        """Ignore colours."""

    def flush(self) -> None:
        """End the record."""
        thread = self._thread
        if thread.level >= jsbsim.LogLevel.ERROR and len(thread.records) < _KEPT_RECORDS:
            thread.records.append(thread.text)

    def clear(self) -> None:
        """Forget this thread's records."""
        self._thread.level, self._thread.text, self._thread.records = 0, "", []

    @property
    def text(self) -> str:
        """This thread's errors in one line."""
        return one_line(" ".join(self._thread.records))


def one_line(text: str) -> str:
    """Return `text` without colours and line breaks."""
    return " ".join(_ANSI_COLOUR.sub("", text).split())


# JSBSim holds one logger a thread and lets go of it at the thread's end without Python's lock: a
# logger that dies there takes the process along. This one outlives every thread, with references to
# spare for those that two threads drop at the same moment.
_LOGGER = QuietLogger()
_IMMORTAL = [_LOGGER] * 10_000


def silence() -> QuietLogger:
    """Silence JSBSim in this thread from now on; the logger returned holds what it says."""
    _LOGGER.clear()
    jsbsim.set_logger(_LOGGER)
    return _LOGGER


@contextmanager
def signals_later() -> Iterator[None]:
    """Handle signals that come in the block at its end.

    JSBSim calls the logger, which is Python, while it loads. A handler that raises there makes
    Python lose the exception, or JSBSim end the process.
    """
    before, came = dict[int, Any](), list[int]()

    def keep(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        came.append(number)

    if threading.current_thread() is threading.main_thread():  # it alone handles signals
        handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
        before = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in before:
            signal.signal(number, keep)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


# Roll, pitch attitude and heading, rad
Angles: TypeAlias = tuple[float, float, float]

# ICAO standard atmosphere: K/m, K, Pa and g/(R L).
LAPSE_RATE = 0.0065
SEA_LEVEL_TEMPERATURE = 288.15
SEA_LEVEL_PRESSURE = 101325.0
PRESSURE_EXPONENT = 5.25588

_RANKINE = 1.8

# Pascal in a pound-force per square foot.
_PSF = 47.880259

_INCHES = 12.0

# Properties that are 0 in an empty aircraft: point masses and fuel.
_LOAD = re.compile(r"inertia/pointmass-weight|/tank(\[\d+\])?/contents-lbs")

# Integration steps a second while an engine settles. Long steps bring it to the same steady state
# with a fifth of the work; where they do not, as with some governors, short ones have to do.
_LONG_STEP_RATE, _SETTLING_RATE = 10.0, 50.0

# Samples in which the thrust must be at rest after JSBSim's own search for a steady state.
_TRIED = 3

# Longest times in long and in short steps, as multiples of the settling time: a filter in front of
# the throttle moves on by the steps of the flight, however long a step is.
_LONG_STEPS, _SHORT_STEPS = 2.0, 5.0

# Longest time in which an electric propeller settles that is too light for such steps, s.
_LIGHT_SETTLES = 15.0

# Change of thrust in a sample, as a share of it, that ends the settling.
_SETTLED_CHANGE = 1e-10

# Longest wait for a steady thrust as a multiple of the settling time, the relative change of thrust
# in a second that counts as none, and the time between two readings, s.
_MAX_SETTLINGS, _STEADY, _LOOK = 5, 1e-9, 0.2

# Height at which an aircraft is loaded whose engine settles, ft over the ground of JSBSim.
_ALOFT = 3000.0

MOTIONS = [
    f"simulation/integrator/{of}/{motion}"
    for of in ("rate", "position")
    for motion in ("rotational", "translational")
]

# Largest number of characters of JSBSim's words in a message.
MAX_REASON = 240

# The starter of all piston engines, with both magnetos, and the time that it turns them, s.
STARTER = {
    "propulsion/active_engine": -1.0,
    "propulsion/magneto_cmd": 3.0,
    "propulsion/starter_cmd": 1.0,
}
STARTING = 8.0


class Fdm:
    """A loaded aircraft over a flat Earth at rest; property nodes only by names that exist."""

    # `steps` is the number of integration steps in one sample of the inner loop's computer.
    # JSBSim's sea level is laid at the `ground` (m above sea level), with the air of that height:
    # turbulence of JSBSim, which takes heights above sea level for heights above ground, is then
    # right. `files` are those of the aircraft, by default looked at again.
    def __init__(
        self,
        config: AircraftConfig,
        *,
        steps: int = 1,
        ground: float = 0.0,
        files: model_files.Unchanged | None = None,
    ) -> None:
        files = files or model_files.unchanged(config)
        model_files.check_loads(files)
        self.files, self.config, self.steps, self.ground = files, config, steps, ground
        self._describe()
        # Makes an aircraft of this kind, as `load` does.
        self.another: Callable[..., Fdm] = load
        engines = range(config.engines.count)
        with signals_later():
            self._begin(files)
        self._properties = self._exec.get_property_manager()
        self.run: Callable[[], bool] = self._exec.run
        self.integrators = {name: (self.writer(name), self.reader(name)) for name in MOTIONS}
        self._read_engines()
        # Properties set for the whole flight, in JSBSim's units.
        # -1 starts all engines at once. Without it they stay off, and the trim finds no thrust.
        self.settings = {**config.settings} | ({"propulsion/set-running": -1.0} if engines else {})
        if ground:
            self.settings |= _sea_level_at(ground)
        for name, value in self.settings.items():
            self.writer(name)(value)
        self._lift_off()
        self.evaluate()

    def _begin(self, files: model_files.Unchanged) -> None:
        silence()
        self._exec = jsbsim.FGFDMExec(str(self.config.folder))
        try:
            with model_files.model_folders(files, weigh, self.steps) as folders:
                self._load(folders, silence())
        except PlantError:
            self.abandon()
            raise
        except RuntimeError as error:  # JSBSim's own errors and those of its property tree
            raise self._translation("cannot be loaded", error) from error

    def _lift_off(self) -> None:
        # Forces of the ground would remain in rates of change that the next evaluations see.
        if self.engine_settles:
            self.writer("ic/h-sl-ft")(_ALOFT)

    def _describe(self) -> None:
        config, files = self.config, self.files
        self._model = model_files.folders_of(files).file
        # Time the engine takes to a steady state, s; 0 where JSBSim knows it at once.
        self.engine_settles = config.engines.settle
        # Systems of the model itself may have a memory.
        self.own_flight_control = model_files.has_flight_control(files)
        self.electric = bool(config.engines.count) and model_files.has_engine(
            files, model_files.ELECTRIC
        )
        # Steps longer than those of the flight make the speed of a light propeller diverge.
        self.light = self.electric and config.engines.settle <= _LIGHT_SETTLES
        # Whether long steps have brought the engine to a steady state each time.
        self._long_steps = not self.light
        # Whether JSBSim's own search for a steady thrust has ended in one each time.
        self._searches = not self.electric
        # Roll, pitch and heading (rad) of `ic/` before a bench wrote the last ones, and those.
        self.attitude: tuple[Angles, Angles] = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.rate = config.inner_loop_rate * self.steps  # integration steps a second

    def _read_engines(self) -> None:
        engines = range(self.config.engines.count)
        self._running = [self.reader(f"propulsion/engine[{i}]/set-running") for i in engines]
        self.thrusts = list(map(self.reader, thrusts_of(self.config)))  # lbf
        self._thrust = self.thrusts[0] if engines else float
        levers = [f"fcs/throttle-pos-norm[{i}]" for i in engines]
        self._levers = [self.reader(name) for name in levers if self.shows(name)]

    def _load(self, folders: model_files.ModelFolders, log: QuietLogger) -> None:
        self._exec.set_debug_level(0)
        self._exec.set_dt(1.0 / self.rate)
        model, engines, systems = map(str, (folders.model, folders.engines, folders.systems))
        self._private = "|".join(map(re.escape, (model, engines, systems)))
        if not self._exec.load_model_with_paths(folders.name, model, engines, systems, False):
            if missing := ", ".join(model_files.missing_parts(self.config, log.text)):
                raise PlantError(f"{self._model}: must have all its parts, got no file {missing}.")
            reason = self._message(log.text) or "no reason"
            raise PlantError(f"{self._model}: must load in JSBSim, got: {reason}.")

    def names(self, beginning: str) -> list[str]:
        """Names of the properties that begin so."""
        lines = self._exec.query_property_catalog(beginning).splitlines()
        names = (line.partition(" ")[0] for line in lines)
        return [name for name in names if name.startswith(beginning)]

    def has(self, name: str) -> bool:
        """Whether there is a property of that name that can be written."""
        node = self._existing(name)
        return node is not None and bool(node.get_attribute(jsbsim.Attribute.WRITE))

    def shows(self, name: str) -> bool:
        """Whether there is a property of that name."""
        return self._existing(name) is not None

    def value(self, name: str, default: float) -> float:
        """The value of a property; a default where there is none of that name."""
        node = self._existing(name)
        return default if node is None else node.get_double_value()

    def start_engines(self) -> None:
        """Start those that do not run, at the airspeed and throttle there are."""
        # Electric ones never say that they run. Started again by JSBSim, some propellers diverge.
        if self.electric or all(read() for read in self._running):
            return
        if self.has("propulsion/magneto_cmd"):
            for name, value in STARTER.items():
                self.writer(name)(value)
            self.hold(STARTING)
            self.writer("propulsion/starter_cmd")(0.0)
        # JSBSim's own start goes to a steady state in steps of half a second, in which some
        # propellers stop: it comes last. -1 means all engines.
        if not all(read() for read in self._running):
            self.writer("propulsion/set-running")(-1.0)

    def reader(self, name: str) -> Callable[[], float]:
        """Return a function that reads the property `name` (JSBSim's units), which must exist."""
        return self._node(name).get_double_value

    def writer(self, name: str) -> Callable[[float], bool]:
        """Return a function that writes the property `name` (JSBSim's units), which must exist."""
        node = self._node(name)
        if not node.get_attribute(jsbsim.Attribute.WRITE):
            raise PlantError(f"{self._model}: property `{name}` must be writable, got read-only.")
        return node.set_double_value

    def declared_writer(self, name: str) -> Callable[[float], bool]:
        """Return a function that writes a declared property, also one of another simulator."""
        node = self._properties.get_node(name) if name in self.config.declared else None
        if node is None:
            raise PlantError(f"{self._model}: property `{name}` must be declared, it is not.")
        return node.set_double_value

    def evaluate(self) -> None:
        """Put the aircraft into the state of the ``ic/`` properties and evaluate its forces."""
        # No time passes. What JSBSim computes early in a step (``accelerations/N*``, what systems
        # see) is that of the evaluation before.
        silence()
        try:
            # Only with the trim status set do lags and rate limits settle in one evaluation.
            self._exec.set_trim_status(True)
            finished = self._exec.run_ic()
            self._exec.set_trim_status(False)
        except jsbsim.BaseError as error:
            raise self._translation("cannot be evaluated", error) from error
        if not finished:
            self.abandon()
            raise PlantError(f"{self._model}: JSBSim does not take the state of `ic/`.")

    def evaluate_again(self) -> None:
        """Evaluate flight control, forces and accelerations in flight; no time passes."""
        self._exec.suspend_integration()
        self._exec.run()
        self._exec.resume_integration()

    def settle_engine(self) -> None:
        """Let the engine settle at throttle and airspeed while the aircraft stays still."""
        if self.engine_settles:
            self.start_engines()
            if self._steady_at_once():
                return
            rate = _LONG_STEP_RATE if self._long_steps else _SETTLING_RATE
            # Behind a filter the throttle may take some steps until the thrust begins to change.
            self.hold(self.engine_settles * _LONG_STEP_RATE / rate, rate=rate)
            if self._long_steps:
                # The slower an electric one turns, the longer it takes.
                longest = (10.0 if self.electric else _LONG_STEPS) * self.engine_settles
                self._long_steps = self.hold(longest, rate=rate, still=_SETTLED_CHANGE)
            self.hold(_SHORT_STEPS * self.engine_settles, still=_SETTLED_CHANGE)

    def _steady_at_once(self) -> bool:
        """Whether JSBSim's own search finds a steady thrust, in a twentieth of the work."""
        # It sees the throttle as it is now, which is not yet there behind a filter.
        throttle = self.value(THROTTLE, math.nan)
        if not self._searches or any(read() != throttle for read in self._levers):
            return False
        self.search_thrust()
        running = [bool(read()) for read in self._running]
        # Its steps of half a second stop some propellers, and let others go to and fro.
        self._searches = (
            all(running)
            and self.run_still(_TRIED, _LONG_STEP_RATE, _SETTLED_CHANGE)
            and self.run_still(_TRIED, _SETTLING_RATE, _SETTLED_CHANGE)
        )
        for i, runs in enumerate(running):
            if not runs:
                self.start_engine(i)
        return self._searches

    def search_thrust(self) -> None:
        """Let JSBSim search for a steady thrust of each engine, in steps of half a second."""
        self._exec.get_propulsion().get_steady_state()  # its value says nothing

    def start_engine(self, i: int) -> None:
        """Start one engine."""
        self._exec.get_propulsion().get_engine(i).init_running()

    def hold(self, duration: float, *, rate: float = _SETTLING_RATE, still: float = 0.0) -> bool:
        """Let `duration` (s) pass for an aircraft that stays still, as `run_still` does."""
        if self.light:  # they settle in the steps in which they fly
            rate = max(rate, self.rate)
        # Whole samples of the inner loop, so that its next one falls on the start of the flight.
        return self.run_still(math.ceil(duration * rate / self.steps), rate, still)

    def rest(self) -> None:
        """Hold the aircraft in the steps of its flight until the thrust is steady."""
        now = self._thrust()
        # An evaluation leaves a turboprop without power, and a steady state depends on the step.
        for _ in range(math.ceil(_MAX_SETTLINGS * self.engine_settles / _LOOK)):
            before = now
            self.run_still(math.ceil(_LOOK * self.config.inner_loop_rate), self.rate)
            now = self._thrust()
            if abs(now - before) <= _LOOK * _STEADY * abs(now):
                return

    def run_still(self, samples: int, rate: float, still: float = 0.0) -> bool:
        """Let samples of the inner loop pass, at `rate` (1/s), while the aircraft stays still."""
        # Integrators of type 0 hold the aircraft still while time passes.
        states = [(write, read()) for write, read in self.integrators.values()]
        for write, _ in states:
            write(0.0)
        # A sample that changes the thrust by a smaller share of it than `still` ends the wait, and
        # the result says so.
        at_rest = False
        self._exec.set_dt(1.0 / rate)
        try:
            for sample in range(samples):
                before = self._thrust()
                for _ in range(self.steps):
                    self._exec.run()
                # Strict: a share of 0 never ends the wait early. The throttle comes with the first.
                at_rest = sample > 0 and abs(self._thrust() - before) < still * abs(before)
                if at_rest:
                    break
        except jsbsim.BaseError as error:
            raise self._translation("cannot be run", error) from error
        self._exec.set_dt(1.0 / self.rate)
        self._exec.set_sim_time(0.0)  # time at rest does not count: the flight begins at t = 0
        for write, value in states:
            write(value)
        return at_rest

    def earth_to_body(self) -> FloatArray:
        """Rotation from the axes of the Earth to those of the body; JSBSim's matrices warn."""
        return np.asarray(self._exec.get_propagate().get_Tec2b())

    def _body(self) -> Body:
        cg = [self.reader(f"inertia/cg-{axis}-in")() / _INCHES for axis in "xyz"]
        inertia = np.empty((3, 3))
        for name, (i, j) in INERTIAS.items():
            inertia[i, j] = inertia[j, i] = self.reader(f"inertia/{name}-slugs_ft2")()
        return Body(self.reader("inertia/weight-lbs")(), np.array(cg), inertia)

    def abandon(self) -> None:
        """Keep the broken aircraft until the process ends."""
        # JSBSim evaluates an aircraft once more when it frees it, and ends the process if that
        # fails.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._exec))

    def _existing(self, name: str) -> jsbsim.FGPropertyNode | None:
        # JSBSim aborts the process on a malformed name, and invents a node for an unknown one.
        # Behind a slash are properties that a model declares for another simulator.
        exists = _is_name(name) and self._properties.hasNode(name)
        return self._properties.get_node(name) if exists else None

    def _node(self, name: str) -> jsbsim.FGPropertyNode:
        if (node := self._existing(name)) is None:
            raise PlantError(f"{self._model}: must have the property `{name}`, got none.")
        return node

    def _translation(self, action: str, error: RuntimeError) -> PlantError:
        self.abandon()
        return PlantError(f"{self._model}: {action} by JSBSim: {self._message(str(error))}")

    def _message(self, text: str) -> str:
        """Words of JSBSim in one line, about the file of the user instead of the one made of it."""
        line = re.sub(rf"({self._private})/(\S+?\.xml)(:\d+)?", r"\2", one_line(text))
        return line.replace("No filename given. ", "")[:MAX_REASON].rstrip(" .:")


def load(files: model_files.Unchanged, steps: int, ground: float) -> Fdm:
    """An aircraft of JSBSim, by its files as they are."""
    return Fdm(files.config, steps=steps, ground=ground, files=files)


def thrusts_of(config: AircraftConfig) -> list[str]:
    """Properties with the thrust of the engines, lbf."""
    engines = range(config.engines.count)
    if engines and config.engines.thrust:
        return [config.engines.thrust]
    return [f"propulsion/engine[{i}]/thrust-lbs" for i in engines]


def _sea_level_at(ground: float) -> dict[str, float]:
    """Settings that shift the standard atmosphere down by `ground` (m), exact below tropopause."""
    # Pressure and temperature of the standard atmosphere at the ground become those at JSBSim's sea
    # level, so that every height above it has the air of `ground` plus that height.
    share = 1.0 - LAPSE_RATE * ground / SEA_LEVEL_TEMPERATURE
    return {
        "atmosphere/delta-T": -LAPSE_RATE * ground * _RANKINE,
        "atmosphere/P-sl-psf": SEA_LEVEL_PRESSURE * share**PRESSURE_EXPONENT / _PSF,
    }


def weigh(config: AircraftConfig) -> MassBalance:
    """Load an aircraft and weigh it, then once more without load and fuel."""
    fdm = Fdm(config)
    whole = fdm._body()
    pounds_per_slug = whole.weight / fdm.reader("inertia/mass-slugs")()
    for name in filter(_LOAD.search, fdm.names("")):
        fdm.writer(name)(0.0)
    fdm.evaluate()  # JSBSim computes mass and inertia here
    return MassBalance(whole=whole, empty=fdm._body(), pounds_per_slug=pounds_per_slug)
