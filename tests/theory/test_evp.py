"""The paper's semidefinite program against the closed form, and the other optimal Q."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import kinematic_model
from flighttune.errors import InputError
from flighttune.theory import evp, trade
from flighttune.theory.evp import paper_evp
from flighttune.theory.indicators import indicators
from flighttune.theory.lmi import LmiSolution
from flighttune.theory.trade import best_trade, tightest_radius

AGREEMENT = 1e-6
EIGENVALUE_ROUNDING = 1e-9

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


def largest_violation(A, Q):
    return np.linalg.eigvalsh(A.T @ Q + Q @ A + np.eye(len(A)))[-1]


@settings(max_examples=1000, deadline=None, derandomize=True, database=None,
          suppress_health_check=list(HealthCheck))  # fmt: skip
@given(stable_loops())
def test_solver_and_closed_form_agree_on_stiff_and_nearly_unstable_loops(A):
    closed_form = indicators(A)

    solved = paper_evp(A)

    assert solved.R_K == pytest.approx(closed_form.R_K, rel=AGREEMENT)
    assert solved.R_K_bound == pytest.approx(closed_form.R_K, rel=AGREEMENT)
    assert solved.status == "optimal"


def test_the_best_rate_of_the_papers_gains_is_that_of_the_closed_form_0_4599():
    solved = paper_evp(closed_loop(MODEL, PAPER_GAINS))

    assert solved.R_K == pytest.approx(0.4599, abs=5e-5)
    assert solved.I_K == pytest.approx(4.9162, abs=5e-5)


def test_a_coupled_loop_has_no_second_optimal_Q_to_tighten_the_radius_with():
    A = closed_loop(MODEL, PAPER_GAINS)

    tightest = tightest_radius(A)

    assert tightest.I_K == pytest.approx(indicators(A).I_K, rel=1e-4)


def test_a_decoupled_loop_has_a_Q_of_the_same_rate_and_a_radius_smaller_by_a_quarter():
    A = closed_loop(MODEL, DECOUPLED)
    smallest = indicators(A)

    tightest = tightest_radius(A)

    assert tightest.R_K == pytest.approx(smallest.R_K, rel=2e-6)
    assert tightest.I_K < 0.75 * smallest.I_K
    assert largest_violation(A, tightest.Q) < EIGENVALUE_ROUNDING


def test_in_a_decoupled_loop_the_tightest_Q_is_no_worse_than_scaling_a_block_by_hand():
    A = closed_loop(MODEL, DECOUPLED)
    blocks = [indicators(A[np.ix_(block, block)]).Q for block in ([0, 2], [1, 3])]
    spectra = np.array([np.linalg.eigvalsh(Q) for Q in blocks])
    top = spectra.max()
    bottom = (spectra[:, 0] * top / spectra[:, 1]).min()
    by_hand = top**2 / (bottom * np.linalg.svd(A, compute_uv=False)[-1])

    assert tightest_radius(A).I_K <= by_hand * (1.0 + AGREEMENT)


@pytest.mark.parametrize("gains", [PAPER_GAINS, DECOUPLED])
def test_the_best_trade_is_never_worse_in_radius_than_the_tightest_at_full_rate(gains):
    A = closed_loop(MODEL, gains)

    best, tightest = best_trade(A), tightest_radius(A)

    assert best.status == "optimal"
    assert best.I_K <= tightest.I_K * (1.0 + AGREEMENT)
    assert best.R_K <= paper_evp(A).R_K * (1.0 + AGREEMENT)
    assert largest_violation(A, best.Q) < EIGENVALUE_ROUNDING


def test_giving_up_rate_buys_radius_where_fast_and_slow_modes_are_coupled():
    A = np.array([[-1.0, 8.0], [0.0, -2.0]])
    full = indicators(A)

    best = best_trade(A)

    assert best.R_K < 0.999 * full.R_K
    assert best.I_K < 0.95 * full.I_K


@pytest.mark.parametrize("question", [paper_evp, tightest_radius, best_trade])
def test_an_unstable_loop_is_a_result_that_names_the_eigenvalue(question):
    result = question([[0.25, 0.0], [0.0, -1.0]])

    assert result.status == "unstable"
    assert "0.25" in result.reason
    assert result.Q is None
    assert result.R_K == 0.0


def test_rate_loss_must_be_a_fraction():
    with pytest.raises(InputError, match=r"`rate_loss` must lie in \(0, 1\), got 1"):
        tightest_radius([[-1.0]], rate_loss=1.0)


def test_a_solver_that_lies_is_not_believed(monkeypatch):
    A = closed_loop(MODEL, PAPER_GAINS)

    def liar(objective, cones, **_):
        """Claims an optimum of half the size of the true one."""
        x = 0.5 * np.ones(len(objective))
        return LmiSolution(status="optimal", reason="", x=x, duals=tuple(np.eye(4) for _ in cones))

    for module in (evp, trade):
        monkeypatch.setattr(module, "minimise", liar)
    solved, radius = paper_evp(A), best_trade(A)

    assert solved.status != "optimal"
    assert solved.R_K <= indicators(A).R_K * (1.0 + AGREEMENT)
    assert largest_violation(A, radius.Q) < EIGENVALUE_ROUNDING


def test_a_solver_that_fails_is_a_result_with_its_reason(monkeypatch):
    failure = LmiSolution(status="failed", reason="the solver failed numerically", x=None, duals=())
    for module in (evp, trade):
        monkeypatch.setattr(module, "minimise", lambda *_, **__: failure)

    assert paper_evp([[-1.0]]).status == "failed"
    assert paper_evp([[-1.0]]).reason == "the solver failed numerically"
    assert tightest_radius([[-1.0]]).status == "inaccurate"
    assert tightest_radius([[-1.0]]).reason == "the solver failed numerically"
