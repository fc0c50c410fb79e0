"""Many flights held against the set at once, and each of them step by step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from flighttune.guarantee.flight_check import error_states, outcomes, quadratic_form

ROUNDED = 1e-12


def step_by_step(inside, moved):
    """Outcome of a flight that is followed from interval to interval."""
    was_inside = False
    for is_inside, has_moved in zip(inside, moved, strict=True):
        if was_inside and not (is_inside or has_moved):
            return "broken"
        was_inside = is_inside and not has_moved
    return "held" if was_inside else "not entered"


flags = array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9).flatmap(
    lambda shape: st.tuples(arrays(bool, shape), arrays(bool, shape))
)


@given(flags)
def test_outcomes_are_those_of_flights_followed_step_by_step(both):
    inside, moved = both
    words = outcomes(inside, moved)
    assert words.tolist() == [step_by_step(*flight) for flight in zip(inside, moved, strict=True)]
    assert outcomes(inside[0], moved[0]) == words[0]


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

    states, moved = error_states(t, errors=errors, references=references, rates=rates)

    slope = np.diff(references) / 0.05 - rates
    s = np.stack([*slope, *(errors[..., :-1] + 0.5 * 0.05 * slope)])
    expected = np.einsum("ink,ij,jnk->nk", s, shape, s)
    assert quadratic_form(states, shape) == pytest.approx(expected, rel=ROUNDED, abs=ROUNDED)
    assert not moved[0].any()
    assert moved[1:, 1:].all()


def test_a_flight_among_many_has_the_bits_of_a_flight_alone():
    t, errors, references, rates = flights(7)
    shape = np.random.default_rng(4).normal(size=(4, 4))
    many, moved = error_states(t, errors=errors, references=references, rates=rates)

    for i in range(7):
        own = {"errors": errors[:, i], "references": references[:, i], "rates": rates[:, i]}
        alone, its_moves = error_states(t, **own)
        assert quadratic_form(alone, shape).tobytes() == quadratic_form(many, shape)[i].tobytes()
        assert np.array_equal(its_moves, moved[i])
