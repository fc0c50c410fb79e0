"""A flight in steady wind starts along its course over ground, trimmed in the moving air."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight import conditions
from flighttune.flight.fly import plant_of

SPEED = 8.0
FROM = (10.0, 100.0, 190.0, 280.0)
"""From ahead, the right, behind and the left of `CHI`."""

CHI = math.radians(10.0)
JSBSIM_DIGITS = 1e-11
"""Rad, and relative to the airspeed: velocities go through JSBSim in ft/s, body axes and back."""

STEADY = math.radians(1e-3)
"""Rad over a second of flight with the commands of the start: what the trim leaves over."""

LIMITS = {"phi_deg": [-45.0, 45.0], "n_z": [-2.1, 2.1]}
LAW = {"kind": "kinematic"}
AIRCRAFT = {"aerosonde": 25.0, "c172p": 45.0, "a4": 150.0}
"""Airspeeds in m/s."""


def windy(from_deg, plants, *, speed=SPEED, down=0.0, **flight):
    start = {"h_m": 500.0, "chi_deg": 10.0, "duration_s": 2.0, **flight}
    return made_up_scenario(
        flight=start,
        plant=plants,
        limits=LIMITS,
        reference={"chi_deg": start["chi_deg"], "gamma_deg": start.get("gamma_deg", 0.0)},
        controller={"feed_forward": True},
        wind={"speed_mps": speed, "from_deg": from_deg, "down_mps": down},
    )


def seen(plant):
    return dict(zip(plant.signals, plant.observe(), strict=True))


def through_air(now, from_deg, down=0.0):
    """Velocity over ground less that of the wind, m/s in NED; V_g is level."""
    level = now["V_g"]
    blows = math.radians(from_deg + 180.0)
    return np.array(
        [
            level * math.cos(now["chi"]) - SPEED * math.cos(blows),
            level * math.sin(now["chi"]) - SPEED * math.sin(blows),
            -level * math.tan(now["gamma"]) - down,
        ]
    )


@pytest.mark.parametrize(("from_deg", "gamma_deg"), [*zip(FROM, (0.0, 4.0, 4.0, 0.0), strict=True)])
@pytest.mark.parametrize("aircraft", AIRCRAFT)
def test_an_aircraft_starts_on_its_course_over_ground_and_in_trim(aircraft, from_deg, gamma_deg):
    V_a, gamma = AIRCRAFT[aircraft], math.radians(gamma_deg)
    table = {"kind": "jsbsim", "aircraft": aircraft}
    scenario = windy(from_deg, [table], V_a_mps=V_a, gamma_deg=gamma_deg, down=-0.5)
    plant = plant_of(scenario.plant[0], scenario)

    plant.start(conditions.start_condition(scenario))
    start = seen(plant)
    stop = plant.advance(0.0, start["n_z"], 1.0)
    later = seen(plant)

    assert (start["chi"], start["gamma"]) == pytest.approx((CHI, gamma), abs=JSBSIM_DIGITS)
    assert start["V_a"] == pytest.approx(V_a, rel=JSBSIM_DIGITS)
    assert np.linalg.norm(through_air(start, from_deg, -0.5)) == pytest.approx(V_a, rel=1e-9)
    assert stop is None
    assert (later["chi"], later["gamma"]) == pytest.approx((CHI, gamma), abs=STEADY)


@pytest.mark.parametrize("kind", ["kinematic", "point_mass", "point_mass_lag"])
@pytest.mark.parametrize("start", ["course", "heading"])
def test_a_point_mass_starts_along_its_course_or_with_its_nose_there(kind, start):
    lags = {"roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 8.0} if kind == "point_mass_lag" else {}
    table = {"kind": kind, **lags}

    (run,) = ft.fly(windy(100.0, [table], gamma_deg=20.0, start=start)).runs

    now = run.signals.iloc[0].to_dict()
    level = 25.0 * math.cos(math.radians(20.0))
    drift = 0.0 if start == "course" else -math.atan2(SPEED, level)
    assert now["chi"] == pytest.approx(CHI + drift, abs=1e-12)
    assert np.linalg.norm(through_air(now, 100.0)) == pytest.approx(25.0)
    if start == "course":
        assert now["gamma"] == pytest.approx(math.radians(20.0), abs=1e-12)


@pytest.mark.parametrize("wind", [None, {"speed_mps": 0.0, "from_deg": 70.0}])
@pytest.mark.parametrize("plant", [LAW, {"kind": "jsbsim", "aircraft": "aerosonde"}])
def test_in_calm_air_both_starts_are_one_to_the_bit(wind, plant):
    calm = {} if wind is None else {"wind": wind}
    on_course, by_heading = (
        ft.fly(scenario).runs[0].signals
        for start in ("course", "heading")
        for scenario in [
            made_up_scenario(
                flight={"gamma_deg": 7.0, "chi_deg": 33.0, "duration_s": 2.0, "start": start},
                plant=[plant], limits=LIMITS, **calm,
            )
        ]
    )  # fmt: skip

    assert on_course.to_numpy().tobytes() == by_heading.to_numpy().tobytes()


def test_turbulence_and_an_oscillating_wind_do_not_turn_the_start():
    swing = {"chi_amplitude": 0.02, "chi_omega_rad_s": 0.3, "as_wind": True}
    aircraft = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    scenario = made_up_scenario(
        plant=aircraft, disturbance=swing, turbulence={"intensity": "light"}
    )

    assert conditions.start_condition(scenario) == conditions.stated_condition(scenario)


class Still(ft.loop.PointMassPlant):
    """A plant of the user's that knows no wind."""


