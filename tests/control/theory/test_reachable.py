"""Ultimate bounds and the largest error of a disturbed loop, against flights and paper."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from printed import A_K, L_D, MODEL, E
from scipy.linalg import expm
from worst_reach import ReachableSet, largest_reach

import flighttune as ft
from flighttune.control.theory import lyapunov
from flighttune.control.theory.reachable import error_slopes, largest_errors, largest_outputs

QUADRATURE = 1e-6
EXACT = 1e-9
SLOPES = 1e-5

FLIGHTS = {
    "paper": A_K,
    "tuned": ft.loop.closed_loop(
        MODEL, ft.PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=np.diag([3.8753, 3.8753]))
    ),
    "coupled": ft.loop.closed_loop(
        MODEL, ft.PIGains(K_P=np.array([[1.5, 0.4], [-0.9, 3.0]]), K_I=np.diag([1.0, 5.0]))
    ),
}


@cache
def bounds(name):
    """Every bound of a loop: exact with its direction, ellipsoid, of each state, ball."""
    A = FLIGHTS[name]
    return (
        largest_reach(ReachableSet.of(A, E, L_d=L_D)),
        lyapunov.invariant_ellipsoid(A, E, L_d=L_D),
        L_D * largest_outputs(A[None], E, np.eye(4))[0],
        lyapunov.paper_balls(A, MODEL.A, I_K=ft.loop.indicators(A).I_K, L_d=L_D)[0],
    )


@pytest.mark.slow
def test_the_ellipsoid_is_within_5_percent_and_the_papers_ball_7_6_times_above():
    (exact, _), ellipsoid, _, ball = bounds("paper")

    assert exact == pytest.approx(0.0318, abs=5e-5)
    assert ellipsoid.radius == pytest.approx(0.0333, abs=5e-5)
    assert exact < ellipsoid.radius < 1.05 * exact
    assert ball / exact == pytest.approx(7.6, abs=0.05)


def test_the_papers_ball_has_three_readings():
    balls = lyapunov.paper_balls(A_K, MODEL.A, I_K=ft.loop.indicators(A_K).I_K, L_d=L_D)

    assert balls == pytest.approx([0.241, 0.104, 0.015], abs=5e-4)


@pytest.mark.slow
def test_a_lightly_damped_loop_leaves_the_ball_of_the_proportional_reading():
    damping = 0.1
    oscillator = np.array([[-damping, -1.0], [1.0, 0.0]])
    safe, proportional, _ = lyapunov.paper_balls(
        oscillator, [[0.0]], I_K=ft.loop.indicators(oscillator).I_K, L_d=1.0
    )

    reached, _ = largest_reach(ReachableSet.of(oscillator, [[1.0], [0.0]], L_d=1.0))

    assert proportional < reached / 5.0
    assert reached < safe


def test_the_ellipsoid_of_a_single_decay_is_the_exact_interval():
    """s' = -k s + v reaches L_d / k; the best multiplier is a = k."""
    k, L_d = 3.0, 0.6

    ellipsoid = lyapunov.invariant_ellipsoid([[-k]], [[1.0]], L_d=L_d)

    assert ellipsoid.radius == pytest.approx(L_d / k, rel=QUADRATURE)
    assert ellipsoid.multiplier == pytest.approx(k, rel=1e-3)


@pytest.mark.parametrize(
    ("A", "E", "L_d", "words"),
    [
        (A_K, E, 0.0, "`L_d` must be positive"),
        (A_K, E, np.nan, "`L_d` must be positive"),
        ([[0.5]], [[1.0]], 1.0, r"`A`.*0\.5"),
        (-np.eye(2), [[0.0], [0.0]], 1.0, r"`E`.*2"),
    ],
)
def test_what_has_no_bound_is_refused_by_name(A, E, L_d, words):
    with pytest.raises(ft.InputError, match=words):
        lyapunov.invariant_ellipsoid(A, E, L_d=L_d)


@pytest.mark.parametrize("L_d", [0.0, np.nan])
def test_the_balls_of_the_paper_have_a_disturbance(L_d):
    with pytest.raises(ft.InputError, match="`L_d` must be positive"):
        lyapunov.paper_balls(A_K, MODEL.A, I_K=1.0, L_d=L_d)


