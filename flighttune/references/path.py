"""A path over ground from waypoints: straight legs, and turns that a limited roll rate can follow.

A turn is a circular arc between two clothoids, on which curvature grows in proportion to the
distance flown: roll that changes at a steady rate. Curvature is that of the path seen from above,
positive where the path turns right, and distances are those seen from above.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, Floats, check_not_negative, check_positive
from flighttune.errors import InputError
from flighttune.units import DEG

Kind: TypeAlias = Literal["leg", "turn", "loiter"]

# Distance between the points of a path's table, m: a chord of it is 3 mm off an arc of 50 m.
STEP = 1.0

# Points of the integration in a step.
SUBSTEPS = 8

# Time for which a path goes on straight beyond its end, s.
BEYOND_S = 10.0

# Shortest time over which a change of the climb is spread, s, and the load factor that it may add.
PULL_UP_S, PULL_UP_N_Z = 2.0, 0.2

# Largest change of course at a corner, rad: its turn begins some six radii before the waypoint.
SHARPEST = 160.0 * DEG

# Course change (rad) and distance (m) below which there is none.
NO_TURN, NO_LENGTH = 1e-6, 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """A point to pass, or the centre of circles to fly.

    Attributes
    ----------
    north, east, up : float, m
        Position from the start of the flight.
    turns : float
        Circles to fly around the point at least, clockwise positive; the last goes on until the
        course is that of the next leg. 0 to pass the point.
    radius : float or None, m
        Radius of the circles; None for the smallest that can be flown.
    climb : float or None, rad
        Size of the path angle at which the leg to the point changes its height, from its beginning
        on; None for a steady change along the whole leg.
    """

    north: float
    east: float
    up: float = 0.0
    turns: float = 0.0
    radius: float | None = None
    climb: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ability:
    """Speed and limits for which a route is planned."""

    V_a: float  # m/s
    wind: float  # m/s: the largest for which turns are planned
    phi: float  # rad: roll that turns may use
    phi_rate: float  # rad/s: rate at which it changes
    gamma: tuple[float, float]  # rad: lowest and highest path angle
    g: float  # m/s^2
    # s: longest time of a flight, on which the path does not depend
    duration: float = field(default=math.inf, compare=False)

    def __post_init__(self) -> None:
        check_positive(V_a=self.V_a, phi=self.phi, phi_rate=self.phi_rate, g=self.g)
        check_not_negative(wind=self.wind)

    @property
    def speed(self) -> float:
        """Largest speed over ground, with the wind from behind, m/s."""
        return self.V_a + self.wind

    @property
    def curvature(self) -> float:
        """Largest curvature over ground, ``g tan(phi) / speed^2``, 1/m."""
        return self.g * math.tan(self.phi) / self.speed**2

    def rolling(self, curvature: float) -> float:
        """Distance flown while roll changes from none to that of a curvature, m."""
        return self.speed * math.atan(curvature * self.speed**2 / self.g) / self.phi_rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A leg, a turn or the circles around a waypoint."""

    kind: Kind
    waypoint: int  # number of the one where it ends or around which it turns, from 1
    start: float  # m: distance along the route at which it begins
    length: float  # m
    course: float  # rad: at its beginning
    turn: float  # rad: change of course, right positive
    radius: float  # m: the smallest; infinite on a leg
    gamma: float  # rad: mean path angle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A planned path: a table of n points, `STEP` apart, and the stretches it consists of."""

    length: float  # m, from start to end; the table goes on straight for `BEYOND_S`
    # `north`, `east` and `up`: (n,), m, from the start of the flight
    north: FloatArray
    east: FloatArray
    up: FloatArray
    course: FloatArray  # (n,), rad: continuous, clockwise from north
    curvature: FloatArray  # (n,), 1/m: right positive
    slope: FloatArray  # (n,): height per distance
    stretches: tuple[Stretch, ...]

    @property
    def s(self) -> FloatArray:
        """Distance along the route of each point, shape (n,), m."""
        return STEP * np.arange(len(self.north), dtype=np.float64)

    def points(self, apart: float) -> FloatArray:
        """Distances every `apart` m along the route, and its end, m."""
        return np.append(np.arange(0.0, self.length, apart), self.length)

    def beside(self, s: FloatArray, right: Floats = 0.0, below: Floats = 0.0) -> FloatArray:
        """North, east and up of points beside the path at distances along it, shape (n, 3), m."""
        table = self.north, self.east, self.up, self.course
        north, east, up, course = (np.interp(s, self.s, values) for values in table)
        aside = -right * np.sin(course), right * np.cos(course)
        return np.column_stack([north + aside[0], east + aside[1], up - below])