def test_a_plant_that_shows_no_wind_starts_as_the_scenario_states():
    scenario = windy(100.0, [LAW])

    flown = ft.fly(scenario, plants={"own": Still})

    now = flown["own / paper"].signals.iloc[0]
    assert not {"wind_north"} & {*now.index}
    assert {*ft.loop.COMMON_SIGNALS} <= {*now.index}
    assert now["chi"] == pytest.approx(CHI, abs=1e-15)


def test_a_recording_from_before_the_key_is_flown_again_as_it_was():
    # a wind that no course can be held in
    (run,) = ft.fly(windy(100.0, [LAW], speed=30.0, start="heading")).runs
    tables = dict(run.provenance.scenario)
    tables["flight"] = {k: v for k, v in tables["flight"].items() if k != "start"}
    older = ft.Run(
        signals=run.signals, status=run.status, reason=run.reason,
        provenance=replace(run.provenance, scenario=tables),
    )  # fmt: skip

    assert ft.refly([older]).equal


@pytest.mark.parametrize("from_deg", FROM)
@pytest.mark.parametrize("down", [-2.0, 0.0, 3.0])
def test_a_slope_is_that_through_the_air_which_thrust_bears(from_deg, down):
    """Expected: the trim in the moving air, whose path is that of its start."""
    scenario = windy(from_deg, [LAW], down=down, gamma_deg=4.0)

    (slope,) = conditions.slopes(scenario)

    assert slope.air == pytest.approx(conditions.start_condition(scenario).gamma, abs=JSBSIM_DIGITS)
    assert slope.gamma == pytest.approx(math.radians(4.0), abs=JSBSIM_DIGITS)


def test_a_climb_that_sinking_air_puts_out_of_reach_says_both_path_angles():
    aircraft = {"kind": "jsbsim", "aircraft": "c172p"}
    still, sinking = (
        conditions.slopes_not_held(
            windy(0.0, [aircraft], speed=0.0, down=down, gamma_deg=4.0, V_a_mps=55.0)
        )
        for down in (0.0, 6.0)
    )

    assert still == ()
    # asin((55 sin 4 + 6) / 55) up to the lean of the path, at 55 m/s
    assert sinking[0].startswith("The reference climbs at 10.2 deg through the air (4.0 deg over ")


def test_a_descent_that_rising_air_puts_out_of_reach_says_both_path_angles():
    aircraft = {"kind": "jsbsim", "aircraft": "c172p"}
    (said,) = conditions.slopes_not_held(
        windy(0.0, [aircraft], speed=0.0, down=-6.0, gamma_deg=-4.0, V_a_mps=40.0)
    )

    # along and across the path: the wind is upright
    down, level = 6.0 * math.sin(math.radians(4.0)), 6.0 * math.cos(math.radians(4.0))
    over_ground = math.sqrt(40.0**2 - level**2) - down
    angle = math.degrees(math.asin((over_ground * math.sin(math.radians(4.0)) + 6.0) / 40.0))
    assert said.startswith(f"The reference descends at {angle:.1f} deg through the air (-4.0 deg ")


