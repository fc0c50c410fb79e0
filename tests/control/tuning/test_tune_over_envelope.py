"""Rates over an envelope: rigorous against corners, K* against tuned gains, and tuned for it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.linear_model import Envelope, jacobian_hull
from flighttune.control.theory.lyapunov import common_Q
from flighttune.control.tuning import envelope as tuning
from flighttune.control.tuning.program import stabilising_starts
from flighttune.control.tuning.tune import smallest_radius
from tests.control.tuning.conftest import relaxed

pytestmark = pytest.mark.slow

G = 9.81
TRIM = Envelope.at(V_a=25.0, gamma=np.pi / 12)
TUNED = ft.PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=3.8753 * np.eye(2))
LAG_AWARE = ft.PIGains(K_P=np.diag([3.17, 2.90]), K_I=np.diag([1.13, 0.92]))
SETS = (ft.PAPER_GAINS, TUNED, LAG_AWARE)
SOLVER = 1e-6
LOCAL = 1e-4


def envelope(V_a, gamma_deg, phi_deg, n_z):
    return Envelope(
        V_a=V_a, gamma=tuple(np.deg2rad(gamma_deg)), phi=tuple(np.deg2rad(phi_deg)), n_z=n_z
    )


FIXED_SPEED = envelope((25.0, 25.0), (-15.0, 45.0), (0.0, 0.0), (1.0, 1.0))
LEVEL = envelope((22.0, 28.0), (-15.0, 45.0), (0.0, 0.0), (1.0, 1.0))
GENTLE = envelope((22.0, 28.0), (-15.0, 45.0), (-20.0, 20.0), (0.8, 1.3))
MODERATE = envelope((20.0, 30.0), (-20.0, 45.0), (-30.0, 30.0), (0.7, 1.5))
STEEP = envelope((20.0, 30.0), (-20.0, 45.0), (-45.0, 45.0), (0.5, 2.1))

TABLE = [  # rates of K*, the optimum for I* = 5 and lag-aware gains; None: no common Q
    # envelope,  corners of the conditions,  polytope
    (FIXED_SPEED, (0.367, 0.461, 0.256), (0.367, 0.461, 0.256)),
    (LEVEL, (0.274, 0.377, 0.228), (0.274, 0.377, 0.228)),
    (GENTLE, (0.095, 0.209, 0.175), (0.0658, 0.172, 0.166)),
    (MODERATE, (None, 0.055, 0.111), (None, 0.0276, 0.0887)),
    (STEEP, (None, 0.0085, 0.0335), (None, 0.0007, 0.0148)),
]
SHOWN = 0.006  # half a unit of three digits, relative


def corner_rate(gains, envelope):
    """Without the polytopes: the law linearised at the 16 corners of the conditions."""
    corners = itertools.product(envelope.V_a, envelope.gamma, envelope.phi, envelope.n_z)
    models = [
        ft.loop.kinematic_model(V_a=V_a, gamma=gamma, phi=phi, n_z=n_z, g=G)
        for V_a, gamma, phi, n_z in corners
    ]
    return common_Q(np.array([ft.loop.closed_loop(model, gains) for model in models])).R


@pytest.mark.soak
@pytest.mark.parametrize(("over", "corners", "polytope"), TABLE)
def test_rates_fall_from_corners_to_the_polytope(over, corners, polytope):
    for gains, at_corners, inside in zip(SETS, corners, polytope, strict=True):
        rates = corner_rate(gains, over), tuning.envelope_rate(gains, over, g=G).R
        expected = [0.0 if rate is None else rate for rate in (at_corners, inside)]
        assert rates == pytest.approx(expected, rel=SHOWN, abs=5e-5)
        assert rates[0] * (1.0 + SOLVER) >= rates[1]


def test_one_common_Q_holds_at_a_thousand_conditions_drawn_from_the_envelope():
    Q = tuning.envelope_rate(TUNED, GENTLE, g=G).Q
    rng = np.random.default_rng(0)
    low, high = np.array([GENTLE.V_a, GENTLE.gamma, GENTLE.phi, GENTLE.n_z]).T

    for V_a, gamma, phi, n_z in rng.uniform(low, high, size=(1000, 4)):
        A = ft.loop.closed_loop(
            ft.loop.kinematic_model(V_a=V_a, gamma=gamma, phi=phi, n_z=n_z, g=G), TUNED
        )
        assert np.linalg.eigvalsh(A.T @ Q + Q @ A + np.eye(4))[-1] < SOLVER


@pytest.mark.soak
def test_the_papers_gains_certify_a_narrower_envelope_than_the_tuned_ones():
    factors = [tuning.largest_factor(gains, MODERATE, TRIM, g=G) for gains in SETS]

    assert factors == pytest.approx([0.822, 1.410, 1.994], abs=2e-3)


@pytest.mark.soak
def test_a_curve_of_rates_starts_at_that_of_the_trim_and_falls(model):
    _, rates = tuning.rate_curve(TUNED, MODERATE, TRIM, g=G, up_to=1.2)

    at_trim = ft.loop.indicators(ft.loop.closed_loop(model, TUNED)).R_K
    assert rates[0] == pytest.approx(at_trim, rel=10.0 * SOLVER)
    assert (np.diff(rates) < 0.0).all()


@pytest.mark.parametrize(
    ("factor", "R_K"), [(math.inf, 0.53976), (7.0, 0.526)], ids=["free", "limited"]
)
def test_the_ascent_over_one_condition_ends_at_the_largest_rate(model, printed, factor, R_K):
    """That which `tune` finds by a smooth program, from the gains of the smallest I_K."""
    problem = replace(printed, limits=None) if factor == math.inf else relaxed(printed, factor)
    smallest = smallest_radius(problem, stabilising_starts(problem, 4))

    start = tuning.point(problem, [model], smallest.K[problem.free])
    best = tuning.ascend(problem, [model], start)

    assert start.common.R < 0.95 * R_K
    assert best.common.R == pytest.approx(R_K, rel=1e-3)
    assert best.trim.I_K == pytest.approx(5.0, rel=1e-3)
    assert (problem.slack(best.k) >= 0.0).all()


def test_gains_that_break_a_constraint_are_no_point_of_the_search(model, printed):
    free = replace(printed, limits=None)
    k = ft.PAPER_GAINS.K[free.free]

    assert tuning.point(free, [model], k) is not None
    assert tuning.point(replace(free, I_star=4.9), [model], k) is None  # its I_K is 4.916
    assert tuning.point(printed, [model], k) is None  # its first commands need 7 times the limits
    assert (
        tuning.point(replace(free, K_max=np.full((2, 4), 3.0)), [model], k) is None
    )  # K_I is 3.49
    assert tuning.point(free, [model], -k) is None  # unstable
    # two models without a common Q
    other = ft.loop.kinematic_model(V_a=25.0, gamma=np.pi / 12, phi=1.5, n_z=0.1, g=G)
    assert tuning.point(free, [model, other], k) is None


@pytest.fixture(scope="module")
def tuned(model):
    return tuning.tune_over_envelope(
        ft.loop.TuningProblem(model=model, I_star=10.0), MODERATE, TRIM, g=G
    )


@pytest.mark.counts
def test_gains_tuned_for_the_envelope_beat_those_tuned_for_the_trim_and_keep_the_radius(
    model, tuned
):
    assert tuned.status == "found"
    assert tuned.I_K <= 10.0
    assert ft.loop.indicators(ft.loop.closed_loop(model, tuned.gains)).I_K == pytest.approx(
        tuned.I_K
    )
    assert tuning.envelope_rate(tuned.gains, MODERATE, g=G).R == pytest.approx(tuned.R_envelope)
    nominal = ft.tune(ft.loop.TuningProblem(model=model, I_star=10.0))
    assert tuned.R_envelope > 1.005 * tuning.envelope_rate(nominal.gains, MODERATE, g=G).R
    assert tuned.R_K < nominal.R_K


@pytest.mark.soak
def test_no_gains_nearby_are_better(model, tuned):
    problem = ft.loop.TuningProblem(model=model, I_star=10.0)
    models = jacobian_hull(MODERATE, g=G).models()
    k = tuned.gains.K[problem.free]
    rng = np.random.default_rng(0)
    sizes = 10.0 ** rng.uniform(-4.0, -0.7, size=(80, 1))

    nearby = [tuning.point(problem, models, k + step) for step in sizes * rng.normal(size=(80, 8))]

    feasible = [one.common.R for one in nearby if one is not None]
    assert len(feasible) > 10
    assert max(feasible) < (1.0 + LOCAL) * tuned.R_envelope


@pytest.mark.soak
def test_input_limits_hold_at_the_gains_tuned_for_an_envelope(printed):
    problem = replace(relaxed(printed, 8.0), I_star=10.0)
    limits, x_0 = problem.limits, problem.x_0

    found = tuning.tune_over_envelope(problem, GENTLE, TRIM, g=G, starts=0)

    u = found.gains.K @ np.concatenate([x_0, 0.1 * x_0])
    u_dot = found.gains.K @ np.concatenate([np.zeros(2), x_0])
    assert found.status == "found"
    assert ((limits.lower <= u) & (u <= limits.upper)).all()
    assert ((limits.rate_lower <= u_dot) & (u_dot <= limits.rate_upper)).all()
    assert 0.6 < found.R_envelope < 0.7066  # without limits


@pytest.mark.soak
def test_an_envelope_out_of_reach_is_a_result_that_says_how_far_gains_got(model):
    wide = envelope((15.0, 40.0), (-30.0, 60.0), (-60.0, 60.0), (-1.0, 3.0))

    found = tuning.tune_over_envelope(
        ft.loop.TuningProblem(model=model, I_star=5.0), wide, TRIM, g=G, starts=0
    )

    assert found.status == "infeasible"
    assert found.reason.startswith("No common Q was found beyond 0.6")
    assert found.R_envelope == 0.0
    assert found.gains is not None


@pytest.mark.soak
def test_a_problem_without_feasible_gains_is_infeasible_here_too(model):
    found = tuning.tune_over_envelope(
        ft.loop.TuningProblem(model=model, I_star=4.0), GENTLE, TRIM, g=G
    )

    assert found.status == "infeasible"
    assert "`I_star` must be at least 4.85" in found.reason
    assert found.gains is None


OUTSIDE = Envelope.at(V_a=40.0, gamma=0.0)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (lambda _: tuning.largest_factor(TUNED, GENTLE, OUTSIDE, g=G), "`envelope` must contain"),
        (
            lambda model: tuning.tune_over_envelope(
                ft.loop.TuningProblem(model=model), GENTLE, OUTSIDE, g=G
            ),
            "`envelope` must contain",
        ),
        (
            lambda model: tuning.tune_over_envelope(
                ft.loop.TuningProblem(model=model, scaling=np.array([1.0, 1.0, 2.0, 2.0])),
                GENTLE, TRIM, g=G,
            ),
            "`scaling`",
        ),
    ],
    ids=["factor", "tuning", "scaling"],
)  # fmt: skip
def test_an_envelope_without_the_trim_and_a_state_scaling_are_refused(model, asked, words):
    with pytest.raises(ft.InputError, match=words):
        asked(model)
