"""Simulation of one closed loop: plant, controller and reference give a table of signals."""

import math
import struct
from collections.abc import Callable, Generator, Iterable, Sequence
from functools import cache, lru_cache, partial
from itertools import chain, repeat
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.controller import (
    Controller,
    FlightCondition,
    LawError,
    Measured,
    ReferenceSample,
    SelfLimiting,
)
from flighttune.control.exact_law import ExactLaw
from flighttune.control.gains import COMMANDS, ERRORS_WITH_AIRSPEED, WITH_AIRSPEED, PIGains
from flighttune.control.mimo_pi import MimoPI
from flighttune.flight.loop.aircraft import OTHER_LAW, CompiledAircraft, inside
from flighttune.flight.loop.batch import ARRIVED, GOES_ON, MEMORY, Motion, SampledLaw, numbers_of
from flighttune.flight.loop.measured import measured_of, seen_names
from flighttune.routes import follow as following
from flighttune.routes.feasible import FeasibleReference
from flighttune.routes.segments import Reference
from flighttune.vehicles.plants.base import COMMON_SIGNALS, N_X_SIGNALS, OVER_GROUND, Plant, Stop
from flighttune.vehicles.plants.inertial import inertial_errors
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.navigation import NUMPY, Arithmetic, Navigation
from flighttune.vehicles.plants.sensors import (
    SENSED,
    DrawnErrors,
    SensedPlant,
    Sensors,
    seen_errors,
)
from flighttune.vehicles.plants.weather import WIND

# Signals that the loop adds to those of the plant. Signals that the controller records stand before
# the last two.
KINDS = ("cmd", "unlimited", "limited")
LOOP_SIGNALS = (
    *("chi_ref", "gamma_ref", "chi_err", "gamma_err"),
    *(f"{name}_{kind}" for kind in KINDS for name in COMMANDS),
)

# Further signals where speed has priority: the path angle given to the law, which is below the
# reference while thrust is short. Where the airspeed is a channel, also its reference and error.
GIVEN = "gamma_given"
AIRSPEED_SIGNALS = (GIVEN, "V_ref", "V_err")

PROGRESS_EVERY = 50

# Errors along a route are drawn for this multiple of its time in still air, and further if needed.
EXPECTED = 1.3

# Samples that a process flies before it loads compiled code: loading takes as long as compiled code
# saves in so many samples. Both give the same numbers.
COMPILED_FROM = 15_000

NOT_LATE = (0.0, 0.0)


def compile_at_once() -> None:
    """Use compiled code from the next flight on, because this process will fly many."""
    Flight.flown = max(Flight.flown, COMPILED_FROM)


# Errors of the signals that the law sees, a row per sample or none; places and numbers for `sense`.
Seen: TypeAlias = tuple[FloatArray, tuple[int, int, int], tuple[float, float, float]]

# Measured values and reference at a sample, and its time; the place on the route, if there is one;
# whether the flight ends with this sample.
Sample: TypeAlias = tuple[Measured, ReferenceSample, float, following.Place | tuple[()], bool]


