"""The table of a flight that turns back, by hand: every place has numbers of its own."""

import math

import pytest

import flighttune as ft
from flighttune.flight.scenario.load import from_level
from flighttune.routes.reference_keys import ReferenceTable
from flighttune.routes.turn_back_keys import TurnBackTable
from flighttune.vehicles.flight_keys import FlightTable

G = 9.81
TRAPEZOIDS = 1e-4  # of an integral in steps of 10 m, relative


def place(along, gamma, h, V_a, back):
    return {
        "along_m": along, "north_m": along, "east_m": 0.0, "chi_deg": 60.0, "gamma_deg": gamma,
        "h_m": h, "V_a_mps": V_a, "rate_dps": 2.0, "back_dps": back,
    }  # fmt: skip


# Level for 400 m, then a slope of 6 deg along which the airspeed rises from 20 to 24 m/s.
PLACES = [
    place(0.0, 0.0, 100.0, 20.0, 10.0),
    place(400.0, 0.0, 130.0, 20.0, 12.0),
    place(400.0 + 1e-9, 6.0, 130.0, 20.0, 12.0),
    place(800.0, 6.0, 170.0, 24.0, 14.0),
]
STATED = {"bank_deg": 30.0, "reaction_s": 1.5, "roll_rate_dps": 20.0, "place": PLACES}


def table(**changes):
    return TurnBackTable.model_validate({**STATED, "at_m": 600.0, "side": -1, **changes})


def test_times_and_turns_of_a_flight_that_turns_back():
    turn = table()
    tangent = math.tan(math.radians(30.0))

    assert turn.here == pytest.approx([600.0, 600.0, 0.0, 60.0, 6.0, 150.0, 22.0, 2.0, 13.0])
    # detected after 10 s, and 180 deg at 10 deg/s, the slowest; 8 s more
    assert (turn.found_s, turn.duration_s) == (10.0, 10.0 + 1.5 + 18.0 + 8.0)
    assert turn.formula(20.0, G) == pytest.approx(20.0 * 1.5 + 400.0 / (G * tangent))
    # the last place has the least: 14 deg/s at 24 m/s
    assert turn.wind(G) == pytest.approx(G * tangent / math.radians(14.0) - 24.0)


@pytest.mark.parametrize(("at_m", "slope_m"), [(600.0, 200.0), (0.0, 0.0), (800.0, 400.0)])
def test_the_slope_of_a_place_begins_where_its_path_is_level_or_turns(at_m, slope_m):
    assert table(at_m=at_m).slope_m == pytest.approx(slope_m, abs=1e-6)


def test_a_slope_is_no_longer_than_its_airspeed_takes_to_settle():
    """60 s at 20 m/s."""
    long = [{**x, "along_m": 10.0 * x["along_m"]} for x in PLACES[:3]] + [
        {**PLACES[3], "along_m": 8000.0, "V_a_mps": 20.0}
    ]
    assert table(place=long, at_m=8000.0).slope_m == pytest.approx(1200.0)


def test_a_slope_may_become_steeper_and_begins_where_its_path_went_the_other_way():
    path = zip((0.0, 300.0, 350.0, 500.0, 800.0), (0.0, -2.0, 0.1, 3.0, 6.0), strict=True)
    places = [place(along, gamma, 100.0, 20.0, 10.0) for along, gamma in path]

    assert table(place=places, at_m=800.0).slope_m == pytest.approx(500.0)


@pytest.mark.parametrize(
    ("wind", "seconds"),
    [
        # the integral of ds / (V + wind along), where V rises by 0.01 m/s in a metre
        ((0.0, 0.0), 100.0 * math.log(22.0 / 20.0)),
        ((3.0, 0.0), 100.0 * math.log(23.5 / 21.5)),
        ((0.0, -4.0), 100.0 * math.log((22.0 - 12.0**0.5) / (20.0 - 12.0**0.5))),
        # at a fifth of the airspeed at least
        ((-60.0, 0.0), 500.0 * math.log(22.0 / 20.0)),
    ],
)
def test_the_time_on_a_slope_is_that_over_ground(wind, seconds):
    assert table().time_on_slope(*wind) == pytest.approx(seconds, rel=TRAPEZOIDS)


