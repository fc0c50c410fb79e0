"""A path over ground from waypoints: straight legs, and turns that a limited roll rate can follow.

Curvature and distances are seen from above; curvature is positive where the path turns right.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.routes import turns

Kind: TypeAlias = Literal["leg", "turn", "loiter", "turn-around"]

# Distances along a route and heights there, m.
Profile: TypeAlias = list[tuple[float, float]]

# Distance between the points of a path's table, m: a chord is 3 mm off an arc of 50 m radius.
STEP = 1.0

# Integration points per step.
SUBSTEPS = 8

# Straight flight beyond the end of a path, s.
BEYOND_S = 10.0

# A change of the climb is spread over at least this time, s, and adds at most this load factor.
PULL_UP_S, PULL_UP_N_Z = 2.0, 0.2

# Largest change of course at a corner, rad: its turn begins some six radii before the waypoint.
SHARPEST = 160.0 * DEG

# A smaller change of course, rad, counts as zero.
NO_TURN = 1e-6

# Path angle of circles that change height, rad.
SPIRAL = 5.0 * DEG

# Steps of the search for a feasible speed or wind, and the lowest speed as a share.
HALVINGS, SLOWEST = 10, 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """A point to pass, or the centre of circles to fly."""

    # Position from the start of the flight, m.
    north: float
    east: float
    up: float = 0.0
    # Minimum number of circles around the point, clockwise positive; the last circle goes on to the
    # course of the next leg. With 0 the point is passed.
    turns: float = 0.0
    # Radius of the circles, m; None for the smallest radius that can be flown.
    radius: float | None = None
    # Absolute path angle (rad) at which the leg to the point changes its height, from its beginning
    # on; None for a steady change along the whole leg.
    climb: float | None = None
    # Minimum time of the circles, s, at the airspeed.
    hold: float = 0.0
    # Whether the circles change the height, instead of the leg to the point.
    spiral: bool = False
    # Its name in messages; by default ``waypoint`` with its number.
    name: str = ""

    @property
    def number(self) -> str:
        """Number of the waypoint in its file, which maps show."""
        return self.name.split()[-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ability:
    """Speed and limits for which a route is planned."""

    V_a: float  # m/s
    wind: float  # m/s: largest wind for which turns are planned
    phi: float  # rad: maximum roll in turns
    phi_rate: float  # rad/s: roll rate
    gamma: tuple[float, float]  # rad: lowest and highest path angle
    g: float  # m/s^2
    widen: bool = False  # whether circles that are too small are widened to the smallest radius
    # m: maximum distance of a turn-around from its leg; 0: no turn-around
    turnaround: float = 0.0
    duration: float = math.inf  # s: maximum time of a flight

    @property
    def speed(self) -> float:
        """Largest speed over ground, in a tail wind, m/s."""
        return self.V_a + self.wind

    @property
    def curvature(self) -> float:
        """Largest curvature over ground, ``g tan(phi) / speed^2``, 1/m."""
        return self.g * math.tan(self.phi) / self.speed**2

    def rolling(self, curvature: float) -> float:
        """Distance flown while roll changes from zero to the roll of a curvature, m."""
        return self.speed * math.atan(curvature * self.speed**2 / self.g) / self.phi_rate


class Stretch(NamedTuple):
    """A leg, a turn, a turn-around in place of a leg, or the circles around a waypoint."""

    kind: Kind
    waypoint: int  # number of the waypoint at its end or centre, from 1
    start: float  # m: its beginning along the route
    length: float  # m
    course: float  # rad: at its beginning
    turn: float  # rad: change of course, right positive
    radius: float  # m: smallest radius; infinite on a leg
    gamma: float  # rad: mean path angle
    aside: float  # m: distance of a turn-around from its leg
    name: str  # name of the waypoint

    @property
    def words(self) -> str:
        """The stretch by its kind and waypoint."""
        return f"{self.kind} {'to' if self.kind == 'leg' else 'at'} {self.name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A planned path: a table of n points, `STEP` apart, and its stretches."""

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

    def at(self, s: FloatArray) -> tuple[FloatArray, ...]:
        """North, east and height (m), and course (rad), at distances along the route."""
        return tuple(np.interp(s, self.s, x) for x in (self.north, self.east, self.up, self.course))

    def beside(self, s: FloatArray, right: Floats = 0.0, below: Floats = 0.0) -> FloatArray:
        """North, east and up of points beside the path at distances along it, shape (n, 3), m."""
        north, east, up, course = self.at(s)
        aside = -right * np.sin(course), right * np.cos(course)
        return np.column_stack([north + aside[0], east + aside[1], up - below])


