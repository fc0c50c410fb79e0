"""The Lyapunov equation against exact rational arithmetic, SciPy and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov

import flighttune as ft
from flighttune.control.theory import lyapunov

ROUNDING = 1e-12
STIFF = 1e-6


def stable_loop(seed, n, decades, *, normal=False):
    """A random stable matrix whose real eigenvalues span `decades` decades below -1e-4."""
    rng = np.random.default_rng(seed)
    rates = -(10.0 ** rng.uniform(-4.0, -4.0 + decades, n))
    basis = rng.standard_normal((n, n))
    if normal:
        basis = np.linalg.qr(basis)[0]
    return basis @ np.diag(rates) @ np.linalg.inv(basis)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9])
def test_a_barely_damped_oscillator_has_the_solution_known_on_paper(distance):
    A = np.array([[-distance, 1.0], [-1.0, -distance]])

    assert lyapunov.lyapunov_solution(A) == pytest.approx(np.eye(2) / (2.0 * distance), rel=STIFF)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 12), decades=st.floats(0.0, 4.0))
def test_any_number_of_states_agrees_with_bartels_and_stewart(seed, n, decades):
    A = stable_loop(seed, n, decades, normal=True)

    Q = lyapunov.lyapunov_solution(A)

    assert np.array_equal(Q, Q.T)
    assert Q == pytest.approx(
        solve_continuous_lyapunov(A.T, -np.eye(n)), abs=STIFF * np.linalg.norm(Q, 2)
    )


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
