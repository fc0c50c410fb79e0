"""Many flights held against the set at once, and each of them step by step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from flighttune.guarantee.error_states import error_states
from flighttune.guarantee.ultimate_set import entered_and_left, outcomes

ROUNDED = 1e-12


def step_by_step(inside, moved):
    """When a flight first was in the set, when it first left it, and whether it ends in it."""
    entered = left = None
    was_inside = False
    for k in range(len(inside)):
        if moved[k]:
            was_inside = False
        elif inside[k]:
            was_inside, entered = True, k if entered is None else entered
        elif was_inside:
            left = k
            break
    return entered, left, was_inside


flags = array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9).flatmap(
    lambda shape: st.tuples(arrays(bool, shape), arrays(bool, shape))
)


@given(flags)
def test_flights_enter_and_leave_as_one_that_is_followed_step_by_step(both):
    inside, moved = both
    within, left = entered_and_left(inside, moved)
    words = outcomes(inside, moved)
    for i in range(len(inside)):
        entered, broken, ends_in = step_by_step(inside[i], moved[i])
        assert (int(np.argmax(within[i])) if within[i].any() else None) == entered
        assert (int(np.argmax(left[i])) if left[i].any() else None) == broken
        held = "held" if ends_in else "not entered"
        assert words[i] == ("broken" if broken is not None else held)
        assert outcomes(inside[i], moved[i]) == words[i]


def test_a_flight_of_no_interval_has_not_entered():
    assert outcomes(np.zeros((2, 0), dtype=bool), np.zeros((2, 0), dtype=bool)).tolist() == [
        "not entered", "not entered",
    ]  # fmt: skip


def flights(count):
    rng = np.random.default_rng(3)
    t = np.arange(40) * 0.05
    errors, references = rng.normal(size=(2, count, 40)), rng.normal(size=(2, count, 40))
    references[0, 0] = 0.3
    references[1, 0] = 0.1 * t
    return t, errors, references, rng.normal(size=(2, count, 39))


def test_the_level_of_a_flight_is_the_quadratic_form_of_its_errors_and_their_rates():
    t, errors, references, rates = flights(5)
    shape = np.random.default_rng(4).normal(size=(4, 4))

    found = error_states(t, errors=errors, references=references, rates=rates)

    slope = np.diff(references) / 0.05 - rates
    s = np.stack([*slope, *(errors[..., :-1] + 0.5 * 0.05 * slope)])
    expected = np.einsum("ink,ij,jnk->nk", s, shape, s)
    assert found.level(shape) == pytest.approx(expected, rel=ROUNDED, abs=ROUNDED)
    assert not found.moved[0].any()
    assert found.moved[1:, 1:].all()


def test_a_flight_among_many_has_the_bits_of_a_flight_alone():
    t, errors, references, rates = flights(7)
    shape = np.random.default_rng(4).normal(size=(4, 4))
    many = error_states(t, errors=errors, references=references, rates=rates)

    for i in range(7):
        alone = error_states(t, errors=errors[:, i], references=references[:, i], rates=rates[:, i])
        assert alone.level(shape).tobytes() == many.level(shape)[i].tobytes()
        assert np.array_equal(alone.moved, many.moved[i])
