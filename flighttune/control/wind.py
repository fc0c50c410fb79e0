"""Paths over ground and through the air, in wind."""

import math
from collections.abc import Sequence

# Minimum ground speed that the law assumes, as a share of the airspeed.
LEAST_SPEED = 0.2

# Time constant of the wind estimate, s: typical of an airborne filter, which ignores gusts.
WIND_ESTIMATE_S = 5.0


class WindEstimate:
    """The wind as an aircraft knows it: the measured wind behind a filter, sample by sample."""

    def __init__(self, dt: float) -> None:
        self.share = min(dt / WIND_ESTIMATE_S, 1.0)
        self._wind: tuple[float, ...] | None = None

    def __call__(self, wind: tuple[float, ...] | None) -> tuple[float, ...] | None:
        """The estimate (north, east, down, m/s) with another sample; None without a measurement."""
        if wind is not None:
            self._wind = filtered(self.share, wind if self._wind is None else self._wind, wind)
        return self._wind


# Numba compiles the functions below too.


def filtered(
    share: float, before: Sequence[float], wind: Sequence[float]
) -> tuple[float, float, float]:
    """The estimate `before`, moved towards the measurement by a share of the difference."""
    return (
        before[0] + share * (wind[0] - before[0]),
        before[1] + share * (wind[1] - before[1]),
        before[2] + share * (wind[2] - before[2]),
    )


def speed_over(north: float, east: float, dt: float) -> float:
    """Speed, m/s, of a move north and east (m) in `dt` (s)."""
    return math.sqrt(north * north + east * east) / dt


def level_speed(chi: float, gamma: float, V_a: float, wind: Sequence[float]) -> float:
    """Level speed over ground (m/s) on a course through moving air."""
    c, s, level = math.cos(chi), math.sin(chi), V_a * math.cos(gamma)
    along, across = wind[0] * c + wind[1] * s, wind[1] * c - wind[0] * s
    return along + math.sqrt(max(level * level - across * across, 0.0))


def wind_triangle(
    chi: float, gamma: float, V_a: float, wind: Sequence[float]
) -> tuple[float, float]:
    """Parts of wind and airspeed along a path over ground, m/s; airspeed 0 if no heading holds it.

    With u the direction over ground and w the `wind` (north, east, down, m/s), V_g is their sum:
    ``|V_g u - w| = V_a``.
    """
    w_n, w_e, w_d = wind[0], wind[1], wind[2]
    level = math.cos(gamma)
    north, east = level * math.cos(chi), level * math.sin(chi)
    along = w_n * north + w_e * east - w_d * math.sin(gamma)
    across = w_n * w_n + w_e * w_e + w_d * w_d - along * along
    ahead = V_a * V_a - across
    return along, math.sqrt(ahead) if ahead > 0.0 else 0.0


def speed_in_wind(chi: float, gamma: float, V_a: float, wind: Sequence[float]) -> float:
    """Speed that converts lift to rates of the path over ground, m/s.

    Lift turns the velocity over ground, and only the part of it across that velocity does. The
    speed is ``V_g / cos(delta)``, delta the angle between the velocities over ground and through
    the air.
    """
    along, ahead = wind_triangle(chi, gamma, V_a, wind)
    if ahead == 0.0:  # no heading holds this course in this wind
        return V_a
    return max(along + ahead, LEAST_SPEED * V_a) * V_a / ahead


def climb_through_air(chi: float, gamma: float, V_a: float, wind: Sequence[float]) -> float:
    """Sine of the path angle through the air of a path over ground, which thrust balances."""
    along, ahead = wind_triangle(chi, gamma, V_a, wind)
    sine = math.sin(gamma)
    if ahead == 0.0:
        return sine
    V_g = max(along + ahead, LEAST_SPEED * V_a)
    # In still air this is the sine itself: the difference of the speeds is zero.
    return sine + (wind[2] + (V_g - V_a) * sine) / V_a


def path_over_ground(chi: float, sine: float, V_a: float, wind: Sequence[float]) -> float:
    """Path angle over ground (rad) on the course `chi`, from its sine through the air."""
    gamma = math.asin(sine)
    up, level = V_a * sine, V_a * math.cos(gamma)
    across = wind[1] * math.cos(chi) - wind[0] * math.sin(chi)
    ahead = math.sqrt(max(level * level - across * across, 0.0))
    along = wind[0] * math.cos(chi) + wind[1] * math.sin(chi) + ahead
    along, climb = max(along, LEAST_SPEED * level), up - wind[2]
    # The angle from one velocity to the other is exactly zero in still air.
    return gamma + math.atan2(climb * level - up * along, along * level + up * climb)
