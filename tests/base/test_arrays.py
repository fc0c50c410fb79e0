"""Checks of values that users give: both ends of each range, and the words of a refusal."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.base import arrays
from flighttune.base.errors import ShapeError

# A check, the values that it takes, and those that it refuses, each with its message
CHECKS = {
    "positive": (arrays.check_positive, (1e-300, 5, None), {
        0.0: "must be positive, got 0.0", -1: "got -1.", math.inf: "got inf", math.nan: "got nan",
        "1": "got '1'", True: "got True",
    }),
    "not negative": (arrays.check_not_negative, (0.0, 0, 2.5), {
        -1e-300: "must not be negative, got -1e-300", math.inf: "got inf", 1j: "got 1j",
    }),
    "at least": (lambda x: arrays.check_at_least(2, x=x), (2, 2.0, 1e9, None), {
        1.99: "must be at least 2, got 1.99", math.nan: "got nan", -3: "got -3",
    }),
    "between": (lambda x: arrays.check_between(-1.5, 2, x=x), (-1.49, 0, 1.999, None), {
        -1.5: "must be between -1.5 and 2, got -1.5", 2: "got 2.", math.nan: "got nan",
    }),
    "upright": (lambda x: arrays.check_upright(x=x), (0, -1.57, 1.57), {
        math.pi / 2: "must lie inside [+]-90 deg, got 90.0 deg", -2.0: "got -114.59",
        "a": "got 'a'",
    }),
    "finite": (lambda x: arrays.check_finite(x=x), (0.0, None, (1, 2.0), [[1e308]]), {
        math.inf: "must be finite, got inf", (0.0, math.nan): "got", "a": "must be real numbers",
    }),
    "numbers": (lambda x: arrays.check_numbers(x=x), (0, -2.5, np.float32(1.0)), {
        None: "must be a finite number, got None", False: "got False", math.inf: "finite, got inf",
        10**400: "got a whole number of 401 digits",
    }),
}  # fmt: skip


@pytest.mark.parametrize("name", CHECKS)
def test_a_check_takes_its_range_and_names_a_value_outside(name):
    check, taken, refused = CHECKS[name]
    if name in ("positive", "not negative"):
        of, check = check, lambda x: of(x=x)

    for value in taken:
        check(value)
    for value, message in refused.items():
        with pytest.raises(ft.InputError, match=f"^`x` .*{message}"):
            check(value)


def test_a_refusal_has_the_unit_and_the_first_bad_name_of_several():
    with pytest.raises(ft.InputError, match=r"^`b` must be positive, got -1.0 m/s\.$"):
        arrays.check_positive("m/s", a=1.0, b=-1.0, c=-2.0)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (10**19, "1" + "0" * 19), (-(10**20), "a whole number of 21 digits"), (True, "True"),
        (np.int64(7), "7"), (None, "None"), (2.5, "2.5"), (1j, "1j"), ("a" * 78, repr("a" * 78)),
        ("a" * 79, "'" + "a" * 39 + " ..."), (np.zeros(3), "an array"), ([1], "a list"),
        ({}, "a dict"), (object(), "an object"),
    ],
)  # fmt: skip
def test_a_message_has_a_value_that_fits_a_line_and_the_kind_of_any_other(value, said):
    assert arrays.got(value) == said


def test_spans_are_from_the_first_true_to_one_past_the_last():
    assert arrays.true_spans(np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)) == [
        (0, 2),
        (3, 4),
        (6, 7),
    ]
    assert arrays.true_spans(np.zeros(3, dtype=bool)) == []
    assert arrays.true_spans(np.ones(2, dtype=bool)) == [(0, 2)]


@pytest.mark.parametrize(
    ("value", "axes", "message"),
    [
        ([1.0], None, r"shape \(\.\.\., n, n\), got \(1,\)"),
        ([[1.0, 2.0]], None, r"got \(1, 2\)"),
        (np.zeros((0, 0)), None, r"got \(0, 0\)"),
        (np.eye(2), 3, r"must have 3 axes, got shape \(2, 2\)"),
        ([[math.nan]], None, r"must be finite, got \[\[nan\]\]"),
        ([[1.0], [1.0, 2.0]], None, "must be real numbers in rows of one length, got a list"),
    ],
)
def test_an_array_that_is_not_square_real_and_finite_is_refused(value, axes, message):
    with pytest.raises(ft.InputError, match=message):
        arrays.square_matrices("A", value, axes)


def test_matrices_of_the_right_shape_are_taken_and_cannot_be_changed():
    assert arrays.square_matrices("A", np.ones((4, 2, 2)), 3).shape == (4, 2, 2)
    assert arrays.square_matrices("A", [[2]]).tolist() == [[2.0]]
    given = np.eye(2)
    matrix, vector = arrays.read_only_matrix("K", given), arrays.read_only_vector("v", [1, 2], (2,))
    given[0, 0] = 7.0
    assert (matrix.tolist(), vector.tolist()) == ([[1.0, 0.0], [0.0, 1.0]], [1.0, 2.0])
    for array in (matrix, vector):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    for bad, shape in (([1.0], None), ([[1.0, 2.0]], (2, 1))):
        with pytest.raises(ShapeError, match="`K` must have"):
            arrays.read_only_matrix("K", bad, shape)
    with pytest.raises(ft.InputError, match="`v` must be finite"):
        arrays.read_only_vector("v", [math.inf])
