"""Follow a path: position over ground to a reference of course and flight-path angle."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.controller import Measured, ReferenceSample
from flighttune.plants.base import Stop
from flighttune.routes.path import STEP, Path

# Signals of a flight along a route, and their units.
ROUTE_SIGNALS = {"along": "m", "cross_track": "m", "height_err": "m"}

# Distances along the route, to the right of it, and below it, m.
Place = tuple[float, float, float]

# Time by which roll is planned ahead, s: about the lag of an inner loop.
LEAD_S = 0.2

# Smallest share of its radius at which a turn's centre may be beside the aircraft, and smallest
# cosine of a crab angle.
NEAREST = 0.2

# Newton's steps to the nearest point of the path, from that of the sample before.
SEARCHES = 2

# Speed over ground below which the look-ahead shrinks no more, m/s.
SLOWEST = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteReference:
    """The reference of a flight along a path.

    Attributes
    ----------
    path : Path
    V_a : float, m/s
        Airspeed of the flight.
    look_ahead : float, s
        Time in which an error of position would be flown off at the speed of the flight.
    g : float, m/s^2
        Acceleration of gravity.
    """

    path: Path
    V_a: float
    look_ahead: float
    g: float

    @property
    def initial(self) -> tuple[float, float]:
        """Course and path angle at the start, rad."""
        return float(self.path.course[0]), math.atan(self.path.slope[0])

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Course and path angle at times `t` (s) of a flight in still air, each of its shape."""
        s = self._flown(t)
        course = np.interp(s, self.path.s, self.path.course)
        return course, np.arctan(np.interp(s, self.path.s, self.path.slope))

    def rates(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Their rates from times `t` (s) on, rad/s."""
        chi, gamma = (np.gradient(values, t) for values in self.sampled(t))
        return chi, gamma

    def not_arrived(self, t: float, along: float) -> Stop | None:
        """Why a flight that lasted `t` (s) and came to `along` (m) did not fly all of it."""
        left = self.path.length - along
        if left <= 0.0:
            return None
        return Stop("not_arrived", f"t = {t:g} s: {left:.0f} m of the route are left.")

    def _flown(self, t: FloatArray) -> FloatArray:
        speed = self.V_a * np.cos(np.arctan(self.path.slope))
        times = np.concatenate([[0.0], np.cumsum(STEP / speed[:-1])])
        return np.interp(t, times, self.path.s)

    @cached_property
    def rows(self) -> list[tuple[float, ...]]:
        """Position, course, curvature, height and slope at each point of the path."""
        p = self.path
        columns = (p.north, p.east, p.course, p.curvature, p.up, p.slope)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def follower(self, dt: float, h_0: float) -> "Follower":
        """Guidance of one flight with samples of `dt` (s) that starts at the height `h_0` (m)."""
        return Follower(self, dt, h_0)


class Follower:
    r"""Measurements to the reference of a law, sample by sample.

    `reference`: the route. `dt` (s): time between samples. `h_0` (m): height of the start.

    Notes
    -----
    Look-ahead guidance about the nearest point of the path, whose course and path angle are
    ``chi_p`` and ``gamma_p``; T is the look-ahead and V_g the speed over ground:

    .. math:: \chi_{ref} = \chi_p - \arctan\frac{e_y}{L},\quad
              \gamma_{ref} = \gamma_p + \arctan\frac{e_h}{L},\quad L = V_g T

    with the distance e_y to the right of the path and the height e_h that is missing. Where course
    and path angle are as asked, ``e_y' = -V_g sin(arctan(e_y / L))``: the distance shrinks like
    ``exp(-t / T)`` once it is small against L (T. Fossen, *Handbook of Marine Craft Hydrodynamics
    and Motion Control*, look-ahead-based steering). The rates of the reference are those of this
    motion, and the roll planned is that of the curvature `LEAD_S` ahead at the speed over ground.
    """

    def __init__(self, reference: RouteReference, dt: float, h_0: float) -> None:
        self._rows, self._last = reference.rows, len(reference.rows) - 2
        self._dt, self._h_0, self._T, self._g = dt, h_0, reference.look_ahead, reference.g
        self._s, self._before = 0.0, None
        self._V_g = reference.V_a * math.cos(reference.initial[1])

    def __call__(self, m: Measured) -> tuple[ReferenceSample, Place]:
        """Return the reference at a sample, and where the aircraft is on the route."""
        north, east, _ = m.position
        if self._before is not None:
            moved = north - self._before[0], east - self._before[1]
            self._V_g = math.hypot(*moved) / self._dt
        self._before, V_g = (north, east), self._V_g
        for _ in range(SEARCHES):
            ahead, _, spread, *_ = self._seen_from(north, east)
            self._s = max(self._s + ahead / spread, 0.0)
        _, e_y, spread, course, curvature, up, slope = self._seen_from(north, east)
        e_h, L = up - (m.h - self._h_0), max(V_g, SLOWEST) * self._T
        side, below = e_y / L, e_h / L
        forward = V_g * math.cos(m.chi - course) / spread
        aside = V_g * math.sin(m.chi - course)
        sinking = forward * slope - V_g * math.tan(m.gamma)
        bend = (self._at(self._s + STEP)[5] - slope) / STEP / (1.0 + slope * slope)
        gamma = math.atan(slope) + math.atan(below)
        sample = ReferenceSample(
            course - math.atan(side),
            gamma,
            curvature * forward - aside / (L * (1.0 + side * side)),
            bend * forward + sinking / (L * (1.0 + below * below)),
            (self._roll(m, V_g), math.cos(gamma) / math.cos(m.phi)),
        )
        return sample, (self._s, e_y, e_h)

    def _seen_from(self, north: float, east: float) -> tuple[float, ...]:
        """How far ahead and to the right of its place on the path a point is, m, and what is there.

        Then the change of the first per metre along the path, course, curvature, height and slope.
        """
        n, e, course, *others = self._at(self._s)
        c, s = math.cos(course), math.sin(course)
        e_y = (east - e) * c - (north - n) * s
        spread = max(1.0 - others[0] * e_y, NEAREST)
        return (north - n) * c + (east - e) * s, e_y, spread, course, *others

    def _at(self, s: float) -> tuple[float, ...]:
        """North, east, course, curvature, height and slope of the path at a distance, m."""
        i = min(int(s / STEP), self._last)
        part = s / STEP - i
        return tuple([a + part * (b - a) for a, b in zip(*self._rows[i : i + 2], strict=True)])

    def _roll(self, m: Measured, V_g: float) -> float:
        """Roll in which the path's next curvature is flown, crabbing where there is wind."""
        curvature = self._at(self._s + V_g * LEAD_S)[3]
        crab = 1.0
        if m.wind is not None:
            behind = m.wind[0] * math.cos(m.chi) + m.wind[1] * math.sin(m.chi)
            crab = max((V_g - behind) / (m.V_a * math.cos(m.gamma)), NEAREST)
        return math.atan(curvature * V_g * V_g / (self._g * crab))
