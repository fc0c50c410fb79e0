"""A path over ground from waypoints: straight legs, and turns that a limited roll rate can follow.

Curvature is that of the path seen from above, positive where the path turns right, and distances
are those seen from above.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, Floats, check_not_negative, check_positive
from flighttune.errors import InputError
from flighttune.references.turns import (
    NO_LENGTH,
    SHARES,
    Piece,
    Pieces,
    Pose,
    bent,
    centre,
    curved,
    turn_arounds,
    turned,
)
from flighttune.units import DEG

Kind: TypeAlias = Literal["leg", "turn", "loiter", "turn-around"]

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

# Course change (rad) below which there is none.
NO_TURN = 1e-6

# Path angle of circles that take a change of height, rad.
SPIRAL = 5.0 * DEG

# Steps in which the speed and the wind of a way out are looked for, and the lowest speed, a share.
HALVINGS, SLOWEST = 10, 0.4


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
    hold : float, s
        Time that the circles take at least, at the airspeed.
    spiral : bool
        Whether the circles take the change of height, in place of the leg to the point.
    name : str
        Its name in messages; by default ``waypoint`` with its number.
    """

    north: float
    east: float
    up: float = 0.0
    turns: float = 0.0
    radius: float | None = None
    climb: float | None = None
    hold: float = 0.0
    spiral: bool = False
    name: str = ""

    @property
    def number(self) -> str:
        """Its number in the file that it was read from, which maps show."""
        return self.name.split()[-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ability:
    """Speed and limits for which a route is planned."""

    V_a: float  # m/s
    wind: float  # m/s: the largest for which turns are planned
    phi: float  # rad: roll that turns may use
    phi_rate: float  # rad/s: rate at which it changes
    gamma: tuple[float, float]  # rad: lowest and highest path angle
    g: float  # m/s^2
    widen: bool = False  # whether circles that are too small are flown at the smallest radius
    # m: how far a turn-around may go from the leg that it replaces; 0 for none
    turnaround: float = 0.0
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
    """A leg, a turn, a turn-around in place of a leg, or the circles around a waypoint."""

    kind: Kind
    waypoint: int  # number of the one where it ends or around which it turns, from 1
    start: float  # m: distance along the route at which it begins
    length: float  # m
    course: float  # rad: at its beginning
    turn: float  # rad: change of course, right positive
    radius: float  # m: the smallest; infinite on a leg
    gamma: float  # rad: mean path angle
    aside: float = 0.0  # m: how far a turn-around goes from its leg
    name: str  # of the waypoint

    @property
    def words(self) -> str:
        """The stretch by its kind and waypoint."""
        return f"{self.kind} {'to' if self.kind == 'leg' else 'at'} {self.name}"


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

    def stretch_at(self, along: float) -> Stretch:
        """The stretch at a distance along the route, m."""
        return [stretch for stretch in self.stretches if stretch.start <= along][-1]

    def points(self, apart: float) -> FloatArray:
        """Distances every `apart` m along the route, and its end, m."""
        return np.append(np.arange(0.0, self.length, apart), self.length)

    def beside(self, s: FloatArray, right: Floats = 0.0, below: Floats = 0.0) -> FloatArray:
        """North, east and up of points beside the path at distances along it, shape (n, 3), m."""
        table = self.north, self.east, self.up, self.course
        north, east, up, course = (np.interp(s, self.s, values) for values in table)
        aside = -right * np.sin(course), right * np.cos(course)
        return np.column_stack([north + aside[0], east + aside[1], up - below])


class _Turn(NamedTuple):
    """A corner, or the circles around a waypoint."""

    pieces: Pieces = ()
    reach: float = 0.0  # distance from its beginning to the foot of the waypoint on the leg, m


class _Laid(NamedTuple):
    """A stretch before the table of its path."""

    kind: Kind
    waypoint: int
    pieces: Pieces
    aside: float = 0.0


class _NoRoomError(InputError):
    """A leg is too short, or a corner too sharp, for the turns that are allowed."""


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
    waypoints = [
        point if point.name else replace(point, name=f"waypoint {number}")
        for number, point in enumerate(waypoints, start=1)
    ]
    if ability.widen:
        least = 1.0 / ability.curvature
        waypoints = [
            replace(point, radius=max(point.radius, least)) if point.radius else point
            for point in waypoints
        ]
    try:
        stretches = _lay(waypoints, ability)
    except _NoRoomError as error:
        raise InputError(f"{error}{_ways_out(waypoints, ability)}.") from None
    ends = [*accumulate(sum(piece.length for piece in laid.pieces) for laid in stretches)]
    if ends[-1] < STEP:
        raise InputError(f"`waypoints` must be {STEP:g} m apart or more, got {ends[-1]:.2g} m.")
    names = (waypoints[laid.waypoint - 1].name for laid in stretches)
    check_length(zip(names, ends, strict=True), ability)
    return _path(stretches, waypoints, _courses(waypoints, ability, set())[0], ability)


def _lay(waypoints: Sequence[Waypoint], ability: Ability) -> list[_Laid]:
    """The stretches of a path, with turn-arounds in place of legs that are too short."""
    around: set[int] = set()
    laid, lengths, corners = _stretches(waypoints, around, ability)
    while short := [i for i, x in enumerate(lengths) if x < -NO_LENGTH]:
        i = short[0]
        if not ability.turnaround:
            raise _NoRoomError(
                f"`waypoints`: the leg to {waypoints[i + 1].name} must be {-lengths[i]:.0f} m "
                f"longer for the turns at its ends, at {ability.speed:g} m/s and "
                f"{ability.phi / DEG:.0f} deg of roll"
            )
        i = min(short, key=lengths.__getitem__)
        # A turn-around in place of a leg beyond a corner gives room too, and is often shorter.
        legs = [i, *[i - 1] * (i in corners), *[i + 1] * (i + 1 in corners)]
        tried = [{*around, leg} for leg in legs]
        ways = [(legs, *_stretches(waypoints, legs, ability)) for legs in tried]
        around, laid, lengths, corners = min(ways, key=lambda way: _cost(*way[1:3], ability))
    if wrong := [x for x in laid if x.aside > ability.turnaround]:
        raise _NoRoomError(
            f"`waypoints`: the turn-around to {waypoints[wrong[0].waypoint - 1].name} must go "
            f"{wrong[0].aside:.0f} m from its leg at {ability.speed:g} m/s and "
            f"{ability.phi / DEG:.0f} deg of roll, where `turnaround_m` is {ability.turnaround:g}"
        )
    return laid


def _cost(laid: Sequence[_Laid], lengths: Sequence[float], ability: Ability) -> float:
    """Length of stretches, m, with a circle for each leg that is still too short."""
    flown = sum(piece.length for stretch in laid for piece in stretch.pieces)
    beyond = sum(max(stretch.aside - ability.turnaround, 0.0) for stretch in laid)
    left = sum(x < -NO_LENGTH for x in lengths)
    return flown + (left + (beyond > 0.0) * len(lengths)) * math.tau / ability.curvature


def _stretches(
    waypoints: Sequence[Waypoint], around: set[int], ability: Ability
) -> tuple[list[_Laid], list[float], set[int]]:
    """Stretches with turn-arounds in place of some legs, and what turns leave of the others, m.

    Also the positions of the waypoints with corners, which the legs before and after them share.
    """
    courses = _courses(waypoints, ability, around)
    turns = _turns(waypoints, courses, around, ability)
    lengths = _straights(waypoints, courses, turns)
    laid: list[_Laid] = []
    for i, after in enumerate(turns[1:]):
        number, straight = i + 2, Piece(max(lengths[i], 0.0), 0.0, 0.0)
        start = _pose(waypoints[i], courses, i, around, ability, out=True)
        if i in around:
            end = _pose(waypoints[i + 1], courses, i + 1, around, ability, out=False)
            laid.append(_around(number, start, end, ability))
            lengths[i] = 0.0
        else:
            if _over(waypoints, courses, i, around):
                laid.append(_around(i + 1, start, start._replace(course=courses[i]), ability))
            laid.append(_Laid("leg", number, (straight,)))
        if after.pieces:
            laid.append(_Laid("loiter" if waypoints[i + 1].turns else "turn", number, after.pieces))
    corners = {i for i, turn in enumerate(turns) if turn.pieces and not waypoints[i].turns}
    return laid, lengths, corners


def check_length(ends: Iterable[tuple[str, float]], ability: Ability) -> None:
    """Refuse stretches, given by waypoint and end (m), that no flight reaches in its time."""
    longest = ability.duration * ability.speed
    for name, end in ends:
        if end > longest:
            raise InputError(
                f"`waypoints`: {name} must be reached within `duration_s`, "
                f"{ability.duration:g} s, which is {longest:.0f} m at {ability.speed:.3g} m/s "
                f"(airspeed and wind), got {end:.0f} m along the route."
            )


def _courses(waypoints: Sequence[Waypoint], ability: Ability, around: set[int]) -> list[float]:
    """Course of the leg after each waypoint but the last, rad; of a turn-around at its ends."""
    courses: list[float] = []
    asides = [_beside(point, ability)[1] if point.turns else 0.0 for point in waypoints]
    for i, (start, end) in enumerate(pairwise(waypoints)):
        north, east = end.north - start.north, end.east - start.east
        aside = asides[i + 1] - asides[i]
        if (apart := math.hypot(north, east)) <= max(abs(aside), NO_LENGTH):
            if not ability.turnaround or (apart <= NO_LENGTH and not aside):
                raise InputError(
                    f"`waypoints`: {end.name} must be more than {abs(aside):.0f} m from "
                    f"{start.name}, got {apart:.1f} m."
                )
            around.add(i)
        if i in around:
            straight = courses[-1] if apart <= NO_LENGTH and courses else math.atan2(east, north)
            courses.append(straight)
        else:
            courses.append(math.atan2(east, north) - math.asin(aside / apart))
    return courses


def _turns(
    waypoints: Sequence[Waypoint], courses: Sequence[float], around: set[int], ability: Ability
) -> list[_Turn]:
    """The flight at each waypoint: circles, a corner, or nothing beside a turn-around."""
    turns = [_Turn()]
    for i, (into, out) in enumerate(pairwise([*courses, courses[-1]]), start=1):
        point = waypoints[i]
        if point.turns:
            turns.append(_circles(point, out - into, waypoints[i - 1], ability))
        elif {i - 1, i} & around or _over(waypoints, courses, i, around):
            if not ability.turnaround:
                raise _NoRoomError(
                    f"`waypoints`: the course must change by at most {SHARPEST / DEG:.0f} deg at "
                    f"{point.name}, got "
                    f"{abs(math.remainder(out - into, math.tau)) / DEG:.1f} deg; two waypoints "
                    "make two corners of it"
                )
            turns.append(_Turn())
        else:
            turns.append(_corner(out - into, ability))
    return turns


def _over(
    waypoints: Sequence[Waypoint], courses: Sequence[float], i: int, around: set[int]
) -> bool:
    """Whether the corner at a waypoint between two legs is too sharp to pass inside of it."""
    if waypoints[i].turns or {i - 1, i} & around or not 0 < i < len(courses):
        return False
    return abs(math.remainder(courses[i] - courses[i - 1], math.tau)) > SHARPEST


def _straights(
    waypoints: Sequence[Waypoint], courses: Sequence[float], turns: Sequence[_Turn]
) -> list[float]:
    """The length of each leg that its turns leave, m."""
    legs = zip(pairwise(waypoints), courses, pairwise(turns), strict=True)
    return [_along(*ends, chi) - before.reach - after.reach for ends, chi, (before, after) in legs]


def _pose(
    point: Waypoint,
    courses: Sequence[float],
    i: int,
    around: set[int],
    ability: Ability,
    *,
    out: bool,
) -> Pose:
    """Where a turn-around begins or ends at a waypoint: on the course of a leg beside it."""
    before, after = courses[max(i - 1, 0)], courses[min(i, len(courses) - 1)]
    if not point.turns:
        if i - 1 not in around and 0 < i:
            course = before
        elif i not in around and i < len(courses):
            course = after
        else:  # between two turn-arounds half way from one leg's course to the other's
            course = before + 0.5 * math.remainder(after - before, math.tau)
        return Pose(point.north, point.east, course)
    ahead, right = _beside(point, ability)
    course, ahead = (after, -ahead) if out else (before, ahead)
    return Pose(*Pose(point.north, point.east, course).beside(-ahead, -right), course)


@lru_cache(maxsize=4096)  # each is tried beside others
def _around(number: int, start: Pose, end: Pose, ability: Ability) -> _Laid:
    """The shortest turn-around within its room, or else the one that takes the least room."""
    curvatures = [share * ability.curvature for share in SHARES]
    ways = turn_arounds(start, end, [(k, ability.rolling(k)) for k in curvatures])
    inside = (way for way in ways if way[0] <= ability.turnaround)
    aside, pieces = next(inside, None) or min(ways)
    return _Laid("turn-around", number, pieces, aside)


def _ways_out(waypoints: Sequence[Waypoint], ability: Ability) -> str:
    """Speed, room or wind with which a route would have room for its turns, in words."""

    def fits(**changed: float) -> bool:
        try:
            _lay(waypoints, replace(ability, **changed))
        except InputError:
            return False
        return True

    def largest(key: str, low: float, high: float) -> float | None:
        if not fits(**{key: low}):
            return None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if fits(**{key: middle}) else (low, middle)
        return low

    speed = largest("V_a", SLOWEST * ability.V_a, ability.V_a)
    room = max(laid.aside for laid in _lay(waypoints, replace(ability, turnaround=math.inf)))
    wind = largest("wind", 0.0, ability.wind) if ability.wind else None
    changes = {
        "`V_a_mps` of {:.1f}": speed and math.floor(10.0 * speed) / 10.0,
        "`turnaround_m` of {:.0f}": math.ceil(room),
        "`wind_mps` of {:.1f}": wind and math.floor(10.0 * wind) / 10.0,
    }
    return "; it is flown with " + " or ".join(
        text.format(value) for text, value in changes.items() if value is not None
    )


def _along(start: Waypoint, end: Waypoint, course: float) -> float:
    """Distance from one waypoint to another along a course, m."""
    north, east = end.north - start.north, end.east - start.east
    return north * math.cos(course) + east * math.sin(course)


def _beside(point: Waypoint, ability: Ability) -> tuple[float, float]:
    """Where the centre of circles lies from the beginning of the roll-in, m: ahead and right."""
    roll_in, *_ = _ring(point, 0.0, ability)
    return centre(roll_in.curvature_end, roll_in.length)


def _ring(point: Waypoint, angle: float, ability: Ability) -> Pieces:
    """Circles around a waypoint that change the course by `angle`, rad."""
    tightest = ability.curvature
    if point.radius is not None and point.radius * tightest < 1.0 - NO_TURN:
        raise InputError(
            f"`radius_m` of {point.name} must be at least {1.0 / tightest:.0f}, got "
            f"{point.radius:g}."
        )
    size = tightest if point.radius is None else 1.0 / point.radius
    return turned(math.copysign(size, point.turns), abs(angle), ability.rolling(size))


def _circles(point: Waypoint, turn: float, before: Waypoint, ability: Ability) -> _Turn:
    """The circles around a waypoint where the course changes by `turn`, rad."""
    curvature = abs(_ring(point, 0.0, ability)[1].curvature)
    change = (point.up - before.up) * point.spiral
    steepest = min(SPIRAL, abs(ability.gamma[change > 0.0]))
    rise = abs(change) / math.tan(steepest) if change else 0.0
    least = max(abs(point.turns) * math.tau, curvature * max(point.hold * ability.V_a, rise))
    onward = (math.copysign(1.0, point.turns) * turn - least) % math.tau
    pieces = _ring(point, least + onward, ability)
    if pieces[1].length < 0.0:
        least = 1.0 - pieces[1].length * abs(pieces[1].curvature) / math.tau
        raise InputError(
            f"`turns` of {point.name} must be at least {least:.2f}, got {point.turns:g}."
        )
    return _Turn(pieces, _beside(point, ability)[0])


@lru_cache(maxsize=4096)
def _corner(turn: float, ability: Ability) -> _Turn:
    """The turn at a waypoint that is passed, where the course changes by `turn`, rad."""
    turn = math.remainder(turn, math.tau)
    if abs(turn) < NO_TURN:
        return _Turn()
    curvature = ability.curvature
    rolling = ability.rolling(curvature)
    # A small turn ends before roll is at its limit.
    share = min(1.0, math.sqrt(abs(turn) / (curvature * rolling)))
    pieces = turned(math.copysign(share * curvature, turn), abs(turn), share * rolling)
    x, y, _ = curved(pieces)
    return _Turn(pieces, x - y / math.tan(turn))


def _path(
    laid: Sequence[_Laid], waypoints: Sequence[Waypoint], course: float, ability: Ability
) -> Path:
    """The table of a path from its first course on."""
    pieces = [stretch.pieces for stretch in laid]
    beyond = Piece(BEYOND_S * ability.speed, 0.0, 0.0)
    flat = [*(piece for stretch in pieces for piece in stretch), beyond]
    counts = list(accumulate(map(len, pieces), initial=0))
    begins = np.cumsum([0.0, *(piece.length for piece in flat)])
    s = np.arange(math.ceil(begins[-1] / STEP) * SUBSTEPS + 1) * (STEP / SUBSTEPS)
    changes, curvature = bent(flat, s)
    courses, ends = course + changes, begins[counts]
    turned_at = course + bent(flat, ends)[0]
    north, east = (
        np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * (STEP / SUBSTEPS)
        for rate in (np.cos(courses), np.sin(courses))
    )
    along, up = _profile(laid, ends, waypoints, ability)
    half = _half_pull_up(along, up, ability)
    # The climbs at the ends go on for as far as the mean of `_rounded` reaches.
    (before, after), far = _climbs(along, up)[[0, -1]], BEYOND_S * ability.speed + 2.0 * half
    along = np.concatenate([[-far], along, [along[-1] + far]])
    up = np.concatenate([[up[0] - far * before], up, [up[-1] + far * after]])
    height, slope = _rounded(s[::SUBSTEPS], along, up, half)
    climbs = np.diff(np.interp(ends, along, up)) / np.maximum(np.diff(ends), NO_LENGTH)
    stretches = tuple(
        Stretch(
            kind=stretch.kind,
            waypoint=stretch.waypoint,
            start=float(ends[i]),
            length=float(ends[i + 1] - ends[i]),
            course=float(turned_at[i]),
            turn=float(turned_at[i + 1] - turned_at[i]),
            radius=1.0 / most if (most := _tightest(stretch.pieces)) else math.inf,
            gamma=math.atan(climbs[i]),
            aside=stretch.aside,
            name=waypoints[stretch.waypoint - 1].name,
        )
        for i, stretch in enumerate(laid)
    )
    return Path(
        length=float(ends[-1]),
        north=waypoints[0].north + north[::SUBSTEPS],
        east=waypoints[0].east + east[::SUBSTEPS],
        up=height,
        course=courses[::SUBSTEPS],
        curvature=curvature[::SUBSTEPS],
        slope=slope,
        stretches=stretches,
    )


def _tightest(pieces: Pieces) -> float:
    """Largest curvature of pieces, 1/m."""
    return max(abs(k) for piece in pieces for k in piece[1:])


def _profile(
    laid: Sequence[_Laid], ends: FloatArray, waypoints: Sequence[Waypoint], ability: Ability
) -> tuple[FloatArray, FloatArray]:
    """Distances, m, and heights, m, between which the height changes at a steady rate."""
    along, up = [0.0], [waypoints[0].up]
    for i, (kind, number, *_) in enumerate(laid):
        point = waypoints[number - 1]
        follows = laid[i + 1].kind if i + 1 < len(laid) else None
        if kind in ("leg", "turn-around"):
            if point.spiral:
                point = replace(point, up=up[-1])
            before = waypoints[number - 2].name
            reached = ends[i + 1] + (0.5 * (ends[i + 2] - ends[i + 1]) if follows == "turn" else 0)
            _climb(before, point, along, up, float(reached), ability)
        elif kind == "loiter":
            along.append(float(ends[i + 1]))
            up.append(waypoints[number - 1].up)
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
    before: str,
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
            f"`waypoints`: the height of {point.name} must differ by at most "
            f"{distance * math.tan(min(abs(steepest), abs(gamma))):.0f} m from that of {before}, "
            f"at a path angle of {low / DEG:.1f} to {high / DEG:.1f} deg over "
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
