"""The polytopes of an envelope: every Jacobian of the law lies inside, extremes included."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import flighttune as ft
from flighttune.control.linear_model import Envelope, jacobian_hull

G = 9.81
WIDE = Envelope(V_a=(20.0, 30.0), gamma=(-0.35, 0.785), phi=(-0.52, 0.7), n_z=(-0.5, 1.5))
TRIM = Envelope.at(V_a=25.0, gamma=math.pi / 12)


def entries_at(V_a, gamma, phi, n_z):
    model = ft.loop.kinematic_model(V_a=V_a, gamma=gamma, phi=phi, n_z=n_z, g=G)
    return np.array([model.A[1, 1], -model.B[0, 0], model.B[1, 0], -model.B[1, 1]])


def inside(point, corners):
    """Whether a point is a convex combination of the corners, by linear programming."""
    shares = np.vstack([corners.T, np.ones(len(corners))])
    found = linprog(np.zeros(len(corners)), A_eq=shares, b_eq=np.append(point, 1.0))
    return found.status == 0


@pytest.mark.slow
@settings(max_examples=40)
@given(st.tuples(*[st.floats(0.0, 1.0)] * 4))
def test_every_jacobian_of_the_envelope_lies_in_the_polytope(at):
    low, high = WIDE.ranges.T

    assert inside(entries_at(*(low + at * (high - low))), jacobian_hull(WIDE, g=G).corners)


def test_the_polytope_holds_what_the_corners_of_the_conditions_miss():
    """At zero roll b1 is least and b3 largest: between the ends of the roll range."""
    corners = np.array([entries_at(*ends) for ends in product(*WIDE.ranges)])
    level = entries_at(25.0, 0.0, 0.0, 1.0)

    assert not inside(level, corners)
    assert inside(level, jacobian_hull(WIDE, g=G).corners)


def test_an_envelope_is_scaled_about_the_trim():
    half, none = WIDE.scaled(TRIM, 0.5), WIDE.scaled(TRIM, 0.0)

    assert half.V_a == pytest.approx((22.5, 27.5))
    assert half.gamma == pytest.approx((math.pi / 24 - 0.175, math.pi / 24 + 0.3925))
    assert none == TRIM
    assert WIDE.contains(half)
    assert half.contains(TRIM)
    assert not half.contains(WIDE)


@pytest.mark.parametrize("name", ["V_a", "gamma", "phi", "n_z"])
@pytest.mark.parametrize("end", [0, 1])
def test_an_envelope_contains_none_that_is_wider_to_one_side(name, end):
    ends = [*getattr(WIDE, name)]
    ends[end] += 0.01 * (-1.0, 1.0)[end]
    wider = replace(WIDE, **{name: tuple(ends)})

    assert wider.contains(WIDE)
    assert not WIDE.contains(wider)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"V_a": (0.0, 30.0)}, "`V_a` must be positive, got 0 m/s"),
        ({"V_a": (30.0, 20.0)}, "`V_a` must be a range"),
        ({"phi": (-2.0, 0.0)}, r"`phi` must lie inside \+-90 deg"),
        ({"n_z": (0.0, math.nan)}, "`n_z` must be a range"),
    ],
)
def test_an_envelope_must_be_one_a_law_can_fly_in(change, message):
    ranges = {"V_a": (20.0, 30.0), "gamma": (0.0, 0.1), "phi": (0.0, 0.1), "n_z": (0.9, 1.1)}

    with pytest.raises(ft.InputError, match=message):
        Envelope(**(ranges | change))
