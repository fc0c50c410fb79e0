"""The inequalities of a certificate: valid ones are proven, changed ones refused by name."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from flighttune.theory.exact import (
    Check,
    Verification,
    exact,
    provable_rate,
    radius_checks,
    rate_checks,
)

A = np.array([[-1.0, 2.0], [0.0, -3.0]])
E = np.array([[1.0], [1.0]])
VERTICES = [exact(A)]
RATE_LOSS = 1e-8


def lyapunov_Q():
    return solve_continuous_lyapunov(A.T, -np.eye(2))


def test_the_lyapunov_solution_is_inflated_until_its_rate_is_proven():
    Q, rate = provable_rate(VERTICES, lyapunov_Q())

    assert Verification.of(rate_checks(VERTICES, Q, rate=rate)).valid
    assert rate == pytest.approx(1.0 / np.linalg.eigvalsh(lyapunov_Q())[-1], rel=RATE_LOSS)


def test_the_lyapunov_solution_itself_is_not_proven_because_it_only_meets_an_equation():
    rate = 0.9 / np.linalg.eigvalsh(lyapunov_Q())[-1]

    assert not Verification.of(rate_checks(VERTICES, lyapunov_Q(), rate=rate)).valid


def test_a_Q_of_an_unstable_loop_cannot_be_inflated_into_a_proof():
    assert provable_rate([exact([[0.1]])], np.array([[1.0]])) is None


def test_a_rate_above_the_proven_one_is_refused_and_the_inequality_named():
    Q, rate = provable_rate(VERTICES, lyapunov_Q())

    verdict = Verification.of(rate_checks(VERTICES, Q, rate=1.01 * rate))

    assert not verdict.valid
    assert verdict.reason == "rate Q <= I does not hold: margin -0.01."


def test_a_Q_that_fails_at_one_vertex_is_refused_with_the_vertex_and_the_margin():
    Q, rate = provable_rate(VERTICES, lyapunov_Q())
    faster = [*VERTICES, exact(A + np.diag([0.5, 0.0]))]

    verdict = Verification.of(rate_checks(faster, Q, rate=rate))
    margin = -np.linalg.eigvalsh(
        (A + np.diag([0.5, 0.0])).T @ Q + Q @ (A + np.diag([0.5, 0.0])) + np.eye(2)
    )[-1]

    assert not verdict.valid
    assert "A' Q + Q A + I <= 0 at vertex 2 of 2" in verdict.reason
    assert f"margin {margin:.3g}" in verdict.reason


def ellipsoid(a=1.0, L_d=0.2):
    shifted = A + a / 2.0 * np.eye(2)
    load = E @ E.T + 1e-6 * np.eye(2)
    W = solve_continuous_lyapunov(shifted, -load * L_d**2 / a)
    return (W + W.T) / 2.0, float(np.sqrt(np.linalg.eigvalsh(W)[-1])) * (1.0 + 1e-9)


def test_an_invariant_ellipsoid_is_proven():
    W, radius = ellipsoid()

    checks = radius_checks(VERTICES, E, W, multiplier=1.0, radius=radius, L_d=0.2)

    assert Verification.of(checks).valid


@pytest.mark.parametrize(
    ("changes", "inequality"),
    [
        ({"radius": 0.99}, "W <= radius^2 I"),
        ({"L_d": 1.01}, "A W + W A' + a W + (L_d^2/a) E E' <= 0 at vertex 1 of 1"),
        ({"multiplier": 1.01}, "A W + W A' + a W + (L_d^2/a) E E' <= 0 at vertex 1 of 1"),
        ({"radius": 0.0}, "radius > 0"),
        ({"multiplier": -1.0}, "multiplier > 0"),
    ],
)
def test_a_changed_radius_claim_is_refused_and_the_inequality_named(changes, inequality):
    W, radius = ellipsoid()
    stated = {"multiplier": 1.0, "radius": radius, "L_d": 0.2}
    stated |= {key: factor * stated[key] for key, factor in changes.items()}

    verdict = Verification.of(radius_checks(VERTICES, E, W, **stated))

    assert not verdict.valid
    assert verdict.reason.startswith(f"{inequality} does not hold: margin ")


def test_an_asymmetric_Q_is_refused():
    Q, rate = provable_rate(VERTICES, lyapunov_Q())
    Q = Q + np.array([[0.0, 1e-15], [0.0, 0.0]])

    assert not Verification.of(rate_checks(VERTICES, Q, rate=rate)).valid


def test_a_verdict_counts_what_else_fails():
    checks = [
        Check(name="one", margin=-1.0, exact=False),
        Check(name="two", margin=-2.0, exact=False),
        Check(name="three", margin=1.0, exact=True),
    ]

    assert Verification.of(checks).reason == "two does not hold: margin -2; 1 more fail."
