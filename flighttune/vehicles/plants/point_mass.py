"""A point of constant airspeed that turns by its lift, by the paper's law or exactly."""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, Floats, check_positive
from flighttune.base.errors import InputError
from flighttune.base.units import G_PAPER
from flighttune.control.inner_loop import InnerLag
from flighttune.control.limits import Limits
from flighttune.vehicles.plants.base import (
    COMMON_SIGNALS,
    N_X_SIGNALS,
    FlightCondition,
    Stop,
    TurnLaw,
)
from flighttune.vehicles.plants.lagged import LaggedChannel
from flighttune.vehicles.plants.weather import (
    CALM,
    NED,
    WIND,
    WindRecord,
    course_of,
    velocity_along,
)

# Time (s) to the disturbance of course and flight-path-angle rate (rad/s).
Disturbance: TypeAlias = Callable[[float], tuple[float, float]]

# A forcing is the turning and the lifting part of the load factor, n_x (0 without one), and the
# disturbance; rates are those of the state in its order, airspeed last.
Numbers: TypeAlias = tuple[float, ...]

# Longest integration step, s: leaves an error below 1e-9 rad over 20 s.
LONGEST_STEP = 0.02

# Longest integration step times the natural frequency of a lag: the same error with lags.
FINEST = 0.06

# Course or flight-path angle (rad) at which the paper's law, which has no pole, has diverged.
LOST = 1e3

STEEPEST = math.radians(89.9)

# Airspeed below which a point with thrust has stopped, m/s.
STOPPED = 1.0


def turn_rates(
    V_a: Floats,
    gamma: Floats,
    phi: Floats,
    n_z: Floats,
    *,
    turn: TurnLaw = "paper",
    g: float = G_PAPER,
) -> tuple[FloatArray, FloatArray]:
    """Course and flight-path-angle rates (rad/s) of a point mass in coordinated flight.

    All arrays have the shape (...): airspeed (m/s), path angle, roll about the velocity, right wing
    down positive (rad), and load factor.
    """
    if not np.all(np.greater(V_a, 0.0)):
        raise InputError(f"`V_a` must be positive, got {np.min(V_a):g} m/s.")
    g_over_v = g / np.asarray(V_a, dtype=float)
    # Lift ``n_z m g`` stands normal to the velocity, rolled by phi. Exactly, its horizontal part
    # ``n_z sin(phi)`` turns the level speed ``V_a cos(gamma)``: R. W. Beard and T. W. McLain,
    # *Small Unmanned Aircraft*, Princeton 2012, section 9.3, with ``C_L q S = n_z m g``. The
    # paper's law, Eq. (38) of arXiv 2411.13140 without its disturbance, takes the course rate of a
    # level coordinated turn, ``tan(phi)``, whatever the load factor.
    turning = np.tan(phi) if turn == "paper" else n_z * np.sin(phi) / np.cos(gamma)
    return g_over_v * turning, g_over_v * (n_z * np.cos(phi) - np.cos(gamma))


def rolled_over(phi_cmd: float, n_z_cmd: float, t: float) -> Stop:
    """The end at time `t` (s) of a flight by the paper's law, which has no value for a command."""
    return Stop(
        "diverged",
        f"roll command {math.degrees(phi_cmd):.4g} deg and load-factor command {n_z_cmd:.4g} "
        f"at t = {t:.2f} s: the law has no value from 90 deg of roll.",
    )


