"""The XML of Aerosonde and X8 against published coefficients, and flight without a rudder."""

import math
import re

import numpy as np
import published_aerosonde
import pytest
from airframes import fdm_of
from places import SHIPPED_AIRCRAFT
from published_aerosonde import RHO_1000_M, evaluated, measured, turning, wind_to_body
from scipy.optimize import fsolve

import flighttune as ft

DEG = math.pi / 180.0
ONE_PER_MILLE = 1e-3
MASS, S, SPAN, CHORD, MOTOR = 3.364, 0.75, 2.1, 0.357143, 20.0
G_0 = 9.80665
J = np.array([[0.325, 0.0, -0.029], [0.0, 0.140, 0.0], [-0.029, 0.0, 0.400]])


def lift_drag_pitch(alpha, beta, q_hat, elevator):
    """Coefficients of Gryte et al., 2018."""
    return (
        0.0867356 + 4.02033 * alpha + 3.87 * q_hat + 0.278074 * elevator,
        0.0197 + 0.0790915 * alpha + 1.05547 * alpha**2 - 0.00584298 * beta + 0.147812 * beta**2
        + 0.0633474 * elevator**2,
        0.02275 - 0.4629 * alpha - 1.301237 * q_hat - 0.2292 * elevator,
    )  # fmt: skip


def accelerations(V_a, alpha, beta, rates, surfaces, throttle):
    """Accelerations without gravity (m/s2) and angular accelerations (rad/s2), body axes."""
    (p, q, r), (aileron, elevator, _) = rates, surfaces
    p_hat, r_hat = (rate * SPAN / (2 * V_a) for rate in (p, r))
    C_L, C_D, C_m = lift_drag_pitch(alpha, beta, q * CHORD / (2 * V_a), elevator)
    C_Y = -0.223872 * beta - 0.137355 * p_hat + 0.0838688 * r_hat + 0.0432764 * aileron
    C_l = -0.0848963 * beta - 0.404198 * p_hat + 0.0555206 * r_hat + 0.120188 * aileron
    C_n = 0.0283 * beta + 0.00436551 * p_hat - 0.0720 * r_hat - 0.00339 * aileron
    pressure_area = 0.5 * RHO_1000_M * V_a**2 * S
    force = pressure_area * wind_to_body(alpha, beta) @ [-C_D, C_Y, -C_L]
    force[0] += MOTOR * throttle
    moment = pressure_area * np.array([SPAN * C_l, CHORD * C_m, SPAN * C_n])
    return force / MASS, turning(J, moment, rates)


PUBLISHED = {
    "aerosonde": (27.0, published_aerosonde.MASS, published_aerosonde.accelerations),
    "x8": (18.0, MASS, accelerations),
}


@pytest.mark.parametrize("aircraft", PUBLISHED)
@pytest.mark.parametrize(
    ("alpha_deg", "beta_deg", "rates", "surfaces"),
    [
        (3.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (-8.0, 0.0, (0.0, 0.7, 0.0), (0.0, 0.2, 0.0)),
        (6.0, 4.0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
        (2.0, 0.0, (1.2, 0.3, -0.6), (-0.2, -0.1, 0.15)),
        (10.0, -5.0, (-0.5, 0.4, 0.8), (0.25, -0.25, -0.2)),
    ],
)
def test_accelerations_are_those_published(aircraft, alpha_deg, beta_deg, rates, surfaces):
    V_a, mass, published = PUBLISHED[aircraft]
    surfaces = surfaces if aircraft == "aerosonde" else (*surfaces[:2], 0.0)
    state = V_a, alpha_deg * DEG, beta_deg * DEG, rates, surfaces, 0.5

    force, angular = measured(evaluated(fdm_of(aircraft), *state))

    expected, expected_angular = published(*state)
    assert force == pytest.approx(list(mass * expected), rel=ONE_PER_MILLE, abs=0.01 * mass)
    assert angular == pytest.approx(list(expected_angular), rel=ONE_PER_MILLE, abs=0.01)


def test_lift_peaks_at_the_ends_of_the_envelope_of_the_aerosonde():
    xml = (SHIPPED_AIRCRAFT / "aerosonde" / "aerosonde.xml").read_text()
    (table,) = re.findall(r"<tableData>(.*?)</tableData>", xml, re.DOTALL)[:1]
    alpha, C_L = np.fromstring(table, sep=" ").reshape(-1, 2).T
    envelope = ft.loop.JSBSimPlant("aerosonde").config.envelope

    assert envelope.alpha[1] == pytest.approx(alpha[np.argmax(C_L)] * DEG)
    assert alpha[np.argmin(C_L)] * DEG <= envelope.alpha[0]


def test_the_inertia_can_be_that_of_a_body():
    fdm = fdm_of("x8")
    xx, yy, zz, xz = (fdm.reader(f"inertia/i{ij}-slugs_ft2")() for ij in ("xx", "yy", "zz", "xz"))

    moments = np.linalg.eigvalsh([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])

    assert moments[0] > 0.0
    assert moments[2] < moments[0] + moments[1]


@pytest.mark.parametrize("phi_deg", [0.0, -40.0, 25.0])
def test_a_steady_turn_without_a_rudder_is_that_of_the_coefficients(fly, phi_deg):
    phi = phi_deg * DEG

    def unbalanced(x):
        alpha, beta, theta, aileron, elevator, psi_dot, throttle = x
        up = np.array([-math.sin(theta), *(math.cos(theta) * f(phi) for f in (math.sin, math.cos))])
        rates, velocity = psi_dot * up, 18.0 * np.array(
            [math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)]
        )  # fmt: skip
        linear, angular = accelerations(18.0, alpha, beta, rates, (aileron, elevator, 0), throttle)
        linear = linear + G_0 * up - np.cross(rates, velocity)
        return *linear, *angular, velocity @ up

    turn = fsolve(unbalanced, (0.05, 0.0, 0.05, 0.0, 0.0, G_0 / 18.0 * math.tan(phi), 0.2))
    *angles, psi_dot, throttle = turn
    start = fly((phi, 1.0), aircraft="x8", V_a=18.0, phi=phi, duration=0.02)

    names = ("alpha", "beta", "theta", "aileron", "elevator")
    assert [start[name][0] for name in names] == pytest.approx(angles, abs=0.02 * DEG)
    assert start["throttle"][0] == pytest.approx(throttle, abs=ONE_PER_MILLE)
    assert start["rudder"][0] == 0.0
    rate = psi_dot * math.cos(start["theta"][0]) * math.cos(phi)
    assert start["r"][0] == pytest.approx(rate, abs=ONE_PER_MILLE)


@pytest.mark.parametrize("phi_deg", [-40.0, 25.0])
def test_a_turn_without_a_rudder_goes_on_as_it_began(fly, holding_gamma, phi_deg):
    phi = phi_deg * DEG

    turn = fly(holding_gamma(phi), aircraft="x8", V_a=18.0, phi=phi, duration=6.0)

    assert turn["phi"] == pytest.approx(phi, abs=0.2 * DEG)
    assert turn["beta"] == pytest.approx(turn["beta"][0], abs=0.2 * DEG)
    assert turn["r"] == pytest.approx(turn["r"][0], rel=0.02)


def test_aileron_and_elevator_must_be_there(changed_aircraft):
    folder = changed_aircraft("aircraft.toml", r"elevator = .*", "", aircraft="x8")

    with pytest.raises(ft.InputError, match=r"\[surfaces\] `elevator`"):
        ft.loop.JSBSimPlant(folder)