class _Laid(NamedTuple):
    """A stretch before the table of the path is made."""

    kind: Kind
    waypoint: int
    pieces: turns.Pieces
    aside: float = 0.0

    @property
    def length(self) -> float:
        """Distance flown, m."""
        return sum(piece.length for piece in self.pieces)

    @property
    def tightest(self) -> float:
        """Largest curvature, 1/m."""
        return max(abs(k) for piece in self.pieces for k in piece[1:])


class _NoRoomError(InputError):
    """A leg is too short, or a corner too sharp, for the allowed turns."""


def plan(waypoints: Sequence[Waypoint], ability: Ability) -> Path:
    """Plan the path of a route, from its first waypoint, which has no circles, through the others.

    Corners have the smallest radius that the ability allows, and every turn rolls in and out at the
    largest rate. A leg is the common tangent of the turns at both ends. It goes through a point
    that is passed, and beside circles by their radius and the offset of the roll-in. The climb
    changes in the middle of a corner, or before circles, which are level. The change is rounded, so
    that the path passes the waypoint a little above or below its height.
    """
    if len(waypoints) < 2:
        raise InputError(f"`waypoints` must be at least 2, got {len(waypoints)}.")
    if waypoints[0].turns:
        raise InputError("`turns` must be absent at the first waypoint, where the flight starts.")
    waypoints = [
        replace(point, name=point.name or f"waypoint {number}")
        for number, point in enumerate(waypoints, start=1)
    ]
    if ability.widen:
        least = 1.0 / ability.curvature
        waypoints = [
            replace(point, radius=max(point.radius, least)) if point.radius else point
            for point in waypoints
        ]
    try:
        layout = _laid_out(waypoints, ability)
    except _NoRoomError as error:
        raise InputError(f"{error}{_ways_out(waypoints, ability)}.") from None
    ends = [*accumulate(stretch.length for stretch in layout.laid)]
    if ends[-1] < STEP:
        raise InputError(f"`waypoints` must be {STEP:g} m apart or more, got {ends[-1]:.2g} m.")
    longest = ability.duration * ability.speed
    for stretch, end in zip(layout.laid, ends, strict=True):
        if end > longest:
            raise InputError(
                f"`waypoints`: {waypoints[stretch.waypoint - 1].name} must be reached within "
                f"`duration_s`, {ability.duration:g} s, which is {longest:.0f} m at "
                f"{ability.speed:.3g} m/s (airspeed and wind), got {end:.0f} m along the route."
            )
    return _path(layout)