class _Piece(NamedTuple):
    """Part of a path on which curvature changes at a steady rate."""

    length: float  # m
    curvature: float  # at its beginning, 1/m
    curvature_end: float


class _Turn(NamedTuple):
    """A corner, or the circles around a waypoint."""

    pieces: tuple[_Piece, ...] = ()
    reach: float = 0.0  # distance from its beginning to the foot of the waypoint on the leg, m


def plan(waypoints: Sequence[Waypoint], ability: Ability) -> Path:
    """Plan the path of a route, from its first waypoint, which has no circles, through the others.

    Raises InputError if a corner is too sharp, a leg too short, circles are too small, a climb is
    too steep or the route too long; the message has the number of the waypoint, and what would do.

    Notes
    -----
    Corners have the smallest radius that the ability allows, and every turn takes its roll in and
    out at the largest rate. A leg is the line that touches what is flown at both ends: it goes
    through a point that is passed, and beside circles by their radius and what the roll-in adds.
    The climb changes in the middle of a corner, or before circles, which are level; the change is
    rounded, so that the path passes the waypoint a little above or below its height.
    """
    if len(waypoints) < 2:
        raise InputError(f"`waypoints` must be at least 2, got {len(waypoints)}.")
    if waypoints[0].turns:
        raise InputError("`turns` must be absent at the first waypoint, where the flight starts.")
    courses = _courses(waypoints, ability)
    corners = [
        _circles(i, point, out - into, ability) if point.turns else _corner(i, out - into, ability)
        for i, (point, (into, out)) in enumerate(
            zip(waypoints[1:], pairwise([*courses, courses[-1]]), strict=True), start=2
        )
    ]
    pieces: list[tuple[_Piece, ...]] = []
    kinds: list[tuple[Kind, int]] = []
    for i, (before, after) in enumerate(pairwise([_Turn(), *corners]), start=1):
        apart = _along(waypoints[i - 1], waypoints[i], courses[i - 1])
        straight = apart - before.reach - after.reach
        if straight < -NO_LENGTH:
            raise InputError(
                f"`waypoints`: the leg to waypoint {i + 1} must be {-straight:.0f} m longer for "
                f"the turns at its ends, which take {before.reach + after.reach:.0f} m of its "
                f"{apart:.0f} m at {ability.speed:g} m/s and {ability.phi / DEG:.0f} deg of roll."
            )
        pieces.append((_Piece(max(straight, 0.0), 0.0, 0.0),))
        kinds.append(("leg", i + 1))
        if after.pieces:
            pieces.append(after.pieces)
            kinds.append(("loiter" if waypoints[i].turns else "turn", i + 1))
    ends = accumulate(sum(piece.length for piece in stretch) for stretch in pieces)
    check_length(zip((number for _, number in kinds), ends, strict=True), ability)
    return _path(pieces, kinds, waypoints, courses[0], ability)


