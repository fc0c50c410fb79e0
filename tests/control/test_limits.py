"""Limits that cannot be are refused when made."""

import numpy as np
import pytest

from flighttune.control.limits import Limits
from flighttune.errors import InputError, ShapeError

ONE = np.ones(2)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"upper": -ONE}, InputError, r"`lower` must be below `upper`, got \[-1\.0, -1\.0\]"),
        ({"upper": [np.nan, 1.0]}, InputError, r"`upper` must not be NaN"),
        ({"rate_lower": 0.5 * ONE}, InputError, r"rate ranges must hold zero"),
        ({"upper": np.ones(3)}, ShapeError, r"must have one length"),
        ({"upper": np.ones((2, 1))}, ShapeError, r"`upper` must have 1 axis"),
    ],
)
def test_limits_that_cannot_be_are_refused(change, error, message):
    fields = {"lower": -ONE, "upper": ONE, "rate_lower": -ONE, "rate_upper": ONE}
    with pytest.raises(error, match=message):
        Limits(**{**fields, **change})


def test_limits_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        Limits.none(2).lower[0] = 3.0
