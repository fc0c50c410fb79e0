"""Roll and lift planned for the rates of a reference, in the wind that an aircraft estimates."""

import math

from flighttune.control.controller import Measured
from flighttune.control.exact_law import turning_speed

# Time constant of the estimate of the wind, s: that of an airborne filter; gusts pass it by.
WIND_ESTIMATE_S = 5.0


class Planner:
    """Plans the commands of one flight, sample by sample.

    `dt` (s): time between samples. `g` (m/s^2): acceleration of gravity.

    Notes
    -----
    Turning the velocity over ground at the rate chi' takes the roll ``atan(chi' V_t / g)``, and
    bending it at gamma' the vertical lift ``cos(gamma) + gamma' V_t / g`` in weights, with V_t the
    `turning_speed`. The wind in V_t is not the one measured: that would show the law what no
    aircraft knows.
    """

    def __init__(self, dt: float, g: float) -> None:
        self._g, self._share = g, min(dt / WIND_ESTIMATE_S, 1.0)
        self._wind: tuple[float, ...] | None = None

    def __call__(
        self, m: Measured, chi_dot: float, gamma_dot: float, gamma: float
    ) -> tuple[float, float]:
        """Roll (rad) and load factor for rates (rad/s) of the reference at its path angle (rad)."""
        if m.wind is not None:
            share, (north, east, down) = self._share, m.wind if self._wind is None else self._wind
            n, e, d = m.wind
            estimate = north + share * (n - north), east + share * (e - east)
            self._wind = *estimate, down + share * (d - down)
        per_g = turning_speed(m, self._wind) / self._g
        lift = math.cos(gamma) + gamma_dot * per_g
        return math.atan(chi_dot * per_g), lift / math.cos(m.phi)
