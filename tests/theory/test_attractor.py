"""Ultimate bounds of the paper's loop, and loops whose bounds are known on paper."""

import numpy as np
import pytest
from printed import A_K, L_D, MODEL, E
from worst_reach import ReachableSet, largest_reach

import flighttune as ft
from flighttune.theory.lyapunov import invariant_ellipsoid, paper_balls

LAST_DIGIT = 5e-4
SEARCH = 1e-6


def test_the_papers_ball_has_three_readings():
    balls = paper_balls(A_K, MODEL.A, I_K=ft.loop.indicators(A_K).I_K, L_d=L_D)

    assert balls == pytest.approx([0.241, 0.104, 0.015], abs=LAST_DIGIT)


def test_a_lightly_damped_loop_leaves_the_ball_of_the_proportional_reading():
    damping = 0.1
    oscillator = np.array([[-damping, -1.0], [1.0, 0.0]])
    safe, proportional, _ = paper_balls(
        oscillator, [[0.0]], I_K=ft.loop.indicators(oscillator).I_K, L_d=1.0
    )

    reached, _ = largest_reach(ReachableSet.of(oscillator, [[1.0], [0.0]], L_d=1.0))

    assert proportional < reached / 5.0
    assert reached < safe


def test_the_ellipsoid_of_the_papers_loop_has_radius_0_0333():
    ellipsoid = invariant_ellipsoid(A_K, E, L_d=L_D)

    assert ellipsoid.radius == pytest.approx(0.0333, abs=5e-5)


def test_the_ellipsoid_of_a_single_decay_is_the_exact_interval():
    """s' = -k s + v reaches L_d / k; the best multiplier is a = k."""
    k, L_d = 3.0, 0.6

    ellipsoid = invariant_ellipsoid([[-k]], [[1.0]], L_d=L_d)

    assert ellipsoid.radius == pytest.approx(L_d / k, rel=SEARCH)
    assert ellipsoid.multiplier == pytest.approx(k, rel=1e-3)


@pytest.mark.parametrize("L_d", [0.0, np.nan])
def test_the_disturbance_bound_must_be_positive(L_d):
    with pytest.raises(ft.InputError, match="`L_d` must be positive"):
        invariant_ellipsoid(A_K, E, L_d=L_d)
    with pytest.raises(ft.InputError, match="`L_d` must be positive"):
        paper_balls(A_K, MODEL.A, I_K=1.0, L_d=L_d)


def test_an_unstable_loop_has_no_ellipsoid():
    with pytest.raises(ft.InputError, match=r"`A`.*0\.5"):
        invariant_ellipsoid([[0.5]], [[1.0]], L_d=1.0)


def test_the_disturbance_must_enter_somewhere():
    with pytest.raises(ft.InputError, match=r"`E`.*2"):
        invariant_ellipsoid(-np.eye(2), [[0.0], [0.0]], L_d=1.0)
