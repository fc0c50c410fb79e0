"""The Aerosonde's XML against its published coefficients, put into the equations of motion here."""

import math
import re
import tomllib

import numpy as np
import pytest

from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.aircraft import load_aircraft
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.trim import trim
from flighttune.shipped import aircraft_folder
from flighttune.units import FT, G_0, LBF

DEG = math.pi / 180.0
MASS = 11.0
INERTIA = np.array([[0.8244, 0.0, -0.1204], [0.0, 1.135, 0.0], [-0.1204, 0.0, 1.759]])
S, SPAN, CHORD = 0.55, 2.8956, 0.18994
CG_AFT = np.array([-0.31 * CHORD, 0.0, 0.0])  # body axes, from the point the coefficients refer to
RHO_1000_M = 1.1116  # ISA
ONE_PER_MILLE = 1e-3


def accelerations(V_a, alpha, beta, rates, surfaces, thrust):
    """Return body accelerations (m/s^2, without gravity) and angular accelerations (rad/s^2)."""
    p, q, r = rates
    aileron, elevator, rudder = surfaces
    q_hat, p_hat, r_hat = q * CHORD / (2 * V_a), p * SPAN / (2 * V_a), r * SPAN / (2 * V_a)
    C_L = 0.23 + 5.61 * alpha + 7.95 * q_hat + 0.13 * elevator
    C_D = 0.043 + C_L**2 / (math.pi * 0.9 * SPAN**2 / S) + 0.0135 * abs(elevator)
    C_Y = -0.83 * beta + 0.075 * aileron + 0.19 * rudder
    C_l = -0.13 * beta - 0.51 * p_hat + 0.25 * r_hat + 0.17 * aileron + 0.0024 * rudder
    C_m = 0.0135 - 2.74 * alpha - 38.21 * q_hat - 0.99 * elevator
    C_n = 0.073 * beta - 0.069 * p_hat - 0.095 * r_hat - 0.011 * aileron - 0.069 * rudder
    pressure_area = 0.5 * RHO_1000_M * V_a**2 * S
    # JSBSim's wind axes: drag against the airspeed, side force normal to it.
    drag_side_lift = np.array([-C_D, C_Y, -C_L])
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    wind_to_body = np.array([[ca * cb, -ca * sb, -sa], [sb, cb, 0.0], [sa * cb, -sa * sb, ca]])
    aerodynamic = pressure_area * wind_to_body @ drag_side_lift
    moment = pressure_area * np.array([SPAN * C_l, CHORD * C_m, SPAN * C_n])
    moment += np.cross(-CG_AFT, aerodynamic)
    rates = np.array(rates)
    angular = np.linalg.solve(INERTIA, moment - np.cross(rates, INERTIA @ rates))
    return (aerodynamic + np.array([thrust, 0.0, 0.0])) / MASS, angular


@pytest.mark.parametrize(
    ("alpha_deg", "beta_deg", "rates", "surfaces"),
    [
        (3.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (-8.0, 0.0, (0.0, 0.7, 0.0), (0.0, 0.2, 0.0)),
        (6.0, 4.0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
        (2.0, 0.0, (1.2, 0.3, -0.6), (-0.2, -0.1, 0.15)),
        (10.0, -5.0, (-0.5, 0.4, 0.8), (0.3, -0.3, -0.2)),
    ],
)
def test_accelerations_agree_with_the_published_coefficients(alpha_deg, beta_deg, rates, surfaces):
    V_a, alpha, beta, thrust = 27.0, alpha_deg * DEG, beta_deg * DEG, 60.0
    fdm = Fdm(load_aircraft("aerosonde"), 200.0)
    channels = fdm.config.channels
    settings = {
        "ic/h-sl-ft": 1000.0 / FT,
        "ic/u-fps": V_a / FT * math.cos(alpha) * math.cos(beta),
        "ic/v-fps": V_a / FT * math.sin(beta),
        "ic/w-fps": V_a / FT * math.sin(alpha) * math.cos(beta),
        "ic/p-rad_sec": rates[0],
        "ic/q-rad_sec": rates[1],
        "ic/r-rad_sec": rates[2],
        channels.aileron_trim_rad: surfaces[0],
        channels.elevator_trim_rad: surfaces[1],
        channels.rudder_trim_rad: surfaces[2],
        channels.throttle_trim: thrust / 120.0,
    }
    for name, value in settings.items():
        fdm.writer(name)(value)
    fdm.evaluate()

    expected, expected_angular = accelerations(V_a, alpha, beta, rates, surfaces, thrust)

    force = [fdm.reader(f"forces/fb{axis}-total-lbs")() * LBF for axis in "xyz"]
    angular = [fdm.reader(f"accelerations/{rate}dot-rad_sec2")() for rate in "pqr"]
    assert force == pytest.approx(list(MASS * expected), rel=ONE_PER_MILLE, abs=0.1)
    assert angular == pytest.approx(list(expected_angular), rel=ONE_PER_MILLE, abs=0.01)


@pytest.mark.parametrize("gamma_deg", [0.0, 20.0, 45.0])
def test_trim_balances_weight_in_the_published_coefficients(gamma_deg):
    gamma = gamma_deg * DEG
    fdm = Fdm(load_aircraft("aerosonde"), 200.0)

    found = trim(fdm, FlightCondition(V_a=25.0, gamma=gamma))

    surfaces = found.aileron, found.elevator, found.rudder
    body, angular = accelerations(
        25.0, found.alpha, found.beta, (0.0, 0.0, 0.0), surfaces, 120.0 * found.throttle
    )
    theta = gamma + found.alpha
    weight = G_0 * np.array([-math.sin(theta), 0.0, math.cos(theta)])
    assert body + weight == pytest.approx(0.0, abs=0.02)
    assert angular == pytest.approx(0.0, abs=0.02)


def test_lift_peaks_at_the_ends_of_the_envelope():
    xml = (aircraft_folder("aerosonde") / "aerosonde.xml").read_text()
    table = re.search(r"<tableData>(.*?)</tableData>", xml, re.DOTALL)
    assert table is not None
    alpha, C_L = np.fromstring(table[1], sep=" ").reshape(-1, 2).T
    envelope = load_aircraft("aerosonde").envelope

    assert envelope.alpha[1] == pytest.approx(alpha[np.argmax(C_L)] * DEG)
    assert alpha[np.argmin(C_L)] * DEG <= envelope.alpha[0]


def test_actuator_travel_is_the_same_in_both_files():
    folder = aircraft_folder("aerosonde")
    xml = (folder / "aerosonde.xml").read_text()
    travel = tomllib.loads((folder / "aircraft.toml").read_text())["actuators"]

    for surface in ("aileron", "elevator", "rudder"):
        stops = re.search(
            rf'"fcs/{surface}-actuator">.*?<min> (\S+) </min> <max> (\S+) </max>', xml, re.DOTALL
        )
        assert stops is not None
        assert np.rad2deg(np.array(stops.groups(), dtype=float)) == pytest.approx(
            travel[f"{surface}_deg"], abs=1e-3
        )
