"""R_K and I_K against the paper's Table 2, identities, and loops known to be unstable."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from printed import A_K, LAST_DIGIT_R

import flighttune as ft

ROUNDING = 1e-9


def test_the_printed_gains_do_not_have_the_printed_indicators():
    printed_R_K, printed_I_K = 0.4427, 4.9244

    found = ft.loop.indicators(A_K)

    assert found.R_K == pytest.approx(0.4599, abs=LAST_DIGIT_R / 2.0)
    assert found.I_K == pytest.approx(4.9162, abs=LAST_DIGIT_R / 2.0)
    assert found.R_K - printed_R_K > 100.0 * LAST_DIGIT_R
    assert printed_I_K - found.I_K > 50.0 * LAST_DIGIT_R


def test_a_loop_of_decoupled_lags_has_the_indicators_known_on_paper():
    slow, fast = 0.5, 4.0

    found = ft.loop.indicators(np.diag([-slow, -fast]))

    assert found.R_K == pytest.approx(2.0 * slow, rel=ROUNDING)
    assert found.I_K == pytest.approx((fast / slow) / (2.0 * slow * slow), rel=ROUNDING)
    assert found.spectral_abscissa == pytest.approx(-slow, rel=ROUNDING)


def test_state_scaling_is_a_change_of_variables():
    scale = np.array([0.5, 0.5, 1.0, 2.0])

    found = ft.loop.indicators(A_K, scaling=scale)

    by_hand = ft.loop.indicators(np.diag(1.0 / scale) @ A_K @ np.diag(scale))
    assert (found.R_K, found.I_K) == pytest.approx((by_hand.R_K, by_hand.I_K), rel=ROUNDING)
    assert found.eigenvalues == pytest.approx(by_hand.eigenvalues, rel=ROUNDING)
    assert found.scaling.tolist() == scale.tolist()


@pytest.mark.slow
@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
def test_the_rate_never_promises_more_than_the_slowest_eigenvalue(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.01, 2.0)) * np.eye(n)

    found = ft.loop.indicators(A)

    assert found.R_K <= -2.0 * found.spectral_abscissa * (1.0 + ROUNDING)
    assert found.I_K * found.R_K * np.linalg.norm(A, 2) >= 1.0 - ROUNDING
    assert found.Q is not None
    assert np.linalg.eigvalsh(found.Q)[-1] == pytest.approx(1.0 / found.R_K, rel=ROUNDING)


@pytest.mark.parametrize(
    ("A", "named"),
    [
        (np.diag([0.25, -1.0]), r"eigenvalue 0\.25\+0j 1/s is not in the open left half"),
        (np.array([[0.0, 2.0], [-2.0, 0.0]]), r"eigenvalue .*\+2j 1/s is not in the open left"),
        (np.zeros((2, 2)), "eigenvalue 0"),
        # of the left half plane, but by less than rounding
        (np.array([[-1e-17, 1.0], [0.0, -1.0]]), r"-1e-17\+0j 1/s is so close to the imaginary"),
    ],
)
def test_an_unstable_loop_is_a_result_that_names_the_eigenvalue(A, named):
    found = ft.loop.indicators(A)

    assert (found.status, found.R_K, found.I_K, found.Q) == ("unstable", 0.0, np.inf, None)
    assert ft.loop.indicators_batch(A).R_K == 0.0
    assert re.search(named, found.reason)


def test_a_loop_stable_only_by_rounding_gets_no_guarantee():
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    integrators = turn @ np.diag([0.0, 0.0, -1.0, -1e3]) @ turn.T

    found = ft.loop.indicators(integrators - 1e-14 * np.eye(4))

    assert found.status == "unstable" or found.R_K < 1e-12


@pytest.mark.parametrize(
    ("A", "scaling", "message"),
    [
        (np.ones((2, 3)), None, "`A_K` must have shape"),
        ([[np.nan]], None, "`A_K` must be finite"),
        ([[-1.0]], [0.0], "`scaling` must be positive"),
    ],
)
def test_what_cannot_be_a_loop_is_refused(A, scaling, message):
    with pytest.raises(ft.InputError, match=message):
        ft.loop.indicators(A, scaling=scaling)


def test_no_loops_have_no_indicators():
    assert ft.loop.indicators_batch(np.empty((0, 3, 3))).R_K.shape == (0,)
