"""Guidance: the reference for a position beside a path, and its roll, lift and airspeed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.control.controller import Measured, ReferenceSample
from flighttune.control.exact_law import turning_speed
from flighttune.control.wind import WindEstimate, path_over_ground
from flighttune.routes.path import STEP, Path
from flighttune.vehicles.plants.base import Stop

# Signals of a flight along a route, and their units.
ROUTE_SIGNALS = {"along": "m", "cross_track": "m", "height_err": "m"}

# The same distances of where the guidance takes the aircraft to be.
SEEN_SIGNALS = "cross_track_seen", "height_err_seen"

# Distances along the route, to the right of it, and below it, m.
Place = tuple[float, float, float]

# A position counts as equal to the position computed from its place up to this distance, m.
SAME_PLACE = 0.01

COLUMNS = ("north", "east", "course", "curvature", "up", "slope")
CURVATURE, SLOPE = map(COLUMNS.index, ("curvature", "slope"))
DIFFERENCES = len(COLUMNS)  # offset from a column to its difference to the next point

# Lower bound of 1 - curvature e_y, which is zero at the centre of a turn.
MIN_SPREAD = 0.2

# Newton steps to the nearest point of the path, from the nearest point of the sample before.
SEARCHES = 2

# Longitudinal load factor of airspeed changes along a route: 5 m/s in 10 s.
CHANGE_N_X = 0.05

# Half step of the difference quotient of a slope, s.
SLOPE_S = 1e-3

# Ground speed below which the look-ahead distance no longer shrinks, m/s.
MIN_SPEED = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteReference:
    """The reference of a flight along a path."""

    path: Path
    # Largest airspeed of the flight, m/s.
    V_a: float
    # Look-ahead time, s: an error of position decays with this time constant.
    look_ahead: float
    g: float
    # Whether the law holds `V_a`, by n_x.
    holds_airspeed: bool = False
    # Airspeed at each point of the path, shape (n,), m/s; None if it is `V_a` everywhere.
    airspeeds: FloatArray | None = None

    @property
    def V(self) -> FloatArray:
        """Airspeed at each point of the path, shape (n,), m/s."""
        return np.full_like(self.path.s, self.V_a) if self.airspeeds is None else self.airspeeds

    def airspeed(self, t: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return airspeed (m/s) and its rate at times `t`; None if the plant holds the airspeed."""
        return (np.full_like(t, self.V_a), np.zeros_like(t)) if self.holds_airspeed else None

    @property
    def initial(self) -> tuple[float, float]:
        """Course and path angle at the start, rad."""
        return float(self.path.course[0]), math.atan(self.path.slope[0])

    @property
    def start_speed(self) -> float:
        """Speed over ground at the start in still air, m/s."""
        return float(self.V[0]) * math.cos(self.initial[1])

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Course and path angle at times `t` (s) of a flight in still air, of the shape of `t`."""
        speed = self.V * np.cos(np.arctan(self.path.slope))
        times = np.concatenate([[0.0], np.cumsum(STEP / speed[:-1])])
        s = np.interp(t, times, self.path.s)
        course = np.interp(s, self.path.s, self.path.course)
        return course, np.arctan(np.interp(s, self.path.s, self.path.slope))

    def rates(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates of course and path angle from times `t` (s) on, rad/s."""
        if np.size(t) < 2:  # a slope needs two times
            low, high = (np.array(self.sampled(np.add(t, side))) for side in (-SLOPE_S, SLOPE_S))
            chi, gamma = (high - low) / (2.0 * SLOPE_S)
            return chi, gamma
        chi, gamma = (np.gradient(values, t) for values in self.sampled(t))
        return chi, gamma

    def not_arrived(self, t: float, place: Place, *, gave_way: bool = False) -> Stop | None:
        """Why a flight of `t` (s) that ended at `place` did not complete the route; None if it did.

        `gave_way`: whether the flight gave up height for airspeed.
        """
        along, *off = place
        left, most = self.path.length - along, self.look_ahead * self.V_a
        beside = abs(off[0]) if self.holds_airspeed or gave_way else math.hypot(*off)
        if left > 0.0:
            return Stop("not_arrived", f"t = {t:g} s: {left:.0f} m of the route are left.")
        if beside > most:
            far = f"{beside:.0f} m from it, must be within its look-ahead of {most:.0f} m"
            return Stop("not_arrived", f"t = {t:g} s: the end of the route was passed {far}.")
        return None

    def displacement(self, signals: pd.DataFrame) -> float:
        """Largest distance, m, between the positions of a flight and their places on the route."""
        names = *ROUTE_SIGNALS, "north", "east", "down"
        along, *off, north, east, down = (signals[name].to_numpy(copy=True) for name in names)
        # The distance along the route never decreases, as in the windows of a band: behind the
        # start it is zero, and a flight that the wind carries back keeps its largest distance so
        # far.
        there = self.path.beside(np.maximum.accumulate(along), *off).T
        off_north, off_east, off_up = north - there[0], east - there[1], -down - there[2]
        return math.sqrt(float((off_north**2 + off_east**2 + off_up**2).max()))

    @cached_property
    def table(self) -> FloatArray:
        """`COLUMNS` at each point of the path but the last, then their changes to the next."""
        values = np.stack([getattr(self.path, name) for name in COLUMNS], axis=1)
        return np.hstack([values[:-1], np.diff(values, axis=0)])

    @cached_property
    def rows(self) -> list[list[float]]:
        """`table` as lists, which Python reads faster."""
        return self.table.tolist()

    def follower(self, dt: float, h_0: float, lead: tuple[float, float] = (0.0, 0.0)) -> "Follower":
        """Guidance of a flight from `h_0` (m); roll and lift are planned `lead` (s) ahead."""
        return Follower(self, dt, h_0, lead)