def test_a_flight_follows_its_place_and_turns_to_its_side():
    tables = table().followed({"flight": {"V_a_mps": 20.0}, "reference": {"V_mps": 20.0}})

    # the tangent of roll for a change from 2 to -13 deg/s at 22 m/s, at 20 deg/s, and a fifth more
    roll_in = 1.2 * math.radians(15.0) * 22.0 / G / math.radians(20.0)
    turned_s = 11.5 + 0.5 * roll_in
    assert tables["flight"] == pytest.approx(
        {
            "V_a_mps": 20.0,
            "duration_s": 37.5,
            "chi_deg": 60.0 - 2.0 * (10.0 - 2.0),
            "gamma_deg": 6.0,
            "h_m": 150.0 - 10.0 * 22.0 * math.sin(math.radians(6.0)),
        }
    )
    ahead, back = tables["reference"]["chi_deg"]
    shape = {"shape": "ramp", "roll_in_s": roll_in}
    assert ahead == pytest.approx({**shape, "start_s": 2.0, "duration_s": 9.5, "rate_dps": 2.0})
    assert back == pytest.approx(
        {**shape, "start_s": turned_s, "duration_s": 180.0 / 13.0, "rate_dps": -13.0}
    )
    # 2.4 s for a slope of 6 deg, at 2 s for each 5 deg
    (level,) = tables["reference"]["gamma_deg"]
    ramp = {"shape": "ramp", "duration_s": 2.4, "roll_in_s": 1.0}
    assert level == pytest.approx({**ramp, "start_s": turned_s, "rate_dps": -2.5})
    # 2 m/s faster than at the start, by a twentieth of gravity
    (faster,) = tables["reference"]["V_mps"]
    per_s = 0.05 * G
    assert faster == pytest.approx({"shape": "ramp", "duration_s": 2.0 / per_s, "rate_mps2": per_s})


def test_a_flight_that_turns_left_and_descends_is_the_mirror_of_one_that_turns_right_and_climbs():
    mirrored = [
        {**x, "chi_deg": 400.0, "gamma_deg": -x["gamma_deg"], "rate_dps": -2.0} for x in PLACES
    ]
    stated = {"flight": {"V_a_mps": 20.0}}

    right = table().followed(stated)
    left = table(place=mirrored, side=1).followed(stated)

    for a, b in zip(right["reference"]["chi_deg"], left["reference"]["chi_deg"], strict=True):
        assert b == pytest.approx(a | {"rate_dps": -a["rate_dps"]})
    (a,), (b,) = right["reference"]["gamma_deg"], left["reference"]["gamma_deg"]
    assert b == pytest.approx(a | {"rate_dps": -a["rate_dps"]})
    start = left["flight"]
    assert start["chi_deg"] == pytest.approx(400.0 + 2.0 * (10.0 - 2.0) - 360.0)
    assert 150.0 - start["h_m"] == pytest.approx(right["flight"]["h_m"] - 150.0)


def test_a_flight_slows_down_or_keeps_its_airspeed_and_is_never_below_the_route():
    def followed(V_a, **changes):
        stated = {"flight": {"V_a_mps": V_a}, "reference": {"V_mps": V_a}}
        return table(**changes).followed(stated)

    (slower,) = followed(25.0)["reference"]["V_mps"]
    assert slower["duration_s"] == pytest.approx(3.0 / (0.05 * G))
    assert slower["rate_mps2"] == pytest.approx(-0.05 * G)
    assert followed(22.0)["reference"]["V_mps"] == pytest.approx(22.0)
    assert followed(22.0, at_m=410.0, detected_s=30.0)["flight"]["h_m"] == 100.0


