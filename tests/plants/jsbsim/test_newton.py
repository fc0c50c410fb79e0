"""Newton's method inside bounds, on equations whose roots are known."""

import numpy as np
import pytest

from flighttune.plants.jsbsim.trim import interior_root

WIDTHS = np.full(2, 1e-7)
ROUNDING = 1e-14


def circle_and_line(x):
    """Meet at (0.6, 0.8) and (-0.8, -0.6)."""
    return np.array([x[0] ** 2 + x[1] ** 2 - 1.0, x[1] - x[0] - 0.2])


def box(low, high):
    return np.full(2, low), np.full(2, high)


@pytest.mark.parametrize(
    ("start", "root"), [((0.5, 0.5), (0.6, 0.8)), ((-0.5, -0.9), (-0.8, -0.6))]
)
def test_the_root_near_the_start_is_found_to_rounding(start, root):
    found = interior_root(circle_and_line, np.array(start), box(-1.0, 1.0), widths=WIDTHS)

    assert found == pytest.approx(np.array(root), abs=ROUNDING)


def test_a_step_that_would_pass_a_bound_stops_short_of_it():
    looked = []

    def watched(x):
        looked.append(x)
        return circle_and_line(x)

    found = interior_root(watched, np.array([0.05, 0.1]), box(0.0, 0.9), widths=WIDTHS)

    assert found == pytest.approx(np.array([0.6, 0.8]), abs=ROUNDING)
    assert np.min(looked) > 0.0
    assert np.max(looked) < 0.9


def test_a_root_beyond_the_bounds_is_none():
    assert interior_root(circle_and_line, np.full(2, 0.2), box(0.0, 0.5), widths=WIDTHS) is None


def test_equations_without_slope_are_none():
    def flat(x):
        return np.array([1.0, x[0]])

    assert interior_root(flat, np.full(2, 0.2), box(0.0, 0.5), widths=WIDTHS) is None
