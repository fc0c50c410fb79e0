"""Enclosures of functions and of lags, and the interval arithmetic below them."""

from fractions import Fraction
from itertools import product

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

import flighttune as ft
from flighttune.claims.tubes import interval as intervals
from flighttune.claims.tubes import proof
from flighttune.claims.tubes.dynamics import SampledLag
from flighttune.control.theory import exact
from flighttune.vehicles.plants.lagged import LaggedChannel

ROUNDING = 1e-12
"""Of the members, which are computed in floating point."""

PIECES, ROWS, SYMBOLS, MEMBERS = 3, 3, 12, 200


NUMBER = st.floats(-1e3, 1e3)
SMALLEST_DIVISOR = 1e-300
"""A quotient of `NUMBER` by less may be larger than any float."""

ANGLE = st.floats(-intervals.LARGEST_ANGLE, intervals.LARGEST_ANGLE)


def holds(interval, number):
    return Fraction(float(interval.low)) <= number <= Fraction(float(interval.high))


@given(a=NUMBER, b=NUMBER)
def test_sums_and_products_contain_the_exact_ones(a, b):
    one, other = intervals.Interval.point(a), intervals.Interval.point(b)

    assert holds(one + other, Fraction(a) + Fraction(b))
    assert holds(one - other, Fraction(a) - Fraction(b))
    assert holds(one * other, Fraction(a) * Fraction(b))
    if b > SMALLEST_DIVISOR:
        assert holds(one / other, Fraction(a) / Fraction(b))


def test_a_radius_reaches_both_ends_from_the_middle():
    """Over 1000 intervals whose middles and differences are not floats, in rational numbers."""
    ends = np.sort(np.random.default_rng(5).normal(size=(2, 1000)), axis=0)
    interval = intervals.Interval(*ends)

    for low, high, middle, radius in zip(*ends, interval.middle, interval.radius, strict=True):
        assert Fraction(middle) + Fraction(radius) >= Fraction(high)
        assert Fraction(middle) - Fraction(radius) <= Fraction(low)


# The nearest float to the sum of the floats 0.1 and 0.2, which is above the sum.
END = 0.1 + 0.2


def test_a_set_refuses_a_point_just_outside():
    centre, size = np.array([0.1, -0.1]), np.array([0.2, 0.2])
    assert Fraction(END) > Fraction(0.1) + Fraction(0.2)

    for row, point in ((0, END), (1, -END)):
        ranges = np.column_stack([centre, centre])
        assert proof.inside(ranges, centre, size)
        ranges[row] = point
        assert not proof.inside(ranges, centre, size)


def test_a_parallelotope_contains_the_corners_of_its_set_exactly():
    """In 60 digits, for rows so nearly dependent that their inverse has only six right ones."""
    n = 8
    W = np.array([[1.0 / (i + j + 1.0) for j in range(n)] for i in range(n)])
    rng = np.random.default_rng(3)
    centre, size = rng.normal(size=n), rng.uniform(0.1, 1.0, n)

    box = proof.parallelotope(W, centre, size)

    with mpmath.workdps(60):
        middle, generators, err = (
            mpmath.matrix(values.tolist())
            for values in (box.values[0, :, 0], box.values[0, :, 1 : 1 + n], box.err[0])
        )
        for signs in rng.choice([-1.0, 1.0], (20, n)):
            q = mpmath.matrix([mpmath.mpf(c) + s * mpmath.mpf(h) for c, s, h in
                               zip(centre, signs, size, strict=True)])  # fmt: skip
            z = mpmath.lu_solve(mpmath.matrix(W.tolist()), q)
            symbols = mpmath.lu_solve(generators, z - middle)
            clipped = mpmath.matrix([max(-1, min(1, x)) for x in symbols])
            rest = z - middle - generators * clipped
            assert all(abs(x) <= e for x, e in zip(rest, err, strict=True))


def sine(angle):
    return intervals.sine_and_cosine(angle)[0]


@given(angle=ANGLE)
def test_sine_and_cosine_contain_the_exact_ones(angle):
    for ours, theirs in ((sine, exact.sine), (intervals.cosine, exact.cosine)):
        found, (low, high) = ours(intervals.Interval.point(angle)), theirs(angle)

        assert holds(found, low)
        assert holds(found, high)


@given(a=ANGLE, b=ANGLE, part=st.floats(0.0, 1.0))
def test_ranges_of_angles_contain_every_value(a, b, part):
    low, high = min(a, b), max(a, b)
    angle = min(max(low + part * (high - low), low), high)
    whole = intervals.Interval(np.asarray(low), np.asarray(high))

    assert all(holds(sine(whole), end) for end in exact.sine(angle))
    assert all(holds(intervals.cosine(whole), end) for end in exact.cosine(angle))


DT = 0.02
QUADRATURE = 1e-9

LAGS = [
    ft.loop.InnerLag(order=1, natural_frequency=6.0),
    ft.loop.InnerLag(order=2, natural_frequency=12.0, damping=0.6, delay=0.03),
    ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.8, lag=0.1, delay=0.055),
]


