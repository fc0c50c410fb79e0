"""The inequalities of a certificate: valid ones are proven, changed ones refused by name."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from flighttune.theory.exact import Verification, exact, provable_rate, radius_checks, rate_checks

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


def ellipsoid(a=1.0, L_d=0.2):
    shifted = A + a / 2.0 * np.eye(2)
    load = E @ E.T + 1e-6 * np.eye(2)
    W = solve_continuous_lyapunov(shifted, -load * L_d**2 / a)
    return (W + W.T) / 2.0, float(np.sqrt(np.linalg.eigvalsh(W)[-1])) * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["radius", "multiplier"])
def test_a_radius_and_a_multiplier_must_be_positive(name):
    W, radius = ellipsoid()
    stated = {"multiplier": 1.0, "radius": radius, "L_d": 0.2}

    assert Verification.of(radius_checks(VERTICES, E, W, **stated)).valid
    verdict = Verification.of(radius_checks(VERTICES, E, W, **stated | {name: -stated[name]}))

    assert verdict.reason.startswith(f"{name} > 0 does not hold: margin ")


def test_an_asymmetric_Q_is_refused():
    Q, rate = provable_rate(VERTICES, lyapunov_Q())
    Q = Q + np.array([[0.0, 1e-15], [0.0, 0.0]])

    assert not Verification.of(rate_checks(VERTICES, Q, rate=rate)).valid
