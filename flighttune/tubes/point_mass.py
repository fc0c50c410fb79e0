r"""The exact point mass over one sample, for a whole set of flights.

The rates ``(g/V) n_z sin(phi)/cos(gamma)`` and ``(g/V)(n_z cos(phi) - cos(gamma))`` are linear in
(phi, n_z, gamma) about the middle of all values of the sample, plus a remainder of second order.
The linear part needs the means of the three over the sample. Those of roll and load factor are
known; that of gamma is ``gamma + (h/2) G + e``, G the mean of its rate and ``|e|`` at most h/4
times how far apart the rate can be, because e is the integral of ``(h/2 - t)/h`` times what the
rate differs from its mean.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.tubes.forms import UP, Form, Quantity, combined
from flighttune.tubes.interval import Interval, sine_and_cosine, within


class Point(NamedTuple):
    """Roll, load factor and flight-path angle.

    `s` and `c` are sine and cosine of the roll, `up` and `level` those of the path angle.
    """

    phi: Interval
    n_z: Interval
    gamma: Interval
    s: Interval
    c: Interval
    up: Interval
    level: Interval


def _point(phi: Interval, n_z: Interval, gamma: Interval) -> Point:
    return Point(phi, n_z, gamma, *sine_and_cosine(phi), *sine_and_cosine(gamma))


def point_mass_sample(
    chi: Form,
    gamma: Quantity,
    phi: Quantity,
    n_z: Quantity,
    d: Interval,
    *,
    h: float,
    g_over_v: float,
) -> tuple[Form, Form, FloatArray]:
    """Course and flight-path angle one sample of `h` seconds later, under the disturbances `d`.

    `phi` and `n_z` have the form of the mean over the sample, and all values in it. Also returned
    is the largest difference of a rate within the sample, shape (2,), rad/s.
    """
    d_chi, d_gamma = (Interval(d.low[j], d.high[j]) for j in (0, 1))
    start = _point(phi.values, n_z.values, gamma.values)
    start_rate = _climb_rate(start) * g_over_v + d_gamma
    # The rate grows with gamma by at most g/V: by less than 2 h g/V of itself in a sample.
    path = gamma.values + within(h * start_rate.largest * (1.0 + 2.0 * h * g_over_v) * UP)
    ranges = phi.values, n_z.values, path
    middles = [each.middle for each in ranges]
    radii = [(each - m).largest for each, m in zip(ranges, middles, strict=True)]
    values, middle = _point(*ranges), _point(*map(Interval.point, middles))
    rate = _climb_rate(values) * g_over_v + d_gamma
    apart = h * 0.5 * rate.radius * UP
    variables = list(zip((phi.form, n_z.form, gamma.form), middles, radii, strict=True))
    remainder = _turn_rate(middle) * g_over_v + _turn_rest(values, radii) * g_over_v
    turning, turn_bend = _mean_rate(remainder, _turn_slopes(middle), variables, g_over_v)
    remainder = _climb_rate(middle) * g_over_v + _climb_rest(values, radii) * g_over_v
    climbing, bend = _mean_rate(remainder, _climb_slopes(middle), variables, g_over_v)
    climbing = combined((1.0, climbing), shift=d_gamma.middle).widened(
        d_gamma.radius + np.abs(bend) * apart * UP
    )
    climbing = combined((1.0 / (1.0 - 0.5 * h * bend), climbing))
    turning = combined((1.0, turning), (0.5 * h * turn_bend, climbing), shift=d_chi.middle).widened(
        d_chi.radius + np.abs(turn_bend) * apart * UP
    )
    turn = _turn_rate(values) * g_over_v + d_chi
    spread = 2.0 * np.array([turn.radius.max(), rate.radius.max()])
    return combined((1.0, chi), (h, turning)), combined((1.0, gamma.form), (h, climbing)), spread


def _mean_rate(
    rest: Interval,
    slopes: Sequence[Interval],
    variables: Sequence[tuple[Form, FloatArray, FloatArray]],
    g_over_v: float,
) -> tuple[Form, FloatArray]:
    """A rate with gamma at its start, linear in the variables, and its slope in gamma.

    `rest` is the rate at their middles with its remainder of second order. Each of the `variables`
    is a form with the middle and the radius of its values.
    """
    terms = []
    for slope, (form, middle, radius) in zip(slopes, variables, strict=True):
        exact = slope * g_over_v
        number = exact.middle
        rest = rest - Interval.point(number) * middle + (exact - number) * within(radius)
        terms.append((number, form))
    return combined(*terms, shift=rest.middle).widened(rest.radius), terms[-1][0]


def _turn_rate(point: Point) -> Interval:
    return point.n_z * point.s / point.level


def _turn_slopes(point: Point) -> tuple[Interval, Interval, Interval]:
    lift = point.n_z / point.level
    return lift * point.c, point.s / point.level, lift * point.s * point.up / point.level


def _turn_rest(p: Point, radii: list[FloatArray]) -> Interval:
    n_z, s, c, up, level = p.n_z, p.s, p.c, p.up, p.level
    a, b, e = radii
    return (
        -(n_z * s / level) * _half_square(a)
        + n_z * s * (up * up + 1.0) / (level * level * level) * _half_square(e)
        + (c / level) * within(a * b * UP)
        + (n_z * c * up / (level * level)) * within(a * e * UP)
        + (s * up / (level * level)) * within(b * e * UP)
    )


def _climb_rate(point: Point) -> Interval:
    return point.n_z * point.c - point.level


def _climb_slopes(point: Point) -> tuple[Interval, Interval, Interval]:
    return -(point.n_z * point.s), point.c, point.up


def _climb_rest(p: Point, radii: list[FloatArray]) -> Interval:
    a, b, e = radii
    return -(p.n_z * p.c) * _half_square(a) + p.level * _half_square(e) + p.s * within(a * b * UP)


def _half_square(radius: FloatArray) -> Interval:
    return Interval(np.zeros_like(radius), 0.5 * radius * radius * UP)
