"""Aircraft of JSBSim's own set inside our inner loop: flown as shipped, at 50 and at 200 m/s."""

import math

import pytest

from .conftest import fdm_of

G_0 = 9.80665

DEG = math.pi / 180.0
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
