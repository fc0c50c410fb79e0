"""Functions of forms, enclosed: what is not affine becomes an affine form with a proven error.

The slopes are free: any slope gives an enclosure, a good one a narrow enclosure.
"""

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.tube.forms import Form, combined, shifted
from flighttune.tube.interval import Interval, cosine, sine_and_cosine, within


def tangent(form: Form, angle: Interval) -> Form:
    """``tan F``, F inside `angle` (rad); ``tan'' = 2 sin/cos^3``."""
    s, c = sine_and_cosine(Interval.point(angle.middle))
    slope = Interval.point(np.ones_like(angle.low)) / (c * c)
    steep, level = sine_and_cosine(angle)
    return _taylor(form, angle, s / c, slope, steep * 2.0 / (level * level * level))


def cosine_of(form: Form, angle: Interval) -> Form:
    """``cos F``, F inside `angle` (rad)."""
    s, c = sine_and_cosine(Interval.point(angle.middle))
    return _taylor(form, angle, c, -s, -cosine(angle))


def secant(form: Form, angle: Interval) -> Form:
    """``1/cos F``, F inside `angle` (rad)."""
    at = Interval.point(angle.middle)
    value = Interval.point(np.ones_like(angle.low)) / cosine(at)
    return _taylor(form, angle, value, _secant_slope(at), _secant_curvature(angle))


def secant_change(form: Form, angle: Interval, change: Form, by: Interval) -> Form:
    """``1/cos F - 1/cos(F + D)`` for a change D inside `by`, by the mean-value theorem in F and D.

    Its slope in D is ``-sec'(F + D)``, in F it is ``sec'(F) - sec'(F + D)``: minus D times
    ``sec''`` in between.
    """
    after = angle + by
    across = angle.hull(after)
    in_form, in_change = -(_secant_curvature(across) * by), -_secant_slope(after)
    at, moved = angle.middle, by.middle
    unity = Interval.point(np.ones_like(at))
    value = unity / cosine(Interval.point(at)) - unity / cosine(Interval.point(at) + moved)
    a, b = in_form.middle, in_change.middle
    rest = (
        value
        - Interval.point(a) * at
        - Interval.point(b) * moved
        + (in_form - a) * within((angle - at).largest)
        + (in_change - b) * within((by - moved).largest)
    )
    return combined((a, form), (b, change), shift=rest.middle).widened(rest.radius)


def arctangent(form: Form, a: Interval, other: Form, b: Interval) -> Form:
    """``atan(F/G)``, F inside `a` and G inside `b`, which is positive."""
    at, over = Interval.point(a.middle), Interval.point(b.middle)
    square = _square(at) + _square(over)
    number = np.arctan2(at.low, over.low)
    # Distance of the library's angle from the true one: the sine of that, over the distance.
    angle = Interval.point(number)
    s, c = sine_and_cosine(angle)
    off = (at * c - over * s).largest / np.sqrt(square.low)
    in_a, in_b = over / square, -(at / square)
    da, db = (a - a.middle).largest, (b - b.middle).largest
    across = _square(a) + _square(b)
    bend = a * b / (across * across)
    rest = (
        Interval.point(number)
        + within(2.0 * off)
        - Interval.point(in_a.middle) * a.middle
        - Interval.point(in_b.middle) * b.middle
        + (in_a - in_a.middle) * within(da)
        + (in_b - in_b.middle) * within(db)
        - bend * _up_to_square(da)
        + bend * _up_to_square(db)
        + (_square(a) - _square(b)) / (across * across) * within(da) * within(db)
    )
    terms = (in_a.middle, form), (in_b.middle, other)
    return combined(*terms, shift=rest.middle).widened(rest.radius)


def _up_to_square(radius: FloatArray) -> Interval:
    return Interval(np.zeros_like(radius), np.nextafter(radius * radius, np.inf))


def _square(values: Interval) -> Interval:
    product = values * values
    across = (values.low <= 0.0) & (values.high >= 0.0)
    return Interval(np.where(across, 0.0, np.maximum(product.low, 0.0)), product.high)


def product(first: Form, a: Interval, second: Form, b: Interval) -> Form:
    """``F G``, F inside `a` and G inside `b`: ``(F - f)(G - g)`` is the error."""
    f, g = a.middle, b.middle
    rest = within((a - f).largest) * within((b - g).largest) - Interval.point(f) * g
    return combined((g, first), (f, second), shift=rest.middle).widened(rest.radius)


def positive_part(form: Form, values: Interval, slope: Floats) -> Form:
    """``max(F, 0)``, F inside `values`: the error has its extremes at the ends and at 0."""
    rest = _hull(
        [
            _clipped(point, 0.0, np.inf) - Interval.point(point) * slope
            for point in (values.low, values.high, np.clip(0.0, values.low, values.high))
        ]
    )
    return shifted(slope, form, rest)


def _taylor(
    form: Form, angle: Interval, value: Interval, slope: Interval, curvature: Interval
) -> Form:
    """``f(m) + f'(m) (F - m) + f''(...) (F - m)^2 / 2`` about the middle m of `angle`."""
    at, s = angle.middle, slope.middle
    radius = (angle - at).largest
    square = Interval(np.zeros_like(radius), np.nextafter(0.5 * radius * radius, np.inf))
    rest = value - Interval.point(s) * at + (slope - s) * within(radius) + curvature * square
    return shifted(s, form, rest)


def _secant_slope(angle: Interval) -> Interval:
    """``sin/cos^2``, which grows with the angle."""
    ends = (sine_and_cosine(Interval.point(end)) for end in (angle.low, angle.high))
    low, high = (s / (c * c) for s, c in ends)
    return Interval(low.low, high.high)


def _secant_curvature(angle: Interval) -> Interval:
    """``(1 + sin^2)/cos^3``, even, and growing with the absolute value of the angle."""
    s, c = sine_and_cosine(angle)
    largest = Interval.point(s.largest)
    smallest = Interval.point(np.maximum(np.maximum(s.low, -s.high), 0.0))
    low = (smallest * smallest + 1.0) / _of_cosine(c.high)
    high = (largest * largest + 1.0) / _of_cosine(c.low)
    return Interval(low.low, high.high)


def _of_cosine(c: FloatArray) -> Interval:
    return Interval.point(c) * c * c


def _clipped(point: FloatArray, low: float, high: float) -> Interval:
    return Interval.point(np.clip(point, low, high))


def _hull(intervals: list[Interval]) -> Interval:
    return Interval(
        np.minimum.reduce([interval.low for interval in intervals]),
        np.maximum.reduce([interval.high for interval in intervals]),
    )