def check_length(ends: Iterable[tuple[int, float]], ability: Ability) -> None:
    """Refuse stretches, given by waypoint and end (m), that no flight reaches in its time."""
    longest = ability.duration * ability.speed
    for number, end in ends:
        if end > longest:
            raise InputError(
                f"`waypoints`: waypoint {number} must be reached within `duration_s`, "
                f"{ability.duration:g} s, which is {longest:.0f} m at {ability.speed:.3g} m/s "
                f"(airspeed and wind), got {end:.0f} m along the route."
            )


def _courses(waypoints: Sequence[Waypoint], ability: Ability) -> list[float]:
    """Course of the leg after each waypoint but the last, rad."""
    courses = []
    asides = [_beside(point, ability)[1] if point.turns else 0.0 for point in waypoints]
    for i, (start, end) in enumerate(pairwise(waypoints)):
        north, east, aside = (
            end.north - start.north,
            end.east - start.east,
            asides[i + 1] - asides[i],
        )
        apart = math.hypot(north, east)
        if apart <= max(abs(aside), NO_LENGTH):
            raise InputError(
                f"`waypoints`: waypoint {i + 2} must be more than {abs(aside):.0f} m from the one "
                f"before, got {apart:.1f} m."
            )
        courses.append(math.atan2(east, north) - math.asin(aside / apart))
    return courses


def _along(start: Waypoint, end: Waypoint, course: float) -> float:
    """Distance from one waypoint to another along a course, m."""
    north, east = end.north - start.north, end.east - start.east
    return north * math.cos(course) + east * math.sin(course)


def _beside(point: Waypoint, ability: Ability) -> tuple[float, float]:
    """Where the centre of circles lies from the beginning of the roll-in, m: ahead and right."""
    roll_in, *_ = _ring(point, 0.0, ability)
    x, y, course = _curved([roll_in])
    return x - math.sin(course) / roll_in[2], y + math.cos(course) / roll_in[2]


def _ring(point: Waypoint, angle: float, ability: Ability) -> tuple[_Piece, ...]:
    """Circles around a waypoint that change the course by `angle`, rad."""
    tightest = ability.curvature
    if point.radius is not None and point.radius * tightest < 1.0 - NO_TURN:
        raise InputError(f"`radius_m` must be at least {1.0 / tightest:.0f}, got {point.radius:g}.")
    size = tightest if point.radius is None else 1.0 / point.radius
    return _turned(math.copysign(size, point.turns), abs(angle), ability.rolling(size))


def _turned(curvature: float, angle: float, rolling: float) -> tuple[_Piece, ...]:
    """An arc between roll-in and roll-out, each of which turns half as much as an arc would."""
    arc = angle / abs(curvature) - rolling
    return (
        _Piece(rolling, 0.0, curvature),
        _Piece(arc, curvature, curvature),
        _Piece(rolling, curvature, 0.0),
    )


def _circles(number: int, point: Waypoint, turn: float, ability: Ability) -> _Turn:
    """The circles around a waypoint where the course changes by `turn`, rad."""
    least = abs(point.turns) * math.tau
    onward = (math.copysign(1.0, point.turns) * turn - least) % math.tau
    pieces = _ring(point, least + onward, ability)
    if pieces[1].length < 0.0:
        least = 1.0 - pieces[1].length * abs(pieces[1].curvature) / math.tau
        raise InputError(
            f"`turns` of waypoint {number} must be at least {least:.2f}, got {point.turns:g}."
        )
    return _Turn(pieces, _beside(point, ability)[0])


def _corner(number: int, turn: float, ability: Ability) -> _Turn:
    """The turn at a waypoint that is passed, where the course changes by `turn`, rad."""
    turn = math.remainder(turn, math.tau)
    if abs(turn) < NO_TURN:
        return _Turn()
    if abs(turn) > SHARPEST:
        raise InputError(
            f"`waypoints`: the course must change by at most {SHARPEST / DEG:.0f} deg at waypoint "
            f"{number}, got {abs(turn) / DEG:.1f} deg; two waypoints make two corners of it."
        )
    curvature = ability.curvature
    rolling = ability.rolling(curvature)
    # A small turn ends before roll is at its limit.
    share = min(1.0, math.sqrt(abs(turn) / (curvature * rolling)))
    pieces = _turned(math.copysign(share * curvature, turn), abs(turn), share * rolling)
    x, y, _ = _curved(pieces)
    return _Turn(pieces, x - y / math.tan(turn))


