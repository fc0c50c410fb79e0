"""The guidance of autopilots against their published equations and the numbers that they print."""

import math

import numpy as np
import pytest

import flighttune as ft

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


def commanded(
    parameters, *, chi=0.0, V=20.0, V_sp=None, wind=(0.0, 0.0), samples=3, path=(0.0,) * 5
):
    """Commands after samples of steady level flight; `path` as of `ReferenceSample`."""
    law, c, s = made(parameters), math.cos(chi), math.sin(chi)
    across = wind[1] * c - wind[0] * s
    V_g = wind[0] * c + wind[1] * s + math.sqrt(V * V - across * across)
    law.start(ft.loop.FlightCondition(V_a=V_sp or V, chi=chi))
    motion = {"V_g": V_g, "velocity": (V_g * c, V_g * s, 0.0), "acceleration": 0.0, "theta": 0.0}
    for k in range(samples):
        place = V_g * k * DT * c, V_g * k * DT * s, 0.0
        measured = ft.loop.Measured(chi, 0.0, V, 0.0, 1.0, 100.0, place, (*wind, 0.0), **motion)
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


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("distance", "samples", "integral"),
    # 0.05 of the angle to the track in a second, up to 0.1 rad; none beyond 5 deg
    [(5.0, 100, 0.1 * math.asin(5.0 / 81.1691)), (5.0, 3000, 0.1), (9.0, 100, 0.0)],
)
def test_l1_adds_up_small_angles_to_a_track(side, distance, samples, integral):
    # L1 distance 0.75 * 17 s * 20 m/s / pi = 81.1691 m; 4 * 0.75^2 * (20 m/s)^2 over it
    parameters = L1 | {"NAVL1_XTRACK_I": 0.05, "ROLL_LIMIT_DEG": 80.0}
    roll, *_ = commanded(parameters, samples=samples, **on_path(-side * distance))
    angle = math.asin(distance / 81.1691) + integral
    assert math.tan(roll) * G == pytest.approx(
        side * 2.25 * 400.0 / 81.1691 * math.sin(angle), rel=1e-5
    )


def test_l1_of_ardupilot_leads_to_a_far_track_at_half_a_right_angle():
    far, further = (commanded(L1, **on_path(right))[0] for right in (-60.0, -200.0))
    assert far == pytest.approx(further, abs=1e-12)
    at_45_deg = 2.25 * 400.0 / 81.1691 * math.sin(0.25 * math.pi)
    assert math.tan(far) * G == pytest.approx(at_45_deg, rel=1e-5)


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


def climbed(
    parameters, *, V=20.0, V_sp=20.0, speeding=0.0, gamma=0.0, alpha=0.0, phi=0.0, samples=150,
    track=None, slope=0.0,
):  # fmt: skip
    """Commands after samples of straight flight north that gains speed, m/s^2, from 100 m on.

    The track is at a height (m), or its slope alone is asked for.
    """
    law, x, h = made(parameters), 0.0, 100.0
    law.start(ft.loop.FlightCondition(V_a=V_sp))
    for k in range(samples):
        V_a, moves = V + speeding * k * DT, DT * (k > 0)
        x, h = x + V_a * math.cos(gamma) * moves, h + V_a * math.sin(gamma) * moves
        V_g, climb = V_a * math.cos(gamma), V_a * math.sin(gamma)
        motion = V_g, (V_g, 0.0, -climb), speeding * (k > 0)
        measured = ft.loop.Measured(
            0.0,
            gamma,
            V_a,
            phi,
            1.0,
            h,
            (x, 0.0, 100.0 - h),
            None,
            None,
            gamma + alpha,
            0.0,
            *motion,
        )
        path = None if track is None else (0.0, 0.0, track - h, 0.0, 0.0)
        answer = law.step(measured, ft.loop.ReferenceSample(0.0, math.atan(slope), path=path), 0.0)
    return answer


SPEEDING = {"track": 103.0, "samples": 40, "gamma": 0.05, "alpha": 0.03, "speeding": 0.5}