def simulate(
    plant: Plant,
    controller: Controller,
    reference: Reference | FeasibleReference | following.RouteReference,
    *,
    condition: FlightCondition,
    duration: float,
    sensors: Sensors | None = None,
    navigation: Navigation | None = None,
    lead: tuple[float, float] | None = None,
    speed_priority: bool = False,
    progress: Callable[[float], None] | None = None,
) -> tuple[pd.DataFrame, Stop | None]:
    """Fly `plant` under `controller` along `reference` from `condition` for `duration` (s).

    The plant has not flown yet. The controller, as `Law.controller` makes it, maps (chi, gamma) to
    (phi, n_z) within its own limits, and starts from the roll and load factor of `condition`; its
    sample time is the step of the loop. It may have a third command, n_x, if the plant takes it and
    the reference has an airspeed; the signals then also hold `AIRSPEED_SIGNALS`. A flight along a
    route stops at the end of the route and has `ROUTE_SIGNALS`. With `sensors` the controller sees
    course, climb and airspeed with their errors, and the signals hold `MEASURED`. With `navigation`
    all values that it sees have errors, and the signals hold them (``*_meas``, and on a route
    `SEEN_SIGNALS`). Tracking errors and places on the route are true ones. `lead`: lags of roll and
    lift (s) for which commands are planned ahead where the reference rolls in or is a route.
    `speed_priority`: the path angle gives way where the airspeed would fall too far below that of
    `condition`, as it does under a third command; the plant shows n_x, and the signals then hold
    `GIVEN`. `progress` is called with the time flown (s), about once a second of flight.

    Returns a read-only table with a row per sample, indexed by `t` in s, in SI and radians: signals
    of the plant, then `LOOP_SIGNALS` with the signals of the controller. The second value says why
    a flight ended early; its table ends with the last sample before. A controller that raises, or
    whose commands cannot be used, ends the flight with ``law_failed``. Raises TrimError if the
    plant finds no steady flight at `condition`.
    """
    settings = sensors, lead, speed_priority, navigation
    flight = Flight(plant, controller, reference, condition, duration, *settings)
    if (flown := flight.fly_compiled(progress)) is not None:
        return flown
    advance, step = flight.samples().send, step_of(controller, flight.plant)
    commands, k = None, 0
    while True:
        try:
            measured, ref, now, *_ = advance(commands)  # the first call starts the flight
        except StopIteration as end:
            return flight.signals(), end.value
        try:
            commands = step(measured, ref, now)
        except LawError as error:
            return flight.signals(), Stop("law_failed", str(error))
        if progress is not None and k % PROGRESS_EVERY == 0:
            progress(now)
        k += 1


def step_of(controller: Controller, plant: Plant) -> Callable[..., Sequence[float]]:
    """The step of a law, which feeds back the load factor that the inner loop follows."""
    if (followed := _fed_back(controller, plant)) is None:
        return controller.step
    return lambda measured, *sample: controller.step(measured._replace(n_z=followed()), *sample)


def _fed_back(controller: Controller, plant: Plant) -> Callable[[], float] | None:
    """A reader of the load factor that the inner loop follows; None if it is not fed back."""
    gains, followed = getattr(controller, "gains", None), getattr(plant, "n_z_followed", None)
    return followed if isinstance(gains, PIGains) and gains.feeds_back else None


