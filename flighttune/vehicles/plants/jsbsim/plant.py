"""The aircraft of JSBSim with its inner loop, as a plant."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError, PlantError
from flighttune.base.units import FT
from flighttune.control.limits import Limits
from flighttune.vehicles.aircraft.aircraft import (
    GAINS_FILE,
    AircraftConfig,
    Fault,
    OffNominal,
    load_aircraft,
)
from flighttune.vehicles.aircraft.model_xml import BALLAST, FAULT, SURFACE_LAG
from flighttune.vehicles.plants.base import N_X_SIGNALS, FlightCondition, Stop, StopStatus
from flighttune.vehicles.plants.jsbsim import properties

if TYPE_CHECKING:
    from flighttune.vehicles.plants.jsbsim.fdm import Fdm
    from flighttune.vehicles.plants.jsbsim.model_files import Unchanged
    from flighttune.vehicles.plants.sensors import DrawnErrors
    from flighttune.vehicles.plants.weather import Weather

# Relative deviation of a duration from a whole number of integration steps: rounding.
_STEP_SHARE = 1e-6

# Longest time between two checks of the state, s.
_GUARD_INTERVAL = 0.02

# Most integration steps of JSBSim in one sample of the inner loop.
MAX_STEPS = 20

# Largest seed. The generator of JSBSim has 2^31 - 2 states, and 0 is none of them: its seeds 0, 1
# and 2^31 - 1 give the same turbulence.
LARGEST_SEED = 2**31 - 3

# Largest depth below and height above sea level of the ground, m.
DEEPEST_GROUND, HIGHEST_GROUND = 500.0, 6000.0

_N_Z = properties.SIGNALS.index("n_z")


@checked_class
class JSBSimPlant:
    """A 6-DoF aircraft that follows roll and load-factor commands and holds its airspeed.

    Parameters
    ----------
    aircraft : str, Path or AircraftConfig
        Name of a shipped aircraft, a folder with an ``aircraft.toml``, or one that is read already.
    steps : int
        Integration steps of JSBSim in one sample of the inner loop's computer.
    seed : int
        Seed of JSBSim's own random numbers (turbulence).
    weather : Weather, optional
        Weather of the flight; still air by default.
    ground : float, m
        Height of the ground above sea level.
    throttle_max : float, optional
        Upper stop of the throttle, for an engine that gives less than it should; by default that of
        the aircraft.
    throttle_max_from : float, s
        Time of the flight from which on `throttle_max` holds: an engine that fails on the way.
    off_nominal : OffNominal, optional
        Differences of the aircraft from its files; the gains of its inner loop do not.
    takes_n_x : bool
        Take a third command, the longitudinal load factor, in place of holding the airspeed; the
        aircraft needs a range of it in its limits. The throttle follows the command by the slope of
        thrust and by the integral of what is missing; `signals` then ends with `N_X_SIGNALS`, whose
        range is what the throttle still has, by that slope.
    shows_n_x : bool
        Show `N_X_SIGNALS` without taking n_x.

    Attributes
    ----------
    config : AircraftConfig
        The aircraft: envelope, limits, gains.
    limits : Limits
        Limits of the inner loop on its commands.
    fdm : Fdm or None
        The aircraft in flight; None before the start.
    errors : DrawnErrors or None
        `INERTIAL` errors by sample of the inner loop, set before the start; none by default.

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft, its ``aircraft.toml`` cannot be used, or it cannot be off the
        nominal that way.

    Notes
    -----
    The Earth is flat and at rest. A flight in wind starts from the trim in still air, carried along
    by the wind at the start: airspeed, attitude and load factor are those of the trim; `chi` and
    `gamma`, which hold over ground, differ from the condition's, which a scenario chooses so that
    the flight starts on its course over ground. `n_z` is the specific force along
    the lift axis (normal to the airspeed, in the plane of symmetry) over standard gravity: lift,
    and the small part of thrust that helps it. `chi` and `psi` run on through +-pi without a jump.

    Examples
    --------
    >>> plant = ft.loop.JSBSimPlant("aerosonde")
    >>> plant.start(ft.loop.FlightCondition(V_a=25.0))
    >>> round(plant.config.engines.count), "elevator" in plant.signals
    (1, True)
    """

    kind: str = "jsbsim"
    signals: tuple[str, ...] = properties.SIGNALS

    def __init__(
        self,
        aircraft: str | Path | AircraftConfig = "aerosonde",
        *,
        steps: int = 1,
        seed: int = 0,
        weather: Weather | None = None,
        ground: float = 0.0,
        throttle_max: float | None = None,
        throttle_max_from: float = 0.0,
        off_nominal: OffNominal | None = None,
        takes_n_x: bool = False,
        shows_n_x: bool = False,
    ) -> None:
        if not 1 <= steps <= MAX_STEPS:
            raise InputError(f"`steps` must lie in 1 to {MAX_STEPS}, got {steps}.")
        if not 0 <= seed <= LARGEST_SEED:
            raise InputError(f"`seed` must lie in 0 to {LARGEST_SEED}, got {seed}.")
        if not -DEEPEST_GROUND <= ground <= HIGHEST_GROUND:
            raise InputError(
                f"`ground` must lie in {-DEEPEST_GROUND:g} to {HIGHEST_GROUND:g} m, got {ground} m."
            )
        config = aircraft if isinstance(aircraft, AircraftConfig) else load_aircraft(aircraft)
        self._later: list[tuple[float, str, float]] = []
        if throttle_max is not None and throttle_max_from > 0.0:
            self._later = [(throttle_max_from, properties.THROTTLE_MAX, throttle_max)]
        elif throttle_max is not None:
            config = config.with_throttle_max(throttle_max)
        if off_nominal is not None:
            config = config.with_off_nominal(off_nominal)
            check_off_nominal(config)
        self.config: AircraftConfig = config
        if takes_n_x and config.limits.n_x is None:
            raise InputError(
                f"{config.folder / 'aircraft.toml'}: [limits] `n_x` must be given for an airspeed "
                "that a law follows, got none."
            )
        self._takes_n_x, self._shows_n_x = takes_n_x, takes_n_x or shows_n_x
        if self._shows_n_x:
            self.signals = (*properties.SIGNALS, *N_X_SIGNALS)
        self.limits: Limits = config.limits.limits(airspeed=takes_n_x)
        self.steps, self.rate = steps, config.inner_loop_rate * steps
        self.seed, self.weather, self.ground = seed or LARGEST_SEED + 1, weather, ground
        self._chunks: dict[float, tuple[range, ...]] = {}
        self.fdm: Fdm | None = None
        self.errors: DrawnErrors | None = None
        self._observe: Callable[[], tuple[float, ...]] = _not_started
        self._write_phi_cmd: Callable[[float], object] = _not_started

    def start(self, condition: FlightCondition, fdm: Fdm | None = None) -> None:
        """Build a fresh aircraft and trim it: steady, coordinated flight at `condition`.

        `fdm` is an aircraft that was loaded already and has not flown.

        The velocity in `condition` is that through the air, also in wind.

        An `n_z` of its own in `condition` does not change that: an aircraft cannot be held in
        unsteady flight. The inner loop takes up the first command at its own rate limit.

        Raises
        ------
        InputError
            If `condition` lies outside the aircraft's envelope.
        PlantError
            If JSBSim cannot load the aircraft, or it lacks a property.
        TrimError
            If there is no steady flight at `condition`.
        """
        from flighttune.vehicles.plants.jsbsim import air, bench, signals, trim
        from flighttune.vehicles.plants.jsbsim.fdm import Fdm
        from flighttune.vehicles.plants.jsbsim.model_files import unchanged

        # A start that fails must not leave the plant of an earlier flight behind.
        self._observe = self._write_phi_cmd = _not_started
        # Looking at the files takes as long as ten evaluations.
        files = unchanged(self.config) if fdm is None else fdm.files
        settings = inner_loop_settings(self.config, files)  # refuses gains of another model
        bench.check_moves(self.config)
        fdm = fdm or Fdm(self.config, steps=self.steps, ground=self.ground, files=files)
        self.fdm = fdm
        fdm.writer("simulation/randomseed")(float(self.seed))
        for name, value in settings.items():
            fdm.writer(name)(value)
        fdm.writer(properties.N_X_SHOWN)(float(self._shows_n_x))
        off = self.config.off_nominal
        if off and off.fault and "actuator_lag" in off.fault.factors:
            # Varied aircraft share the file.
            fdm.writer(f"{FAULT}actuator_rate")(SURFACE_LAG / off.actuator_lag_factor)
        if missing := set(fdm.names(properties.GAINS)) - settings.keys():
            raise PlantError(
                f"{self.config.folder / GAINS_FILE}: `gains` must give "
                f"`{min(missing).removeprefix(properties.GAINS)}`, got none."
            )
        point = trim.trim(fdm, condition)
        if self.weather is not None:
            air.carry_along(fdm, self.weather.deterministic(0.0, condition.h))
        # After the wind is set: the signals take their origin and first angles from this instant.
        observe = signals.signal_reader(fdm, condition.chi, point.psi, n_x=self._shows_n_x)
        self._inside, self._diagnosis = signals.guard(fdm)
        self._time, self._run = fdm.reader("simulation/sim-time-sec"), fdm.run
        later = sorted(self.changes(), reverse=True)  # the first is taken from the end
        self._changes = [(at, fdm.writer(name), value) for at, name, value in later]
        self._flown = 0.0
        self._engage(fdm, condition, steady_n_z=observe()[_N_Z])
        # After the inner loop is engaged: turbulence and gusts would disturb its first output.
        if self.weather is not None:
            self._run = air.weather_step(fdm, self.weather, self.rate)
        if self.errors is not None:
            self._run = _sensed(fdm, self.errors, self.steps, self._run)
        self._observe = observe

    def key_of_start(self, condition: FlightCondition, files: Unchanged) -> Hashable:
        """All that a start at `condition` depends on: starts of one key are equal to the bit."""
        config = self.config
        given = config.model_dump_json(), repr(config.gains), repr(config.off_nominal)
        of_plant = self.steps, self.seed, self.weather, self.ground, tuple(self._later)
        return files.key, given, of_plant, self.signals, self._takes_n_x, condition

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians.

        Raises
        ------
        PlantError
            If the plant was not started.
        """
        return self._observe()

    def changes(self) -> list[tuple[float, str, float]]:
        """Time (s), JSBSim's property and its value from then on, of what fails in flight."""
        fault, fdm = self.config.off_nominal and self.config.off_nominal.fault, self.fdm
        if not fault or fdm is None:
            return self._later
        values = {f"{FAULT}{name}": factor for name, factor in fault.factors.items()}
        if slower := values.pop(f"{FAULT}actuator_lag", None):
            rate = f"{FAULT}actuator_rate"
            values[rate] = fdm.reader(rate)() / slower
        for name, angle in fault.stuck.items():
            values |= dict.fromkeys((f"{FAULT}{name}-min", f"{FAULT}{name}-max"), angle)
        if fault.V_a_bias_mps:
            values[f"{FAULT}V_a-bias"] = fault.V_a_bias_mps
        if fault.cg_aft_m:
            *_, place = fdm.names("inertia/pointmass-location-X-inches")
            values[place] = fdm.reader(place)() + fault.cg_aft_m / (BALLAST * FT) * 12.0
        failing = [(fault.from_s, name, value) for name, value in values.items()]
        return [*self._later, *failing, *self._ending(fault)]

    def _ending(self, fault: Fault) -> list[tuple[float, str, float]]:
        """Changes that end a flight: throttle closed and, after a cut, surfaces at their stops."""
        if (at := fault.ended_s) is None:
            return []
        stops = [(f"{FAULT}throttle", 0.0)]
        for name, surface in self.config.surfaces.named() if fault.ended_by == "cut" else ():
            if name not in fault.stuck or at < fault.from_s:
                stop = surface.travel[0 if name == "elevator" else 1]  # elevator: nose up
                stops += [(f"{FAULT}{name}-{end}", stop) for end in ("min", "max")]
        return [(at, name, value) for name, value in stops]

    def n_z_followed(self) -> float:
        """The load factor that the inner loop sees, a step of its computer old."""
        return self._read_n_z()

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did.

        Parameters
        ----------
        phi_cmd : float, rad
            Roll command, right wing down positive.
        n_z_cmd : float, 1
            Load-factor command.
        duration : float, s
            Time to fly: a whole number of integration steps.
        n_x : float, 1
            Longitudinal load-factor command, of an aircraft that takes it.

        Returns
        -------
        Stop or None
            ``diverged`` where a command or the state is not finite, ``ground_contact``, or
            ``left_envelope``; checked at least every 20 ms of flight.

        Raises
        ------
        InputError
            If `duration` is not a whole number of integration steps.
        PlantError
            If the plant was not started, or its flight has ended.
        """
        chunks = self._chunks.get(duration) or self._count_steps(duration)
        self._write_phi_cmd(phi_cmd)
        self._write_n_z_cmd(n_z_cmd)
        for command in n_x:
            self._write_n_x_cmd(command)
        run, end = self._run, self._flown + duration
        if self._changes and self._changes[-1][0] < end:
            run = self._run_after_changes
        else:
            self._flown = end
        if not (isfinite(phi_cmd) and isfinite(n_z_cmd)):
            commands = f"phi_cmd {phi_cmd:g} rad, n_z_cmd {n_z_cmd:g}"
            return self._end("diverged", f"commands must be finite, got {commands}.")
        # `run` is false where JSBSim itself ends the run, as on the ground.
        inside, going = self._inside, True
        try:
            for chunk in chunks:
                for _ in chunk:
                    going = run()
                if not (going and inside()):
                    break
            else:
                return None
        except RuntimeError as error:
            from flighttune.vehicles.plants.jsbsim.fdm import one_line

            stop = self._end("diverged", f"JSBSim gave up: {one_line(str(error))}")
            if self.fdm is not None:
                self.fdm.abandon()
            return stop
        if (why := self._diagnosis()) is None:
            raise PlantError(
                f"t = {self._time():.3f} s: JSBSim ended the run by itself, its state inside the "
                "envelope."
            )
        return self._end(*why)

    def _run_after_changes(self) -> bool:
        """An integration step, after the changes that are due."""
        while self._changes and self._changes[-1][0] <= self._flown + _STEP_SHARE / self.rate:
            _, write, value = self._changes.pop()
            write(value)
        self._flown += 1.0 / self.rate
        return self._run()

    def count_steps(self, duration: float) -> int:
        """Integration steps of a duration (s); an InputError if they are no whole number."""
        return sum(map(len, self._chunks.get(duration) or self._count_steps(duration)))

    @property
    def guarded_steps(self) -> int:
        """Most integration steps between two checks of the state."""
        return max(1, math.floor(_GUARD_INTERVAL * self.rate))

    def _engage(self, fdm: Fdm, condition: FlightCondition, steady_n_z: float) -> None:
        """Engage the inner loop without a bump: its first output comes off the trim."""
        self._write_n_z_cmd = fdm.writer(properties.N_Z_CMD)
        self._read_n_z = fdm.reader(properties.N_Z)
        write_phi_cmd = fdm.writer(properties.PHI_CMD)
        write_phi_cmd(condition.phi)
        fdm.writer(properties.V_A_CMD)(condition.V_a)
        if self._takes_n_x:
            self._write_n_x_cmd = fdm.writer(properties.N_X_CMD)
            self._write_n_x_cmd(math.sin(condition.gamma))
            fdm.writer(properties.N_X_FOLLOWED)(1.0)
        fdm.evaluate()  # the inner loop sees the load factor of the evaluation before
        self._write_n_z_cmd(steady_n_z)
        fdm.evaluate()
        if fdm.engine_settles:
            fdm.rest()
        for trim_name, law_name in zip(properties.TRIMS, properties.LAWS, strict=True):
            # The law is added to the trim: its first output must not move the surface.
            trim_value, law = fdm.reader(trim_name)(), fdm.reader(law_name)()
            fdm.writer(trim_name)(trim_value - law)
        fdm.writer(properties.ENGAGED)(1.0)
        if fdm.engine_settles:
            fdm.run_still(1, fdm.rate)
        else:
            fdm.evaluate()
        self._write_phi_cmd = write_phi_cmd

    def _count_steps(self, duration: float) -> tuple[range, ...]:
        """Return the integration steps of `duration`, in chunks; the guard checks after each."""
        steps = duration * self.rate
        if not (0.5 < steps < math.inf and abs(steps - round(steps)) < _STEP_SHARE * steps):
            raise InputError(
                f"`duration` must be a whole number of steps of {1.0 / self.rate:g} s, "
                f"got {duration:g} s."
            )
        longest = self.guarded_steps
        whole, remainder = divmod(round(steps), longest)
        chunks = (range(longest),) * whole + (range(remainder),) * (remainder > 0)
        return self._chunks.setdefault(duration, chunks)

    def _end(self, status: StopStatus, reason: str) -> Stop:
        self._write_phi_cmd = _ended
        return Stop(status, f"t = {self._time():.3f} s: {reason}")


def _sensed(
    fdm: Fdm, errors: DrawnErrors, steps: int, run: Callable[[], bool]
) -> Callable[[], bool]:
    """A step that writes the errors of the inner loop's sensors, new ones every `steps` steps."""
    writers = [fdm.writer(name) for name in properties.ERRORS]

    def flown() -> Iterator[bool]:
        for row in errors:
            for write, error in zip(writers, row, strict=True):
                write(error)
            for _ in range(steps):
                yield run()

    return flown().__next__


