"""Semidefinite programs: the solver, and the paper's program against the closed form."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from semidefinite import largest_rate, rate

import flighttune as ft
from flighttune.control.theory import lmi

OFF_DIAGONAL = np.array([[0.0, 1.0], [1.0, 0.0]])


def above_off_diagonal(t):
    """``[[t, 1], [1, t]] >= 0``: t is at least one."""
    return t * np.eye(2) + OFF_DIAGONAL >> 0


@pytest.mark.parametrize(
    ("sign", "most", "reason"), [(-1.0, 0.0, "infeasible"), (1.0, np.inf, "unbounded")]
)
def test_a_problem_without_a_solution_is_a_reason_and_not_an_error(sign, most, reason):
    t = lmi.unknown()
    more = [t <= most] if np.isfinite(most) else []

    assert reason in lmi.solve(lmi.largest(sign * t, [above_off_diagonal(t), *more]))


def test_a_solver_stopped_early_has_no_answer(monkeypatch):
    monkeypatch.setitem(lmi.SOLVER_OPTIONS, "max_iter", 2)
    t = lmi.unknown()

    assert lmi.solve(lmi.largest(-t, [above_off_diagonal(t)]))


AGREEMENT = 1e-6


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


@pytest.mark.soak
@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(stable_loops())
def test_solver_and_closed_form_agree_on_stiff_and_nearly_unstable_loops(A):
    assert rate(largest_rate(A)) == pytest.approx(ft.loop.indicators(A).R_K, rel=AGREEMENT)
