"""Exact gradients against central differences and a closed form."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flighttune.errors import ShapeError
from flighttune.theory.indicators import indicators_batch, spectra

STEP = 1e-5
TRUNCATION = 1e-6
ROUNDING = 1e-10
GAP = 1.05


def random_stable_loop(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    return A - (np.linalg.eigvals(A).real.max() + rng.uniform(0.3, 2.0)) * np.eye(n)


def rate_and_radius_gradients(A_K, scaling=None):
    """Of ``R_K = 1 / largest`` and ``I_K = largest^2 / (smallest sigma)``."""
    found = spectra(A_K, scaling=scaling)
    smallest, largest = found.eigenvalues[[0, -1]]
    d_smallest, d_largest = found.eigenvalue_gradients[[0, -1]]
    sigma, d_sigma = found.singular_values[-1], found.singular_value_gradients[-1]
    d_log_I_K = 2.0 * d_largest / largest - d_smallest / smallest - d_sigma / sigma
    return -d_largest / largest**2, largest**2 / (smallest * sigma) * d_log_I_K


def is_separated(values):
    """Whether the extreme values are single, so that they have a derivative."""
    ordered = np.sort(values)
    return len(values) < 2 or (ordered[1:] / ordered[:-1])[[0, -1]].min() > GAP


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), is_scaled=st.booleans())
def test_the_gradients_are_those_of_central_differences(seed, n, is_scaled):
    A_K = random_stable_loop(seed, n)
    scaling = np.geomspace(0.5, 3.0, n) if is_scaled else None
    moves = STEP * np.eye(n * n).reshape(n * n, n, n)

    dR_K, dI_K = rate_and_radius_gradients(A_K, scaling=scaling)

    found = spectra(A_K, scaling=scaling)
    assume(found is not None and is_separated(found.eigenvalues))
    assume(is_separated(found.singular_values))
    forward = indicators_batch(A_K + moves, scaling=scaling)
    backward = indicators_batch(A_K - moves, scaling=scaling)
    for exact, ahead, behind in (
        (dR_K, forward.R_K, backward.R_K),
        (dI_K, forward.I_K, backward.I_K),
    ):
        difference = (ahead - behind) / (2.0 * STEP)
        assert exact.ravel() == pytest.approx(
            difference, abs=TRUNCATION * np.abs(exact).max(), rel=1e-3
        )


def test_a_single_lag_has_the_derivatives_known_on_paper():
    rate = 0.4

    dR_K, dI_K = rate_and_radius_gradients([[-rate]])

    assert dR_K[0, 0] == pytest.approx(-2.0, rel=ROUNDING)  # R_K = 2 rate
    assert dI_K[0, 0] == pytest.approx(1.0 / rate**3, rel=ROUNDING)  # I_K = 1 / (2 rate^2)


def test_every_eigenvalue_of_a_decoupled_loop_moves_with_its_own_rate():
    rates = np.array([2.0, 0.5, 1.0])

    found = spectra(np.diag(-rates))

    assert found is not None
    order = np.argsort(1.0 / rates)
    assert found.eigenvalues == pytest.approx(0.5 / rates[order], rel=ROUNDING)
    for k, gradient in zip(order, found.eigenvalue_gradients, strict=True):
        expected = np.zeros((3, 3))
        expected[k, k] = 0.5 / rates[k] ** 2
        assert gradient == pytest.approx(expected, abs=ROUNDING)


def test_an_unstable_loop_has_no_spectra():
    assert spectra(np.diag([0.1, -1.0])) is None
    with pytest.raises(ShapeError, match="`A_K` must have 2 axes"):
        spectra(np.zeros((2, 2, 2)))
