"""Interface of a control law, and the guard of a user's law: limits, and an end if it fails."""

import math
import textwrap
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_numbers, check_positive, check_upright
from flighttune.base.units import G_PAPER
from flighttune.control.gains import PIGains
from flighttune.control.limits import AntiWindup, CommandLimiter, Limits
from flighttune.control.linear_model import LinearModel


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class FlightCondition:
    """Condition at the start of a flight.

    Attributes
    ----------
    V_a : float, m/s
        Airspeed, positive.
    h : float, m
        Height above sea level.
    chi, gamma, phi : float, rad
        Course clockwise from north; flight-path angle, climb positive; roll, right wing down.
    n_z : float or None, 1
        Load factor in force at the start; None for the steady value cos(gamma)/cos(phi).

    Examples
    --------
    >>> round(ft.loop.FlightCondition(V_a=25.0, gamma=0.2, phi=0.5).n_z_start, 4)
    1.1168
    """

    V_a: float
    h: float = 1000.0
    chi: float = 0.0
    gamma: float = 0.0
    phi: float = 0.0
    n_z: float | None = None

    def __post_init__(self) -> None:
        check_positive("m/s", V_a=self.V_a)
        given = {} if self.n_z is None else {"n_z": self.n_z}
        check_numbers(h=self.h, chi=self.chi, gamma=self.gamma, phi=self.phi, **given)
        check_upright(gamma=self.gamma, phi=self.phi)

    @property
    def n_z_start(self) -> float:
        """Load factor in force at the start: `n_z`, or the steady value if it is None."""
        return math.cos(self.gamma) / math.cos(self.phi) if self.n_z is None else self.n_z

    def commands(self, m: int) -> tuple[float, ...]:
        """The first `m` commands in force: roll, load factor, and n_x of steady flight."""
        return (self.phi, self.n_z_start, math.sin(self.gamma))[:m]


class Measured(NamedTuple):
    """Measurements of a law at a sample, through sensors and navigation that err, if any.

    Attributes
    ----------
    chi, gamma : float, rad
        Course, clockwise from north and continuous through +-pi; flight-path angle, climb positive.
    V_a : float, m/s
        Airspeed.
    phi : float, rad
        Roll, right wing down positive.
    n_z : float, 1
        Load factor: lift over weight.
    h : float, m
        Height above sea level.
    position : tuple of three floats, m
        North, east and down from the start.
    wind : tuple of three floats or None, m/s
        Velocity of the air, north, east and down; None if the plant does not measure it, or if
        `chi` and `gamma` belong to the path through the air.
    n_x : tuple of three floats or None, 1
        Longitudinal load factor, thrust minus drag over weight, with its present minimum and
        maximum by the engines; None from a plant that holds its airspeed by itself.
    theta, elevator : float or None, rad
        Pitch, nose up positive, and the position of the elevator, trailing edge down positive; None
        from a plant without them, such as a point mass.
    V_g : float or None, m/s
        Level speed over ground.
    velocity : tuple of three floats or None, m/s
        Velocity over ground, north, east and down.
    acceleration : float or None, m/s^2
        Acceleration along the path through the air.

    Examples
    --------
    >>> still = ft.loop.Measured(0.0, 0.0, 25.0, 0.0, 1.0, 1000.0, (0.0, 0.0, 0.0), None)
    >>> still.V_a, still.h
    (25.0, 1000.0)
    """

    chi: float
    gamma: float
    V_a: float
    phi: float
    n_z: float
    h: float
    position: tuple[float, ...]
    wind: tuple[float, ...] | None
    n_x: tuple[float, ...] | None = None
    theta: float | None = None
    elevator: float | None = None
    V_g: float | None = None
    velocity: tuple[float, float, float] | None = None
    acceleration: float | None = None


class Followed(Protocol):
    """A reference over the time of a flight; a law may read it ahead of time."""

    @property
    def initial(self) -> tuple[float, float]:
        """Course and path angle at the start, rad."""
        ...

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Course and path angle (rad) at times `t` (s); along a route, of a flight in still air."""
        ...

    def rates(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates of course and path angle (rad/s) from times `t` (s) on."""
        ...


class ReferenceSample(NamedTuple):
    """Reference of a law at a sample.

    Attributes
    ----------
    chi, gamma : float, rad
        Course, not wrapped, and flight-path angle.
    chi_dot, gamma_dot : float, rad/s
        Their rates from this sample on; a step has no rate. If roll and lift are planned for the
        rates, the rates lead by the lags of the aircraft.
    planned : tuple of two floats or None, rad and 1
        Roll and load-factor command that fly the reference without disturbances; None if the
        reference is neither made of commands nor planned.
    V : float or None, m/s
        Airspeed to fly; None if the plant holds its own airspeed.
    V_dot : float, m/s^2
        Its rate from this sample on.
    path : tuple of five floats or None
        The nearest point of a route: its course (rad), the distance of the aircraft to the right of
        it and below it (m), curvature (1/m, right positive) and slope (height per distance); None
        without a route.

    Examples
    --------
    >>> ft.loop.ReferenceSample(chi=0.5, gamma=0.1).chi_dot
    0.0
    """

    chi: float
    gamma: float
    chi_dot: float = 0.0
    gamma_dot: float = 0.0
    planned: tuple[float, float] | None = None
    V: float | None = None
    V_dot: float = 0.0
    path: tuple[float, ...] | None = None


