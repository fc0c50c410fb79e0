"""The paper's chi/gamma law: commanded roll and load factor are flown at once."""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.control.limits import Limits
from flighttune.errors import InputError
from flighttune.plants.base import COMMON_SIGNALS, FlightCondition, Stop

G_PAPER = 9.81
"""Acceleration of gravity in Table 1 of arXiv 2411.13140, m/s^2."""

Disturbance: TypeAlias = Callable[[float], tuple[float, float]]
"""Time (s) to the disturbance of course and flight-path-angle rate (rad/s)."""

LONGEST_STEP = 0.02
LOST = 1e3


def turn_rates(
    V_a: Floats, gamma: Floats, phi: Floats, n_z: Floats, *, g: float = G_PAPER
) -> tuple[FloatArray, FloatArray]:
    r"""Course and flight-path-angle rates of the kinematic guidance law.

    Parameters
    ----------
    V_a : array_like, shape (...), m/s
        Airspeed, positive.
    gamma, phi : array_like, shape (...), rad
        Flight-path angle, climb positive; roll angle, right wing down positive.
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
    Eq. (38) of arXiv 2411.13140 without its disturbance. The course rate takes the bank of a
    coordinated turn, ``tan(phi)``, whatever the load factor; the exact point mass has
    ``n_z sin(phi)/cos(gamma)`` in its place.
    """
    if not np.all(np.greater(V_a, 0.0)):
        raise InputError(f"`V_a` must be positive, got {np.min(V_a):g} m/s.")
    g_over_v = g / np.asarray(V_a, dtype=float)
    return g_over_v * np.tan(phi), g_over_v * (n_z * np.cos(phi) - np.cos(gamma))


class KinematicPlant:
    """A point that turns and climbs as the kinematic law says, at constant airspeed.

    The law is integrated by the classical Runge-Kutta rule in steps of at most 20 ms with the
    command held, which leaves an error below 1e-9 rad over 20 s.

    Parameters
    ----------
    disturbance : callable, optional
        Disturbance of the two rates over time; none by default.
    g : float, m/s^2
        Acceleration of gravity; by default the paper's 9.81.

    Attributes
    ----------
    kind : str
        ``"kinematic"``.
    signals : tuple of str
        `COMMON_SIGNALS`, ``d_chi`` and ``d_gamma``.
    limits : Limits
        None: every command is flown.

    Raises
    ------
    InputError
        If `g` is not positive.
    """

    kind = "kinematic"
    signals: tuple[str, ...] = (*COMMON_SIGNALS, "d_chi", "d_gamma")
    limits = Limits.none(2)

    def __init__(self, disturbance: Disturbance | None = None, *, g: float = G_PAPER) -> None:
        if not (math.isfinite(g) and g > 0.0):
            raise InputError(f"`g` must be positive, got {g} m/s^2.")
        self._disturbance = disturbance or _calm
        self._g = g

    def start(self, condition: FlightCondition) -> None:
        """Put the point at the origin with the course, climb and airspeed of `condition`."""
        self._t = 0.0
        self._V_a = condition.V_a
        self._state = (condition.chi, condition.gamma, 0.0, 0.0, 0.0)
        self._command = (condition.phi, condition.n_z_start)

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        chi, gamma, north, east, down = self._state
        return (
            chi,
            gamma,
            *self._command,
            self._V_a,
            north,
            east,
            down,
            *self._disturbance(self._t),
        )

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did.

        Notes
        -----
        A roll command of 90 deg and more ends the flight: tan(phi) has no value there.
        """
        if not (abs(phi_cmd) < math.pi / 2 and math.isfinite(n_z_cmd)):
            return Stop(
                "diverged",
                f"roll command {math.degrees(phi_cmd):.4g} deg and load-factor command "
                f"{n_z_cmd:.4g} at t = {self._t:.2f} s: the law has no value from 90 deg of roll.",
            )
        self._command = (phi_cmd, n_z_cmd)
        steps = math.ceil(duration / LONGEST_STEP - 1e-9)
        step, start = duration / steps, self._t
        for i in range(steps):
            self._runge_kutta_step(start + i * step, step)
        self._t = start + duration
        chi, gamma = self._state[:2]
        if not (abs(chi) < LOST and abs(gamma) < LOST):
            return Stop(
                "diverged",
                f"chi {chi:.4g} rad, gamma {gamma:.4g} rad at t = {self._t:.2f} s.",
            )
        return None

    def _rates(
        self, t: float, state: tuple[float, ...]
    ) -> tuple[float, float, float, float, float]:
        chi, gamma = state[0], state[1]
        phi, n_z = self._command
        d_chi, d_gamma = self._disturbance(t)
        g_over_v = self._g / self._V_a
        level = self._V_a * math.cos(gamma)
        return (
            g_over_v * math.tan(phi) + d_chi,
            g_over_v * (n_z * math.cos(phi) - math.cos(gamma)) + d_gamma,
            level * math.cos(chi),
            level * math.sin(chi),
            -self._V_a * math.sin(gamma),
        )

    def _runge_kutta_step(self, t: float, step: float) -> None:
        x = self._state
        half = 0.5 * step
        k1 = self._rates(t, x)
        k2 = self._rates(t + half, tuple(a + half * b for a, b in zip(x, k1, strict=True)))
        k3 = self._rates(t + half, tuple(a + half * b for a, b in zip(x, k2, strict=True)))
        k4 = self._rates(t + step, tuple(a + step * b for a, b in zip(x, k3, strict=True)))
        sixth = step / 6.0
        self._state = tuple(
            a + sixth * (b + 2.0 * (c + d) + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        )


def _calm(_: float) -> tuple[float, float]:
    return 0.0, 0.0
