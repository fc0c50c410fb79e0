"""Turns that a limited roll rate can follow, and the shortest way from one pose to another.

A turn is a circular arc between two clothoids, on which curvature grows in proportion to the
distance flown: roll that changes at a steady rate.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray

# Curvatures of a turn-around, as shares of the largest: a small change of course needs a gentle
# turn, because rolling takes time.
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.1)

# Number of points at which the distance of a turn-around from its leg is measured.
POINTS = 400

# Gauss quadrature with 32 points: exact to rounding for a clothoid up to a half turn.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)

# Distances below this, m, count as zero.
NO_LENGTH = 1e-6


class Piece(NamedTuple):
    """Part of a path on which curvature changes at a steady rate."""

    length: float  # m
    curvature: float  # at its beginning, 1/m
    curvature_end: float


Pieces: TypeAlias = tuple[Piece, ...]


class Pose(NamedTuple):
    """A place, m, and the course there, rad."""

    north: float
    east: float
    course: float

    def beside(self, ahead: float, right: float) -> tuple[float, float]:
        """North and east of a place ahead of it and to its right, m."""
        c, s = math.cos(self.course), math.sin(self.course)
        return self.north + ahead * c - right * s, self.east + ahead * s + right * c


def turned(curvature: float, angle: float, rolling: float) -> Pieces:
    """An arc between roll-in and roll-out; each of these turns half as much as an arc would."""
    return (
        Piece(rolling, 0.0, curvature),
        Piece(angle / abs(curvature) - rolling, curvature, curvature),
        Piece(rolling, curvature, 0.0),
    )


def curved(pieces: Sequence[Piece]) -> tuple[float, float, float]:
    """Distance ahead and to the right, m, and change of course, rad, after the pieces."""
    x = y = course = 0.0
    for length, k, k_end in pieces:
        s = 0.5 * (NODES + 1.0)
        chi = course + length * (k * s + 0.5 * (k_end - k) * s * s)
        x += 0.5 * length * float(WEIGHTS @ np.cos(chi))
        y += 0.5 * length * float(WEIGHTS @ np.sin(chi))
        course += 0.5 * length * (k + k_end)
    return x, y, course


def bent(pieces: Sequence[Piece], s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Change of course, rad, and curvature, 1/m, at distances `s` (m) along pieces."""
    lengths, k, k_end = np.array(pieces).T
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    changes = np.concatenate([[0.0], np.cumsum(0.5 * (k + k_end) * lengths)])
    piece = np.clip(np.searchsorted(begins, s, side="right") - 1, 0, len(lengths) - 1)
    inside = s - begins[piece]
    change = ((k_end - k) / np.maximum(lengths, NO_LENGTH))[piece] * inside
    return changes[piece] + inside * (k[piece] + 0.5 * change), k[piece] + change


def centre(curvature: float, rolling: float) -> tuple[float, float]:
    """Centre of an arc relative to the beginning of its roll-in, m: ahead and right."""
    x, y, course = curved([Piece(rolling, 0.0, curvature)])
    return x - math.sin(course) / curvature, y + math.cos(course) / curvature


def ways(start: Pose, end: Pose, curvature: float, rolling: float) -> Iterator[Pieces]:
    """Ways between two poses by turns of one curvature: two and a straight, or three."""
    x, y = centre(curvature, rolling)
    least = curvature * rolling

    def turn(side: int, begin: float, finish: float) -> Pieces:
        # Rolling in and out turns by at least `least`: a smaller change takes another full circle.
        angle = (side * (finish - begin)) % math.tau
        angle += math.tau * (angle < least)
        return turned(side * curvature, angle, rolling)

    # These are the words of Dubins (1957) with clothoids. The centre of a turn lies x ahead of its
    # roll-in and y beside it, and likewise at its end. Straight lines therefore begin x beyond the
    # foot of the centre, at the distance y. Two opposite turns meet half way between centres that
    # are ``2 hypot(x, y)`` apart.
    for first, last in product((1, -1), repeat=2):
        a, b = start.beside(x, first * y), end.beside(-x, last * y)
        apart, bearing = _vector(a, b)
        aside = (last - first) * y
        if apart > abs(aside):
            course = bearing - math.asin(aside / apart)
            straight = math.sqrt(apart**2 - aside**2) - 2.0 * x
            if straight >= 0.0:
                before, after = turn(first, start.course, course), turn(last, course, end.course)
                yield (*before, Piece(straight, 0.0, 0.0), *after)
        reach = 2.0 * math.hypot(x, y)
        if first != last or not NO_LENGTH < apart < 2.0 * reach:
            continue
        for side in (1.0, -1.0):
            angle = bearing + side * math.acos(0.5 * apart / reach)
            middle = a[0] + reach * math.cos(angle), a[1] + reach * math.sin(angle)
            tilt = math.atan2(first * y, x)
            out, back = angle + tilt, _vector(middle, b)[1] - tilt
            yield (
                *turn(first, start.course, out),
                *turn(-first, out, back),
                *turn(first, back, end.course),
            )


def back_to(place: tuple[float, float], turning: Pose, curvature: float, rolling: float) -> Pieces:
    """The way from a turn to a place: the rest of the turn, its roll-out and a straight line.

    Empty if the place is so near that no straight line from the turn passes it.
    """
    side = math.copysign(1.0, curvature)
    x, y = centre(abs(curvature), rolling)
    apart, bearing = _vector(turning.beside(0.0, 1.0 / curvature), place)
    if apart <= math.hypot(x, y):
        return ()
    # As in `ways`: the line begins x beyond the foot of the centre, at the distance y.
    course = bearing + side * math.asin(y / apart)
    rolled_out = 0.5 * abs(curvature) * rolling
    angle = (side * (course - turning.course) - rolled_out) % math.tau
    return (
        Piece(angle / abs(curvature), curvature, curvature),
        Piece(rolling, curvature, 0.0),
        Piece(math.sqrt(apart**2 - y**2) - x, 0.0, 0.0),
    )


def _vector(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Distance and bearing from one place to another."""
    north, east = b[0] - a[0], b[1] - a[1]
    return math.hypot(north, east), math.atan2(east, north)


def farthest(pieces: Pieces, start: Pose, end: Pose) -> float:
    """Largest distance of a way from the straight line between its ends, m."""
    s = np.linspace(0.0, sum(piece.length for piece in pieces), POINTS)
    course = start.course + bent(pieces, s)[0]
    places = np.column_stack([_integral(np.cos(course), s), _integral(np.sin(course), s)])
    line = np.array([end.north - start.north, end.east - start.east])
    square = float(line @ line)
    share = np.clip(places @ line / square, 0.0, 1.0)[:, None] if square > NO_LENGTH else 0.0
    return float(np.linalg.norm(places - share * line, axis=1).max())


def _integral(rate: FloatArray, s: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))])
