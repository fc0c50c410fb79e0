"""Limits that cannot be are refused when made."""

import numpy as np
import pytest

import flighttune as ft

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
