"""The guidance of autopilots against their published equations and the numbers that they print."""

import math

import pytest

import flighttune as ft
from flighttune.control.laws.autopilot import _heading

DT, G = 0.02, 9.81
ROUNDED = 2e-6  # rad: the expected angles have six digits
NO_SLEW = {"FW_PN_R_SLEW_MAX": 0.0}
NPFG = {"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7, "NPFG_LB_PERIOD": 0.0, **NO_SLEW}


def scenario(parameters, **plant):
    tables = ft.load_scenario("paper_as_printed").as_dict()
    law = {"name": "now", "kind": "autopilot", "parameters": parameters}
    changed = {"law": [law], "gains": ["paper"], "expect": []}
    return ft.scenario_from(tables | changed | ({"plant": [plant]} if plant else {}))


def made(parameters):
    setup = ft.loop.LawSetup(dt=DT, limits=ft.loop.Limits.none(2), g=G)
    return scenario(parameters).laws[0].make(setup)


def commanded(parameters, *, chi=0.0, V=20.0, wind=(0.0, 0.0), samples=3, path=(0.0,) * 5):
    """Commands after samples of steady level flight; `path` as of `ReferenceSample`."""
    law, c, s = made(parameters), math.cos(chi), math.sin(chi)
    across = wind[1] * c - wind[0] * s
    V_g = wind[0] * c + wind[1] * s + math.sqrt(V * V - across * across)
    law.start(ft.loop.FlightCondition(V_a=V, chi=chi))
    for k in range(samples):
        place = V_g * k * DT * c, V_g * k * DT * s, 0.0
        measured = ft.loop.Measured(chi, 0.0, V, 0.0, 1.0, 100.0, place, (*wind, 0.0), theta=0.0)
        answer = law.step(measured, ft.loop.ReferenceSample(0.0, 0.0, path=path), k * DT)
    return answer


L1 = {"NAVL1_PERIOD": 17.0, "NAVL1_DAMPING": 0.75, "NAVL1_XTRACK_I": 0.0}


def on_path(right, curvature=0.0):
    return {"path": (0.0, right, 0.0, curvature, 0.0)}


@pytest.mark.parametrize(
    ("parameters", "flight", "roll"),
    [
        # NPFG turns by 4 pi damping over period and the sine of the error.
        (NPFG, {"chi": -0.1}, 0.177161),
        # It leads back to the track by its look-ahead angle: 20 m of a bound of
        # 10 s * 0.7 * 20 m/s: 0.416742 rad.
        (NPFG, on_path(20.0), -0.627914),
        # On its track in a crosswind it keeps its wings level.
        (NPFG, {"V": 15.0, "wind": (0.0, 6.0)}, 0.0),
        # L1 aims at the point that is damping, period and speed over pi ahead.
        (L1, on_path(-10.0), 0.138360),
        # It holds a circle by its acceleration: 100 m to the right: 20^2/100 = 4 m/s^2.
        (L1, on_path(0.0, 0.01), 0.387167),
        # 5 m outside it leads back to it: 5 (2 pi/17)^2 + 20^2/105.
        (L1, on_path(-5.0, 0.01), 0.429450),
    ],
)
def test_the_roll_is_that_of_the_published_equations(parameters, flight, roll):
    assert commanded(parameters, **flight)[0] == pytest.approx(roll, abs=ROUNDED)


@pytest.mark.parametrize(
    ("bearing", "wind", "V", "heading"),
    [
        (0.0, (0.0, 6.0), 15.0, -0.4115168),
        (math.pi, (0.0, 6.0), 15.0, -2.73),
        (0.0, (0.0, 30.0), 30.0, -0.5 * math.pi),
        (0.25 * math.pi, (-16.0, 0.0), 25.0, None),
    ],
)
def test_npfg_flies_the_headings_that_px4_expects_in_wind(bearing, wind, V, heading):
    # NpfgTest.cpp of PX4: LightCrossWind (twice) and ExcessCrossWind, within 0.01 rad
    found = _heading(bearing, wind, V)
    if heading is not None:
        assert abs(math.remainder(found - heading, math.tau)) < 0.01
    else:  # the velocity over ground has the bearing
        north, east = V * math.cos(found) + wind[0], V * math.sin(found) + wind[1]
        assert math.atan2(east, north) == pytest.approx(bearing, abs=1e-12)


def test_npfg_of_the_default_period_has_the_gain_that_px4_prints():
    (course, _), *_ = made({"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7071}).linear(20.0)
    assert course == pytest.approx(0.8885, abs=1e-4)  # AirspeedDirectionController.hpp


def test_npfg_does_not_fly_a_period_that_its_roll_could_not_follow():
    # pi * 0.5 s / 0.7 * 1.5 = 3.366 s in place of 2 s
    bounded, as_long = (
        commanded(NPFG | period, chi=-0.1)[0]
        for period in ({"NPFG_PERIOD": 2.0, "NPFG_LB_PERIOD": 1.0}, {"NPFG_PERIOD": 3.36599})
    )
    assert bounded == pytest.approx(as_long, abs=1e-5)


def test_l1_of_px4_has_the_distance_that_its_authors_print():
    # PX4 pull request 18811: 18 m at 15 m/s, damping 0.75, a period of 5 s; there it turns back
    # at a right angle, whatever the distance
    x = {"FW_L1_PERIOD": 5.0, "FW_L1_DAMPING": 0.75, "FW_R_LIM": 89.0, "FW_L1_R_SLEW_MAX": 0.0}
    near, at, far = (commanded(x, V=15.0, **on_path(right))[0] for right in (17.0, 18.0, 40.0))
    assert at == pytest.approx(far, abs=1e-9)
    assert near > at + 1e-3


STILL = {"FW_T_I_GAIN_PIT": 0.0, "FW_T_PTCH_DAMP": 0.1, "FW_T_ALT_TC": 5.0, "FW_P_TC": 0.4}


@pytest.mark.parametrize(
    ("parameters", "angle", "late"),
    [
        ({**NPFG, **STILL}, 4.0 / 5.0 * 1.1 / 20.0, 0.4),
        ({**L1, "TECS_INTEG_GAIN": 0.0}, 4.0 / 5.0 * 1.3 / 20.0, 0.5),
    ],
)
def test_tecs_pitches_for_the_missing_height_over_its_time_constant(parameters, angle, late):
    # 4 m missing, time constant 5 s, at 20 m/s; (1 + damping) of it, and the rate of the pitch
    _, lift, climb = commanded(parameters, samples=3000, path=(0.0, 0.0, 4.0, 0.0, 0.0))
    assert climb == pytest.approx(angle, abs=1e-5)
    assert lift == pytest.approx(1.0 + 20.0 / G * angle / late, abs=1e-4)


@pytest.mark.parametrize("parameters", [NPFG, L1, {"FW_L1_PERIOD": 12.0}])
def test_the_linear_loop_has_the_slopes_of_the_commands(parameters):
    (a, _), (b, _), *_ = made(parameters).linear(20.0)
    small = 1e-4
    turned = math.tan(commanded(parameters, chi=-small)[0]) * G / 20.0
    moved = math.tan(commanded(parameters, **on_path(-20.0 * small))[0]) * G / 20.0
    assert turned / small == pytest.approx(a, rel=1e-3)
    assert moved / small == pytest.approx(b, rel=1e-3)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"FW_R_LIM": 40.0}, r"must have one of NAVL1_PERIOD, NPFG_PERIOD, .*got FW_R_LIM"),
        ({"NPFG_PERIOD": 0.0}, r"`NPFG_PERIOD` must be a positive number, got 0"),
        ({"NPFG_PERIOD": 9.0, "NPFG_DAMPIN": 0.7}, "did you mean NPFG_DAMPING"),
        ({"NAVL1_PERIOD": 17.0, "NPFG_DAMPING": 0.7}, "must be of L1, got NPFG_DAMPING"),
        ({"NPFG_PERIOD": "ten"}, "`NPFG_PERIOD` must be a positive number, got 'ten'"),
    ],
)
def test_parameters_of_no_guidance_are_refused(parameters, words):
    with pytest.raises(ft.InputError, match=words):
        made(parameters)


@pytest.mark.parametrize("parameters", [NPFG, L1])
def test_a_scenario_flies_them_on_any_plant_to_its_course(parameters):
    flown = ft.fly(scenario(parameters, kind="point_mass"))
    (run,) = flown.runs
    assert run.label == "point_mass / now:paper"
    assert run.status == "completed"
    error = run.signals["chi_err"].abs()
    assert error.iloc[-1] < 0.2 * error.iloc[0]