def airspeeds_along(
    path: Path, V_a: float, changes: Mapping[int, float], g: float
) -> FloatArray | None:
    """Airspeed at each point of a path, m/s, from `V_a` at its start; None if it is constant.

    `changes`: airspeeds by number of waypoint. Each holds from the end of the waypoint's turn or
    circles on, and is approached with `CHANGE_N_X` in still air: ``(V^2)' = 2 g n_x`` along the
    path.
    """
    if {*changes.values()} <= {V_a}:
        return None
    target = np.full_like(path.s, V_a)
    for waypoint, V in sorted(changes.items()):
        ends = [x.start + x.length for x in path.stretches if x.waypoint == waypoint]
        target[path.s >= max(ends, default=0.0)] = V
    square, step = V_a * V_a, 2.0 * g * CHANGE_N_X * STEP
    squares = []
    for goal in (target * target).tolist():
        squares.append(square)
        square = min(max(goal, square - step), square + step)
    return np.sqrt(squares)


class Follower:
    r"""Measurements to the reference of a law, sample by sample.

    `reference`: the route. `dt` (s): time between samples. `h_0` (m): height of the start. `lead`
    (s): lags of roll and lift behind their commands.

    Notes
    -----
    Look-ahead guidance about the nearest point of the path, whose course and path angle are
    ``chi_p`` and ``gamma_p``; T is the look-ahead and V_g the speed over ground:

    .. math:: \chi_{ref} = \chi_p - \arctan\frac{e_y}{L},\quad
              \gamma_{ref} = \gamma_p + \arctan\frac{e_h}{L},\quad L = V_g T

    with the distance e_y to the right of the path and the height deficit e_h. If the aircraft
    tracks both angles, ``e_y' = -V_g sin(arctan(e_y / L))``: the distance shrinks like ``exp(-t /
    T)`` once it is small against L (T. Fossen, *Handbook of Marine Craft Hydrodynamics and Motion
    Control*, look-ahead-based steering). The rates of the reference follow from this motion, with
    the curvature and the bend of the climb `lead` ahead. `Planner` plans roll and lift for the
    rates of the path itself.
    """

    def __init__(
        self, reference: RouteReference, dt: float, h_0: float, lead: tuple[float, float]
    ) -> None:
        self._rows = reference.rows
        self._settings = h_0, reference.look_ahead, *lead
        self._plan = Planner(dt, reference.g)
        self._nearest = self._nearest_true = path_at(self._rows, 0.0)
        self._begun, self._V_g = False, reference.start_speed
        self._V = None if reference.airspeeds is None else reference.airspeeds.tolist()

    def __call__(self, m: Measured) -> tuple[ReferenceSample, Place]:
        """Return the reference at a sample, and the place of the aircraft on the route."""
        chi, gamma, _, _, _, h, (north, east, _), *_ = m
        if self._begun and m.V_g is not None:
            self._V_g = m.V_g
        self._begun = True
        ref, place, path, planned, self._nearest = guidance(
            self._rows, self._nearest, self._V_g, (chi, gamma, north, east, h), self._settings
        )
        turn_rate, climb_rate, forward = planned
        V, V_dot = (None, 0.0) if self._V is None else self._airspeed(self._V, place[0], forward)
        commands = self._plan(m, turn_rate, climb_rate, ref[1])
        return tuple.__new__(ReferenceSample, (*ref, commands, V, V_dot, path)), place

    def placed(self, north: float, east: float, h: float) -> Place:
        """Where an aircraft is that takes itself to be elsewhere (m)."""
        position = north, east, h - self._settings[0]
        self._nearest_true, place = placed(self._rows, self._nearest_true, position)
        return place

    def _airspeed(self, V: list[float], s: float, forward: float) -> tuple[float, float]:
        """The airspeed at a distance (m), and its rate at a speed along the route (m/s)."""
        i = min(int(s / STEP), len(self._rows) - 1)
        rise = V[i + 1] - V[i]
        return V[i] + min(s / STEP - i, 1.0) * rise, rise / STEP * forward