def _curved(pieces: Sequence[_Piece]) -> tuple[float, float, float]:
    """Distance ahead and to the right, m, and change of course, rad, after some pieces."""
    x = y = course = 0.0
    for length, k, k_end in pieces:
        # Gauss's rule with 32 points: exact to rounding up to a half turn.
        nodes, weights = np.polynomial.legendre.leggauss(32)
        s = 0.5 * (nodes + 1.0)
        chi = course + length * (k * s + 0.5 * (k_end - k) * s * s)
        x += 0.5 * length * float(weights @ np.cos(chi))
        y += 0.5 * length * float(weights @ np.sin(chi))
        course += 0.5 * length * (k + k_end)
    return x, y, course


def _path(
    pieces: Sequence[tuple[_Piece, ...]],
    kinds: Sequence[tuple[Kind, int]],
    waypoints: Sequence[Waypoint],
    course: float,
    ability: Ability,
) -> Path:
    """The table of a path whose stretches have these pieces, from its first course on."""
    beyond = _Piece(BEYOND_S * ability.speed, 0.0, 0.0)
    lengths, k, k_end = np.array([piece for stretch in pieces for piece in stretch] + [beyond]).T
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    turned = np.concatenate([[course], course + np.cumsum(0.5 * (k + k_end) * lengths)])
    s = np.arange(math.ceil(begins[-1] / STEP) * SUBSTEPS + 1) * (STEP / SUBSTEPS)
    piece = np.clip(np.searchsorted(begins, s, side="right") - 1, 0, len(lengths) - 1)
    inside = s - begins[piece]
    change = (k_end - k) / np.maximum(lengths, NO_LENGTH)
    courses = turned[piece] + inside * (k[piece] + 0.5 * change[piece] * inside)
    north, east = (
        np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * (STEP / SUBSTEPS)
        for rate in (np.cos(courses), np.sin(courses))
    )
    counts = list(accumulate(map(len, pieces), initial=0))
    ends = begins[counts]
    along, up = _profile(kinds, ends, waypoints, ability)
    half = _half_pull_up(along, up, ability)
    # The climbs at the ends go on for as far as the mean of `_rounded` reaches.
    (before, after), far = _climbs(along, up)[[0, -1]], BEYOND_S * ability.speed + 2.0 * half
    along = np.concatenate([[-far], along, [along[-1] + far]])
    up = np.concatenate([[up[0] - far * before], up, [up[-1] + far * after]])
    height, slope = _rounded(s[::SUBSTEPS], along, up, half)
    climbs = np.diff(np.interp(ends, along, up)) / np.maximum(np.diff(ends), NO_LENGTH)
    curved = np.maximum(np.abs(k), np.abs(k_end))
    stretches = tuple(
        Stretch(
            kind=kind,
            waypoint=waypoint,
            start=float(ends[i]),
            length=float(ends[i + 1] - ends[i]),
            course=float(turned[first]),
            turn=float(turned[last] - turned[first]),
            radius=float(1.0 / most) if (most := curved[first:last].max()) else math.inf,
            gamma=math.atan(climbs[i]),
        )
        for i, ((kind, waypoint), (first, last)) in enumerate(
            zip(kinds, pairwise(counts), strict=True)
        )
    )
    return Path(
        length=float(ends[-1]),
        north=waypoints[0].north + north[::SUBSTEPS],
        east=waypoints[0].east + east[::SUBSTEPS],
        up=height,
        course=courses[::SUBSTEPS],
        curvature=(k[piece] + change[piece] * inside)[::SUBSTEPS],
        slope=slope,
        stretches=stretches,
    )


