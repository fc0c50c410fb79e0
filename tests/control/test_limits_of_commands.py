"""Ranges and rates of commands: which are refused, what satisfies two of them, and what is held."""

import math

import pytest

import flighttune as ft


def limits(lower=(-1.0, -2.0), upper=(1.0, 2.0), rate_lower=(-3.0, -4.0), rate_upper=(5.0, 6.0)):
    return ft.loop.Limits(lower=lower, upper=upper, rate_lower=rate_lower, rate_upper=rate_upper)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"upper": (1.0, -2.0)}, "`lower` must be below `upper`"),
        ({"rate_lower": (-3.0, 7.0)}, "`rate_lower` must be below `rate_upper`"),
        ({"rate_lower": (0.5, -4.0)}, "must hold zero"),
        ({"rate_upper": (5.0, -0.5)}, "must hold zero"),
        ({"upper": (math.nan, 2.0)}, "`upper` must not be NaN"),
    ],
)
def test_a_range_that_holds_nothing_and_rates_without_zero_are_refused(wrong, says):
    with pytest.raises(ft.InputError, match=says):
        limits(**wrong)


def test_limits_within_others_are_the_narrower_at_every_end():
    other = limits((-2.0, -1.0), (0.5, 3.0), (-1.0, -9.0), (9.0, 2.0))

    for both in (limits().within(other), other.within(limits())):
        assert both.lower.tolist() == [-1.0, -1.0]
        assert both.upper.tolist() == [0.5, 2.0]
        assert both.rate_lower.tolist() == [-1.0, -4.0]
        assert both.rate_upper.tolist() == [5.0, 2.0]


def test_a_limiter_says_what_holds_a_command_and_by_how_much():
    """In 0.1 s the first moves by 0.5 up at most, the second by 0.4 down."""
    limiter = ft.loop.CommandLimiter(limits(), dt=0.1)

    limiter.start([0.0, 0.0])
    assert limiter.limit(0.8, -0.8) == pytest.approx((0.5, -0.4))
    assert limiter.limited == [2, 2]
    assert limiter.excess == pytest.approx((0.3, -0.4))
    # the range ends before, or as far as, the rate reaches
    assert limiter.limit(3.0, -0.8) == pytest.approx((1.0, -0.8))
    assert limiter.limited == [1, 0]
    limiter.start([0.0, 0.0])
    assert limiter.limited == [0, 0]
    for wrong in ([0.0], [0.0, math.inf]):
        with pytest.raises(ft.InputError, match="`u` must be 2 finite numbers"):
            limiter.start(wrong)
