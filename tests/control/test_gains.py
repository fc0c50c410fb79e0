"""Gains and limits as values: equal by numbers and names, refused when they cannot be."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft


def test_gains_are_equal_by_numbers_and_names():
    copy = ft.PIGains(K_P=ft.PAPER_GAINS.K_P.copy(), K_I=ft.PAPER_GAINS.K_I.copy())

    assert copy == ft.PAPER_GAINS
    assert hash(copy) == hash(ft.PAPER_GAINS)
    assert {ft.PAPER_GAINS: "paper"}[copy] == "paper"
    assert copy != ft.PAPER_GAINS.K_P.tolist()


def test_gains_differ_by_the_last_bit_of_a_number_and_by_a_name():
    K_I = ft.PAPER_GAINS.K_I.copy()
    K_I[0, 1] = np.nextafter(K_I[0, 1], 1.0)

    assert replace(ft.PAPER_GAINS, K_I=K_I) != ft.PAPER_GAINS
    assert replace(ft.PAPER_GAINS, inputs=("phi", "alpha")) != ft.PAPER_GAINS


def test_a_zero_has_no_sign():
    zero = np.zeros((2, 2))
    plus, minus = (ft.PIGains(K_P=one, K_I=zero) for one in (zero, -zero))

    assert plus == minus
    assert hash(plus) == hash(minus)


ONE = np.ones(2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"upper": -ONE}, r"`lower` must be below `upper`, got \[-1\.0, -1\.0\]"),
        ({"upper": [np.nan, 1.0]}, r"`upper` must not be NaN"),
        ({"rate_lower": 0.5 * ONE}, r"rate ranges must hold zero"),
        ({"upper": np.ones(3)}, r"must have one length"),
    ],
)
def test_limits_that_cannot_be_are_refused(change, message):
    fields = {"lower": -ONE, "upper": ONE, "rate_lower": -ONE, "rate_upper": ONE}
    with pytest.raises(ft.InputError, match=message):
        ft.loop.Limits(**{**fields, **change})


def test_limits_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        ft.loop.Limits.none(2).lower[0] = 3.0


def test_limits_that_hold_together_are_the_narrower_of_each():
    wide = ft.loop.Limits(lower=-2 * ONE, upper=[1.0, 5.0], rate_lower=-ONE, rate_upper=[9.0, 0.1])
    narrow = ft.loop.Limits(lower=-ONE, upper=2 * ONE, rate_lower=-2 * ONE, rate_upper=ONE)

    both = wide.within(narrow)

    assert both.lower.tolist() == [-1.0, -1.0]
    assert both.upper.tolist() == [1.0, 2.0]
    assert both.rate_lower.tolist() == [-1.0, -1.0]
    assert both.rate_upper.tolist() == [1.0, 0.1]
    assert wide.within(ft.loop.Limits.none(2)).upper.tolist() == wide.upper.tolist()
