"""The values that a law is given at a sample: `Measured`, from the signals of a plant."""

import math
from collections.abc import Callable
from operator import itemgetter

from flighttune.control.controller import Measured
from flighttune.control.wind import level_speed, speed_over
from flighttune.vehicles.plants.base import COMMON_SIGNALS, N_X_SIGNALS, OVER_GROUND, Plant
from flighttune.vehicles.plants.sensors import ERROR, WIND_MEASURED, SensedPlant, seen_as
from flighttune.vehicles.plants.weather import WIND

_DOWN = COMMON_SIGNALS.index("down")
_POSITION = slice(COMMON_SIGNALS.index("north"), _DOWN + 1)
_TRUE = itemgetter(*map(COMMON_SIGNALS.index, ("chi", "gamma", "V_a")))
_STILL = 0.0, 0.0, 0.0

# Signals of a law in the order of `Measured`: the true ones, and those with navigation errors.
TRUE_NAMES = "chi", "gamma", "V_a", "phi", "n_z"
SEEN_NAMES = seen_as(TRUE_NAMES)


def seen_names(signals: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the course, path angle, airspeed, roll and load factor that a law sees."""
    return tuple(
        seen if seen in signals else name for name, seen in zip(TRUE_NAMES, SEEN_NAMES, strict=True)
    )


class Moving:
    """The motion of an aircraft from one sample to the next.

    The velocity over ground is the difference of positions; at the first sample it follows from
    course, airspeed and wind. The acceleration along the path through the air is the difference of
    velocities.
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._before: tuple[float, ...] = ()
        self._velocity: tuple[float, float, float] | None = None

    def __call__(
        self, angles: tuple[float, ...], position: tuple[float, ...], wind: tuple[float, ...]
    ) -> tuple[float, tuple[float, float, float], float]:
        """Level speed and velocity over ground (m/s), and acceleration (m/s^2).

        `angles`: course and path angle (rad), and airspeed (m/s).
        """
        chi, gamma, V_a = angles
        if not self._before:
            V_g = level_speed(chi, gamma, V_a, wind)
            down = -V_g * math.tan(gamma)
        else:
            north, east, down = (x - y for x, y in zip(position, self._before, strict=True))
            V_g, down = speed_over(north, east, self._dt), down / self._dt
        velocity = north, east, down = V_g * math.cos(chi), V_g * math.sin(chi), down
        a_n, a_e, a_d = north - wind[0], east - wind[1], down - wind[2]
        n, e, d = self._velocity or velocity
        change = (north - n) * a_n + (east - e) * a_e + (down - d) * a_d
        self._before, self._velocity = position, velocity
        return V_g, velocity, change / (self._dt * max(math.hypot(a_n, a_e, a_d), 1.0))


def measured_of(plant: Plant, h_0: float, dt: float) -> Callable[[tuple[float, ...]], Measured]:
    """A function that turns the signals of a plant into `Measured`, sample by sample."""
    signals, new = plant.signals, tuple.__new__  # takes a third of the time of calling the class
    angles = itemgetter(*map(signals.index, seen_names(signals)))
    h = signals.index("h") if "h" in signals else None
    n_x = signals.index(N_X_SIGNALS[0]) if N_X_SIGNALS[0] in signals else None
    # A plant that follows its path through the air moves as in still air.
    air = signals.index(WIND[0]) if WIND[0] in signals and OVER_GROUND[0] not in signals else None
    has_body = {"theta", "elevator"} <= {*signals}
    body = itemgetter(*map(signals.index, ("theta", "elevator"))) if has_body else None
    moving = Moving(dt)

    def further(seen: tuple[float, ...]) -> tuple[object, ...]:
        return (
            None if n_x is None else seen[n_x : n_x + len(N_X_SIGNALS)],
            *((None, None) if body is None else body(seen)),
        )

    def measured(seen: tuple[float, ...]) -> Measured:
        height = h_0 - seen[_DOWN] if h is None else seen[h]
        wind, position = None if air is None else seen[air : air + len(WIND)], seen[_POSITION]
        known = angles(seen)
        motion = moving(known[:3], position, wind or _STILL)
        return new(Measured, (*known, height, position, wind, *further(seen), *motion))

    if not (isinstance(plant, SensedPlant) and plant.navigated):
        return measured
    of_place = itemgetter(*map(signals.index, seen_as(("north", "east", "h", "V_g"))))
    estimate = air if air is None else signals.index(WIND_MEASURED[0])

    def known(seen: tuple[float, ...]) -> Measured:
        air_true = _STILL if air is None else seen[air : air + len(WIND)]
        _, (_, _, sink), along = moving(_TRUE(seen), seen[_POSITION], air_true)
        chi, *_ = now = angles(seen)
        north, east, height, V_g = of_place(seen)
        error = plant.error
        position = north, east, seen[_DOWN] - error[ERROR.h]
        wind = None if estimate is None else seen[estimate : estimate + len(WIND)]
        velocity = V_g * math.cos(chi), V_g * math.sin(chi), sink - error[ERROR.v_up]
        motion = V_g, velocity, along + error[ERROR.acceleration]
        return new(Measured, (*now, height, position, wind, *further(seen), *motion))

    return known