def inner_loop_settings(config: AircraftConfig, files: Unchanged | None = None) -> dict[str, float]:
    """Limits and gains of an aircraft's inner loop by JSBSim property, in rad, s and 1."""
    from flighttune.vehicles.plants.jsbsim.model_files import model_hash

    file = config.folder / GAINS_FILE
    if config.gains is None:
        raise PlantError(f"{file}: must be there; `flighttune design` writes it.")
    if config.gains.made_for != model_hash(config, files):
        raise PlantError(
            f"{file}: must be made for the model, `[surfaces]`, `[engines]` and `[settings]` "
            "there are, got gains for others; `flighttune design` makes them anew."
        )
    limits = config.limits
    (phi_min, phi_max), (n_z_min, n_z_max) = limits.phi, limits.n_z
    command_limits = {
        "phi-min-rad": phi_min,
        "phi-max-rad": phi_max,
        "phi-rate-rad_sec": limits.phi_rate,
        "n_z-min": n_z_min,
        "n_z-max": n_z_max,
        "n_z-rate-per_sec": limits.n_z_rate,
        "throttle-max": config.engines.throttle[1],
    }
    gains = dict.fromkeys(properties.GYROSCOPIC, 0.0) | config.gains.gains
    return {f"{properties.LIMITS}{name}": value for name, value in command_limits.items()} | {
        f"{properties.GAINS}{name}": value for name, value in gains.items()
    }


def steps_for(config: AircraftConfig, rate: float) -> int:
    """Fewest steps in a sample of the inner loop that make a sample of the outer loop whole."""
    inner = config.inner_loop_rate
    for steps in range(1, MAX_STEPS + 1):
        ratio = steps * inner / rate
        if round(ratio) >= 1 and abs(ratio - round(ratio)) < _STEP_SHARE * ratio:
            return steps
    raise InputError(
        f"`controller.rate_hz` must divide the {inner:g} Hz of the inner loop, or a multiple of "
        f"them up to {MAX_STEPS}, got {rate:g}."
    )


def check_off_nominal(config: AircraftConfig) -> None:
    """Refuse an aircraft that cannot be off the nominal as `config` says; name the factor's key."""
    from flighttune.vehicles.plants.jsbsim.fdm import weigh
    from flighttune.vehicles.plants.jsbsim.model_files import template_and_values, unchanged

    template_and_values(unchanged(config), weigh)


def _not_started(*_: object) -> NoReturn:
    raise PlantError("`JSBSimPlant` must be started before it can be observed or flown.")


def _ended(*_: object) -> NoReturn:
    raise PlantError("`JSBSimPlant` must be started again: its flight has ended.")