def test_a_flight_from_level_flight_climbs_while_its_route_does():
    """5 s on the slope, which takes 2.4 s to begin: half of them are level."""
    tables = table(sloped_s=5.0).followed({"flight": {"V_a_mps": 22.0}})

    sloped, _ = tables["reference"]["gamma_deg"]
    assert sloped["start_s"] == pytest.approx(15.0 - 5.0)
    assert (sloped["duration_s"], sloped["rate_dps"]) == pytest.approx((2.4, 2.5))
    assert tables["flight"]["gamma_deg"] == 0.0
    rise = (200.0 - 0.5 * 22.0 * 2.4) * math.sin(math.radians(6.0))
    assert tables["flight"]["h_m"] == pytest.approx(150.0 - rise)
    assert tables["flight"]["duration_s"] == pytest.approx(37.5 + 5.0)
    # 10 m after the slope has begun, and 1 s, the path angle changes over 2.4 s all the same
    tables = table(sloped_s=1.0, at_m=410.0).followed({"flight": {"V_a_mps": 20.1}})
    sloped, _ = tables["reference"]["gamma_deg"]
    assert sloped["start_s"] == pytest.approx(11.0 - 2.4)
    rise = 0.5 * 20.1 * 2.4 * math.sin(math.radians(6.0))
    assert tables["flight"]["h_m"] == pytest.approx(131.0 - rise)


@pytest.mark.parametrize(
    ("wind", "along"), [({}, 0.0), ({"wind": {"speed_mps": 6.0, "from_deg": 240.0}}, 6.0)]
)
def test_the_time_on_a_slope_is_that_in_the_wind_of_the_flight(wind, along):
    turn = {**STATED, "at_m": 600.0, "or_level": True}
    plants = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    tables = {"title": "up", "flight": {"V_a_mps": 22.0}, "turn_back": turn, "plant": plants}

    scenario = from_level(ft.scenario_from({**tables, **wind}))

    seconds = 100.0 * math.log((22.0 + along) / (20.0 + along))
    assert scenario.turn_back.sloped_s == pytest.approx(seconds, rel=TRAPEZOIDS)


FLIGHT = FlightTable.model_validate({"V_a_mps": 20.0, "gamma_deg": 2.0, "duration_s": 10.0})


def ramp(start, duration, **rate):
    return {"shape": "ramp", "start_s": start, "duration_s": duration, **rate}


@pytest.mark.parametrize(
    ("gamma", "steepest"),
    [
        (7.0, (0.0, 7.0)),
        (-7.0, (0.0, -7.0)),
        # 2 deg, 6 deg from 3 s to 5 s, then down to -8 deg at 9 s
        ([ramp(1.0, 2.0, rate_dps=2.0), ramp(5.0, 4.0, rate_dps=-3.5)], (9.0, -8.0)),
        ([ramp(1.0, 2.0, rate_dps=2.0), ramp(5.0, 2.0, rate_dps=-3.5)], (3.0, 6.0)),
        # it ends while it climbs
        ([ramp(8.0, 8.0, rate_dps=1.5)], (10.0, 5.0)),
    ],
)
def test_the_steepest_path_angle_is_that_up_or_down(gamma, steepest):
    reference = ReferenceTable.model_validate({"chi_deg": 0.0, "gamma_deg": gamma})
    assert reference.steepest(FLIGHT) == pytest.approx(steepest)


def test_the_airspeeds_of_a_flight_are_those_until_its_end():
    changes = [ramp(1.0, 2.0, rate_mps2=2.0), ramp(4.0, 4.0, rate_mps2=-2.0)]
    later = [*changes, ramp(12.0, 3.0, rate_mps2=5.0)]
    for V_mps, expected in ((21.0, (21.0, 21.0)), (changes, (16.0, 24.0)), (later, (16.0, 24.0))):
        reference = ReferenceTable.model_validate(
            {"chi_deg": 0.0, "gamma_deg": 0.0, "V_mps": V_mps}
        )
        assert reference.airspeeds(FLIGHT) == pytest.approx(expected)
