"""What a certificate claims, held against flights of the nonlinear chi/gamma law."""

import numpy as np
import pytest
from printed import L_D, MODEL
from scipy.integrate import solve_ivp

from flighttune.certificates.make import certify_model
from tests.certificates.test_certify import ENVELOPE, TUNED, G

GAMMA = np.pi / 12
INTEGRATION = 1e-6


@pytest.fixture(scope="module")
def certificate():
    return certify_model(MODEL, TUNED, envelope=ENVELOPE, g=G, L_d=L_D).certificate


def errors_rate(V_a, e, u, d):
    """Eq. (39) of arXiv 2411.13140: e' of the law, course reference 0, no limits."""
    phi, n_z = u
    return -np.array(
        [G / V_a * np.tan(phi), G / V_a * (n_z * np.cos(phi) - np.cos(GAMMA - e[1]))]
    ) - np.asarray(d)


def flight(V_a, e_0, d, duration):
    """s = (e', e) over time, and the commands, from a start trimmed but for the error."""
    xi_0 = np.linalg.solve(TUNED.K_I, [0.0, np.cos(GAMMA)])

    def rates(t, y):
        e, xi = y[:2], y[2:]
        return np.concatenate([errors_rate(V_a, e, TUNED.K_P @ e + TUNED.K_I @ xi, d(t)), e])

    t = np.linspace(0.0, duration, 4001)
    flown = solve_ivp(
        rates, (0.0, duration), np.concatenate([e_0, xi_0]), t_eval=t, rtol=1e-10, atol=1e-12
    )
    e, xi = flown.y[:2], flown.y[2:]
    u = TUNED.K_P @ e + TUNED.K_I @ xi
    e_dot = np.array([errors_rate(V_a, *at) for at in zip(e.T, u.T, map(d, t), strict=True)]).T
    return t, np.vstack([e_dot, e]), u


def stays_inside(s, u):
    ranges = (GAMMA - s[3], ENVELOPE.gamma), (u[0], ENVELOPE.phi), (u[1], ENVELOPE.n_z)
    return all(low <= x.min() and x.max() <= high for x, (low, high) in ranges)


@pytest.mark.parametrize("V_a", [22.0, 24.3, 28.0])
@pytest.mark.parametrize("e_0", [(0.1, -0.05), (-0.12, 0.08), (0.0, 0.1)])
def test_the_quadratic_form_decays_at_the_certified_rate_inside_the_envelope(certificate, V_a, e_0):
    t, s, u = flight(V_a, np.array(e_0), lambda _: (0.0, 0.0), 15.0)

    form = np.einsum("it,ij,jt->t", s, certificate.Q, s)

    assert stays_inside(s, u)
    allowed = form[:-1] * np.exp(-certificate.claim.rate * np.diff(t))
    assert (form[1:] <= allowed * (1.0 + INTEGRATION) + 1e-14).all()


@pytest.mark.slow
@pytest.mark.parametrize("V_a", [22.0, 28.0])
@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_a_disturbance_of_the_papers_rate_leaves_the_loop_inside_the_certified_radius(
    certificate, V_a, sense
):
    """Half the amplitude at twice the frequency: the paper's own takes n_z out of this envelope."""

    def d(t):
        return 0.05 * np.sin(0.3 * t), sense * 0.05 * np.cos(0.3 * t)

    t, s, u = flight(V_a, np.zeros(2), d, 100.0)

    settled = t > 40.0
    assert stays_inside(s[:, settled], u[:, settled])
    assert np.linalg.norm(s[:, settled], axis=0).max() < certificate.claim.radius
