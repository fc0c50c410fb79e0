"""The inner loop against what an outer loop needs of it, on the Aerosonde and JSBSim's models."""

import math

import numpy as np
import pytest
from airframes import fdm_of

DEG = math.pi / 180.0
FINE = 0.005

ROLL_T90, ROLL_OVERSHOOT = 1.3, 0.06
LOAD_T90, LOAD_OVERSHOOT = 0.8, 0.05
BANKED_LOAD, BANKED_LOAD_TOLERANCE = 1.41, 0.02
COURSE_DRIFT = 0.02 * DEG
STARTS = ("V_a", 20.0), ("V_a", 30.0), ("h", 3000.0), ("gamma", 45.0 * DEG)


def time_to_90_percent(t, y, y_0, y_1):
    return t[np.argmax((y - y_0) / (y_1 - y_0) >= 0.9)]


def overshoot(y, y_0, y_1):
    return np.max((y - y_0) / (y_1 - y_0)) - 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["right", "left"])
@pytest.mark.parametrize(("name", "value"), STARTS)
def test_rolls_30_deg_fast_and_well_damped(fly, holding_gamma, name, value, sign):
    phi_1 = sign * 30.0 * DEG

    flight = fly(holding_gamma(phi_1), **{name: value}, duration=3.0, dt=FINE)

    assert time_to_90_percent(flight.t, flight["phi"], 0.0, phi_1) <= ROLL_T90
    assert overshoot(flight["phi"], 0.0, phi_1) <= ROLL_OVERSHOOT
    assert flight["phi"][-1] == pytest.approx(phi_1, abs=0.2 * DEG)


@pytest.mark.parametrize("step", [0.5, -0.5])
@pytest.mark.parametrize(("V_a", "gamma"), [(20, 0), (25, 0.785), (30, 0)])
def test_changes_load_factor_by_half_fast_and_well_damped(fly, V_a, gamma, step):
    n_0 = math.cos(gamma)

    # Until the pull-up has turned the path away from the start.
    flight = fly((0.0, n_0 + step), V_a=V_a, gamma=gamma, duration=1.5, dt=FINE)

    assert time_to_90_percent(flight.t, flight["n_z"], n_0, n_0 + step) <= LOAD_T90
    assert overshoot(flight["n_z"], n_0, n_0 + step) <= LOAD_OVERSHOOT


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["right", "left"])
def test_banks_45_deg_level_and_coordinated(fly, holding_gamma, sign):
    flight = fly(holding_gamma(sign * 45.0 * DEG), duration=8.0)

    settled = flight.t > 4.0
    assert flight["n_z"][settled] == pytest.approx(BANKED_LOAD, abs=BANKED_LOAD_TOLERANCE)
    assert flight["n_y"][settled] == pytest.approx(0.0, abs=0.01)
    assert flight["V_a"][settled] == pytest.approx(25.0, abs=0.1)


@pytest.mark.parametrize("chi_deg", [60.0, 179.9])
def test_holds_course_wings_level(fly, chi_deg):
    flight = fly((0.0, 1.0), chi=chi_deg * DEG, duration=20.0, dt=0.1)

    assert flight["chi"] == pytest.approx(chi_deg * DEG, abs=COURSE_DRIFT)


@pytest.mark.parametrize("share", [0.5, 2.0, 3.0])
def test_stable_with_other_surface_effectiveness(fly, holding_gamma, changed_aircraft, share):
    # The surface gains are proportional to the square of the design airspeed.
    speed = rf"\g<1>{25.0 * math.sqrt(share)}"
    folder = changed_aircraft("gains.json", r'(V_a-design-mps": )25\.0', speed)

    flight = fly(holding_gamma(30.0 * DEG), aircraft=folder, duration=8.0)

    late = flight.t > 6.0
    assert np.ptp(flight["phi"][late]) < 1.0 * DEG
    assert np.ptp(flight["n_z"][late]) < 0.02


def test_inner_loop_limits_commands_in_size_and_rate(fly, holding_gamma):
    flight = fly(holding_gamma(80.0 * DEG), duration=3.0)

    assert np.max(flight["phi"]) == pytest.approx(45.0 * DEG, abs=2.0 * DEG)
    assert np.max(flight["p"]) < 36.0 * DEG


def test_pitch_integrator_does_not_wind_up_at_the_elevator_stop(fly, changed_aircraft):
    folder = changed_aircraft(
        "aircraft.toml",
        r"elevator = { travel_deg = \[-25.0, 25.0\]",
        "elevator = { travel_deg = [-2.29183, 2.29183]",
    )

    def pull_up(now):
        return 0.0, 1.8 if now["theta"] < 25.0 * DEG else 1.0

    flight = fly(pull_up, aircraft=folder, duration=5.0)

    at_stop = np.flatnonzero(flight["elevator"] <= -0.0399)
    assert len(at_stop) > 50
    assert flight["n_z"][at_stop[-1] + 50] == pytest.approx(1.0, abs=0.05)


G_0 = 9.80665
WRAPPED = [("c172p", 50.0), ("a4", 200.0)]
STEADY = {"phi": 0.1 * DEG, "gamma": 0.1 * DEG, "V_a": 0.15, "n_z": 2e-3}


@pytest.mark.parametrize(("name", "V_a"), WRAPPED)
def test_level_flight_stays_level(fly, name, V_a):
    flight = fly((0.0, 1.0), aircraft=name, V_a=V_a, duration=10.0)

    for signal, tolerance in STEADY.items():
        assert flight[signal] == pytest.approx(flight[signal][0], abs=tolerance), signal
    assert flight["n_z"][0] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(("name", "V_a"), WRAPPED)
def test_a_level_turn_turns_at_g_tan_phi_over_V(fly, holding_gamma, name, V_a):
    phi = 40.0 * DEG

    turn = fly(holding_gamma(phi), aircraft=name, V_a=V_a, phi=phi, duration=6.0)

    rate = (turn["chi"][-1] - turn["chi"][0]) / 6.0
    assert rate == pytest.approx(G_0 * math.tan(phi) / V_a, rel=1e-2)
    assert turn["n_z"] == pytest.approx(1.0 / math.cos(phi), abs=0.01)


def test_the_shift_of_the_aerodynamic_reference_point_acts(changed_aircraft):
    """JSBSim drops it where a planet is loaded after the model."""
    share, tag = 0.5, "aero_ref_pt_shift_x"
    shift = f"<{tag}><function><value>{share}</value></function></{tag}>"
    folder = changed_aircraft("aerosonde.xml", "<aerodynamics>", f"<aerodynamics>{shift}")
    moments = []
    for aircraft in ("aerosonde", folder):
        fdm = fdm_of(aircraft)
        fdm.writer("ic/u-fps")(80.0)
        fdm.evaluate()
        moments.append(fdm.reader("moments/m-aero-lbsft")())

    moment = share * fdm.reader("metrics/cbarw-ft")() * fdm.reader("forces/fbz-aero-lbs")()
    assert abs(moment) > 0.1
    assert moments[1] - moments[0] == pytest.approx(moment, rel=1e-9)
