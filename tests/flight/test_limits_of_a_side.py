"""Limits that differ to either side: each holds for its own, and the lesser where both matter."""

import math

import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight import conditions
from flighttune.flight.load import check_scenario
from flighttune.vehicles.aircraft.aircraft import load_aircraft

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
    change = conditions.manoeuvre_of(made_up_scenario(limits=SIDES, reference=stated))

    assert change.lower == pytest.approx((-0.8 * math.radians(30.0), 1.0 - 0.8 * 0.5))
    assert change.upper == pytest.approx((0.8 * math.radians(40.0), 1.0 + 0.8 * 0.3))
    assert change.rate_lower == pytest.approx((-0.8 * math.radians(20.0), -1.6))
    assert change.rate_upper == pytest.approx((0.8 * math.radians(50.0), 0.4))


LAGGED = {"kind": "point_mass_lag", "roll_lag_rad_s": 3.0, "n_z_lag_rad_s": 4.0, "n_z_delay_s": 0.1}


def fastest(flight=None, reference=None, **tables):
    """The fastest change of a flight in a turn to the right, at 40 Hz."""
    stated = {"V_a_mps": 20.0, "chi_deg": 30.0, "gamma_deg": 2.0, "phi_deg": 10.0, "g_mps2": 9.8}
    wanted = {"shape": "feasible", "chi_deg": 20.0, "gamma_deg": 5.0}
    tables = {"limits": SIDES, "controller": {"rate_hz": 40.0}} | tables
    return conditions.manoeuvre_of(
        made_up_scenario(
            flight=stated | (flight or {}), reference=wanted | (reference or {}), **tables
        )
    )


def test_the_fastest_change_begins_at_the_flight_or_where_it_is_stated_to():
    change = fastest()
    elsewhere = fastest(
        flight={"n_z": 1.1}, reference={"chi_from_deg": 25.0, "gamma_from_deg": 1.0}
    )

    assert change.start == pytest.approx((math.radians(30.0), math.radians(2.0)))
    assert change.end == elsewhere.end == pytest.approx((math.radians(20.0), math.radians(5.0)))
    steady = math.cos(math.radians(2.0)) / math.cos(math.radians(10.0))
    assert change.u_0 == pytest.approx((math.radians(10.0), steady))
    assert (change.V_a, change.g, change.dt, change.lags) == (20.0, 9.8, 0.025, None)
    assert change.upper == pytest.approx((0.8 * math.radians(40.0), 1.0 + 0.8 * 0.3))  # 0.2 is left
    assert elsewhere.start == pytest.approx((math.radians(25.0), math.radians(1.0)))
    assert elsewhere.u_0 == pytest.approx((math.radians(10.0), 1.1))


@pytest.mark.parametrize(("V_a", "lift"), [(20.0, (20.0 / 25.0) ** 2), (30.0, 1.0)])
def test_the_fastest_change_has_the_lift_and_the_lags_of_an_aircraft_at_its_airspeed(V_a, lift):
    """The Aerosonde is designed for 25 m/s."""
    own = load_aircraft("aerosonde").limits
    wide = {"phi_deg": [-80.0, 80.0], "phi_rate_dps": 500.0, "n_z": [-9.0, 9.0]}
    change = fastest(
        flight={"V_a_mps": V_a, "phi_deg": 0.0},
        limits=wide | {"n_z_rate_per_s": 99.0},
        plant=[{"kind": "jsbsim", "aircraft": "aerosonde"}],
    )

    for end, phi, n_z in zip((change.lower, change.upper), own.phi, own.n_z, strict=True):
        assert end == pytest.approx((0.8 * phi, 1.0 + 0.8 * (lift * n_z - 1.0)))
    assert change.rate_upper == pytest.approx((0.8 * own.phi_rate, 0.8 * own.n_z_rate))
    near = ft.loop.load_identified("aerosonde").nearest(V_a, math.radians(2.0))
    assert change.lags == near.lags


def test_commands_of_ramps_lead_by_the_lags_of_the_plant_and_half_a_sample():
    turning = rolling_in("chi_deg", -12.5, 1.7)
    lagged = turning.model_copy(update={"plant": made_up_scenario(plant=[LAGGED]).plant})
    straight, half = made_up_scenario(plant=[LAGGED]), 0.5 / turning.controller.rate_hz

    assert conditions.lead_on(lagged, lagged.plant[0]) == pytest.approx(
        (1.0 / 3.0 + half, 1.0 / 4.0 + 0.1 + half)
    )
    for plant in (None, turning.plant[0]):
        assert conditions.lead_on(turning, plant) == (half, half)
    assert conditions.lead_on(straight, straight.plant[0]) == (0.0, 0.0)
    roll, load = fastest(plant=[LAGGED]).lags
    assert (roll.whole, load.whole) == pytest.approx((1.0 / 3.0, 0.35))