@pytest.mark.slow
@settings(max_examples=15)
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
    (exact, _), ellipsoid, channels, ball = bounds(name)
    forms = np.einsum("ti,ij,tj->t", states, np.linalg.inv(ellipsoid.W), states)

    assert farthest <= exact * (1.0 + QUADRATURE)
    assert forms.max() <= 1.0
    assert (np.abs(states).max(axis=0) <= channels).all()
    assert farthest <= ball


def oscillator_error(p, q):
    """Integral of the size of the impulse response of ``e'' + p e' + q e = d'``, on paper."""
    damping = p / (2.0 * math.sqrt(q))
    ratio = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    return (1.0 + ratio) / (1.0 - ratio) / q


def test_the_slopes_of_a_decoupled_channel_are_those_of_its_formula():
    """The formula has no kinks: differences of it are its slopes to the square of their step."""
    p, q, step = 0.8, 1.5, 1e-5
    by_hand = [
        (oscillator_error(p + step, q) - oscillator_error(p - step, q)) / (2.0 * step),
        (oscillator_error(p, q + step) - oscillator_error(p, q - step)) / (2.0 * step),
    ]
    in_k = np.array([[[-1.0, 0.0], [0.0, 0.0]], [[0.0, -1.0], [0.0, 0.0]]])

    values, slopes = error_slopes(np.array([[-p, -q], [1.0, 0.0]]), in_k, errors=1)

    assert values == pytest.approx([oscillator_error(p, q)], rel=EXACT)
    assert slopes[0] == pytest.approx(by_hand, rel=SLOPES)


@pytest.mark.parametrize("seed", range(4))
def test_any_number_of_states_is_integrated_as_by_brute_force(seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(3, 9)), int(rng.integers(2, 4))
    A = rng.standard_normal((n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    inputs, c = rng.standard_normal((n, m)), rng.standard_normal(n)

    integral = largest_outputs(A[None], inputs, c[None])[0, 0]

    # kinks keep the plain sum, which also leaves out its tail, from more digits
    by_hand = ReachableSet.of(A, inputs, L_d=1.0).reach(c)
    assert integral == pytest.approx(by_hand, rel=1e-7)


def test_a_stiff_or_defective_loop_keeps_its_digits():
    stiff = np.array([[-1e-2, 1.0], [0.0, -1e4]])
    chain = 3.0 * (np.eye(4, k=1) - np.eye(4))

    reached = largest_outputs(stiff[None], np.eye(2)[:, 1:], np.eye(2))[0]
    through = largest_outputs(chain[None], np.eye(4)[:, 3:], np.eye(4)[:1])[0]

    assert reached == pytest.approx([1e-2, 1e-4], rel=EXACT)
    assert through == pytest.approx([1.0 / 3.0], rel=EXACT)


def test_a_loop_without_a_figure_is_a_result():
    hardly_damped = np.array([[-1e-9, -1.0], [1.0, 0.0]])
    loops = np.array([A_K, -A_K, 0.0 * A_K])  # the last has no Lyapunov solution

    assert largest_errors(hardly_damped, errors=1) == np.inf
    assert np.isinf(largest_errors(loops, errors=2)).tolist() == [
        [False] * 2,
        [True] * 2,
        [True] * 2,
    ]
    assert largest_outputs(-np.eye(2)[None], np.eye(2)[:, :1], np.eye(2)[1:]) == 0.0


def test_a_loop_has_its_bits_in_any_stack():
    rng = np.random.default_rng(1)
    loops = rng.normal(size=(40, 4, 4))
    abscissas = np.linalg.eigvals(loops).real.max(axis=1)
    # from quickly to very lightly damped: from a pass of a few panels to many passes
    loops -= np.eye(4) * (abscissas + np.geomspace(1e-3, 3.0, 40))[:, None, None]

    together = largest_errors(loops, errors=2)

    alone = [largest_errors(loop, errors=2) for loop in loops]
    np.testing.assert_array_equal(together, alone)