@pytest.mark.parametrize("lag", LAGS)
def test_a_step_is_answered_as_in_flight_at_every_sample_and_on_average(lag):
    sampled, channel = SampledLag.of(lag, DT), LaggedChannel(lag, 0.0)
    given = [0.0] * (sampled.older + 1)
    state = np.zeros(sampled.order)
    for k in range(12):
        command = 1.0 if k < 5 else -0.5
        channel.order(k * DT, command)
        given.insert(0, command)
        inputs = np.array([*state, given[sampled.older + 1], given[sampled.older]])
        states, edges = sampled.transition @ inputs, sorted(channel.switches((k + 1) * DT))
        area, begin = 0.0, k * DT
        for end in (*edges, (k + 1) * DT):
            area += quad(channel.at, begin, end)[0]
            channel.move_to(end)
            begin = end
        assert states[0] == pytest.approx(channel.at((k + 1) * DT), abs=ROUNDING)
        assert sampled.mean @ inputs == pytest.approx(area / DT, abs=QUADRATURE)
        state = states


@pytest.mark.parametrize("lag", LAGS)
def test_values_within_a_sample_contain_the_response_and_little_more(lag):
    sampled = SampledLag.of(lag, DT)
    start = [intervals.Interval(np.array([-0.1]), np.array([0.1])) for _ in range(sampled.order)]
    command = intervals.Interval(np.array([0.9]), np.array([1.0]))

    A, B = lag.undelayed
    still = sampled.rest
    # At the end the response is the first row of exp(A h) times the distance from rest, plus rest.
    ends = [
        (still * u + expm(A * DT) @ (np.array(y) - still * u))[0]
        for u in (0.9, 1.0)
        for y in product((-0.1, 0.1), repeat=sampled.order)
    ]
    end = intervals.Interval(np.array([min(ends)]), np.array([max(ends)]))

    values = sampled.values_within(start, end, command, DT)

    rng = np.random.default_rng(5)
    for _ in range(200):
        y, u, t = rng.uniform(-0.1, 0.1, sampled.order), rng.uniform(0.9, 1.0), rng.uniform(0, DT)
        response = (still * u + expm(A * t) @ (y - still * u))[0]
        assert values.low[0] <= response <= values.high[0]
    assert values.high[0] - values.low[0] <= 0.2 + 3.0 * DT * (np.abs(A[0]).sum() + B[0])


def test_a_command_that_switches_halfway_bends_a_response_as_far_as_it_may():
    """A lag of first order: down for half a sample and up again, nearly to where it began."""
    rate, h = 0.5, 0.02
    sampled = SampledLag.of(ft.loop.InnerLag(order=1, natural_frequency=rate), h)
    half = np.exp(-0.5 * rate * h)
    lowest = half - 1.0  # from 0 towards -1, then towards 1
    at_end = 1.0 + half * (lowest - 1.0)
    start, end = (intervals.Interval.point(np.array([x])) for x in (0.0, at_end))
    either = intervals.Interval(np.array([-1.0]), np.array([1.0]))

    values = sampled.values_within([start], end, either, h)

    assert lowest - 4.0 * (rate * h) ** 2 <= values.low.item() <= lowest
    assert -lowest <= values.high.item()


@pytest.mark.parametrize("command", [1.0, -1.0])
def test_a_response_that_moves_away_from_its_command_first_is_contained(command):
    """It leaves 0 at 8 1/s, and turns within the sample."""
    lag, h = ft.loop.InnerLag(order=2, natural_frequency=12.0, damping=0.6), 0.1
    (A, B), sampled = lag.undelayed, SampledLag.of(lag, h)
    first = -command * np.array([0.0, 8.0 / A[0, 1]])
    still = command * sampled.rest
    times = np.linspace(0.0, h, 50)
    moved = np.array([(still + expm(A * t) @ (first - still))[0] for t in times])
    start = [intervals.Interval.point(np.array([x])) for x in first]
    end, sent = (intervals.Interval.point(np.array([x])) for x in (moved[-1], command))

    values = sampled.values_within(start, end, sent, h)

    assert B[0] == 0.0
    assert (command * moved).min() < moved[-1] * command - 0.05
    assert values.low.item() <= moved.min()
    assert values.high.item() >= moved.max()


@pytest.mark.parametrize("frequency", [12.0, 150.0])
@pytest.mark.parametrize("h", [0.02, 0.1])
def test_a_lag_is_sampled_to_the_last_digit(frequency, h):
    """The lag goes from 0 to 1 and from 1 to 0, also with 15 time constants in a sample."""
    sampled = SampledLag.of(ft.loop.InnerLag(order=1, natural_frequency=frequency), h)

    x = frequency * h
    kept, mean = np.exp(-x), -np.expm1(-x) / x
    # No delay: the older command, in the middle, does not act.
    assert sampled.transition[0] == pytest.approx([kept, 0.0, -np.expm1(-x)], rel=ROUNDING)
    assert sampled.mean == pytest.approx([mean, 0.0, 1.0 - mean], rel=ROUNDING)
