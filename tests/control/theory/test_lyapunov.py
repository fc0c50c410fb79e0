"""The Lyapunov equation against exact rational arithmetic, SciPy and closed forms."""

from fractions import Fraction

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


def rational_solution(A):
    """Q of ``A' Q + Q A + I = 0`` by elimination over the n^2 entries in fractions."""
    n = len(A)
    exact = [[Fraction(float(a)) for a in row] for row in A]
    table = [[Fraction(0)] * (n * n) + [Fraction(-(r // n == r % n))] for r in range(n * n)]
    for i in range(n):
        for j in range(n):
            for k in range(n):
                table[i * n + j][k * n + j] += exact[k][i]
                table[i * n + j][i * n + k] += exact[k][j]
    for c in range(n * n):
        pivot = next(r for r in range(c, n * n) if table[r][c])
        table[c], table[pivot] = table[pivot], table[c]
        for r in range(n * n):
            if r != c and table[r][c]:
                factor = table[r][c] / table[c][c]
                table[r] = [a - factor * b for a, b in zip(table[r], table[c], strict=True)]
    return np.array([float(table[r][-1] / table[r][r]) for r in range(n * n)]).reshape(n, n)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("normal", [True, False])
def test_stiff_loops_agree_with_exact_rational_arithmetic(seed, normal):
    A = stable_loop(seed, n=3, decades=7.0, normal=normal)

    extremes = np.linalg.eigvalsh(lyapunov.lyapunov_solution(A))[[0, -1]]

    assert extremes == pytest.approx(np.linalg.eigvalsh(rational_solution(A))[[0, -1]], rel=STIFF)


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