def test_a_turn_of_a_route_climbs_steepest_where_it_flies_downwind():
    """A glide in its turn from an upwind to a downwind leg: its air path is the steeper there."""
    start = {"V_a_mps": 25.0, "h_m": 500.0, "duration_s": 200.0}
    tables = windy(0.0, [LAW], speed=10.0).as_dict()
    del tables["reference"]
    corners = (900.0, 0.0, 40.0), (900.0, 600.0, 70.0), (0.0, 600.0, 110.0)
    points = [dict(zip(("north_m", "east_m", "up_m"), corner, strict=True)) for corner in corners]
    limits = LIMITS | {"phi_rate_dps": 60.0}
    tables |= {"flight": start, "limits": limits, "route": {"waypoint": points}}

    found = conditions.slopes(ft.scenario_from(tables))

    turn = [slope for slope in found if slope.words.startswith("turn")]
    steepest = max(turn[-9:])
    assert steepest is turn[-1]
    # downwind, at 35 m/s over ground
    assert math.sin(steepest.air) == pytest.approx(35.0 / 25.0 * math.sin(steepest.gamma), rel=0.05)


def test_a_slope_of_a_route_is_in_the_wind_at_its_middle():
    """A tail wind that grows from 0 to 10 m/s over a leg of 100 m of climb blows at 5 m/s there."""
    tables = windy(0.0, [{"kind": "jsbsim", "aircraft": "aerosonde"}]).as_dict()
    del tables["reference"]
    levels = [
        {"h_m": h, "speed_mps": speed, "from_deg": 180.0} for h, speed in ((500, 0), (600, 10))
    ]
    tables |= {
        "flight": {"V_a_mps": 25.0, "h_m": 500.0, "duration_s": 200.0},
        "limits": LIMITS | {"phi_rate_dps": 60.0},
        "wind": {"level": levels},
        "route": {
            "waypoint": [
                {"north_m": north, "east_m": 0.0, "up_m": up}
                for north, up in ((0.0, 0.0), (1000.0, 100.0))
            ]
        },
    }

    (slope,) = conditions.slopes(ft.scenario_from(tables))

    gamma = math.atan(0.1)
    along, across = 5.0 * math.cos(gamma), 5.0 * math.sin(gamma)
    over_ground = along + math.sqrt(25.0**2 - across**2)
    assert slope.gamma == pytest.approx(gamma)
    assert math.sin(slope.air) == pytest.approx(over_ground * math.sin(gamma) / 25.0)
    assert slope.words == "leg to waypoint 2"


def on_route(*plants, **tables):
    """A climb to the north-east by 50 m in a kilometre, in still air."""
    made = windy(0.0, [*plants], speed=0.0).as_dict()
    del made["reference"]
    corners = (0.0, 0.0, 0.0), (600.0, 800.0, 50.0)
    points = [dict(zip(("north_m", "east_m", "up_m"), x, strict=True)) for x in corners]
    flight = {"V_a_mps": 25.0, "h_m": 500.0, "duration_s": 60.0, **tables.pop("flight", {})}
    limits = LIMITS | {"phi_rate_dps": 60.0}
    made |= {"flight": flight, "limits": limits, "route": {"waypoint": points}, **tables}
    return ft.scenario_from(made)


def test_angles_at_the_start_of_a_route_count_from_its_own():
    start = conditions.stated_condition(on_route(LAW, flight={"chi_deg": 5.0, "gamma_deg": -2.0}))

    assert start.chi == pytest.approx(math.atan2(800.0, 600.0) + math.radians(5.0))
    assert start.gamma == pytest.approx(math.atan(0.05) - math.radians(2.0))


def test_roll_and_lift_are_planned_ahead_by_their_lags_and_half_a_sample():
    lagged = {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 2.0}
    route = on_route(lagged | {"n_z_damping": 0.7}, controller={"rate_hz": 20.0})
    (plant,) = route.plant

    # behind a ramp a lag of second order is twice its damping over its frequency late
    late = 1.0 / 5.0 + 0.025, 2.0 * 0.7 / 2.0 + 0.025
    assert conditions.lead_on(route, plant) == pytest.approx(late)
    assert conditions.lead_on(route, None) == pytest.approx((0.025, 0.025))
    assert conditions.lead_on(windy(0.0, [LAW]), None) == (0.0, 0.0)