@checked_class
class PointMassPlant:
    """A point of constant airspeed that turns by its lift.

    Roll and load factor follow their commands at once, or with `lags`. In a wind record the point
    flies relative to the air: the wind carries it, and a change of wind turns its velocity through
    the air, because the velocity over ground has inertia. Thrust is ideal: it holds the airspeed.
    `chi` and `gamma` are then course and climb over ground; `condition` of the start is that of the
    velocity through the air.

    Parameters
    ----------
    lags : tuple of InnerLag, length 2, optional
        Lags of roll and of load factor.
    wind : WindRecord, optional
        Still air by default.
    disturbance : callable, optional
        Disturbance of the two rates over time; none by default.
    turn : {"exact", "paper"}
        Rates of course and climb from roll and load factor: see `turn_rates`.
    g : float, m/s^2
        Acceleration of gravity.

    Attributes
    ----------
    kind : str
        ``"kinematic"`` with the paper's law, else ``"point_mass"`` or ``"point_mass_lag"``.
    signals : tuple of str
        `COMMON_SIGNALS`, ``d_chi`` and ``d_gamma``; in wind also `WIND` and ``V_g``.
    limits : Limits
        None: the point takes every command.
    follows_at_once : bool
        True without lags: a law then has nothing to feed back.

    Raises
    ------
    InputError
        If `g` is not positive or `turn` is unknown.

    Notes
    -----
    The lags are solved in closed form; the rest is integrated by the classical Runge-Kutta rule
    between the instants at which a command takes effect or the wind record has a sample.

    Examples
    --------
    >>> plant = ft.loop.PointMassPlant()
    >>> plant.start(ft.loop.FlightCondition(V_a=25.0))
    >>> plant.advance(0.5, 1.0, 2.0)  # seconds at 0.5 rad of roll
    >>> dict(zip(plant.signals, plant.observe()))["chi"] > 0.3
    True
    """

    limits = Limits.none(2)

    def __init__(
        self,
        lags: tuple[InnerLag, ...] | None = None,
        *,
        wind: WindRecord | None = None,
        disturbance: Disturbance | None = None,
        turn: TurnLaw = "exact",
        g: float = G_PAPER,
    ) -> None:
        check_positive("m/s^2", g=g)
        if turn not in ("exact", "paper"):
            raise InputError(f"`turn` must be exact or paper, got {turn!r}.")
        self._paper = turn == "paper"
        lagged = "point_mass" if lags is None else "point_mass_lag"
        self.kind = "kinematic" if self._paper else lagged
        wind_signals = () if wind is None else (*WIND, "V_g")
        self.signals: tuple[str, ...] = (*COMMON_SIGNALS, "d_chi", "d_gamma", *wind_signals)
        self._lags, self._g, self.follows_at_once = lags or (), g, not lags
        self._wind, self._windy = wind or WindRecord.steady(), wind is not None
        self._disturbance = disturbance or _undisturbed
        self._step = min([LONGEST_STEP, *(FINEST / lag.natural_frequency for lag in self._lags)])
        self._range: tuple[float, ...] = ()  # least and largest n_x, if it is commanded

    def start(self, condition: FlightCondition) -> None:
        """Put the point at the origin, its velocity through the air along `condition`."""
        self._t, self._chi = 0.0, condition.chi
        self._state = (condition.chi, condition.gamma, 0.0, 0.0, 0.0, condition.V_a)
        self._hold(condition.phi, condition.n_z_start)

    def _hold(self, *command: float) -> None:
        """Let a command be in force before the start."""
        self._command = command
        self._channels = tuple(map(LaggedChannel, self._lags, command))

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        chi, gamma, *position, V_a = self._state
        wind_signals: tuple[float, ...] = ()
        if self._windy:
            w_n, w_e, w_d = wind = self._wind.at(self._t)
            v_n, v_e, v_d = velocity_along(V_a, chi, gamma)
            over_ground = v_n + w_n, v_e + w_e, v_d + w_d
            chi, gamma = course_of(over_ground)
            self._chi += math.remainder(chi - self._chi, math.tau)
            chi, wind_signals = self._chi, (*wind, math.hypot(*over_ground[:2]))
        # Without lags the command is flown at once.
        phi, n_z, *n_x = [channel.at(self._t) for channel in self._channels] or self._command
        further = (*wind_signals, *n_x, *self._range)
        return (chi, gamma, phi, n_z, V_a, *position, *self._disturbance(self._t), *further)

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did.

        Notes
        -----
        The flight ends where the path through the air stands vertical: there is no course there.
        The paper's law has a course there unless it flies in wind, but ends at 90 deg of roll.
        """
        steepest = math.pi / 2 if self._paper else math.inf
        if not (abs(phi_cmd) < steepest and math.isfinite(n_z_cmd)):
            return rolled_over(phi_cmd, n_z_cmd, self._t)
        self._command = (phi_cmd, n_z_cmd, *n_x)
        for channel, command in zip(self._channels, self._command, strict=False):
            channel.order(self._t, command)
        end = self._t + duration
        # Between these instants commands and slope of the wind are constant.
        inside = set(self._wind.knots(self._t, end)) if self._windy else set[float]()
        inside.update(*(channel.switches(end) for channel in self._channels))
        for instant in [*sorted(inside), end]:
            self._fly_to(instant)
            if (stop := self._stop()) is not None:
                return stop
        return None

    def _stop(self) -> Stop | None:
        chi, gamma = self._state[:2]
        if self._paper and not self._windy:
            if abs(chi) < LOST and abs(gamma) < LOST:  # false for NaN
                return None
            where = f"chi {chi:.4g} rad, gamma {gamma:.4g} rad"
            return Stop("diverged", f"{where} at t = {self._t:.2f} s.")
        if abs(gamma) > STEEPEST:
            return Stop(
                "left_envelope",
                f"flight-path angle {math.degrees(gamma):.2f} deg at t = {self._t:.2f} s: "
                "straight up or down there is no course.",
            )
        return None

    def _fly_to(self, end: float) -> None:
        # Without the 1e-9, rounding would add a step to a duration of whole steps.
        start, steps = self._t, math.ceil((end - self._t) / self._step - 1e-9)
        _, _, rate = self._wind.piece(start)
        if steps:
            step = (end - start) / steps
            forcing = self._forcing(start, 0.5 * step, 2 * steps)
            for i in range(steps):
                air = self._wind.at(start + (i + 0.5) * step) if self._windy else CALM
                self._integrate(step, forcing[2 * i : 2 * i + 3], rate, air)
        self._t = end
        for channel in self._channels:
            channel.move_to(end)

    def _forcing(self, start: float, step: float, count: int) -> list[Numbers]:
        """Parts of the load factor, n_x and the disturbance after 0 to `count` steps."""
        if self._channels:
            flown = (channel.over(step, count) for channel in self._channels)
            parts = list(map(self._parts, *flown))
        else:
            parts = [self._parts(*self._command)] * (count + 1)  # held: computed once
        return [(*each, *self._disturbance(start + i * step)) for i, each in enumerate(parts)]

    def _parts(self, phi: float, n_z: float, n_x: float = 0.0) -> tuple[float, float, float]:
        """Turning and lifting part of the load factor, and n_x."""
        turning = math.tan(phi) if self._paper else n_z * math.sin(phi)
        return turning, n_z * math.cos(phi), n_x

    def _rates(self, chi: float, gamma: float, V_a: float, forcing: Numbers, w_dot: NED) -> Numbers:
        """Rates of course, flight-path angle, position but for the wind, and airspeed."""
        turning, lifting, _, d_chi, d_gamma = forcing
        sin_chi, cos_chi = math.sin(chi), math.cos(chi)
        sin_gamma, cos_gamma = math.sin(gamma), math.cos(gamma)
        g_over_v, level = self._g / V_a, V_a * cos_gamma
        chi_dot = g_over_v * (turning if self._paper else turning / cos_gamma) + d_chi
        gamma_dot = g_over_v * (lifting - cos_gamma) + d_gamma
        if w_dot != CALM:
            chi_dot += (w_dot[0] * sin_chi - w_dot[1] * cos_chi) / level
            ahead = w_dot[0] * cos_chi + w_dot[1] * sin_chi
            gamma_dot += (ahead * sin_gamma + w_dot[2] * cos_gamma) / V_a
        return chi_dot, gamma_dot, level * cos_chi, level * sin_chi, -V_a * sin_gamma, 0.0

    def _integrate(self, step: float, forcing: Sequence[Numbers], w_dot: NED, wind: NED) -> None:
        """Take a step of Runge and Kutta: forcing at begin, middle and end, wind at the middle."""
        # Written out: NumPy, or a loop over the states, takes several times as long.
        chi, gamma, north, east, down, V_a = self._state
        half, sixth = 0.5 * step, step / 6.0
        begin, middle, end = forcing
        a = self._rates(chi, gamma, V_a, begin, w_dot)
        b = self._rates(chi + half * a[0], gamma + half * a[1], V_a + half * a[5], middle, w_dot)
        c = self._rates(chi + half * b[0], gamma + half * b[1], V_a + half * b[5], middle, w_dot)
        d = self._rates(chi + step * c[0], gamma + step * c[1], V_a + step * c[5], end, w_dot)
        self._state = (
            chi + sixth * (a[0] + 2.0 * (b[0] + c[0]) + d[0]),
            gamma + sixth * (a[1] + 2.0 * (b[1] + c[1]) + d[1]),
            north + sixth * (a[2] + 2.0 * (b[2] + c[2]) + d[2]) + step * wind[0],
            east + sixth * (a[3] + 2.0 * (b[3] + c[3]) + d[3]) + step * wind[1],
            down + sixth * (a[4] + 2.0 * (b[4] + c[4]) + d[4]) + step * wind[2],
            V_a + sixth * (a[5] + 2.0 * (b[5] + c[5]) + d[5]),
        )


@checked_class
class PoweredPointMass(PointMassPlant):
    """A `PointMassPlant` whose airspeed is its own: ``V_a' = g (n_x - sin(gamma))``.

    Parameters
    ----------
    n_x : tuple of two floats, 1
        Least and largest longitudinal load factor that its engine gives, whatever the airspeed.
    lags : tuple of InnerLag, length 3, optional
        Lags of roll, load factor and longitudinal load factor.
    options
        As of `PointMassPlant`. In wind the airspeed also takes up the change of the wind along it.

    Raises
    ------
    InputError
        If the range of `n_x` does not rise.

    Examples
    --------
    >>> plant = ft.loop.PoweredPointMass((-0.2, 0.5))
    >>> plant.start(ft.loop.FlightCondition(V_a=25.0))
    >>> plant.advance(0.0, 1.0, 2.0, 0.1)
    >>> round(dict(zip(plant.signals, plant.observe()))["V_a"], 3)
    26.962
    """

    def __init__(
        self, n_x: tuple[float, float], lags: tuple[InnerLag, ...] | None = None, **options: Any
    ) -> None:
        if not n_x[0] < n_x[1]:
            raise InputError(f"`n_x` must be a rising range, got {list(n_x)}.")
        super().__init__(lags, **options)
        self._range, free = n_x, np.full(3, math.inf)
        lower, upper = np.append(-free[:2], n_x[0]), np.append(free[:2], n_x[1])
        self.limits = Limits(lower=lower, upper=upper, rate_lower=-free, rate_upper=free)
        self.signals = (*self.signals, *N_X_SIGNALS)

    def start(self, condition: FlightCondition) -> None:
        """Put the point at the origin, n_x that of steady flight as far as its engine gives it."""
        super().start(condition)
        self._hold(*self._command, *self._within(math.sin(condition.gamma)))

    def _within(self, *n_x: float) -> list[float]:
        low, high = self._range
        return [min(max(value, low), high) for value in n_x]

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held, n_x as far as the engine gives it."""
        return super().advance(phi_cmd, n_z_cmd, duration, *self._within(*n_x))

    def _stop(self) -> Stop | None:
        V_a = self._state[-1]
        if V_a > STOPPED:  # false for NaN
            return super()._stop()
        return Stop("left_envelope", f"airspeed {V_a:.3g} m/s at t = {self._t:.2f} s.")

    def _rates(self, chi: float, gamma: float, V_a: float, forcing: Numbers, w_dot: NED) -> Numbers:
        *path, _ = super()._rates(chi, gamma, V_a, forcing, w_dot)
        pull = sum(w * u for w, u in zip(w_dot, velocity_along(1.0, chi, gamma), strict=True))
        return (*path, self._g * (forcing[2] - math.sin(gamma)) - pull)


# A function of the module, so that a plant can be copied to another process.
def _undisturbed(_: float) -> tuple[float, float]:
    return 0.0, 0.0