class _Layout:
    """Stretches through waypoints, with turn-arounds in place of the legs `around`."""

    def __init__(
        self, waypoints: Sequence[Waypoint], ability: Ability, around: Iterable[int] = ()
    ) -> None:
        self.waypoints, self.ability, self.around = waypoints, ability, {*around}
        # Courses (rad) belong to the legs. Lengths (m) are the legs without the turns at their
        # ends, negative if the turns have no room. Corners are waypoints with one turn between the
        # legs before and after.
        self.courses = self._courses()
        bends, reaches = zip(*self._turns(), strict=True)
        self.corners = {i for i, x in enumerate(bends) if x and not waypoints[i].turns}
        self.lengths: list[float] = []
        for i, (start, end) in enumerate(pairwise(waypoints)):
            north, east, course = end.north - start.north, end.east - start.east, self.courses[i]
            along = north * math.cos(course) + east * math.sin(course)
            self.lengths.append(along - reaches[i] - reaches[i + 1])
        self.laid: list[_Laid] = []
        for i, turn in enumerate(bends[1:]):
            number, start = i + 2, self._pose(i, out=True)
            if i in self.around:
                self.laid.append(_around(number, start, self._pose(i + 1, out=False), ability))
                self.lengths[i] = 0.0
            else:
                if self._is_over(i):
                    end = start._replace(course=self.courses[i])
                    self.laid.append(_around(i + 1, start, end, ability))
                straight = turns.Piece(max(self.lengths[i], 0.0), 0.0, 0.0)
                self.laid.append(_Laid("leg", number, (straight,)))
            if turn:
                kind = "loiter" if waypoints[i + 1].turns else "turn"
                self.laid.append(_Laid(kind, number, turn))

    @property
    def short(self) -> list[int]:
        """Legs that are too short for the turns at their ends."""
        return [i for i, length in enumerate(self.lengths) if length < -turns.NO_LENGTH]

    @property
    def cost(self) -> float:
        """Length of the stretches, m, with a circle for each leg that is still too short."""
        flown = sum(piece.length for stretch in self.laid for piece in stretch.pieces)
        circles = len(self.short)
        if any(stretch.aside > self.ability.turnaround for stretch in self.laid):
            circles += len(self.lengths)
        return flown + circles * math.tau / self.ability.curvature

    def _courses(self) -> list[float]:
        """Course of the leg after each waypoint but the last, or of a turn-around at its ends."""
        courses: list[float] = []
        asides = [_beside(x, self.ability)[1] if x.turns else 0.0 for x in self.waypoints]
        for i, (start, end) in enumerate(pairwise(self.waypoints)):
            north, east = end.north - start.north, end.east - start.east
            aside = asides[i + 1] - asides[i]
            if (apart := math.hypot(north, east)) <= max(abs(aside), turns.NO_LENGTH):
                if not self.ability.turnaround or (apart <= turns.NO_LENGTH and not aside):
                    raise InputError(
                        f"`waypoints`: {end.name} must be more than {abs(aside):.0f} m from "
                        f"{start.name}, got {apart:.1f} m."
                    )
                self.around.add(i)
            bearing = math.atan2(east, north)
            if i not in self.around:
                courses.append(bearing - math.asin(aside / apart))
            else:
                courses.append(courses[-1] if apart <= turns.NO_LENGTH and courses else bearing)
        return courses

    def _turns(self) -> Iterator[tuple[turns.Pieces, float]]:
        """The turn at each waypoint (none beside a turn-around) and its reach."""
        yield (), 0.0
        # The reach is the distance from its beginning to the foot of the waypoint on the leg, m.
        for i, (into, out) in enumerate(pairwise([*self.courses, self.courses[-1]]), start=1):
            point = self.waypoints[i]
            if point.turns:
                yield _circles(point, out - into, self.waypoints[i - 1], self.ability)
            elif not ({i - 1, i} & self.around or self._is_over(i)):
                yield _corner(out - into, self.ability)
            elif self.ability.turnaround:
                yield (), 0.0
            else:
                raise _NoRoomError(
                    f"`waypoints`: the course must change by at most {SHARPEST / DEG:.0f} deg at "
                    f"{point.name}, got "
                    f"{abs(math.remainder(out - into, math.tau)) / DEG:.1f} deg; two waypoints "
                    "make two corners of it"
                )

    def _is_over(self, i: int) -> bool:
        """Whether a corner between two legs is too sharp for a turn inside the waypoint."""
        if self.waypoints[i].turns or {i - 1, i} & self.around or not 0 < i < len(self.courses):
            return False
        return abs(math.remainder(self.courses[i] - self.courses[i - 1], math.tau)) > SHARPEST

    def _pose(self, i: int, *, out: bool) -> turns.Pose:
        """Pose of a turn-around at a waypoint: on the course of the leg beside it."""
        point, last = self.waypoints[i], len(self.courses) - 1
        before, after = self.courses[max(i - 1, 0)], self.courses[min(i, last)]
        if point.turns:
            ahead, right = _beside(point, self.ability)
            course, ahead = (after, -ahead) if out else (before, ahead)
            return turns.Pose(
                *turns.Pose(point.north, point.east, course).beside(-ahead, -right), course
            )
        if 0 < i and i - 1 not in self.around:
            course = before
        elif i <= last and i not in self.around:
            course = after
        else:  # between two turn-arounds: the mean of the two courses
            course = before + 0.5 * math.remainder(after - before, math.tau)
        return turns.Pose(point.north, point.east, course)