class Flight:
    """One flight that waits at every sample for commands: `simulate` takes them from a law.

    Parameters are those of `simulate`. The caller takes commands from the controller's `step` or
    from elsewhere. `samples` yields each `Sample`, receives the result of `Controller.step`, and
    returns why the flight ended early, or None. The first sample starts plant and controller.
    `plant` is the given plant, with the errors of sensors and navigation.
    """

    # Samples of this process that compiled code could have flown
    flown = 0

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        reference: Reference | FeasibleReference | following.RouteReference,
        condition: FlightCondition,
        duration: float,
        sensors: Sensors | None = None,
        lead: tuple[float, float] | None = None,
        speed_priority: bool = False,
        navigation: Navigation | None = None,
    ) -> None:
        dt = controller.dt
        if not (math.isfinite(duration) and duration >= dt):
            raise InputError(f"`duration` must be at least one sample ({dt} s), got {duration} s.")
        if not isinstance(controller, SelfLimiting):
            raise InputError(
                "`controller` must apply limits itself (SelfLimiting); wrap it in GuardedLaw."
            )
        last = round(duration / dt)
        self._t = t = _times(last + 1, dt)
        route = reference if isinstance(reference, following.RouteReference) else None
        self._errors, expected = None, last + 1
        if route is not None:
            expected = round(EXPECTED * route.path.length / (condition.V_a * dt))
        _set_inertial_errors(plant, navigation, (last + 1) * dt, expected * dt)
        if sensors is not None or navigation is not None:
            followed = _fed_back(controller, plant) is not None
            # JSBSim's own flights keep to NumPy, so that they check compiled errors too.
            by = compiled_arithmetic(len(t)) if inside(plant, CompiledAircraft) else NUMPY
            draw = partial(seen_errors, sensors, navigation, dt, condition.V_a, followed, by)
            self._errors = DrawnErrors(draw, last + 1, expected)
            share = 1.0 if navigation is None else navigation.wind_share(dt)
            plant = SensedPlant(plant, self._errors, dt, condition.h, share)
        self._wrapped = getattr(controller, "wrapped", (True,))[0]
        airspeed = priority = plan = None
        if not isinstance(reference, FeasibleReference):
            airspeed = reference.airspeed(t)
        if airspeed or speed_priority:
            held = None if airspeed else condition.V_a
            priority = following.AirspeedPriority(held, reference.g, dt)
        if lead is not None and isinstance(reference, Reference) and reference.planned:
            plan = following.Planner(dt, reference.g)  # a route's follower has one of its own
        m = len(plant.limits.lower)
        if (m == 3) is (airspeed is None):
            raise InputError(
                f"`reference` must have an airspeed with a plant of {m} commands: "
                f"{'none' if m == 2 else 'one'}, got {'none' if airspeed is None else 'one'}."
            )
        if len(controller.limiter.u_unsat) != m:
            raise InputError(
                f"`controller` must have the {m} commands of the plant, got "
                f"{len(controller.limiter.u_unsat)}."
            )
        further = () if route is None else tuple(following.ROUTE_SIGNALS)
        if route is not None and navigation is not None:
            further += following.SEEN_SIGNALS
        further += AIRSPEED_SIGNALS if airspeed else (GIVEN,) * speed_priority
        self._columns = _columns(plant.signals, (*controller.signals, *further), m)
        self._rows = bytearray()
        self.plant = plant  # as the law sees it
        self._given = plant, controller, condition, reference, lead or NOT_LATE
        self._priority = priority if airspeed is None else None  # where the plant holds airspeed
        self._planned = plan is not None
        # Only these laws are compiled: a class derived from them may compute something else.
        self._of_matrices: ExactLaw | MimoPI | None = None
        if isinstance(controller, ExactLaw | MimoPI) and type(controller) in (ExactLaw, MimoPI):
            self._of_matrices = controller
        self._helpers = measured_of(plant, condition.h, dt), plan, priority, airspeed

    def fly_compiled(
        self, progress: Callable[[float], None] | None
    ) -> tuple[pd.DataFrame, Stop | None] | None:
        """Fly a law of the package on an aircraft in compiled code; None if that is impossible."""
        # The plain loop gives the same bits. It flies until enough samples are flown to pay for
        # loading compiled code, and where Numba is not installed.
        (plant, _, condition, _, _), t, controller = self._given, self._t, self._of_matrices
        if "h" not in plant.signals:
            return None
        aircraft, flown = inside(plant, CompiledAircraft), Flight.flown + len(t)
        if controller is None:
            if aircraft and flown >= COMPILED_FROM:
                aircraft.refused = OTHER_LAW
            return None
        Flight.flown = flown
        if flown < COMPILED_FROM:
            return None
        if aircraft:
            aircraft.compiles = True
        from flighttune.flight.loop import kernel

        if not (kernel.COMPILED and self.law_compiles):
            return None
        plant.start(condition)
        controller.start(condition)
        rows, n, stop = np.empty((len(t), len(self._columns))), 0, None
        if aircraft and aircraft.compiled and OVER_GROUND[0] not in plant.signals:
            n, stop = self._fly_whole(aircraft, rows, progress)
            if not n:
                aircraft.compiles = False
                plant.start(condition)
        if not n:
            n, stop = self._fly_steps(rows, progress)
        return self.table(rows[:n]), stop

    @property
    def law_compiles(self) -> bool:
        """Whether compiled code computes the law of this flight, to the bit."""
        controller, reference = self._of_matrices, self._given[3]
        if controller is None or controller.gains.airspeed:
            return False
        if isinstance(controller, ExactLaw) or not controller.feed_forward:
            return True
        # Its feed-forward has NumPy's cosine, known in advance only where the path angle is.
        routed = isinstance(reference, following.RouteReference)
        return not (routed or self._priority or self._planned)

    def _sampled_law(self) -> tuple[SampledLaw, float]:
        """The law for compiled code, and the length of the route (m)."""
        (plant, _, condition, reference, lead), t = self._given, self._t
        controller = self._of_matrices
        assert controller is not None  # only these laws have numbers
        shown = plant.signals
        navigated = isinstance(plant, SensedPlant) and plant.navigated
        suffix = "_meas" * navigated
        air = WIND[0] in shown and OVER_GROUND[0] not in shown
        wind = shown.index(WIND[0] + suffix) if air else -1
        V_g = shown.index("V_g_meas") if navigated else -1
        position = (name + suffix for name in ("north", "east", "h"))
        places = *map(shown.index, (*seen_names(shown), *position, "h")), wind, V_g, len(shown)
        state = controller.state
        end, ahead, speed = math.inf, 0.0, 0.0
        path, refs, further = np.empty((0, 0)), np.empty((0, 4)), np.empty((0, 2))
        if isinstance(reference, following.RouteReference):
            end, ahead = reference.path.length, reference.look_ahead
            speed, path = reference.start_speed, reference.table
        else:
            refs = np.ascontiguousarray(np.transpose(sampled(reference, t, lead)))
            if isinstance(controller, MimoPI) and controller.feed_forward:
                further = _feed_forward(reference, t, refs[:, 1])
        engines = shown.index(N_X_SIGNALS[-1]) if self._priority else -1
        memory = np.zeros(MEMORY)
        memory[:12] = [*chain(*state[:5], state.expected)]
        memory[13] = speed
        return SampledLaw(
            np.array(numbers_of(controller.law)),
            places,
            controller.dt,
            (condition.h, ahead, *lead),
            (*(self._priority.numbers if self._priority else (0.0, 0.0, 0.0)), engines),
            refs,
            path,
            further,
            memory,
        ), end

    def _fly_steps(
        self, rows: FloatArray, progress: Callable[[float], None] | None
    ) -> tuple[int, Stop | None]:
        """Fly a compiled law on the plant; return the samples and why the flight ended."""
        from flighttune.flight.loop.kernel import law_sample

        (plant, controller, *_), t = self._given, self._t
        observe, advance, dt, shown = plant.observe, plant.advance, controller.dt, plant.signals
        n_z = shown.index(seen_names(shown)[-1])
        followed = _fed_back(controller, plant) or (lambda: signals[n_z])
        pack, bytes_of = struct.Struct(f"{len(shown)}d").pack_into, rows.data.cast("B")
        width, last, (law, end) = 8 * rows.shape[1], len(t) - 1, self._sampled_law()
        for k, now in enumerate(t.tolist()):
            signals = observe()
            pack(bytes_of, width * k, *signals)
            phi_cmd, n_z_cmd, along = law_sample(k, followed(), law, rows)
            if progress is not None and k % PROGRESS_EVERY == 0:
                progress(now)
            if k == last or along >= end:
                return k + 1, self._not_arrived(rows[: k + 1])
            if (stop := advance(phi_cmd, n_z_cmd, dt)) is not None:
                return k + 1, stop
        raise AssertionError("a flight has a last sample")

    def _fly_whole(
        self, aircraft: CompiledAircraft, rows: FloatArray, progress: Callable[[float], None] | None
    ) -> tuple[int, Stop | None]:
        """Fly law and aircraft in compiled code; no samples if JSBSim must find the ending."""
        from flighttune.flight.loop.compiled import fly_samples

        (functions, motion, *flown, (errors, *how_seen)), end = self.sampled(aircraft, 1)
        rows[0, : len(aircraft.signals)] = aircraft.observe()
        first, last = 0, len(rows)
        if progress is not None:  # it may end the flight, so compiled code is loaded before
            fly_samples(*functions, motion, *flown, (errors, *how_seen), (0, 0, end), rows)
        while True:
            until = last
            if progress is not None:
                progress(float(self._t[first]))
                until = min(first + PROGRESS_EVERY, last)
            if self._errors is not None:
                errors = self._errors.reach(first)
                until = min(until, len(errors))
            motion, until = aircraft.sensed(motion, first, until)
            n, how, steps = fly_samples(
                *functions, motion, *flown, (errors, *how_seen), (first, until, end), rows
            )
            if how == ARRIVED:
                return n, self._not_arrived(rows[:n])
            if how != GOES_ON:
                stop = aircraft.stop(how, steps)
                return (n if stop else 0), stop
            first = until

    def sampled(
        self, aircraft: CompiledAircraft, samples: int | None = None
    ) -> tuple[tuple[tuple[Any, Any], Motion, SampledLaw, bool, Seen], float]:
        """The first arguments of `fly_samples` after the start, and the length of the route (m).

        They have the errors of at least the first `samples`, by default of the whole flight.
        """
        plant, controller, *_ = self._given
        (law, end), (functions, motion) = self._sampled_law(), aircraft.sampled(controller.dt)
        motion, _ = aircraft.sensed(motion, (samples or len(self._t)) - 1, 0)
        fed_back = _fed_back(controller, plant) is not None
        seen = np.empty((0, len(SENSED))), (0, 0, 0), (0.0, 0.0, 0.0)
        if self._errors is not None and isinstance(plant, SensedPlant):
            errors = self._errors.reach((samples or len(self._t)) - 1)
            seen = errors, plant.places, plant.numbers
        return (functions, motion, law, fed_back, seen), end

    @property
    def shape(self) -> tuple[int, int]:
        """Samples of a whole flight, and columns of its table."""
        return len(self._t), len(self._columns)

    def table(self, rows: FloatArray) -> pd.DataFrame:
        """The table of `simulate` from rows of samples; writes tracking errors into the rows."""
        return _table(rows, self._columns, self._t, self._wrapped)

    def _not_arrived(self, rows: FloatArray) -> Stop | None:
        """Why a flight with these samples did not complete its route; None without a route."""
        plant, controller, _, route, _ = self._given
        if not isinstance(route, following.RouteReference):
            return None
        place = len(plant.signals) + len(LOOP_SIGNALS) + len(controller.signals) - 2
        along, aside, below = rows[-1, place : place + 3].tolist()
        now = float(self._t[len(rows) - 1])
        return route.not_arrived(now, (along, aside, below), gave_way=self._gave_way(rows))

    def _gave_way(self, rows: FloatArray) -> bool:
        """Whether the path angle gave way to the airspeed in these samples."""
        if GIVEN not in self._columns:
            return False
        given, asked = (self._columns.index(name) for name in (GIVEN, "gamma_ref"))
        return bool((rows[:, given] < rows[:, asked]).any())

    # The flight keeps no generator of itself: such a cycle would keep JSBSim and all errors drawn.
    def samples(self) -> Generator[Sample, Sequence[float] | None, Stop | None]:
        """Fly all samples, or to the end of a route, and add them to the rows."""
        plant, controller, condition, reference, lead = self._given
        measured_of, plan, priority, airspeed = self._helpers
        route = reference if isinstance(reference, following.RouteReference) else None
        plant.start(condition)
        try:
            controller.start(condition)
        except LawError as error:
            return Stop("law_failed", str(error))
        dt, limiter, place, seen, speed = controller.dt, controller.limiter, (), (), ()
        references = _references(reference, self._t, lead)
        follow = None if route is None else route.follower(dt, condition.h, lead)
        navigated = isinstance(plant, SensedPlant) and plant.navigated
        true = _true_place(plant.signals, condition.h)
        u_unsat, limited, m = limiter.u_unsat, limiter.limited, 2 if airspeed is None else 3
        speeds = None if airspeed is None else np.stack(airspeed, axis=1).tolist()
        gave_way = False
        observe, advance, rows = plant.observe, plant.advance, self._rows
        pack, last = struct.Struct(f"{len(self._columns)}d").pack, len(self._t) - 1
        end, times = math.inf if route is None else route.path.length, self._t.tolist()
        # A generator that refers to its flight would keep the plant, and JSBSim with it, until the
        # next garbage collection.
        del self
        for k, (now, ref) in enumerate(zip(times, references, strict=True)):
            signals = observe()
            measured = measured_of(signals)
            if follow is not None:
                ref, place = follow(measured)
                if navigated:
                    seen, place = place[1:], follow.placed(*true(signals))
            elif plan is not None:
                _, gamma_ref, chi_dot, gamma_dot, *_ = ref
                ref = ref._replace(planned=plan(measured, chi_dot, gamma_dot, gamma_ref))
            asked = ref
            if speeds is not None and ref[5] is None:  # not by its place on a route
                ref = ref._replace(V=speeds[k][0], V_dot=speeds[k][1])
            if priority is not None:
                ref = priority(measured, ref)
                speed = (ref[1],) if speeds is None else (ref[1], ref[5], 0.0)
                gave_way = gave_way or ref[1] < asked[1]
            ends = k == last or (bool(place) and place[0] >= end)
            commands = yield measured, ref, now, place, ends
            assert commands is not None  # None only starts the flight
            # Tracking errors are computed after the flight, from the true signals.
            loop = asked[0], asked[1], 0.0, 0.0, *commands[:m]
            rows += pack(*signals, *loop, *u_unsat, *commands[m:], *place, *seen, *speed, *limited)
            if ends:
                if route is None or not place:
                    return None
                return route.not_arrived(now, place, gave_way=gave_way)
            if (stop := advance(commands[0], commands[1], dt, *commands[2:m])) is not None:
                return stop
        return None

    def signals(self) -> pd.DataFrame:
        """The table of `simulate` for the samples so far; the flight cannot continue after it."""
        values = np.frombuffer(self._rows, dtype=np.float64).reshape(-1, len(self._columns))
        return self.table(values)


