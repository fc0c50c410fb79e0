"""Guarantees held against flights whose answer is known on paper."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import kinematic_model
from flighttune.plants.kinematic import G_PAPER
from flighttune.recording.certified import certified
from flighttune.recording.frozen_loop import frozen_loop
from flighttune.theory.indicators import indicators

from .conftest import SCENARIO, V_A, fly, made_up

DT = 0.02
SECOND_ORDER = 40.0 * DT**2
"""Error of a midpoint rate and value relative to ||s(0)|| for a loop slower than 10 rad/s."""


def linear_flight(gains, e_0, *, seconds=10.0):
    """The linear loop itself as a run: errors by the matrix exponential, nothing limited."""
    model = kinematic_model(V_a=V_A, gamma=0.0, g=G_PAPER)
    A_K = closed_loop(model, gains)
    s_0 = np.concatenate([(model.A + model.B @ gains.K_P) @ e_0, e_0])
    t = np.arange(round(seconds / DT) + 1) * DT
    step, s = expm(A_K * DT), [s_0]
    for _ in t[1:]:
        s.append(step @ s[-1])
    s = np.array(s)
    zero = np.zeros(len(t))
    table = {
        "chi": -s[:, 2], "gamma": -s[:, 3], "phi": zero, "n_z": zero + 1.0, "V_a": zero + V_A,
        "north": V_A * t, "east": zero, "down": zero, "chi_ref": zero, "gamma_ref": zero,
        "chi_err": s[:, 2], "gamma_err": s[:, 3],
        "phi_cmd": zero, "n_z_cmd": zero + 1.0,
        "phi_limited": zero, "n_z_limited": zero,
    }  # fmt: skip
    signals = pd.DataFrame(table, index=pd.Index(t, name="t"))
    return made_up(signals, "kinematic", "linear", gains), s, A_K


@pytest.mark.parametrize("e_0", [(0.5, 0.0), (0.0, 0.3), (0.4, -0.2)])
def test_s_is_the_error_and_its_rate(e_0):
    run, s, A_K = linear_flight(PAPER_GAINS, np.array(e_0))

    found = certified(run)

    middle = s[:-1] @ expm(A_K * DT / 2.0).T
    wanted = np.linalg.norm(middle, axis=1)
    assert np.abs(found.size - wanted).max() < SECOND_ORDER * wanted[0]
    assert found.t == pytest.approx(run.signals.index[:-1] + DT / 2.0)


def test_the_linear_loop_never_breaks_its_exponential():
    run, s, A_K = linear_flight(PAPER_GAINS, np.array([0.4, -0.2]))
    known = indicators(A_K)

    found = certified(run)

    spectrum = np.linalg.eigvalsh(known.Q)
    s_0 = s[0]
    exponential = np.sqrt(s_0 @ known.Q @ s_0 / spectrum[0]) * np.exp(-known.R_K / 2.0 * found.t)
    assert found.rate == known.R_K
    assert found.bound - found.radius == pytest.approx(exponential, rel=0.02)
    assert found.t_broken is None
    assert found.share_broken == 0.0


def test_a_loop_slower_than_its_gains_breaks_it():
    fast, _, _ = linear_flight(PAPER_GAINS, np.array([0.4, -0.2]), seconds=20.0)
    lame = PIGains(K_P=0.12 * PAPER_GAINS.K_P, K_I=0.02 * PAPER_GAINS.K_I)
    slow, _, _ = linear_flight(lame, np.array([0.4, -0.2]), seconds=20.0)
    commands = {name: fast.signals[name] for name in ("phi_cmd", "n_z_cmd")}
    pretended = replace(
        slow,
        signals=slow.signals.assign(**commands),
        provenance=replace(slow.provenance, gains=PAPER_GAINS),
    )

    found = certified(pretended)

    assert found.t_broken is not None
    assert found.broken.any()
    assert np.all(found.size[found.broken] > found.bound[found.broken])


def test_nothing_is_claimed_while_a_limit_holds_and_the_claim_begins_anew():
    run = fly("kinematic", "paper", PAPER_GAINS)
    held = (run.signals[["phi_limited", "n_z_limited"]].to_numpy() != 0.0).any(axis=1)[:-1]

    found = certified(run)

    assert held.any()
    assert np.array_equal(np.isnan(found.bound), held)
    begins = np.flatnonzero(~held & np.concatenate([[True], held[:-1]]))
    assert np.all(found.size[begins] <= found.bound[begins])


def test_a_flight_without_gains_or_numbers_of_its_law_has_no_guarantee(without_gains):
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    bare = {key: value for key, value in SCENARIO.items() if key != "flight"}
    unstable = PIGains(K_P=-PAPER_GAINS.K_P, K_I=PAPER_GAINS.K_I)

    assert certified(without_gains) is None
    assert certified(replace(run, signals=run.signals.iloc[:5])) is None
    assert certified(replace(run, provenance=replace(run.provenance, scenario=bare))) is None
    assert certified(replace(run, provenance=replace(run.provenance, gains=unstable))) is None


def test_frozen_eigenvalues_are_those_of_the_jacobian_at_the_flight_condition():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=4.0)

    found = frozen_loop(run)

    for k in (0, 77, 150):
        at = run.signals.iloc[k]
        model = kinematic_model(V_a=V_A, gamma=at.gamma, phi=at.phi, n_z=at.n_z, g=G_PAPER)
        wanted = np.linalg.eigvals(closed_loop(model, PAPER_GAINS))
        assert np.sort_complex(found.eigenvalues[k]) == pytest.approx(np.sort_complex(wanted))
        assert found.abscissa[k] == pytest.approx(wanted.real.max())
        assert found.damping[k] == pytest.approx((-wanted.real / np.abs(wanted)).min())


def test_the_loop_at_the_trim_is_that_of_the_indicators():
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    model = kinematic_model(V_a=V_A, gamma=np.deg2rad(30.0), g=G_PAPER)
    wanted = indicators(closed_loop(model, PAPER_GAINS)).eigenvalues

    assert np.sort_complex(frozen_loop(run).trim) == pytest.approx(np.sort_complex(wanted))
