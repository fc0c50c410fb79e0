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
    middle = Interval.point(angle.values.middle)
    curvature = _secant_curvature(angle.values)
    form = _taylor(angle, one_over(cosine(middle)), _secant_slope(middle), curvature)
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
    x_0, moved = before.middle, by.middle
    value = one_over(cosine(Interval.point(x_0))) - one_over(cosine(Interval.point(x_0) + moved))
    a, b = in_angle.middle, in_change.middle
    rest_of_change = (
        value
        - Interval.point(a) * x_0
        - Interval.point(b) * moved
        + (in_angle - a) * within((before - x_0).largest)
        + (in_change - b) * within((by - moved).largest)
    )
    return combined((a, angle.form), (b, change.form), shift=rest_of_change.middle).widened(
        rest_of_change.radius
    )


def arctangent(first: Quantity, second: Quantity) -> Form:
    """``atan(F/G)``, G positive."""
    a, b = first.values, second.values
    a_0, b_0 = Interval.point(a.middle), Interval.point(b.middle)
    square = _square(a_0) + _square(b_0)
    number = np.arctan2(a_0.low, b_0.low)
    # Distance of the library's angle from the true one: the sine of that, over the distance.
    angle = Interval.point(number)
    s, c = sine_and_cosine(angle)
    off = (a_0 * c - b_0 * s).largest / np.sqrt(square.low)
    in_a, in_b = b_0 / square, -(a_0 / square)
    da, db = (a - a.middle).largest, (b - b.middle).largest
    across = _square(a) + _square(b)
    bend = a * b / (across * across)
    remainder = (
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
    return combined(*terms, shift=remainder.middle).widened(remainder.radius)


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
    remainder = within((a - f).largest) * within((b - g).largest) - Interval.point(f) * g
    return combined((g, first.form), (f, second.form), shift=remainder.middle).widened(
        remainder.radius
    )


def positive_part(quantity: Quantity, slope: Floats) -> Form:
    """``max(F, 0)``: the error has its extremes at the ends of the values and at 0."""
    low, high = quantity.values.low, quantity.values.high
    errors = [
        Interval.point(np.maximum(point, 0.0)) - Interval.point(point) * slope
        for point in (low, high, np.clip(0.0, low, high))
    ]
    remainder = errors[0].hull(errors[1]).hull(errors[2])
    return shifted(slope, quantity.form, remainder)


def _taylor(angle: Quantity, value: Interval, slope: Interval, curvature: Interval) -> Form:
    """``f(m) + f'(m) (F - m) + f''(...) (F - m)^2 / 2`` about the middle m of the values."""
    middle, s = angle.values.middle, slope.middle
    radius = (angle.values - middle).largest
    square = Interval(np.zeros_like(radius), np.nextafter(0.5 * radius * radius, np.inf))
    remainder = (
        value - Interval.point(s) * middle + (slope - s) * within(radius) + curvature * square
    )
    return shifted(s, angle.form, remainder)


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
