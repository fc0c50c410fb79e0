"""Verdicts and bounds on flights of linear loops, for which every answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run
from scipy.linalg import expm

from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import closed_loop, disturbance_entry, kinematic_model
from flighttune.guarantee.flight_check import certified_loop, check_against
from flighttune.guarantee.mismatch import Mismatch
from flighttune.theory.attractor import invariant_ellipsoid

MODEL = kinematic_model(V_a=25.0, gamma=0.26, g=9.81)
FIGURES, UNIT = certified_loop(MODEL, PAPER_GAINS)
A_K, E = closed_loop(MODEL, PAPER_GAINS), disturbance_entry(MODEL)
DT, L_D = 0.01, 0.015
FIRST_SAMPLES = 0.02
"""Part by which a mean over a sample may differ from a value at its middle."""


def linear_flight(v, s_0, *, moved_at=None, by=(0.0, 0.0), limited_until=0.0):
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
    signals = {
        "chi_err": errors[:, 0],
        "gamma_err": errors[:, 1],
        "chi_ref": moved[:, 0],
        "gamma_ref": moved[:, 1],
        "phi_limited": np.where(t < limited_until, 2.0, 0.0),
    }
    rates = np.diff(moved - errors, axis=0) / DT
    middle = 0.5 * (v[1:] + v[:-1])
    found = Mismatch(t=t[:-1], rates=rates, d=np.zeros_like(rates), d_dot=-middle)
    return check_against(made_up_run(signals, t), FIGURES, UNIT, found)


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
    claim, outcome = pushed.claim(0.0)

    assert outcome == "held"
    assert claim.L_d == pytest.approx(L_D, rel=FIRST_SAMPLES)


def test_radius_and_widths_are_those_of_the_theory(pushed):
    found = pushed.claim(0.0)[0]
    ellipsoid = invariant_ellipsoid(A_K, E, L_d=found.L_d)

    assert found.radius == pytest.approx(ellipsoid.radius, rel=1e-6)
    assert found.tube == pytest.approx(np.sqrt(np.diag(ellipsoid.W)[2:]), rel=1e-6)


def random_pushes(seconds=30):
    rng = np.random.default_rng(4)
    return np.repeat(rng.normal(size=(2 * seconds, 2)), 50, axis=0) * 0.01


def test_the_bound_holds_on_the_way_in_from_far_outside():
    check = linear_flight(random_pushes(), [0.3, -0.2, -1.0, 0.5])

    assert check.t_broken is None
    assert check.share_broken == 0.0
    assert (np.abs(check.states[:, 2:]) <= check.error_bounds.high).all()


def test_the_bound_is_never_above_the_exponential_plus_the_radius_of_the_largest_mismatch():
    check = linear_flight(random_pushes(), [0.3, -0.2, -1.0, 0.5])
    Q, s_0 = FIGURES.Q, check.states[0]

    start = np.sqrt(s_0 @ Q @ s_0 / np.linalg.eigvalsh(Q)[0])
    exponential = start * np.exp(-0.5 * FIGURES.R_K * (check.t - check.t[0]))
    assert (check.bound <= (exponential + check.claim(0.0)[0].radius) * (1.0 + 1e-12)).all()
    assert check.bound[0] == pytest.approx(start)


def test_there_is_no_claim_while_a_limit_holds_a_command_and_it_starts_anew_behind_it():
    check = linear_flight(random_pushes(), [0.3, -0.2, -1.0, 0.5], limited_until=4.0)
    first = int(np.searchsorted(check.t, 4.0))

    assert np.isnan(check.bound[:first]).all()
    assert np.isfinite(check.bound[first:]).all()
    Q, s = FIGURES.Q, check.states[first]
    assert check.bound[first] == pytest.approx(np.sqrt(s @ Q @ s / np.linalg.eigvalsh(Q)[0]))


def test_an_error_that_no_disturbance_explains_breaks_the_set_when_it_appears(pushed):
    level, states = pushed.level.copy(), pushed.states.copy()
    level[pushed.t > 12.0] += 1.0
    states[pushed.t > 12.0, 2] += 1.0

    broken = replace(pushed, level=level, states=states)

    assert broken.claim(0.0)[1] == "broken"
    assert broken.t_broken == pytest.approx(12.0, abs=2 * DT)
    assert broken.claim(12.5)[1] == "not entered"


def test_a_step_of_the_reference_is_not_held_against_the_set():
    v = worst([0.0, 0.0, 1.0, 0.0], 40.0)

    loop = linear_flight(v, np.zeros(4), moved_at=15.0, by=(0.8, 0.0))

    around = (loop.t > 15.1) & (loop.t < 16.0)
    assert (loop.level[around] > L_D**2).all()
    assert loop.claim(0.0)[1] == "held"
    assert loop.t_broken is None
    assert np.isnan(loop.bound).sum() == 2  # up and flat again


def test_a_set_that_was_left_as_the_reference_moved_and_not_entered_again_is_not_held():
    loop = linear_flight(
        worst([0.0, 0.0, 1.0, 0.0], 15.2), np.zeros(4), moved_at=15.0, by=(0.8, 0.0)
    )

    assert loop.claim(0.0)[1] == "not entered"


def test_a_bound_of_half_the_change_commanded_is_vacuous_and_one_of_a_few_degrees_never_is():
    claim = linear_flight(np.full((100, 2), 0.001), np.zeros(4)).claim(0.0)[0]
    width = max(claim.tube) / claim.L_d

    assert replace(claim, L_d=np.radians(31.0) / width, commanded=np.radians(60.0)).vacuous
    assert not replace(claim, L_d=np.radians(29.0) / width, commanded=np.radians(60.0)).vacuous
    assert not replace(claim, L_d=np.radians(4.9) / width, commanded=0.0).vacuous
    assert replace(claim, L_d=np.pi / width, commanded=100.0).vacuous