@lru_cache(maxsize=4)  # a flight along a route may last hours, of which it needs minutes
def _times(samples: int, dt: float) -> FloatArray:
    times = np.arange(samples, dtype=np.float64) * dt
    times.flags.writeable = False
    return times


def _set_inertial_errors(
    plant: Plant, navigation: Navigation | None, longest: float, expected: float
) -> None:
    """Let the sensors of an aircraft's inner loop err only if `navigation` says so.

    The flight takes up to the `longest` time (s); errors are drawn for the `expected` time first.
    """
    if (aircraft := inside(plant, JSBSimPlant)) is None:
        return
    aircraft.errors = None  # those of an earlier flight
    if navigation is not None and navigation.inner_loop:
        rate = aircraft.config.inner_loop_rate
        draw = partial(inertial_errors, navigation, rate=rate)
        aircraft.errors = DrawnErrors(draw, math.ceil(longest * rate), math.ceil(expected * rate))


def compiled_arithmetic(samples: int) -> Arithmetic:
    """The compiled arithmetic where a flight of so many samples may load compiled code."""
    if Flight.flown + samples < COMPILED_FROM:
        return NUMPY
    from flighttune.flight.loop import kernel

    return kernel.ARITHMETIC if kernel.COMPILED else NUMPY


def _true_place(
    signals: tuple[str, ...], h_0: float
) -> Callable[[tuple[float, ...]], tuple[float, float, float]]:
    """A reader of north, east and height above sea level (m)."""
    north, east, down = map(signals.index, ("north", "east", "down"))
    h = signals.index("h") if "h" in signals else None
    return lambda shown: (shown[north], shown[east], h_0 - shown[down] if h is None else shown[h])


