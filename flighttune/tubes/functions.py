"""Functions of forms, enclosed: what is not affine becomes an affine form with a proven error.

The slopes are free: any slope gives an enclosure, a good one a narrow enclosure.
"""

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.tubes.forms import Form, Quantity, combined, shifted
from flighttune.tubes.interval import Interval, cosine, one_over, sine_and_cosine, within


def tangent(angle: Quantity) -> Form:
    """``tan F`` of an angle, rad; ``tan'' = 2 sin/cos^3``."""
    s, c = sine_and_cosine(Interval.point(angle.values.middle))
    steep, level = sine_and_cosine(angle.values)
    return _taylor(angle, s / c, one_over(c * c), steep * 2.0 / (level * level * level))


def cosine_of(angle: Quantity) -> Quantity:
    """``cos F`` of an angle, rad."""
    s, c = sine_and_cosine(Interval.point(angle.values.middle))
    values = cosine(angle.values)
    return Quantity(_taylor(angle, c, -s, -values), values)


def secant(angle: Quantity) -> Quantity:
    """``1/cos F`` of an angle, rad."""
    at = Interval.point(angle.values.middle)
    curvature = _secant_curvature(angle.values)
    form = _taylor(angle, one_over(cosine(at)), _secant_slope(at), curvature)
    return Quantity(form, one_over(cosine(angle.values)))


def secant_change(angle: Quantity, change: Quantity) -> Form:
    """``1/cos F - 1/cos(F + D)`` for a change D, by the mean-value theorem in F and D.

    Its slope in D is ``-sec'(F + D)``, in F it is ``sec'(F) - sec'(F + D)``: minus D times
    ``sec''`` in between.
    """
    before, by = angle.values, change.values
    after = before + by
    across = before.hull(after)
    in_angle, in_change = -(_secant_curvature(across) * by), -_secant_slope(after)
    at, moved = before.middle, by.middle
    value = one_over(cosine(Interval.point(at))) - one_over(cosine(Interval.point(at) + moved))
    a, b = in_angle.middle, in_change.middle
    rest = (
        value
        - Interval.point(a) * at
        - Interval.point(b) * moved
        + (in_angle - a) * within((before - at).largest)
        + (in_change - b) * within((by - moved).largest)
    )
    return combined((a, angle.form), (b, change.form), shift=rest.middle).widened(rest.radius)


def arctangent(first: Quantity, second: Quantity) -> Form:
    """``atan(F/G)``, G positive."""
    a, b = first.values, second.values
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
    terms = (in_a.middle, first.form), (in_b.middle, second.form)
    return combined(*terms, shift=rest.middle).widened(rest.radius)


def _up_to_square(radius: FloatArray) -> Interval:
    return Interval(np.zeros_like(radius), np.nextafter(radius * radius, np.inf))


def _square(values: Interval) -> Interval:
    product = values * values
    across = (values.low <= 0.0) & (values.high >= 0.0)
    return Interval(np.where(across, 0.0, np.maximum(product.low, 0.0)), product.high)


def product(first: Quantity, second: Quantity) -> Form:
    """``F G``: ``(F - f)(G - g)`` about their middles is the error."""
    a, b = first.values, second.values
    f, g = a.middle, b.middle
    rest = within((a - f).largest) * within((b - g).largest) - Interval.point(f) * g
    return combined((g, first.form), (f, second.form), shift=rest.middle).widened(rest.radius)


def positive_part(quantity: Quantity, slope: Floats) -> Form:
    """``max(F, 0)``: the error has its extremes at the ends of the values and at 0."""
    low, high = quantity.values.low, quantity.values.high
    errors = [
        Interval.point(np.maximum(point, 0.0)) - Interval.point(point) * slope
        for point in (low, high, np.clip(0.0, low, high))
    ]
    rest = errors[0].hull(errors[1]).hull(errors[2])
    return shifted(slope, quantity.form, rest)


def _taylor(angle: Quantity, value: Interval, slope: Interval, curvature: Interval) -> Form:
    """``f(m) + f'(m) (F - m) + f''(...) (F - m)^2 / 2`` about the middle m of the values."""
    at, s = angle.values.middle, slope.middle
    radius = (angle.values - at).largest
    square = Interval(np.zeros_like(radius), np.nextafter(0.5 * radius * radius, np.inf))
    rest = value - Interval.point(s) * at + (slope - s) * within(radius) + curvature * square
    return shifted(s, angle.form, rest)


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