def _profile(
    kinds: Sequence[tuple[Kind, int]],
    ends: FloatArray,
    waypoints: Sequence[Waypoint],
    ability: Ability,
) -> tuple[FloatArray, FloatArray]:
    """Distances, m, and heights, m, between which the height changes at a steady rate."""
    along, up = [0.0], [waypoints[0].up]
    for i, (kind, number) in enumerate(kinds):
        point = waypoints[number - 1]
        follows = kinds[i + 1][0] if i + 1 < len(kinds) else None
        if kind == "leg":
            reached = ends[i + 1] + (0.5 * (ends[i + 2] - ends[i + 1]) if follows == "turn" else 0)
            _climb(number, point, along, up, float(reached), ability)
        elif kind == "loiter":
            along.append(float(ends[i + 1]))
            up.append(point.up)
    distinct = np.append(True, np.diff(along) > NO_LENGTH)
    return np.array(along)[distinct], np.array(up)[distinct]


def _climbs(along: FloatArray, up: FloatArray) -> FloatArray:
    """Slopes between these distances and heights."""
    return np.diff(up) / np.diff(along)


def _half_pull_up(along: FloatArray, up: FloatArray, ability: Ability) -> float:
    """Half the distance over which each change of the climb is spread, m."""
    bends = np.abs(np.diff(np.arctan(_climbs(along, up))))
    pull_up = max(PULL_UP_S, ability.V_a * bends.max(initial=0.0) / (ability.g * PULL_UP_N_Z))
    apart = np.diff(along[1:-1][bends > NO_TURN]).min(initial=math.inf)
    if pull_up > PULL_UP_S and pull_up * ability.V_a > apart:
        raise InputError(
            f"`waypoints`: changes of the climb must be {pull_up * ability.V_a:.0f} m apart at "
            f"{ability.V_a:g} m/s, got {apart:.0f} m; gentler climbs may be closer."
        )
    return 0.5 * pull_up * ability.V_a


def _climb(
    number: int,
    point: Waypoint,
    along: list[float],
    up: list[float],
    reached: float,
    ability: Ability,
) -> None:
    """Add the change of height of the leg to a waypoint, which is `reached` there."""
    change, distance = point.up - up[-1], reached - along[-1]
    gamma = math.atan2(change, distance)
    if point.climb is not None and change:
        gamma = math.copysign(point.climb, change)
    needed = change / math.tan(gamma) if change else 0.0
    low, high = ability.gamma
    if not (low <= gamma <= high and needed <= distance + NO_LENGTH):
        steepest = high if change > 0.0 else low
        raise InputError(
            f"`waypoints`: the height of waypoint {number} must differ by at most "
            f"{distance * math.tan(min(abs(steepest), abs(gamma))):.0f} m from that of the one "
            f"before, at a path angle of {low / DEG:.1f} to {high / DEG:.1f} deg over "
            f"{distance:.0f} m, got {abs(change):.0f} m at {gamma / DEG:.1f} deg."
        )
    if NO_LENGTH < needed < distance - NO_LENGTH:
        along.append(along[-1] + needed)
        up.append(point.up)
    along.append(reached)
    up.append(point.up)


def _rounded(
    s: FloatArray, at: FloatArray, up: FloatArray, half: float
) -> tuple[FloatArray, FloatArray]:
    """Means over +-`half` (m) of a height that changes at steady rates, and their slopes."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (up[1:] + up[:-1]) * np.diff(at))])

    def integral(x: FloatArray) -> FloatArray:
        below = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
        return area[below] + 0.5 * (x - at[below]) * (up[below] + np.interp(x, at, up))

    low, high = s - half, s + half
    mean = (integral(high) - integral(low)) / (2.0 * half)
    return mean, (np.interp(high, at, up) - np.interp(low, at, up)) / (2.0 * half)