def _references(
    reference: Reference | FeasibleReference | following.RouteReference,
    t: np.ndarray,
    lead: tuple[float, float],
) -> Iterable[ReferenceSample]:
    if isinstance(reference, following.RouteReference):
        return repeat(ReferenceSample(*reference.initial), len(t))  # the follower replaces it
    values = np.stack(sampled(reference, t, lead))
    if isinstance(reference, FeasibleReference):
        planned = map(tuple, reference.commands(t).tolist())
        return map(ReferenceSample, *values.tolist(), planned)
    if (values == values[:, :1]).all():
        return repeat(ReferenceSample(*values[:, 0].tolist()), len(t))
    return map(ReferenceSample, *values.tolist())


def sampled(
    reference: Reference | FeasibleReference, t: np.ndarray, lead: tuple[float, float]
) -> list[FloatArray]:
    """Course, path angle and their rates at each time."""
    late = () if isinstance(reference, FeasibleReference) else (lead,)
    return [*reference.sampled(t), *reference.rates(t, *late)]


def _feed_forward(
    reference: Reference | FeasibleReference, t: FloatArray, gamma_ref: FloatArray
) -> FloatArray:
    """Feed-forward of the paper's law at each sample, for `law_sample`."""
    if isinstance(reference, FeasibleReference):
        return reference.commands(t)
    # Number by number, as in `MimoPI`: NumPy's cosine of an array may differ in the last bit.
    lift = {gamma: float(np.cos(gamma)) for gamma in set(gamma_ref.tolist())}
    return np.array([(math.nan, lift[gamma]) for gamma in gamma_ref.tolist()])


