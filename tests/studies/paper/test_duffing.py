"""The Duffing oscillator against closed forms and an independent integrator."""

import math

import numpy as np
import pytest

from flighttune.studies.paper import duffing

ROUNDING = 1e-12
DIFFERENCE = 1e-6
DERIVATIVE = 1e-8
GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0

PRINTED = duffing.Duffing(alpha=0.5, beta=0.25, delta=1.5)


@pytest.mark.parametrize("x", [(0.0, 0.0), (1.3, -0.7), (-2.0, 3.0)])
def test_the_jacobian_is_that_of_the_rates(x):
    x = np.array(x)
    differences = np.column_stack(
        [
            (PRINTED.rates(x + step) - PRINTED.rates(x - step)) / (2.0 * DIFFERENCE)
            for step in DIFFERENCE * np.eye(2)
        ]
    )

    assert PRINTED.jacobian(x) == pytest.approx(differences, abs=DERIVATIVE)


def test_the_condition_of_the_theorem_ends_where_the_quadratic_says():
    edge = math.sqrt((1.0 + math.sqrt(2.0)) / (3.0 * 0.25))

    assert PRINTED.region == pytest.approx(edge, rel=ROUNDING)
    assert PRINTED.margin(0.0) == pytest.approx(1.0, abs=ROUNDING)
    assert PRINTED.margin(0.999 * edge) > 0.0 > PRINTED.margin(1.001 * edge)
    assert PRINTED.bound(1.0, half_width=1.001 * edge) == (0.0, math.inf)
    assert duffing.Duffing(alpha=1.0, beta=0.0, delta=1.0).region == math.inf


def test_inside_a_strip_V_decays_at_the_rate_of_the_theorem_for_that_strip():
    case = duffing.DuffingCase(PRINTED, np.zeros((200, 1)))
    f = PRINTED.rates(case.x[:, 0])
    V = np.einsum("ki,ij,kj->k", f, PRINTED.P, f)
    rate, _ = PRINTED.bound(0.0, half_width=case.farthest)

    assert case.farthest < PRINTED.region
    assert rate > 0.0
    assert (V <= V[0] * np.exp(-rate * case.t) * (1.0 + 1e-6)).all()


def test_smoothness_alone_proves_the_condition_in_a_smaller_disc():
    r = PRINTED.smooth_region
    x, y = np.random.default_rng(0).uniform(-r, r, (2, 10_000, 2)) / math.sqrt(2.0)
    apart = np.linalg.norm(PRINTED.jacobian(x) - PRINTED.jacobian(y), 2, axis=(1, 2))

    assert r == pytest.approx(1.0 / (math.sqrt(12.0 * 0.25) * GOLDEN), rel=ROUNDING)
    assert np.max(apart / np.linalg.norm(x - y, axis=1)) <= PRINTED.smoothness(r)
    assert PRINTED.margin(r) > 0.0
    assert r < PRINTED.region


def test_the_slowest_decay_is_that_of_the_poles_over_the_rate_of_the_theorem():
    """At the origin the rate is 1 over the largest eigenvalue of P; poles are of s^2 + d s + a."""
    ratios = []
    for alpha in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0):
        for delta in (0.2, 0.5, 1.0, 1.5, 3.0):
            p_12 = 0.5 / alpha
            p_22 = (1.0 + 2.0 * p_12) / (2.0 * delta)
            P = [[alpha * p_22 + delta * p_12, p_12], [p_12, p_22]]
            slowest = min(-np.roots([1.0, delta, alpha]).real)
            ratios.append(slowest * np.linalg.eigvalsh(P)[-1])

    assert duffing.DuffingCases().slowest_decay == pytest.approx(min(ratios))
    assert min(ratios) > 0.5  # which the theorem claims