def _laid_out(waypoints: Sequence[Waypoint], ability: Ability) -> _Layout:
    """The stretches of a path, with turn-arounds in place of legs that are too short."""
    layout = _Layout(waypoints, ability)
    while short := layout.short:
        if not ability.turnaround:
            i = short[0]
            raise _NoRoomError(
                f"`waypoints`: the leg to {waypoints[i + 1].name} must be "
                f"{-layout.lengths[i]:.0f} m longer for the turns at its ends, at "
                f"{ability.speed:g} m/s and {ability.phi / DEG:.0f} deg of roll"
            )
        i = min(short, key=layout.lengths.__getitem__)
        # A turn-around in place of the leg beyond a corner also makes room, and is often shorter.
        legs = [i, *[i - 1] * (i in layout.corners), *[i + 1] * (i + 1 in layout.corners)]
        others = (_Layout(waypoints, ability, {*layout.around, leg}) for leg in legs)
        layout = min(others, key=lambda other: other.cost)
    for stretch in layout.laid:
        if stretch.aside > ability.turnaround:
            raise _NoRoomError(
                f"`waypoints`: the turn-around to {waypoints[stretch.waypoint - 1].name} must go "
                f"{stretch.aside:.0f} m from its leg at {ability.speed:g} m/s and "
                f"{ability.phi / DEG:.0f} deg of roll, where `turnaround_m` is "
                f"{ability.turnaround:g}"
            )
    return layout


@lru_cache(maxsize=4096)  # each is tried together with other turn-arounds
def _around(number: int, start: turns.Pose, end: turns.Pose, ability: Ability) -> _Laid:
    """The shortest turn-around within its room, else the turn-around that needs the least room."""
    curvatures = [share * ability.curvature for share in turns.SHARES]
    tried = [x for k in curvatures for x in turns.ways(start, end, k, ability.rolling(k))]
    tried.sort(key=lambda pieces: sum(piece.length for piece in pieces))
    asides = [(turns.farthest(pieces, start, end), pieces) for pieces in tried]
    inside = (way for way in asides if way[0] <= ability.turnaround)
    aside, pieces = next(inside, None) or min(asides)
    return _Laid("turn-around", number, pieces, aside)


def _ways_out(waypoints: Sequence[Waypoint], ability: Ability) -> str:
    """Speed, room or wind at which the turns of a route would fit, in words."""

    def fits(**changed: float) -> bool:
        try:
            _laid_out(waypoints, replace(ability, **changed))
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
    around = _laid_out(waypoints, replace(ability, turnaround=math.inf)).laid
    wind = largest("wind", 0.0, ability.wind) if ability.wind else None
    changes = {
        "`V_a_mps` of {:.1f}": speed and math.floor(10.0 * speed) / 10.0,
        "`turnaround_m` of {:.0f}": math.ceil(max(stretch.aside for stretch in around)),
        "`wind_mps` of {:.1f}": wind and math.floor(10.0 * wind) / 10.0,
    }
    return "; it is flown with " + " or ".join(
        text.format(value) for text, value in changes.items() if value is not None
    )


def _curvature(point: Waypoint, ability: Ability) -> float:
    """Curvature of the circles around a waypoint, right positive, 1/m."""
    tightest = ability.curvature
    if point.radius is not None and point.radius * tightest < 1.0 - NO_TURN:
        raise InputError(
            f"`radius_m` of {point.name} must be at least {1.0 / tightest:.0f}, got "
            f"{point.radius:g}."
        )
    return math.copysign(tightest if point.radius is None else 1.0 / point.radius, point.turns)


def _beside(point: Waypoint, ability: Ability) -> tuple[float, float]:
    """Centre of circles relative to the beginning of the roll-in, m: ahead and right."""
    curvature = _curvature(point, ability)
    return turns.centre(curvature, ability.rolling(abs(curvature)))


