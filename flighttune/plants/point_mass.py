"""The exact point mass in coordinated flight, with the inner loop's lag and in moving air."""

import math
from typing import Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.control.inner_loop import InnerLag
from flighttune.control.limits import Limits
from flighttune.errors import InputError
from flighttune.plants.base import COMMON_SIGNALS, FlightCondition, Stop
from flighttune.plants.kinematic import G_PAPER, LONGEST_STEP, Disturbance
from flighttune.plants.lagged_channel import LaggedChannel
from flighttune.plants.wind import NED, WindPiece, WindRecord, course_of, velocity_along

TurnLaw: TypeAlias = Literal["exact", "paper"]

WIND_SIGNALS = ("wind_north", "wind_east", "wind_down", "V_g")
"""What a point in a wind record shows besides the signals of still air."""

FINEST = 0.06
"""Longest integration step times the natural frequency of a lag."""

STEEPEST = math.radians(89.9)


def point_mass_rates(
    V_a: Floats, gamma: Floats, phi: Floats, n_z: Floats, *, g: float = G_PAPER
) -> tuple[FloatArray, FloatArray]:
    r"""Course and flight-path-angle rates of a point mass in coordinated flight.

    Parameters
    ----------
    V_a : array_like, shape (...), m/s
        Airspeed, positive.
    gamma, phi : array_like, shape (...), rad
        Flight-path angle, climb positive; roll angle about the velocity, right wing down positive.
    n_z : array_like, shape (...), 1
        Load factor: lift over weight.
    g : float, m/s^2
        Acceleration of gravity.

    Returns
    -------
    chi_dot, gamma_dot : ndarray, shape (...), rad/s
        Rates of course (clockwise from north) and of flight-path angle.

    Raises
    ------
    InputError
        If an airspeed is not positive.

    Notes
    -----
    Lift ``n_z m g`` stands normal to the velocity, rolled by phi; its horizontal part
    ``n_z sin(phi)`` turns the level speed ``V_a cos(gamma)``. R. W. Beard and T. W. McLain, *Small
    Unmanned Aircraft*, Princeton 2012, section 9.3, with ``C_L q S = n_z m g``.
    """
    if not np.all(np.greater(V_a, 0.0)):
        raise InputError(f"`V_a` must be positive, got {np.min(V_a):g} m/s.")
    g_over_v = g / np.asarray(V_a, dtype=float)
    level = np.cos(gamma)
    return g_over_v * n_z * np.sin(phi) / level, g_over_v * (n_z * np.cos(phi) - level)