class Controller(Protocol):
    """A law that turns course and path angle into commands; a plain class satisfies it.

    A member is used for one flight: ``start``, then ``step`` at every sample. The loop applies the
    limits of the flight to the commands from ``step``. A law that needs the limited commands (for
    anti-windup) applies the limits itself by a `CommandLimiter` that it keeps as ``limiter``. A law
    may further have ``linear()``, which returns its `LinearModel` and `PIGains` for indicators and
    certificates.

    Attributes
    ----------
    dt : float, s
        Sample time.
    signals : mapping of str to str
        Names of what the law wants recorded, with their units.

    Examples
    --------
    >>> import math
    >>> class WingsLevel:
    ...     dt, signals = 0.02, {}
    ...     def start(self, condition):
    ...         pass
    ...     def step(self, measured, reference, t):
    ...         return 0.0, math.cos(measured.gamma)
    >>> tables = ft.load_scenario("paper_as_printed").as_dict()
    >>> flown = ft.fly(ft.scenario_from(tables), laws={"level": lambda setup: WingsLevel()})
    >>> [run.label for run in flown.runs]
    ['kinematic / paper', 'kinematic / level:paper']
    """

    @property
    def dt(self) -> float:
        """Sample time, s."""
        ...

    @property
    def signals(self) -> Mapping[str, str]:
        """Names of what the law wants recorded, with their units."""
        ...

    def start(self, condition: FlightCondition, /) -> None:
        """Reset the law and begin at `condition`: its roll and load factor are in force."""
        ...

    def step(self, measured: Measured, reference: ReferenceSample, t: float, /) -> Sequence[float]:
        """Return the roll command (rad), the load-factor command (1), and the values of `signals`.

        Parameters
        ----------
        t : float, s
            Time since the start.
        """
        ...


class SelfLimiting(ABC):
    """Base of controllers that apply the limits of their flight themselves."""

    # The loop records their ``limiter`` and adds no limits of its own. This is a base class, not a
    # protocol: a user's controller with a `limiter` of its own is wrapped in `GuardedLaw`, which
    # limits its commands.
    dt: float
    signals: Mapping[str, str]

    @property
    @abstractmethod
    def limiter(self) -> Any:
        """Record of the limits, the same lists at every sample.

        ``u_unsat`` has the commands before the limits; ``limited`` is 0 for a free command, 1 at a
        magnitude limit and 2 at a rate limit.
        """

    @abstractmethod
    def start(self, condition: FlightCondition, /) -> None:
        """Prepare for a flight from `condition`, as a `Controller` does."""

    @abstractmethod
    def step(self, measured: Measured, reference: ReferenceSample, t: float, /) -> Sequence[float]:
        """Return the commands of a sample, as a `Controller` does, inside their limits."""


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawSetup:
    """Setup of a law for a flight: ``Law(setup, **parameters)``.

    Attributes
    ----------
    dt : float, s
        Sample time of the flight.
    limits : Limits
        Limits of the commands (phi, n_z) by the scenario and the plant.
    gains : PIGains or None
        The gain set of the run.
    g : float, m/s^2
        Acceleration of gravity.
    scenario : mapping
        The scenario as it would be written in TOML.
    anti_windup : "conditional", "back_calculation" or "none"
        As in `MimoPI`, from the table ``[controller]``.
    tracking_time : float or None, s
        Time constant of back-calculation.
    schedule_speed : float or None, m/s
        Design airspeed of scheduled gains; None without a schedule.
    feed_forward : bool
        True if the load factor of steady flight on the reference is added.
    reference : Followed or None
        The reference of the flight, to look at ahead: ``setup.reference.sampled(t)``.

    Examples
    --------
    >>> setup = ft.loop.LawSetup(dt=0.02, limits=ft.loop.JSBSimPlant("aerosonde").limits)
    >>> setup.g, setup.anti_windup
    (9.81, 'conditional')
    """

    dt: float
    limits: Limits
    gains: PIGains | None = None
    g: float = G_PAPER
    scenario: Mapping[str, Any] = field(default_factory=dict, repr=False)
    anti_windup: AntiWindup = "conditional"
    tracking_time: float | None = None
    schedule_speed: float | None = None
    feed_forward: bool = False
    reference: Followed | None = field(default=None, repr=False)


# Exceptions that end only the flight: a user's code must not end the program.
FAILURES = (Exception, SystemExit)


# Wall time by which a law may fall behind real time, s.
MAX_LAG_S = 5.0

# Maximum length of a returned value in a message, characters.
MAX_SHOWN = 40


def failure(name: str, error: BaseException, t: float | None) -> str:
    """Source, time (s; None before a flight) and reason of an exception, in one line."""
    when = "" if t is None else f" at t = {t:.2f} s"
    return f"{name}{when}: {type(error).__name__}: {_shown(error, str, 2**15)}{_place(error)}"