@pytest.mark.parametrize(
    ("period", "parameters", "flight", "angle"),
    [
        ("NPFG_PERIOD", {}, SPEEDING | {"V_sp": 22.0}, 0.020645284725),
        ("NPFG_PERIOD", {"FW_T_CLMB_MAX": 2.5, "FW_T_CLMB_R_SP": 4}, {"track": 200}, 0.139834808),
        ("NPFG_PERIOD", {"FW_T_SINK_MAX": 1.5, "FW_T_SINK_R_SP": 3}, {"track": 20}, -0.08554052),
        ("NPFG_PERIOD", {"FW_T_I_GAIN_PIT": 0.3}, {"track": 70.0, "samples": 100}, -0.10146652),
        (
            "NPFG_PERIOD",
            {"FW_T_SPDWEIGHT": 0.4},
            {"track": 102.0, "V_sp": 23.0, "speeding": 0.4},
            0.011126269566,
        ),
        (
            "NPFG_PERIOD",
            {"FW_T_SPDWEIGHT": 1.7, "FW_T_SINK_MIN": 3.0},
            {"track": 100.0, "V_sp": 12.0},
            0.105,
        ),
        (
            "FW_L1_PERIOD",
            {"FW_T_SEB_R_FF": 0.8},
            {"slope": 0.06, "gamma": 0.02, "V_sp": 20.5},
            0.051753717901,
        ),
        ("NPFG_PERIOD", {"FW_T_VERT_ACC": 4}, {"track": 120, "samples": 5, "V": 18}, -0.1 / 4.5),
    ],
)
def test_tecs_climbs_as_the_source_of_px4_does(period, parameters, flight, angle):
    # TECS.cpp of PX4, sample by sample with its default parameters
    found = climbed({period: 15.0, **parameters}, **flight)[2]
    assert found == pytest.approx(angle, abs=1e-10)


UP, DOWN = {"track": 200.0}, {"track": 20.0}


@pytest.mark.parametrize(
    ("parameters", "flight", "pitch"),
    [
        (NPFG | {"FW_P_LIM_MAX": 3.0, "FW_P_LIM_MIN": -9.0}, UP, 3.0),
        (NPFG | {"FW_P_LIM_MAX": 9.0, "FW_P_LIM_MIN": -3.0}, DOWN, -3.0),
        (L1 | {"TECS_PITCH_MAX": 3.0, "TECS_PITCH_MIN": -9.0}, UP, 3.0),
        (L1 | {"TECS_PITCH_MAX": 9.0, "TECS_PITCH_MIN": -3.0}, DOWN, -3.0),
        # limits of TECS that are 0 are not set, and those of the aircraft hold beside others
        (L1 | {"TECS_PITCH_MAX": 0.0, "PTCH_LIM_MAX_DEG": 4.0}, UP, 4.0),
        (L1 | {"PTCH_LIM_MIN_DEG": -2.0}, DOWN, -2.0),
        (L1 | {"TECS_PITCH_MIN": -9.0, "PTCH_LIM_MIN_DEG": -2.0}, DOWN, -2.0),
        (L1 | {"TECS_PITCH_MAX": 9.0, "PTCH_LIM_MAX_DEG": 2.0}, UP, 2.0),
    ],
)
def test_the_pitch_stays_in_the_limits_of_its_side(parameters, flight, pitch):
    trim = 0.02
    _, _, angle = climbed(parameters, alpha=trim, **flight)
    assert math.degrees(angle + trim) == pytest.approx(pitch, abs=1e-9)


@pytest.mark.parametrize(("bank", "divided"), [(0.0, 0.0), (0.4, 0.4), (1.4, 1.2)])
def test_the_lift_turns_the_pitch_within_its_time_constant(bank, divided):
    # gamma' = V (wanted - pitch) / (tc g), and the lift is divided by the cosine of 1.2 rad at most
    gamma, alpha = 0.05, 0.03
    flight = {"gamma": gamma, "alpha": alpha, "track": 103.0, "samples": 60, "phi": bank}
    _, lift, angle = climbed(NPFG | {"FW_P_TC": 0.7}, **flight)
    upwards = math.cos(gamma) + 20.0 * (angle - gamma) / 0.7 / G
    assert lift == pytest.approx(upwards / math.cos(divided), rel=1e-9)


