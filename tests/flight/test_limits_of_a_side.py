"""Limits that differ to either side: each holds for its own, and the lesser where both matter."""

import math

import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight.conditions import manoeuvre_of
from flighttune.flight.load import check_scenario

PER_LOAD = 25.0 * math.radians(1.0) / 9.81  # lift of a degree a second at 25 m/s
PHI, PHI_RATE, N_Z, N_Z_RATE = [-30.0, 40.0], [-20.0, 50.0], [0.5, 1.3], [-2.0, 0.5]
SIDES = {"phi_deg": PHI, "phi_rate_dps": PHI_RATE, "n_z": N_Z, "n_z_rate_per_s": N_Z_RATE}


def rolling_in(channel, rate, roll_in_s):
    ramp = {"shape": "ramp", "start_s": 6.0, "duration_s": 5.0}
    ramps = {channel: [{**ramp, "rate_dps": rate, "roll_in_s": roll_in_s}]}
    stated = {"chi_deg": 0.0, "gamma_deg": 0.0} | ramps
    return made_up_scenario(limits=SIDES, reference=stated, controller={"feed_forward": True})


@pytest.mark.parametrize(
    ("channel", "rate", "roll_in_s", "says"),
    [
        ("chi_deg", 15.0, 1.92, ""),
        ("chi_deg", -12.5, 1.7, ""),
        ("chi_deg", -15.0, 1.92, f"within -{math.tan(math.radians(30.0)) / PER_LOAD:.4g} deg/s"),
        ("chi_deg", 19.5, 3.0, f"within {math.tan(math.radians(40.0)) / PER_LOAD:.4g} deg/s"),
        # the slower roll rate, 20 deg/s, has to take the roll out again
        ("chi_deg", 15.0, 1.9, f"must be at least {15.0 * PER_LOAD / math.radians(20.0):.3f}"[:-1]),
        ("gamma_deg", 6.5, 0.6, ""),
        ("gamma_deg", -11.0, 1.0, ""),
        ("gamma_deg", 7.0, 1.0, f"within {0.3 / PER_LOAD:.4g} deg/s"),
        ("gamma_deg", -11.5, 2.0, f"within -{0.5 / PER_LOAD:.4g} deg/s"),
        ("gamma_deg", -6.0, 0.5, f"must be at least {6.0 * PER_LOAD / 0.5:.3f}"),
    ],
)
def test_a_ramp_rolls_in_within_the_limits_of_its_side(channel, rate, roll_in_s, says):
    scenario = rolling_in(channel, rate, roll_in_s)
    if not says:
        check_scenario(scenario, "sides")
        return
    with pytest.raises(ft.InputError, match=rf"\[reference\.{channel}\].*{says}"):
        check_scenario(scenario, "sides")


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"phi_deg": [5.0, 40.0]}, r"`phi_deg` .*, 0, .*got 5 to 40"),
        ({"phi_deg": [-40.0, -5.0]}, r"`phi_deg` .*, 0, .*got -40 to -5"),
        ({"n_z": [1.1, 2.0]}, r"`n_z` .*, 1, .*got 1\.1 to 2"),
        ({"n_z": [0.0, 0.9]}, r"`n_z` .*, 1, .*got 0 to 0\.9"),
    ],
)
def test_limits_to_one_side_of_level_flight_are_refused(limits, says):
    with pytest.raises(ft.InputError, match=says):
        check_scenario(made_up_scenario(limits=limits), "sides")


def test_a_flight_may_begin_and_go_on_in_a_turn_to_one_side():
    turning = made_up_scenario(limits={"phi_deg": [5.0, 40.0]}, flight={"phi_deg": 20.0})
    check_scenario(turning, "sides")


@pytest.mark.parametrize(
    ("limits", "same"),
    [
        ({"phi_deg": [-30.0, 45.0]}, {"phi_deg": [-30.0, 30.0]}),
        ({"phi_deg": [-45.0, 30.0]}, {"phi_deg": [-30.0, 30.0]}),
        ({"phi_rate_dps": [-20.0, 90.0]}, {"phi_rate_dps": 20.0}),
        ({"phi_rate_dps": [-90.0, 20.0]}, {"phi_rate_dps": 20.0}),
    ],
)
def test_a_route_turns_to_either_side_by_the_lesser_limit(limits, same):
    both = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 60.0}
    points = [(0.0, 0.0), (900.0, 0.0), (900.0, 900.0), (2000.0, 900.0)]
    waypoints = [{"north_m": north, "east_m": east} for north, east in points]
    tables = made_up_scenario(flight={"duration_s": 300.0}).as_dict() | {
        "route": {"waypoint": waypoints}
    }
    del tables["reference"]
    lengths = [
        ft.route(ft.scenario_from({**tables, "limits": {**both, **change}})).reference.path.length
        for change in (limits, same, {})
    ]
    assert lengths[0] == lengths[1]
    assert abs(lengths[0] - lengths[2]) > 1.0


def test_the_fastest_change_has_the_limits_of_each_side_less_its_margin():
    stated = {"shape": "feasible", "chi_deg": 20.0, "gamma_deg": 5.0, "margin": 0.2}
    change = manoeuvre_of(made_up_scenario(limits=SIDES, reference=stated))

    assert change.lower == pytest.approx((-0.8 * math.radians(30.0), 1.0 - 0.8 * 0.5))
    assert change.upper == pytest.approx((0.8 * math.radians(40.0), 1.0 + 0.8 * 0.3))
    assert change.rate_lower == pytest.approx((-0.8 * math.radians(20.0), -1.6))
    assert change.rate_upper == pytest.approx((0.8 * math.radians(50.0), 0.4))
