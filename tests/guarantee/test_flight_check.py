"""Guarantees held against flights whose answer is known on paper."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run
from recording.conftest import SCENARIO, V_A, fly
from scipy.linalg import expm

from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import closed_loop, kinematic_model
from flighttune.guarantee.flight_check import flight_check
from flighttune.units import G_PAPER

DT = 0.02
SECOND_ORDER = 40.0 * DT**2
"""Error of a midpoint rate and value relative to ||s(0)|| for a loop slower than 10 rad/s."""


def linear_flight(gains, e_0, *, seconds=10.0):
    """The linear loop itself as a run: errors by the matrix exponential, nothing limited.

    Commands are those by which the law flies just these rates, so that there is no mismatch.
    """
    model = kinematic_model(V_a=V_A, gamma=0.0, g=G_PAPER)
    A_K = closed_loop(model, gains)
    s_0 = np.concatenate([(model.A + model.B @ gains.K_P) @ e_0, e_0])
    t = np.arange(round(seconds / DT) + 1) * DT
    step, s = expm(A_K * DT), [s_0]
    for _ in t[1:]:
        s.append(step @ s[-1])
    s = np.array(s)
    zero = np.zeros(len(t))
    chi_dot, gamma_dot = (np.append(np.diff(-s[:, i]) / DT, 0.0) for i in (2, 3))
    cosine = np.cos(-s[:, 3])
    level = np.append(0.5 * (cosine[1:] + cosine[:-1]), 1.0)
    phi_cmd = np.arctan(V_A / G_PAPER * chi_dot)
    n_z_cmd = (V_A / G_PAPER * gamma_dot + level) / np.cos(phi_cmd)
    table = {
        "chi": -s[:, 2], "gamma": -s[:, 3], "phi": zero, "n_z": zero + 1.0, "V_a": zero + V_A,
        "north": V_A * t, "east": zero, "down": zero, "chi_ref": zero, "gamma_ref": zero,
        "chi_err": s[:, 2], "gamma_err": s[:, 3],
        "phi_cmd": phi_cmd, "n_z_cmd": n_z_cmd,
        "phi_limited": zero, "n_z_limited": zero,
    }  # fmt: skip
    return made_up_run(table, t, gains_name="linear", gains=gains, scenario=SCENARIO), s, A_K


@pytest.mark.parametrize("e_0", [(0.5, 0.0), (0.0, 0.3), (0.4, -0.2)])
def test_s_is_the_error_and_its_rate(e_0):
    run, s, A_K = linear_flight(PAPER_GAINS, np.array(e_0))

    found = flight_check(run)

    middle = s[:-1] @ expm(A_K * DT / 2.0).T
    wanted = np.linalg.norm(middle, axis=1)
    assert np.abs(found.size - wanted).max() < SECOND_ORDER * wanted[0]
    assert found.t == pytest.approx(run.signals.index[:-1] + DT / 2.0)
    assert (found.t_broken, found.share_broken) == (None, 0.0)


def test_a_loop_slower_than_its_gains_breaks_it():
    lame = PIGains(K_P=0.12 * PAPER_GAINS.K_P, K_I=0.02 * PAPER_GAINS.K_I)
    slow, _, _ = linear_flight(lame, np.array([0.4, -0.2]), seconds=20.0)
    pretended = replace(slow, provenance=replace(slow.provenance, gains=PAPER_GAINS))

    found = flight_check(pretended)

    assert found.t_broken is not None
    assert found.broken.any()
    assert np.all(found.size[found.broken] > found.bound[found.broken])


def test_a_flight_without_gains_or_numbers_of_its_law_has_no_guarantee():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    bare = {key: value for key, value in SCENARIO.items() if key != "flight"}
    unstable = PIGains(K_P=-PAPER_GAINS.K_P, K_I=PAPER_GAINS.K_I)

    assert flight_check(replace(run, provenance=replace(run.provenance, gains=None))) is None
    assert flight_check(replace(run, signals=run.signals.iloc[:3])) is None
    assert flight_check(replace(run, provenance=replace(run.provenance, scenario=bare))) is None
    assert flight_check(replace(run, provenance=replace(run.provenance, gains=unstable))) is None
