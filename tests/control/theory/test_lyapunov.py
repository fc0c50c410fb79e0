"""The Lyapunov equation against a closed form, with any right-hand side, and what it refuses."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.theory import lyapunov

ROUNDING = 1e-12
STIFF = 1e-6


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9])
def test_a_barely_damped_oscillator_has_the_solution_known_on_paper(distance):
    A = np.array([[-distance, 1.0], [-1.0, -distance]])

    assert ft.loop.indicators(A).Q == pytest.approx(np.eye(2) / (2.0 * distance), rel=STIFF)


@pytest.mark.parametrize("n", [2, lyapunov.KRONECKER_STATES, lyapunov.KRONECKER_STATES + 1])
def test_a_stack_equals_its_members_and_broadcasts_the_right_hand_side(n):
    rng = np.random.default_rng(n)
    A = rng.standard_normal((3, 1, n, n)) - 3.0 * n * np.eye(n)
    half = rng.standard_normal((2, n, n))
    S = half @ half.mT

    Q = lyapunov.lyapunov_solution(A, S)

    assert Q.shape == (3, 2, n, n)
    one = lyapunov.lyapunov_solution(A[2, 0], S[1])
    assert Q[2, 1] == pytest.approx(one, rel=ROUNDING, abs=ROUNDING)
    residual = A.mT @ Q + Q @ A + S
    assert np.abs(residual).max() < ROUNDING * n * np.abs(S).max()


def test_a_pair_of_opposite_eigenvalues_is_refused():
    with pytest.raises(ft.InputError, match="`A`"):
        lyapunov.lyapunov_solution(np.diag([1.0, -1.0]))


@pytest.mark.parametrize(
    ("S", "message"),
    [
        ([[1.0, 2.0], [0.0, 1.0]], "`S` must be symmetric"),
        (np.ones((5, 2, 2)), "`S` must broadcast"),
    ],
)
def test_a_right_hand_side_that_does_not_fit_is_named(S, message):
    with pytest.raises(ft.InputError, match=message):
        lyapunov.lyapunov_solution(-np.stack([np.eye(2)] * 3), S)
