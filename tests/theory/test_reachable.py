"""Bounds against flights of the linear loop under the worst disturbance and random ones."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from printed import A_K, L_D, MODEL, E
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from worst_reach import largest_reach, worst_disturbance

from flighttune.control.gains import PIGains
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.theory import reachable as tabulated
from flighttune.theory.attractor import invariant_ellipsoid, paper_balls
from flighttune.theory.indicators import indicators
from flighttune.theory.reachable import ReachableSet

REACHED = 0.01
QUADRATURE = 1e-6
KINKS = 1e-4  # of the integral of a function that changes sign

FLIGHTS = {
    "paper": A_K,
    "tuned": closed_loop(
        MODEL, PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=np.diag([3.8753, 3.8753]))
    ),
    "coupled": closed_loop(
        MODEL, PIGains(K_P=np.array([[1.5, 0.4], [-0.9, 3.0]]), K_I=np.diag([1.0, 5.0]))
    ),
}


@cache
def bounds(name):
    """Every bound of a loop: exact, ellipsoid, peak gain, ball."""
    A = FLIGHTS[name]
    reachable = ReachableSet.of(A, E, L_d=L_D)
    return (
        largest_reach(reachable),
        invariant_ellipsoid(A, E, L_d=L_D),
        reachable.peak_gain(),
        paper_balls(A, MODEL.A, I_K=indicators(A).I_K, L_d=L_D)[0],
    )


@pytest.fixture(scope="module")
def reachable():
    return ReachableSet.of(A_K, E, L_d=L_D)


def test_the_peak_gain_of_the_papers_loop_is_0_0425_and_0_0251_for_x_alone(reachable):
    assert reachable.peak_gain().s == pytest.approx(0.0425, abs=5e-5)
    assert reachable.peak_gain(slice(2, 4)).s == pytest.approx(0.0251, abs=5e-5)


@pytest.mark.slow
def test_the_exact_radius_of_the_papers_loop_is_0_0318_and_the_search_is_proven_complete():
    exact, _, _, _ = bounds("paper")

    assert exact.radius == pytest.approx(0.0318, abs=5e-5)
    assert exact.upper == pytest.approx(exact.radius, rel=QUADRATURE)
    assert np.linalg.norm(exact.direction) == pytest.approx(1.0)


@pytest.mark.slow
def test_the_ellipsoid_is_within_5_percent_and_the_papers_ball_7_6_times_above():
    exact, ellipsoid, _, ball = bounds("paper")

    assert exact.radius < ellipsoid.radius < 1.05 * exact.radius
    assert ball / exact.radius == pytest.approx(7.6, abs=0.05)


def test_the_peak_gain_of_an_oscillator_is_known_on_paper():
    """x'' + 2 d x' + w0^2 x = v: the integral of the impulse's size is coth(pi d/2w) / w0^2."""
    d, w = 0.2, 1.7
    oscillator = np.array([[-2.0 * d, -(d**2 + w**2)], [1.0, 0.0]])

    gain = ReachableSet.of(oscillator, [[1.0], [0.0]], L_d=1.0).peak_gain()

    expected = 1.0 / math.tanh(math.pi * d / (2.0 * w)) / (d**2 + w**2)
    assert gain.channels[1] == pytest.approx(expected, rel=KINKS)


def test_the_reach_of_decoupled_decays_is_known_on_paper():
    """Each v_i alone: s_i reaches L_d / k_i; the farthest is along the slowest."""
    exact = largest_reach(ReachableSet.of(-np.diag([1.0, 4.0]), np.eye(2), L_d=0.5))

    assert exact.radius == pytest.approx(0.5, rel=QUADRATURE)
    assert np.abs(exact.direction) == pytest.approx([1.0, 0.0], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_the_worst_disturbance_reaches_the_exact_figure_within_1_percent(name):
    A = FLIGHTS[name]
    reachable = ReachableSet.of(A, E, L_d=L_D)
    exact, ellipsoid, gain, _ = bounds(name)
    duration = 12.0 / -np.linalg.eigvals(A).real.max()
    v = worst_disturbance(reachable, exact.direction, duration)

    flight = solve_ivp(
        lambda t, s: A @ s + E @ v(t), (0.0, duration), np.zeros(4), rtol=1e-6, atol=1e-9
    )

    reached = np.linalg.norm(flight.y, axis=0).max()
    assert (1.0 - REACHED) * exact.radius < reached < (1.0 + QUADRATURE) * exact.upper
    assert reached < min(ellipsoid.radius, gain.s)


@pytest.mark.parametrize("channel", range(4))
def test_the_worst_disturbance_of_a_channel_reaches_its_peak_gain(reachable, channel):
    duration = 40.0
    c = np.eye(4)[channel]
    v = worst_disturbance(reachable, c, duration)

    flight = solve_ivp(
        lambda t, s: A_K @ s + E @ v(t), (0.0, duration), np.zeros(4), rtol=1e-6, atol=1e-9
    )

    bound = reachable.peak_gain().channels[channel]
    assert flight.y[channel, -1] == pytest.approx(bound, rel=REACHED)
    assert flight.y[channel, -1] < bound * (1.0 + QUADRATURE)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    name=st.sampled_from(sorted(FLIGHTS)),
    seed=st.integers(0, 2**32),
    hold=st.floats(0.05, 6.0),
    steady=st.booleans(),
)
def test_no_bound_is_broken_by_disturbances_within_l_d(name, seed, hold, steady):
    """Piecewise constant ones, flown exactly; turning in a sense or drawn anew every `hold`."""
    A = FLIGHTS[name]
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.normal(size=200)) if steady else rng.uniform(0.0, math.tau, 200)
    v = L_D * np.column_stack([np.cos(angles), np.sin(angles)])
    across = expm(np.block([[A, E], [np.zeros((2, 6))]]) * hold)
    states = [np.zeros(4)]
    for held in v:
        states.append(across[:4, :4] @ states[-1] + across[:4, 4:] @ held)
    states = np.array(states)

    farthest = np.linalg.norm(states, axis=1).max()
    exact, ellipsoid, gain, ball = bounds(name)
    forms = np.einsum("ti,ij,tj->t", states, np.linalg.inv(ellipsoid.W), states)

    assert farthest <= exact.upper
    assert forms.max() <= 1.0
    assert farthest <= gain.s
    assert (np.abs(states).max(axis=0) <= gain.channels).all()
    assert farthest <= ball


def test_a_stiff_loop_is_tabulated_on_few_panels():
    stiff = ReachableSet.of(-np.diag([1e-2, 1e4]), np.eye(2), L_d=1.0)

    assert len(stiff.t) < 5000
    assert stiff.reach([0.0, 1.0]) == pytest.approx(1e-4, rel=QUADRATURE)
    assert stiff.reach([1.0, 0.0]) == pytest.approx(1e2, rel=QUADRATURE)


def test_a_loop_that_hardly_decays_in_many_oscillations_is_refused(monkeypatch):
    monkeypatch.setattr(tabulated, "MAX_PANELS", 500)
    with pytest.raises(InputError, match="`A`"):
        ReachableSet.of([[-1e-6, 1.0], [-1.0, -1e-6]], np.eye(2), L_d=1.0)