def _columns(
    plant_signals: tuple[str, ...], law_signals: tuple[str, ...], m: int
) -> tuple[str, ...]:
    if plant_signals[: len(COMMON_SIGNALS)] != COMMON_SIGNALS:
        raise InputError(f"`plant.signals` must begin with {COMMON_SIGNALS}, got {plant_signals}.")
    commands = COMMANDS if m == len(COMMANDS) else WITH_AIRSPEED[COMMANDS]
    cmd, unlimited, limited = ([f"{name}_{kind}" for name in commands] for kind in KINDS)
    columns = *plant_signals, *LOOP_SIGNALS[:4], *cmd, *unlimited, *law_signals, *limited
    if twice := sorted({name for name in columns if columns.count(name) > 1 or name == "t"}):
        kind = LawError if set(twice) & set(law_signals) else InputError
        raise kind(f"`signals` must have names that nothing else has, got {twice}.")
    return columns


def _table(
    values: FloatArray, columns: tuple[str, ...], t: FloatArray, wrapped: bool
) -> pd.DataFrame:
    for name in ERRORS_WITH_AIRSPEED:
        if f"{name}_err" not in columns:
            continue
        ref, err = (columns.index(f"{name}{kind}") for kind in ("_ref", "_err"))
        errors = values[:, ref] - values[:, columns.index("V_a" if name == "V" else name)]
        if name == "chi" and wrapped:
            errors = math.pi - (math.pi - errors) % math.tau  # `wrap_angle`, to the bit
        values[:, err] = errors
    index = pd.Index(t[: len(values)], name="t")
    values.flags.writeable = False
    return pd.DataFrame(values, columns=_named(columns), index=index, copy=False)


@cache
def _named(columns: tuple[str, ...]) -> pd.Index:
    """Names of columns, made once: making them takes most of the time of a table."""
    return pd.Index(columns)
