"""The matrix exponential against SciPy's."""

import numpy as np
import pytest
from scipy.linalg import expm

from flighttune.theory.exponential import exponential

ROUNDING = 1e-13


@pytest.mark.parametrize("size", [0.0, 1e-3, 1.0, 30.0])
def test_it_is_that_of_scipy_for_stable_and_unstable_matrices(size):
    A = size * np.random.default_rng(0).standard_normal((20, 4, 4))

    found, expected = exponential(A), expm(A)

    scale = np.linalg.norm(expected, axis=(1, 2), keepdims=True)
    assert found / scale == pytest.approx(expected / scale, abs=max(1.0, size) * ROUNDING)


def test_a_double_eigenvalue_is_no_obstacle():
    A = np.array([[-2.0, 1.0], [0.0, -2.0]])

    assert exponential(A) == pytest.approx(np.exp(-2.0) * np.array([[1.0, 1.0], [0.0, 1.0]]))
