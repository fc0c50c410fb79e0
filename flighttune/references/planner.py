"""What a sample of the loop makes of a reference: roll and lift planned, the airspeed put first."""

import math

from flighttune.arrays import FloatArray
from flighttune.control.controller import Measured, ReferenceSample
from flighttune.control.exact_law import turning_speed

# Share of its reference below which the airspeed shall not fall.
LEAST_SHARE = 0.95

# Rate at which the airspeed may approach that share, 1/s: docs/airspeed.md has its flights.
APPROACH = 0.35

# Sine of the steepest descent that is asked for in exchange for airspeed.
STEEPEST_DIVE = -0.5


class AirspeedPriority:
    """Puts the airspeed into a reference, sample by sample, and keeps its path angle flyable.

    `V`, `V_dot` (m/s, m/s^2): the airspeed to fly and its rate at each sample, where the reference
    has none by its place on a route. `g` (m/s^2).

    Notes
    -----
    With n_x at most what the engines give, ``V' = g (n_x - sin(gamma))`` stays above
    ``-kappa (V - V_low)`` as long as ``sin(gamma) <= n_x + kappa (V - V_low) / g``: V then never
    falls through V_low, `LEAST_SHARE` of its reference. The path angle asked for is cut to that. At
    the other stop nothing is cut: a descent that is too steep costs some airspeed above the
    reference, and keeping it would cost the path.
    """

    def __init__(self, V: FloatArray, V_dot: FloatArray, g: float) -> None:
        self._samples = list(zip(V.tolist(), V_dot.tolist(), strict=True))
        self._per_g = APPROACH / g

    def __call__(self, k: int, m: Measured, ref: ReferenceSample) -> ReferenceSample:
        """Return the reference of sample `k` with its airspeed; its path angle may be less."""
        assert m.n_x is not None  # of a plant that takes n_x
        V, V_dot = self._samples[k] if ref.V is None else (ref.V, ref.V_dot)
        steepest = m.n_x[2] + self._per_g * (m.V_a - LEAST_SHARE * V)
        if math.sin(ref.gamma) <= steepest:
            return ref._replace(V=V, V_dot=V_dot)
        gamma = math.asin(max(steepest, STEEPEST_DIVE))
        return ref._replace(gamma=gamma, gamma_dot=0.0, planned=None, V=V, V_dot=V_dot)


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