def _shown(value: object, text: Callable[[object], str] = repr, most: int = MAX_SHOWN) -> str:
    """A user's object as one line for a message; its type, if its `repr` raises."""
    try:
        return textwrap.shorten(text(value), most)
    except FAILURES:  # also for a whole number with thousands of digits
        return f"a value of type {type(value).__name__}"


def _place(error: BaseException) -> str:
    """Line, file and function of the user's code that raised an exception; empty if none did."""
    places = [
        (frame.f_code, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_globals.get("__name__", "").startswith("flighttune.")
        and not frame.f_code.co_filename.startswith("<frozen")
    ]
    for code, line in reversed(places):  # the user's code called a library
        if code.co_filename == places[0][0].co_filename:
            function = code.co_qualname.rpartition("<locals>.")[2]
            of = "" if function == "<module>" else f" of {function}"
            return f" (line {line}{of} in {Path(code.co_filename).name})"
    return ""


def _number(value: Any) -> float:
    """A number that a law returns; TypeError for other values that `float` would accept."""
    if isinstance(value, str | bytes | bytearray | bool | np.bool_ | np.complexfloating):
        raise TypeError
    return float(value)


class LawError(Exception):
    """A law raised, or its commands cannot be flown; the message names law and time."""


class GuardedLaw(SelfLimiting):
    """A law with limits; if it fails, the flight ends with one line of reason."""

    def __init__(self, law: Controller, limits: Limits, name: str = "law") -> None:
        self._law, self._name = law, name
        self.dt: float = law.dt
        self.signals = {str(name): str(unit) for name, unit in law.signals.items()}
        # The limits of (phi, n_z), or (phi, n_z, n_x), hold for every command of the law, even if
        # it has its own limiter. The commands before that limiter are then recorded.
        self._m, self._limits = len(limits.lower), CommandLimiter(limits, self.dt)
        self._recorded: Any = self._limits
        self._spent = 0.0

    @property
    def limiter(self) -> Any:
        """Commands before the limits, and which limit holds; from the law if it has a limiter."""
        return self._recorded

    def start(self, condition: FlightCondition) -> None:
        """Start the law and the limits from the roll and load factor of `condition`."""
        self._limits.start(condition.commands(self._m))
        self._spent = 0.0
        try:
            self._law.start(condition)
        except FAILURES as error:
            raise self._failed(error, 0.0) from error
        self._recorded = getattr(self._law, "limiter", self._limits)
        if not isinstance(self._recorded, CommandLimiter):
            shown_value = _shown(self._recorded)
            raise LawError(f"{self._name}: `limiter` must be a CommandLimiter, got {shown_value}.")

    def step(self, measured: Measured, reference: ReferenceSample, t: float) -> Sequence[float]:
        """Commands of the law after the limits; LawError if it fails or takes too long."""
        began = time.perf_counter()
        try:
            returned: object = self._law.step(measured, reference, t)
        except FAILURES as error:
            raise self._failed(error, t) from error
        self._spent += time.perf_counter() - began
        when, m = f"{self._name} at t = {t:.2f} s", self._m
        names = *("phi_cmd", "n_z_cmd", "n_x_cmd")[:m], *self.signals
        try:
            if isinstance(returned, bytes | bytearray):  # an integer array would truncate
                raise TypeError
            # One value more than needed shows that there are too many: an iterator may have no end.
            first = islice(returned, len(names) + 1)  # type: ignore[call-overload]
            values = [_number(value) for value in first]
        except (TypeError, ValueError, OverflowError):
            values = []
        if len(values) != len(names):
            count = "more" if len(values) > len(names) else len(values)
            count = count if values else _shown(returned)
            expected = f"{len(names)} numbers ({', '.join(names)})"
            raise LawError(f"{when}: `step` must return {expected}, got {count}.")
        for name, value in zip(names[:m], values, strict=False):
            if not math.isfinite(value):
                raise LawError(f"{when}: `{name}` must be finite, got {value}.")
        if self._spent > t + MAX_LAG_S:
            raise LawError(
                f"{when}: its steps must not take {MAX_LAG_S:g} s longer than the flight, "
                f"got {self._spent:.1f} s."
            )
        return (*self._limits.limit(*values[:m]), *values[m:])

    def linear(self) -> tuple[LinearModel, PIGains] | None:
        """Model and gains of the law's ``linear``, None without it; LawError if it fails."""
        linear = getattr(self._law, "linear", None)
        try:
            returned = None if linear is None else linear()
            if returned is None:
                return None
            model, gains = returned
        except FAILURES as error:
            raise self._failed(error, 0.0) from error
        if not (isinstance(model, LinearModel) and isinstance(gains, PIGains)):
            got = _shown(returned)
            raise LawError(
                f"{self._name}: `linear` must return a LinearModel and PIGains, got {got}."
            )
        return model, gains

    def _failed(self, error: BaseException, t: float) -> LawError:
        return LawError(failure(self._name, error, t))