class PointMassPlant:
    """A point of constant airspeed that turns by its lift.

    Roll and load factor are flown at once, or as `lags` say. In a wind record the point flies
    relative to the air: the wind carries it, and a change of wind turns its velocity through the
    air, because the velocity over ground has inertia. Thrust is ideal: it holds the airspeed.
    `chi` and `gamma` are then course and climb over ground; `condition` of the start is that of the
    velocity through the air.

    Parameters
    ----------
    lags : tuple of InnerLag, length 2, optional
        Of roll and of load factor.
    wind : WindRecord, optional
        Still air by default.
    disturbance : callable, optional
        Disturbance of the two rates over time; none by default.
    law : {"exact", "paper"}
        How course and climb follow from roll and load factor: `point_mass_rates`, or `turn_rates`
        of `flighttune.plants.kinematic`, for the paper's law in wind.
    g : float, m/s^2
        Acceleration of gravity.

    Attributes
    ----------
    kind : str
        ``"point_mass"``, ``"point_mass_lag"`` or ``"kinematic"``.
    signals : tuple of str
        `COMMON_SIGNALS`, ``d_chi`` and ``d_gamma``; in wind also `WIND_SIGNALS`.
    limits : Limits
        None: the point takes every command.

    Raises
    ------
    InputError
        If `g` is not positive or `law` is unknown.

    Notes
    -----
    The lags are solved in closed form; the rest is integrated by the classical Runge-Kutta rule
    between the instants at which a command takes effect or the wind record has a sample, in steps
    that leave an error below 1e-9 rad over 20 s.
    """

    limits = Limits.none(2)

    def __init__(
        self,
        lags: tuple[InnerLag, InnerLag] | None = None,
        *,
        wind: WindRecord | None = None,
        disturbance: Disturbance | None = None,
        law: TurnLaw = "exact",
        g: float = G_PAPER,
    ) -> None:
        if not (math.isfinite(g) and g > 0.0):
            raise InputError(f"`g` must be positive, got {g} m/s^2.")
        if law not in ("exact", "paper"):
            raise InputError(f"`law` must be exact or paper, got {law!r}.")
        self.kind: str = (
            "kinematic" if law == "paper" else "point_mass" if lags is None else "point_mass_lag"
        )
        shown = () if wind is None else WIND_SIGNALS
        self.signals: tuple[str, ...] = (*COMMON_SIGNALS, "d_chi", "d_gamma", *shown)
        self._lags, self._law, self._g = lags, law, g
        self._wind = WindRecord.steady() if wind is None else wind
        self._windy = wind is not None
        self._disturbance = disturbance or _calm
        fastest = max((lag.natural_frequency for lag in lags or ()), default=0.0)
        self._step = min(LONGEST_STEP, FINEST / fastest) if fastest else LONGEST_STEP

    def start(self, condition: FlightCondition) -> None:
        """Put the point at the origin, its velocity through the air along `condition`."""
        self._t, self._V_a = 0.0, condition.V_a
        self._state = (condition.chi, condition.gamma, 0.0, 0.0, 0.0)
        self._chi = condition.chi
        flown = condition.phi, condition.n_z_start
        self._held = flown
        self._channels = self._lags and tuple(
            LaggedChannel(lag, value) for lag, value in zip(self._lags, flown, strict=True)
        )

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        chi, gamma, *position = self._state
        shown: tuple[float, ...] = ()
        if self._windy:
            wind = self._wind.piece(self._t).at(self._t)
            over_ground = _sum(velocity_along(self._V_a, chi, gamma), wind)
            chi, gamma = course_of(over_ground)
            self._chi += math.remainder(chi - self._chi, math.tau)
            chi, shown = self._chi, (*wind, math.hypot(*over_ground))
        flown = self._flown(self._t)
        return (chi, gamma, *flown, self._V_a, *position, *self._disturbance(self._t), *shown)

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did.

        Notes
        -----
        The flight ends where the path through the air stands vertical: there is no course there.
        The paper's law also ends at 90 deg of roll.
        """
        paper = self._law == "paper"
        if not (math.isfinite(phi_cmd + n_z_cmd) and not (paper and abs(phi_cmd) >= math.pi / 2)):
            return Stop(
                "diverged",
                f"roll command {math.degrees(phi_cmd):.4g} deg and load-factor command "
                f"{n_z_cmd:.4g} at t = {self._t:.2f} s: the law has no value there.",
            )
        self._held = (phi_cmd, n_z_cmd)
        for channel, command in zip(self._channels or (), self._held, strict=False):
            channel.order(self._t, command)
            channel.move_to(self._t)
        end = self._t + duration
        for stop in self._breaks(end):
            self._fly_to(stop)
            if abs(self._state[1]) > STEEPEST:
                return Stop(
                    "left_envelope",
                    f"flight-path angle {math.degrees(self._state[1]):.2f} deg at "
                    f"t = {self._t:.2f} s: straight up or down there is no course.",
                )
        return None

    def _breaks(self, end: float) -> list[float]:
        """Instants up to `end` between which commands and slope of the wind are constant."""
        inside = set(self._wind.knots(self._t, end))
        for channel in self._channels or ():
            inside.update(channel.switches(end))
        return [*sorted(inside), end]

    def _fly_to(self, end: float) -> None:
        start, steps = self._t, math.ceil((end - self._t) / self._step - 1e-9)
        wind = self._wind.piece(start)
        step = (end - start) / max(steps, 1)
        for i in range(steps):
            self._runge_kutta_step(start + i * step, step, wind)
        self._t = end
        for channel in self._channels or ():
            channel.move_to(end)

    def _flown(self, t: float) -> tuple[float, float]:
        if self._channels is None:
            return self._held
        roll, load = self._channels
        return roll.at(t), load.at(t)

    def _lift(self, t: float) -> tuple[float, float, float, float]:
        """Turning and lifting part of the load factor, and the disturbance."""
        phi, n_z = self._flown(t)
        turning = math.tan(phi) if self._law == "paper" else n_z * math.sin(phi)
        return turning, n_z * math.cos(phi), *self._disturbance(t)

    def _rates(
        self,
        state: tuple[float, ...],
        lift: tuple[float, float, float, float],
        wind: NED,
        push: NED,
    ) -> tuple[float, ...]:
        chi, gamma = state[0], state[1]
        turning, lifting, d_chi, d_gamma = lift
        sin_chi, cos_chi = math.sin(chi), math.cos(chi)
        sin_gamma, cos_gamma = math.sin(gamma), math.cos(gamma)
        V_a, g = self._V_a, self._g
        sideways = push[0] * sin_chi - push[1] * cos_chi
        upwards = (push[0] * cos_chi + push[1] * sin_chi) * sin_gamma + push[2] * cos_gamma
        turn = g * turning if self._law == "paper" else g * turning / cos_gamma
        level = V_a * cos_gamma
        return (
            turn / V_a + sideways / level + d_chi,
            (g * (lifting - cos_gamma) + upwards) / V_a + d_gamma,
            level * cos_chi + wind[0],
            level * sin_chi + wind[1],
            wind[2] - V_a * sin_gamma,
        )

    def _runge_kutta_step(self, t: float, step: float, piece: WindPiece) -> None:
        x, half, push = self._state, 0.5 * step, piece.rate
        first, middle, last = (self._lift(s) for s in (t, t + half, t + step))
        wind, wind_between, wind_after = (piece.at(s) for s in (t, t + half, t + step))
        k1 = self._rates(x, first, wind, push)
        k2 = self._rates(_moved(x, half, k1), middle, wind_between, push)
        k3 = self._rates(_moved(x, half, k2), middle, wind_between, push)
        k4 = self._rates(_moved(x, step, k3), last, wind_after, push)
        sixth = step / 6.0
        self._state = tuple(
            a + sixth * (b + 2.0 * (c + d) + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        )


def _calm(_: float) -> tuple[float, float]:
    return 0.0, 0.0


def _sum(a: NED, b: NED) -> NED:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _moved(x: tuple[float, ...], step: float, rates: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(a + step * b for a, b in zip(x, rates, strict=True))
