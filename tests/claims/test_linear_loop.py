"""Bounds of flights of linear loops, for which every answer is known, and of the law."""

import numpy as np
import pytest
from made_up import made_up_run, shortened
from printed import A_K, E
from scipy.linalg import expm

import flighttune as ft
from flighttune.claims import linear_loop
from flighttune.control.linear_model import disturbance_entry
from flighttune.control.theory.lyapunov import invariant_ellipsoid

FIGURES, UNIT = ft.loop.indicators(A_K), invariant_ellipsoid(A_K, E, L_d=1.0)
DT, L_D = 0.01, 0.015
FIRST_SAMPLES = 0.02
"""Part by which a mean over a sample may differ from a value at its middle."""
ROUNDING = 1e-6
"""Part by which a bound may be exceeded."""


def unit_radius(gamma_deg):
    """Radius of the ultimate set for L_d = 1, about this path angle."""
    model = ft.loop.kinematic_model(V_a=25.0, gamma=np.deg2rad(gamma_deg), g=9.81)
    loop = ft.loop.closed_loop(model, ft.PAPER_GAINS)
    return invariant_ellipsoid(loop, disturbance_entry(model), L_d=1.0).radius


def linear_flight(v, s_0, *, moved_at=None, by=(0.0, 0.0), limited_until=0.0, L_d=L_D):
    """Check of ``s' = A_K s + E v`` with v held over samples; the reference may jump once."""
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
    errors = np.array(states)[:, 2:]
    signals = {
        **{f"{name}_err": errors[:, i] for i, name in enumerate(("chi", "gamma"))},
        **{f"{name}_ref": moved[:, i] for i, name in enumerate(("chi", "gamma"))},
        **{name: moved[:, i] - errors[:, i] for i, name in enumerate(("chi", "gamma"))},
        "phi_limited": np.where(t < limited_until, 2.0, 0.0),
    }
    run = made_up_run(signals, t)
    return linear_loop.bound_of(run, FIGURES, UNIT, L_d), run


def exceeded(flight):
    """Whether the norm of s is anywhere above its bound."""
    return bool((flight.size > flight.bound * (1.0 + ROUNDING) + ROUNDING**2).any())


def worst(direction, seconds):
    """The disturbance of norm `L_D` that takes ``direction @ s`` farthest at the end."""
    t = np.arange(round(seconds / DT))[::-1] * DT + 0.5 * DT
    step, pull, pulls = expm(A_K * DT), np.asarray(direction) @ expm(A_K * 0.5 * DT), []
    for _ in t:
        pulls.append(pull @ E)
        pull = pull @ step
    pulls = np.array(pulls[::-1])
    return L_D * pulls / np.linalg.norm(pulls, axis=1, keepdims=True)


def random_pushes(seconds=30):
    v = np.random.default_rng(4).normal(size=(2 * seconds, 2))
    return np.repeat(L_D * v / np.linalg.norm(v, axis=1, keepdims=True), 50, axis=0)


@pytest.mark.parametrize("direction", np.eye(4))
def test_a_linear_loop_under_its_worst_disturbance_stays_below_its_bound(direction):
    check, _ = linear_flight(worst(direction, 30.0), np.zeros(4))

    assert not exceeded(check)
    assert check.radius == pytest.approx(invariant_ellipsoid(A_K, E, L_d=L_D).radius, rel=1e-6)
    assert check.size.max() > 0.5 * check.radius  # the bound is not far above it


def test_what_a_disturbance_adds_grows_from_nothing():
    """After the first second V' = a (L_d^2 - V) has come to 1 - exp(-a)."""
    check, _ = linear_flight(random_pushes(2), np.zeros(4))
    second = round(1.0 / DT)

    since = check.t[second] - check.t[0]
    added = UNIT.radius * L_D * np.sqrt(1.0 - np.exp(-UNIT.multiplier * since))
    start = check.bound[0] * np.exp(-0.5 * FIGURES.R_K * since)
    assert check.bound[second] == pytest.approx(start + added)


def test_there_is_no_bound_while_a_limit_holds_a_command_and_it_starts_anew_behind_it():
    check, run = linear_flight(random_pushes(), [0.3, -0.2, -1.0, 0.5], limited_until=4.0)
    first = int(np.searchsorted(check.t, 4.0))

    assert np.isnan(check.bound[:first]).all()
    assert np.isfinite(check.bound[first:]).all()
    Q, s = FIGURES.Q, linear_loop.error_states(run)[0][first]
    assert check.bound[first] == pytest.approx(np.sqrt(s @ Q @ s / np.linalg.eigvalsh(Q)[0]))


@pytest.mark.parametrize("by", [(0.8, 0.0), (0.0, 0.8)])
def test_a_step_of_the_reference_does_not_break_the_bound(by):
    v = worst([0.0, 0.0, *np.sign(by)], 40.0)
    check, _ = linear_flight(v, np.zeros(4), moved_at=15.0, by=by)

    around = (check.t > 15.1) & (check.t < 16.0)
    assert (check.size[around] > check.radius).all()
    assert not exceeded(check)
    assert np.isnan(check.bound).sum() == 2  # up and flat again


@pytest.mark.slow
def test_an_aircraft_has_no_bound_and_the_law_beside_it_the_one_of_its_stated_disturbance():
    stall = ft.fly(shortened("weak_engine", 13.0)).runs
    assert {run.status for run in stall if run.provenance.aircraft} == {"left_envelope"}
    assert all(
        (linear_loop.linear_bound(run) is None) == bool(run.provenance.aircraft) for run in stall
    )

    (disturbed,) = ft.fly(shortened("paper_as_printed", 10.0)).runs
    assert linear_loop.linear_bound(disturbed).radius == pytest.approx(
        0.1 * 0.15 * unit_radius(15.0)
    )
