"""The paper's semidefinite program against the closed form, and the other optimal Q."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from semidefinite import largest_rate, radius, rate, smallest_radius

from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import closed_loop, kinematic_model
from flighttune.theory.indicators import indicators

AGREEMENT = 1e-6
RATE_LOSS = 1e-6

MODEL = kinematic_model(V_a=25.0, gamma=np.pi / 12, g=9.81)
DECOUPLED = PIGains(K_P=np.diag([1.6, 2.4]), K_I=3.5 * np.eye(2))

decays = st.floats(-3.0, 2.0).map(lambda power: 10.0**power)
frequencies = st.floats(-2.0, 2.0).map(lambda power: 10.0**power)
poles = st.tuples(decays, st.none() | frequencies)


@st.composite
def stable_loops(draw):
    """1 to 6 states, rates over five decades, mixed by a matrix of condition up to 30."""
    blocks, room = [], draw(st.integers(1, 6))
    while room:
        decay, frequency = draw(poles)
        if frequency is None or room == 1:
            blocks.append([[-decay]])
        else:
            blocks.append([[-decay, frequency], [-frequency, -decay]])
        room -= len(blocks[-1])
    D = block_diag(*blocks)
    n = len(D)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    T = left * np.geomspace(1.0, 10.0 ** draw(st.floats(0.0, 1.5)), n) @ right
    return T @ D @ np.linalg.inv(T)


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(stable_loops())
def test_solver_and_closed_form_agree_on_stiff_and_nearly_unstable_loops(A):
    assert rate(largest_rate(A)) == pytest.approx(indicators(A).R_K, rel=AGREEMENT)


def test_the_best_rate_of_the_papers_gains_is_that_of_the_closed_form_0_4599():
    A = closed_loop(MODEL, PAPER_GAINS)

    Q = largest_rate(A)

    assert rate(Q) == pytest.approx(0.4599, abs=5e-5)
    assert radius(A, Q) == pytest.approx(4.9162, abs=5e-5)


def test_a_coupled_loop_has_no_second_optimal_Q_to_tighten_the_radius_with():
    A = closed_loop(MODEL, PAPER_GAINS)

    tightest = smallest_radius(A, rate_loss=RATE_LOSS)

    assert radius(A, tightest) == pytest.approx(indicators(A).I_K, rel=1e-4)


def test_a_decoupled_loop_has_a_Q_of_the_same_rate_and_a_radius_smaller_by_a_quarter():
    A = closed_loop(MODEL, DECOUPLED)
    smallest = indicators(A)

    tightest = smallest_radius(A, rate_loss=RATE_LOSS)

    assert rate(tightest) == pytest.approx(smallest.R_K, rel=2e-6)
    assert radius(A, tightest) < 0.75 * smallest.I_K


def test_giving_up_rate_buys_radius_where_fast_and_slow_modes_are_coupled():
    A = np.array([[-1.0, 8.0], [0.0, -2.0]])
    full = indicators(A)

    best = smallest_radius(A)

    assert rate(best) < 0.999 * full.R_K
    assert radius(A, best) < 0.95 * full.I_K
