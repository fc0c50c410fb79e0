"""Verdicts on flights of linear loops, for which every answer is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import kinematic_model
from flighttune.gap.certified_set import loop_flown
from flighttune.gap.mismatch import Mismatch
from flighttune.theory.attractor import invariant_ellipsoid
from flighttune.theory.reachable import ReachableSet

MODEL = kinematic_model(V_a=25.0, gamma=0.26, g=9.81)
A_K = closed_loop(MODEL, PAPER_GAINS)
E = disturbance_entry(MODEL)
DT, L_D = 0.01, 0.015
FIRST_SAMPLES = 0.02
"""Part by which a mean over a sample may differ from a value at its middle."""


class Flown:
    """What the verdict looks at of a run."""

    def __init__(self, signals):
        self.signals = signals


def linear_flight(v, s_0, *, moved_at=None, by=(0.0, 0.0)):
    """Fly ``s' = A_K s + E v`` with v held over samples; the reference may jump once."""
    step = expm(np.block([[A_K, E], [np.zeros((2, 6))]]) * DT)
    s, states = np.array(s_0, dtype=float), []
    t = np.arange(len(v) + 1) * DT
    moved = np.zeros((len(t), 2))
    for k in range(len(t)):
        if moved_at is not None and k == round(moved_at / DT):
            s[2:] += by
            moved[k:] = by
        states.append(s)
        if k < len(v):
            s = step[:4, :4] @ s + step[:4, 4:] @ v[k]
    states = np.array(states)
    errors = states[:, 2:]
    signals = pd.DataFrame(
        {
            "chi_err": errors[:, 0],
            "gamma_err": errors[:, 1],
            "chi_ref": moved[:, 0],
            "gamma_ref": moved[:, 1],
        },
        index=pd.Index(t, name="t"),
    )
    rates = np.diff(moved - errors, axis=0) / DT
    middle = 0.5 * (v[1:] + v[:-1])
    found = Mismatch(t=t[:-1], rates=rates, d=np.zeros_like(rates), d_dot=-middle)
    return loop_flown(Flown(signals), found, A_K, E)


def worst(direction, seconds):
    """The disturbance of norm `L_D` that takes ``direction @ s`` farthest at the end."""
    t = np.arange(round(seconds / DT))[::-1] * DT + 0.5 * DT
    step, pull, pulls = expm(A_K * DT), np.asarray(direction) @ expm(A_K * 0.5 * DT), []
    for _ in t:
        pulls.append(pull @ E)
        pull = pull @ step
    pulls = np.array(pulls[::-1])
    return L_D * pulls / np.linalg.norm(pulls, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def pushed():
    """The course error pushed as far as it goes, from rest."""
    return linear_flight(worst([0.0, 0.0, 1.0, 0.0], 30.0), np.zeros(4))


def test_a_linear_loop_under_its_worst_disturbance_stays_in_the_set(pushed):
    found = pushed.verdict()

    assert found.held
    assert found.sentence == "held"
    assert found.L_d == pytest.approx(L_D, rel=FIRST_SAMPLES)
    assert found.t_broken is None


def test_the_worst_disturbance_takes_the_error_to_the_exact_reach():
    step = expm(np.block([[A_K, E], [np.zeros((2, 6))]]) * DT)
    s = np.zeros(4)
    for v in worst([0.0, 0.0, 1.0, 0.0], 40.0):
        s = step[:4, :4] @ s + step[:4, 4:] @ v

    loop = linear_flight(np.full((100, 2), L_D / np.sqrt(2.0)), np.zeros(4))
    assert s[2] == pytest.approx(loop.verdict().reach[0], rel=1e-3)


def test_radius_and_reach_are_those_of_the_theory(pushed):
    found = pushed.verdict()
    ellipsoid = invariant_ellipsoid(A_K, E, L_d=found.L_d)

    assert found.radius == pytest.approx(ellipsoid.radius, rel=1e-6)
    assert found.tube == pytest.approx(
        [ellipsoid.reach(np.eye(4)[2]), ellipsoid.reach(np.eye(4)[3])], rel=1e-6
    )
    exact = ReachableSet.of(A_K, E, L_d=found.L_d)
    assert found.reach == pytest.approx([exact.reach(np.eye(4)[i]) for i in (2, 3)], rel=1e-6)
    assert (np.array(found.reach) < found.tube).all()


def test_the_promise_holds_on_the_way_in_from_far_outside():
    rng = np.random.default_rng(4)
    v = np.repeat(rng.normal(size=(60, 2)), 50, axis=0) * 0.01

    loop = linear_flight(v, [0.3, -0.2, -1.0, 0.5])

    assert loop.t_promise_broken() is None
    assert loop.promise_sentence == "held"
    assert loop.verdict().t_entered > 1.0


def test_an_error_that_no_disturbance_explains_breaks_the_set_when_it_appears(pushed):
    loop = pushed
    level = loop.level.copy()
    level[loop.t > 12.0] += 1.0

    broken = replace(loop, level=level)

    assert not broken.verdict().held
    assert broken.verdict().t_broken == pytest.approx(12.0, abs=2 * DT)
    assert broken.verdict().sentence.startswith("broken at t = 12.0")
    assert broken.t_promise_broken() == pytest.approx(12.0, abs=2 * DT)
    assert broken.verdict(t_from=12.5).sentence == "never entered"


def test_a_step_of_the_reference_is_not_held_against_the_set():
    v = worst([0.0, 0.0, 1.0, 0.0], 40.0)

    loop = linear_flight(v, np.zeros(4), moved_at=15.0, by=(0.8, 0.0))

    around = (loop.t > 15.1) & (loop.t < 16.0)
    assert (loop.level[around] > L_D**2).all()
    assert loop.verdict().held
    assert loop.t_promise_broken() is None


def test_the_tube_is_the_largest_error_of_the_promised_ellipsoid():
    loop = linear_flight(np.full((100, 2), 0.001), [0.0, 0.0, 0.4, 0.0])

    ellipsoid = invariant_ellipsoid(A_K, E, L_d=float(np.sqrt(loop.promised[50])))
    assert loop.tube()[50, 0] == pytest.approx(ellipsoid.reach(np.eye(4)[2]), rel=1e-6)
    assert (np.abs([0.4]) < loop.tube()[0, 0]).all()
