"""The reach of a flight without limits, on linear loops whose answers are known and in flight."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import kinematic_model
from flighttune.guarantee.flight_check import check_against, free_flight
from flighttune.guarantee.mismatch import Mismatch
from flighttune.guarantee.ultimate_set import certified_loop
from flighttune.theory.reachable import ReachableSet

LOOP = certified_loop(kinematic_model(V_a=25.0, gamma=0.26, g=9.81), PAPER_GAINS)
A_K, E = LOOP.A_K, LOOP.E
DT, SECONDS = 0.01, 30.0
START = np.array([0.05, -0.02, 0.1, 0.05])
OF_A_SAMPLE = 0.02
"""Part by which means over samples may differ from values in the middle of them."""


def reach(v, s=START, *, limited_until=0.0, moved_at=None, measured=1.0):
    """Fly ``s' = A_K s + E v``, v held over samples; `measured` is the part of v that is."""
    step = expm(np.block([[A_K, E], [np.zeros((2, 6))]]) * DT)
    errors = [s[2:]]
    for pushed in v:
        s = step[:4, :4] @ s + step[:4, 4:] @ pushed
        errors.append(s[2:])
    errors, t = np.array(errors), np.arange(len(v) + 1) * DT
    columns = {
        "chi_err": errors[:, 0], "gamma_err": errors[:, 1],
        "chi_ref": np.where(t < (moved_at or 0.0), 0.0, 0.1), "gamma_ref": 0.0,
        "phi_limited": np.where(t < limited_until, 2.0, 0.0), "n_z_limited": 0.0,
    }  # fmt: skip
    signals = pd.DataFrame(columns, index=pd.Index(t, name="t"))
    rates = -np.diff(errors, axis=0) / DT
    d_dot = -0.5 * measured * (v[1:] + v[:-1])
    found = Mismatch(t=t[:-1], rates=rates, d=np.zeros_like(rates), d_dot=d_dot)
    made_by = SimpleNamespace(scenario={}, plant="linear")
    run = SimpleNamespace(signals=signals, t=t, provenance=made_by)
    return free_flight(check_against(run, LOOP, found))


def worst(strength):
    """The disturbance of the strength given at each sample that takes the course farthest."""
    step, pull, pulls = expm(A_K * DT), np.eye(4)[2] @ expm(A_K * 0.5 * DT), []
    for _ in strength:
        pulls.append(pull @ E)
        pull = pull @ step
    pulls = np.array(pulls[::-1])
    return strength[:, None] * pulls / np.linalg.norm(pulls, axis=1, keepdims=True)


def still(seconds=SECONDS):
    return np.zeros((round(seconds / DT), 2)) + 1e-12


def test_left_alone_the_errors_are_those_of_the_linear_loop():
    found = reach(still())

    assert found.errors == pytest.approx(found.centre, abs=OF_A_SAMPLE * 0.1)
    assert max(found.widest) < 1e-9
    assert found.t_from == pytest.approx(0.5 * DT)


@pytest.mark.parametrize("fades", [0.0, 0.2])
def test_the_worst_disturbance_takes_the_course_to_the_edge_and_not_beyond(fades):
    t = np.arange(round(SECONDS / DT)) * DT
    found = reach(worst(0.05 * np.exp(-fades * t)), np.zeros(4))

    pushed = np.abs(found.errors - found.centre)[:, 0]
    assert pushed[-1] == pytest.approx(found.width[-1, 0], rel=OF_A_SAMPLE)
    assert (pushed <= found.width[:, 0] * (1.0 + OF_A_SAMPLE) + 1e-5).all()


def test_under_a_constant_bound_it_is_the_peak_gain_of_the_loop():
    found = reach(worst(np.full(round(SECONDS / DT), 0.05)), np.zeros(4))

    known = ReachableSet.of(A_K, E, L_d=0.05).peak_gain(slice(2, 4)).channels
    assert found.width[-1] == pytest.approx(known, rel=OF_A_SAMPLE)


def test_a_disturbance_that_was_not_measured_breaks_it_and_by_how_much_is_told():
    found = reach(worst(np.full(round(SECONDS / DT), 0.05)), np.zeros(4), measured=0.5)

    over = float(found.outside.max())
    assert found.t_broken == pytest.approx(0.0, abs=0.1)
    assert over == pytest.approx(found.width[-1, 0], rel=2.0 * OF_A_SAMPLE)
    assert found.sentence.endswith(f", by at most {math.degrees(over):.2f} deg")


def test_it_begins_behind_the_last_limit_and_the_last_move_of_the_reference():
    assert reach(still(), limited_until=4.0).t_from == pytest.approx(4.0, abs=2 * DT)
    assert reach(still(), moved_at=6.0).t_from == pytest.approx(6.0, abs=2 * DT)
    assert reach(still(), limited_until=SECONDS - 0.5) is None