@pytest.mark.parametrize(
    ("parameters", "roll"),
    [
        (NPFG | {"FW_PN_R_SLEW_MAX": 30.0}, 3 * 30.0 * DT),
        (NPFG | {"FW_R_LIM": 37.0}, 37.0),
        (L1 | {"ROLL_LIMIT_DEG": 12.0}, 12.0),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_roll_and_its_rate_are_limited_to_either_side(parameters, roll, side):
    found, *_ = commanded(parameters, **on_path(-side * 60.0))
    assert math.degrees(found) == pytest.approx(side * roll, abs=1e-9)


def test_the_way_back_to_a_track_takes_the_acceleration_of_its_look_ahead_angle():
    """At u = 1 - y/B off a track, B = 0.7 * 10 s * V, the course is ``(1 - u^2) pi/2`` off it.

    So y falls by V sin(course), and V times the rate of the course is
    ``V^2/B pi u sin((1 - u^2) pi/2)``.
    """
    u = np.linspace(0.0, 1.0, 20_001)
    largest = (math.pi * u * np.sin((1.0 - u**2) * 0.5 * math.pi)).max() * 20.0 / 7.0

    for roll in (25.0, 50.0):
        share = largest / (G * math.tan(math.radians(roll)))
        assert made(NPFG | {"FW_R_LIM": roll}).way_back(20.0) == pytest.approx(share, rel=1e-5)
    assert made(L1).way_back(20.0) == 0.0


@pytest.mark.parametrize("parameters", [NPFG, L1, {"FW_L1_PERIOD": 12.0}])
def test_the_linear_loop_has_the_slopes_of_the_commands(parameters):
    (a, _), (b, _), *_ = made(parameters).linear(20.0)
    small = 1e-4
    turned = math.tan(commanded(parameters, chi=-small)[0]) * G / 20.0
    moved = math.tan(commanded(parameters, **on_path(-20.0 * small))[0]) * G / 20.0
    assert turned / small == pytest.approx(a, rel=1e-3)
    assert moved / small == pytest.approx(b, rel=1e-3)


@pytest.mark.parametrize("wind", [(8.0, 0.0), (-8.0, 0.0), (0.0, 8.0), (-5.0, 6.0)])
@pytest.mark.parametrize("parameters", [NPFG, L1, {"FW_L1_PERIOD": 12.0}])
def test_wind_changes_no_margin_of_a_leg_but_for_the_cosine_of_the_drift_in_l1(parameters, wind):
    # y'' = -A y' - B y beside the leg: y' = V_g chi, and y'' is the acceleration across the air's
    # path, g tan(phi), times the cosine of the drift angle. In still air A = a and B = b / V.
    (a, _), (b, _), *_ = made(parameters).linear(20.0)
    small, drift = 1e-5, math.asin(-wind[1] / 20.0)
    V_g = wind[0] + 20.0 * math.cos(drift)
    turned, moved = (
        math.tan(commanded(parameters, wind=wind, **flight)[0]) * G * math.cos(drift) / small
        for flight in ({"chi": -small}, on_path(-20.0 * small))
    )
    lowered = 1.0 if parameters is NPFG else math.cos(drift)
    assert turned / V_g == pytest.approx(lowered * a, rel=1e-4)
    assert moved / 20.0 == pytest.approx(lowered * b, rel=1e-4)


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
    made = scenario(parameters, kind="point_mass").as_dict()
    made["flight"]["duration_s"] = 15.0
    (run,) = ft.fly(ft.scenario_from(made)).runs
    assert run.label == "point_mass / now:paper"
    assert run.status == "completed"
    error = run.signals["chi_err"].abs()
    assert error.iloc[-1] < 0.2 * error.iloc[0]