# Share of its reference below which the airspeed of a third channel shall not fall, and the rate at
# which it may approach that share, 1/s: docs/airspeed.md has its flights.
LEAST_SHARE, APPROACH = 0.95, 0.35

# Share and rate for the priority of two channels. In gusts a healthy aircraft with a slow engine
# falls below 0.95, and its path would suffer. The rate is in g/V: a faster rate makes a jet
# oscillate, and a slower rate loses a slow aircraft in gusts.
LEAST_SHARE_BESIDE, APPROACH_BESIDE = 0.875, 1.5

# Sine of the steepest descent that may be commanded to regain airspeed.
STEEPEST_DIVE = -0.5


class AirspeedPriority:
    """Keeps the path angle of a reference flyable by the engines, sample by sample.

    With the largest n_x of the engines, ``V' = g (n_x - sin(gamma))`` stays above ``-kappa (V -
    V_low)`` as long as ``sin(gamma) <= n_x + kappa (V - V_low) / g``, gamma through the air. V then
    never falls below V_low, a share of its reference. The commanded path angle over ground is
    limited to this, in the wind that an aircraft measures. At idle there is no limit: in a descent
    that is too steep the airspeed rises above the reference, and holding it would cost the path.
    """

    # `V` (m/s): airspeed that the plant holds by itself; None if the reference has an airspeed.
    def __init__(self, V: float | None, g: float, dt: float) -> None:
        self._wind = WindEstimate(dt)
        numbers = (
            (0.0, APPROACH / g) if V is None else (LEAST_SHARE_BESIDE * V, APPROACH_BESIDE / V)
        )
        self.numbers = *numbers, self._wind.share

    def __call__(self, m: Measured, ref: ReferenceSample) -> ReferenceSample:
        """Return the reference of a sample; its path angle may be less than commanded."""
        assert m.n_x is not None  # the plant measures n_x
        V_low, per_g, _ = self.numbers
        if ref.V is not None:
            V_low = LEAST_SHARE * ref.V
        sine = steepest_sine(m.n_x[2], m.V_a, V_low, per_g)
        wind = self._wind(m.wind)
        gamma = math.asin(sine) if wind is None else path_over_ground(m.chi, sine, m.V_a, wind)
        if ref.gamma <= gamma:
            return ref
        return ref._replace(gamma=gamma, gamma_dot=0.0, planned=None)


class Planner:
    """Plans the commands of one flight, sample by sample.

    Turning the velocity over ground at the rate chi' takes the roll ``atan(chi' V_t / g)``, and
    bending it at gamma' the vertical lift ``cos(gamma) + gamma' V_t / g`` in weights, with V_t the
    `turning_speed`. V_t does not use the true wind, which no aircraft knows.
    """

    def __init__(self, dt: float, g: float) -> None:
        self._g, self._wind = g, WindEstimate(dt)

    def __call__(
        self, m: Measured, chi_dot: float, gamma_dot: float, gamma: float
    ) -> tuple[float, float]:
        """Roll (rad) and load factor for rates (rad/s) of the reference at its path angle (rad)."""
        per_g = turning_speed(m, self._wind(m.wind)) / self._g
        lift = math.cos(gamma) + gamma_dot * per_g
        return math.atan(chi_dot * per_g), lift / math.cos(m.phi)


# Numba compiles the functions below too.


def steepest_sine(n_x_max: float, V_a: float, V_low: float, per_g: float) -> float:
    """Sine of the steepest air path that the engines sustain, see `AirspeedPriority`."""
    return min(max(n_x_max + per_g * (V_a - V_low), STEEPEST_DIVE), 1.0)


