"""Follow a path: position over ground to a reference of course and flight-path angle."""

import math
from collections.abc import Callable
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

# Smallest share of the radius of a turn at which its centre counts as to the side, not ahead.
NEAREST = 0.2


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
    def _rows(self) -> list[tuple[float, ...]]:
        """Position, course, curvature, height and slope at each point of the path."""
        p = self.path
        columns = (p.north, p.east, p.course, p.curvature, p.up, p.slope)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def follower(
        self, dt: float, h_0: float
    ) -> Callable[[Measured], tuple[ReferenceSample, Place]]:
        r"""A function that turns measurements into the reference, sample by sample.

        Parameters
        ----------
        dt : float, s
            Sample time.
        h_0 : float, m
            Height of the start.

        Notes
        -----
        Look-ahead guidance about the nearest point of the path, with its course ``chi_p``:

        .. math:: \chi_{ref} = \chi_p - \arctan\frac{e_y}{L},\quad
                  \gamma_{ref} = \gamma_p + \arctan\frac{e_h}{L},\quad L = V_g T

        with the distance e_y to the right of the path and the height e_h below it.
        """
        rows, last = self._rows, len(self._rows) - 2
        s, before = 0.0, None
        T, g = self.look_ahead, self.g
        V_g = self.V_a * math.cos(self.initial[1])

        def at(distance: float) -> tuple[float, ...]:
            i = min(int(distance / STEP), last)
            f = distance / STEP - i
            a, b = rows[i], rows[i + 1]
            return tuple([x + f * (y - x) for x, y in zip(a, b, strict=True)])

        def follow(m: Measured) -> tuple[ReferenceSample, Place]:
            nonlocal s, before, V_g
            north, east = m.position[0], m.position[1]
            if before is not None:
                V_g = math.hypot(north - before[0], east - before[1]) / dt
            before = north, east
            for _ in range(2):
                n, e, course, kappa, up, slope = at(s)
                c, sn = math.cos(course), math.sin(course)
                ahead = (north - n) * c + (east - e) * sn
                e_y = (east - e) * c - (north - n) * sn
                s = max(s + ahead / max(1.0 - kappa * e_y, NEAREST), 0.0)
            n, e, course, kappa, up, slope = at(s)
            c, sn = math.cos(course), math.sin(course)
            e_y = (east - e) * c - (north - n) * sn
            e_h = up - (m.h - h_0)
            L = max(V_g, 1.0) * T
            off = m.chi - course
            s_dot = V_g * math.cos(off) / max(1.0 - kappa * e_y, NEAREST)
            y_dot = V_g * math.sin(off)
            chi_dot = kappa * s_dot - y_dot / L / (1.0 + (e_y / L) ** 2)
            chi = course - math.atan(e_y / L)
            gamma_p = math.atan(slope)
            h_dot = s_dot * slope - V_g * math.tan(m.gamma)
            gamma = gamma_p + math.atan(e_h / L)
            bend = (at(s + STEP)[5] - slope) / STEP / (1.0 + slope * slope)
            gamma_dot = bend * s_dot + h_dot / L / (1.0 + (e_h / L) ** 2)
            *_, kappa_ahead, _, _ = at(s + V_g * LEAD_S)
            crab = 1.0
            if m.wind is not None:
                along = m.wind[0] * math.cos(m.chi) + m.wind[1] * math.sin(m.chi)
                crab = max((V_g - along) / (m.V_a * math.cos(m.gamma)), 0.2)
            roll = math.atan(kappa_ahead * V_g * V_g / (g * crab))
            sample = ReferenceSample(
                chi, gamma, chi_dot, gamma_dot, (roll, math.cos(gamma) / math.cos(m.phi))
            )
            return sample, (s, e_y, e_h)

        return follow