def _circles(
    point: Waypoint, turn: float, before: Waypoint, ability: Ability
) -> tuple[turns.Pieces, float]:
    """The circles around a waypoint with a course change of `turn`, rad, and their reach."""
    curvature = _curvature(point, ability)
    size, change = abs(curvature), (point.up - before.up) * point.spiral
    steepest = min(SPIRAL, abs(ability.gamma[change > 0.0]))
    rise = abs(change) / math.tan(steepest) if change else 0.0
    least = max(abs(point.turns) * math.tau, size * max(point.hold * ability.V_a, rise))
    onward = (math.copysign(1.0, point.turns) * turn - least) % math.tau
    pieces = turns.turned(curvature, least + onward, ability.rolling(size))
    if pieces[1].length < 0.0:
        least = 1.0 - pieces[1].length * size / math.tau
        raise InputError(
            f"`turns` of {point.name} must be at least {least:.2f}, got {point.turns:g}."
        )
    return pieces, _beside(point, ability)[0]


@lru_cache(maxsize=4096)
def _corner(turn: float, ability: Ability) -> tuple[turns.Pieces, float]:
    """The turn at a waypoint that is passed, with a course change of `turn`, and its reach."""
    turn = math.remainder(turn, math.tau)
    if abs(turn) < NO_TURN:
        return (), 0.0
    curvature = ability.curvature
    rolling = ability.rolling(curvature)
    # A small turn ends before roll reaches its limit.
    share = min(1.0, math.sqrt(abs(turn) / (curvature * rolling)))
    pieces = turns.turned(math.copysign(share * curvature, turn), abs(turn), share * rolling)
    x, y, _ = turns.curved(pieces)
    return pieces, x - y / math.tan(turn)


def laid_from(start: turns.Pose, pieces: Sequence[turns.Piece]) -> tuple[FloatArray, ...]:
    """North and east (m), course (rad) and curvature (1/m) of points `STEP` apart on pieces."""
    length = float(np.cumsum([piece.length for piece in pieces])[-1])
    points = np.arange(math.ceil(length / STEP) * SUBSTEPS + 1, dtype=np.float64)
    s: FloatArray = points * (STEP / SUBSTEPS)
    changes, curvature = turns.bent(pieces, s)
    courses = start.course + changes
    north, east = (
        np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * (STEP / SUBSTEPS)
        for rate in (np.cos(courses), np.sin(courses))
    )
    along = start.north + north, start.east + east, courses, curvature
    return tuple(column[::SUBSTEPS] for column in along)


def _path(layout: _Layout) -> Path:
    """The table of a path."""
    laid, waypoints, ability = layout.laid, layout.waypoints, layout.ability
    beyond = turns.Piece(BEYOND_S * ability.speed, 0.0, 0.0)
    flat = [*(piece for stretch in laid for piece in stretch.pieces), beyond]
    counts = list(accumulate((len(stretch.pieces) for stretch in laid), initial=0))
    begins = np.cumsum([0.0, *(piece.length for piece in flat)])
    start = turns.Pose(waypoints[0].north, waypoints[0].east, layout.courses[0])
    north, east, course, curvature = laid_from(start, flat)
    ends = begins[counts]
    turned_at = layout.courses[0] + turns.bent(flat, ends)[0]
    profile = _profile(layout, ends.tolist())

    def place(distance: float) -> str:
        return waypoints[laid[int(np.searchsorted(ends, distance)) - 1].waypoint - 1].name

    s: FloatArray = STEP * np.arange(len(north), dtype=np.float64)
    height, slope = _heights(s, *profile, ability, place)
    climbs = np.diff(np.interp(ends, *profile)) / np.maximum(np.diff(ends), turns.NO_LENGTH)
    stretches = tuple(
        Stretch(
            kind=stretch.kind,
            waypoint=stretch.waypoint,
            start=float(ends[i]),
            length=float(ends[i + 1] - ends[i]),
            course=float(turned_at[i]),
            turn=float(turned_at[i + 1] - turned_at[i]),
            radius=1.0 / tightest if (tightest := stretch.tightest) else math.inf,
            gamma=math.atan(climbs[i]),
            aside=stretch.aside,
            name=waypoints[stretch.waypoint - 1].name,
        )
        for i, stretch in enumerate(laid)
    )
    return Path(
        length=float(ends[-1]),
        north=north,
        east=east,
        up=height,
        course=course,
        curvature=curvature,
        slope=slope,
        stretches=stretches,
    )