def path_at(rows: Sequence[Sequence[float]], s: float) -> tuple[float, ...]:
    """The path at s (m): s, north, east, course, its cosine and sine, curvature, height, slope."""
    part = s / STEP
    i = int(part)
    if i > len(rows) - 1:  # takes half the time of `min`
        i = len(rows) - 1
    part -= i
    row = rows[i]
    n, e, course = row[0] + part * row[6], row[1] + part * row[7], row[2] + part * row[8]
    k, up, slope = row[3] + part * row[9], row[4] + part * row[10], row[5] + part * row[11]
    return s, n, e, course, math.cos(course), math.sin(course), k, up, slope


def column_at(rows: Sequence[Sequence[float]], column: int, s: float) -> float:
    """A column of the path at a distance s, m."""
    part = s / STEP
    i = int(part)
    if i > len(rows) - 1:
        i = len(rows) - 1
    row = rows[i]
    return row[column] + (part - i) * row[column + DIFFERENCES]


def guidance(
    rows: Sequence[Sequence[float]],
    nearest: tuple[float, ...],
    V_g: float,
    now: tuple[float, ...],
    settings: tuple[float, ...],
) -> tuple[tuple[float, ...], Place, tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Look-ahead guidance of a sample, see `Follower`.

    `nearest`: the nearest point of the sample before, by `path_at`. `now`: course and path angle
    (rad), north, east and height (m). `settings`: height of the start (m), look-ahead, lead of roll
    and of lift (s). Returns the reference course, path angle and their rates; the place; the path
    there, as in a sample; the rates of turn and climb to plan, and the speed along the path; the
    nearest point.
    """
    chi, gamma, north, east, h = now
    h_0, T, roll_lead, lift_lead = settings
    nearest, ahead, e_y, spread = nearest_point(rows, nearest, north, east)
    s, _, _, course, _, _, curvature, up, slope = nearest
    e_h, L = up - (h - h_0), max(V_g, MIN_SPEED) * T
    side, below = e_y / L, e_h / L
    forward = V_g * math.cos(chi - course) / spread
    aside = V_g * math.sin(chi - course)
    sinking = forward * slope - V_g * math.tan(gamma)
    later = s + V_g * lift_lead
    bend = (column_at(rows, SLOPE, later + STEP) - column_at(rows, SLOPE, later)) / STEP
    climb_rate = bend / (1.0 + slope * slope) * forward
    turn_rate = column_at(rows, CURVATURE, s + V_g * roll_lead) * forward
    ref = (
        course - math.atan(side),
        math.atan(slope) + math.atan(below),
        turn_rate - aside / (L * (1.0 + side * side)),
        climb_rate + sinking / (L * (1.0 + below * below)),
    )
    path = course, e_y, e_h, curvature, slope
    place = s, off_route(ahead, e_y), e_h
    return ref, place, path, (turn_rate, climb_rate, forward), nearest


def nearest_point(
    rows: Sequence[Sequence[float]], nearest: tuple[float, ...], north: float, east: float
) -> tuple[tuple[float, ...], float, float, float]:
    """The point of the path nearest to a position (m), from that of the sample before.

    Returns the point, how far the position is ahead of it and to the right (m), and how far the
    position moves with each metre of the point.
    """
    s, n, e, _, c_n, c_e, curvature, _, _ = nearest
    ahead = e_y = spread = 0.0
    # The last nearest point starts the next search, so that each search reads the path once.
    for search in range(SEARCHES + 1):
        ahead, e_y = (north - n) * c_n + (east - e) * c_e, (east - e) * c_n - (north - n) * c_e
        spread = 1.0 - curvature * e_y
        if spread < MIN_SPREAD:
            spread = MIN_SPREAD
        if search < SEARCHES:
            s += ahead / spread
            if s < 0.0:
                s = 0.0
            nearest = path_at(rows, s)
            s, n, e, _, c_n, c_e, curvature, _, _ = nearest
    return nearest, ahead, e_y, spread


def off_route(ahead: float, e_y: float) -> float:
    """Distance from the route, m, right positive; behind the start it counts from the start."""
    if abs(ahead) >= SAME_PLACE:
        return math.copysign(math.sqrt(e_y * e_y + ahead * ahead), e_y)
    return e_y


def placed(
    rows: Sequence[Sequence[float]], nearest: tuple[float, ...], position: tuple[float, ...]
) -> tuple[tuple[float, ...], Place]:
    """The nearest point and the place of a position: north, east, and up from the start (m)."""
    north, east, up = position
    nearest, ahead, e_y, _ = nearest_point(rows, nearest, north, east)
    return nearest, (nearest[0], off_route(ahead, e_y), nearest[7] - up)