def _profile(layout: _Layout, ends: list[float]) -> tuple[FloatArray, FloatArray]:
    """Distances, m, and heights, m, of the corners of a piecewise linear height profile."""
    waypoints, laid = layout.waypoints, layout.laid
    profile: Profile = [(0.0, waypoints[0].up)]
    for i, stretch in enumerate(laid):
        point, reached = waypoints[stretch.waypoint - 1], ends[i + 1]
        if stretch.kind == "loiter":
            profile.append((reached, point.up))
        elif stretch.kind != "turn":
            if point.spiral:
                point = replace(point, up=profile[-1][1])
            if i + 1 < len(laid) and laid[i + 1].kind == "turn":
                reached += 0.5 * (ends[i + 2] - reached)
            _climb(profile, waypoints[stretch.waypoint - 2].name, point, reached, layout.ability)
    along, up = np.array(profile).T
    distinct = np.append(True, np.diff(along) > turns.NO_LENGTH)
    return along[distinct], up[distinct]


def _climb(
    profile: Profile, before: str, point: Waypoint, reached: float, ability: Ability
) -> None:
    """Add the change of height of the leg to a waypoint, which ends at the distance `reached`."""
    along, up = profile[-1]
    change, distance = point.up - up, reached - along
    gamma = math.atan2(change, distance)
    if point.climb is not None and change:
        gamma = math.copysign(point.climb, change)
    needed = change / math.tan(gamma) if change else 0.0
    low, high = ability.gamma
    if not (low <= gamma <= high and needed <= distance + turns.NO_LENGTH):
        steepest = high if change > 0.0 else low
        raise InputError(
            f"`waypoints`: the height of {point.name} must differ by at most "
            f"{distance * math.tan(min(abs(steepest), abs(gamma))):.0f} m from that of {before}, "
            f"at a path angle of {low / DEG:.1f} to {high / DEG:.1f} deg over "
            f"{distance:.0f} m, got {abs(change):.0f} m at {gamma / DEG:.1f} deg."
        )
    if turns.NO_LENGTH < needed < distance - turns.NO_LENGTH:
        profile.append((along + needed, point.up))
    profile.append((reached, point.up))


def _heights(
    s: FloatArray, at: FloatArray, up: FloatArray, ability: Ability, place: Callable[[float], str]
) -> tuple[FloatArray, FloatArray]:
    """Smoothed heights of a profile, and their slopes.

    `place`: the name of the waypoint at or after a distance.
    """
    climbs = np.diff(up) / np.diff(at)
    bends = np.abs(np.diff(np.arctan(climbs)))
    pull_up = max(PULL_UP_S, ability.V_a * bends.max(initial=0.0) / (ability.g * PULL_UP_N_Z))
    changes = at[1:-1][bends > NO_TURN]
    apart = np.diff(changes)
    if pull_up > PULL_UP_S and pull_up * ability.V_a > apart.min(initial=math.inf):
        near = int(np.argmin(apart))
        names = " and ".join(dict.fromkeys(place(float(x)) for x in changes[near : near + 2]))
        raise InputError(
            f"`waypoints`: changes of the climb at {names} must be {pull_up * ability.V_a:.0f} m "
            f"apart at {ability.V_a:g} m/s, got {apart[near]:.0f} m; they may be closer "
            "where climbs are gentler or the airspeed is lower."
        )
    # Heights are means over the distance of a pull-up.
    half = 0.5 * pull_up * ability.V_a
    # The climbs at both ends are extended by the length of the mean.
    far = BEYOND_S * ability.speed + 2.0 * half
    at = np.concatenate([[-far], at, [at[-1] + far]])
    up = np.concatenate([[up[0] - far * climbs[0]], up, [up[-1] + far * climbs[-1]]])
    area = np.concatenate([[0.0], np.cumsum(0.5 * (up[1:] + up[:-1]) * np.diff(at))])

    def integral(x: FloatArray) -> FloatArray:
        below = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
        return area[below] + 0.5 * (x - at[below]) * (up[below] + np.interp(x, at, up))

    low, high = s - half, s + half
    mean = (integral(high) - integral(low)) / (2.0 * half)
    return mean, (np.interp(high, at, up) - np.interp(low, at, up)) / (2.0 * half)
