"""When made-up flights leave a box, are ended, and come down: times and distances by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from forging import changed
from made_up import made_up_run, made_up_scenario
from small_claims import stated_hours

import flighttune as ft

RATE, V, G = 50.0, 25.0, 9.81
SIDE, HIGH = 100.0, 50.0
SCENARIO = made_up_scenario(
    controller={"rate_hz": RATE}, flight={"h_m": 300.0, "ground_m": 100.0, "g_mps2": G}
)
FAULTY = made_up_scenario(
    controller={"rate_hz": RATE},
    flight={"h_m": 300.0, "ground_m": 100.0, "g_mps2": G},
    plant=[
        {"kind": "kinematic"},
        {
            "kind": "jsbsim",
            "aircraft": "aerosonde",
            "airframe": {"fault": {"from_s": 1.5, "throttle_factor": 0.01}},
        },
    ],
)
CORNERS = ((-SIDE, -SIDE), (SIDE, -SIDE), (SIDE, SIDE), (-SIDE, SIDE))
NEVER = -1.0


@cache
def stated():
    """What a file of hours says of its last term: a volume, an ending, and when a flight left."""
    hourly = ft.load(stated_hours())
    return hourly.flights_of(hourly.terms[-1]).leaving


def volume(*corners, low=None, high=None):
    return replace(stated().volume, rings=(corners,), low=low, high=high)


def wide(**ends):
    return volume(*((1e4 * n, 1e4 * e) for n, e in CORNERS), **ends)


def box():
    return volume(*CORNERS, low=-20.0, high=HIGH)


def flight(seconds=6.0, status="completed", climb=0.0, **columns):
    """Straight north at 25 m/s, 200 m above the ground."""
    t = np.arange(round(seconds * RATE) + 1) / RATE
    usual = {
        "north": V * t, "east": 0.0 * t, "h": 300.0 + climb * t, "V_a": V + 0.0 * t,
        "V_g": V + 0.0 * t, "wind_north": 0.0 * t, "wind_east": 0.0 * t,
    }  # fmt: skip
    return made_up_run({**usual, **columns}, t, status=status)


def probe(volume, how="cut", after_s=None, alarms=None, lead_s=0.0, **ending):
    """The probe of flights that are ended so, a time after a fault at 1.5 s."""
    monitor = {} if alarms is None else {"monitor": "made_up.npz"}
    table = type(stated().ending)(kind=how, **monitor, **ending)
    return replace(stated(), volume=volume, ending=table, how=how, after_s=after_s, alarms=alarms,
                   lead_s=lead_s)  # fmt: skip


@pytest.mark.parametrize(
    ("run", "left"),
    [
        # 100 m at 25 m/s: on the edge at 4 s, seen outside at the next look, 0.1 s later
        (flight(), 4.1),
        (flight(4.0), NEVER),
        # the last sample is looked at, also between looks
        (flight(4.02), 4.02),
        # 50 m at 20.08 m/s upwards, 20 m at 8.03 m/s downwards: 2.490 s
        (flight(climb=20.08), 2.5),
        (flight(climb=19.0), 2.7),
        (flight(climb=-8.03), 2.5),
        (flight(3.0, status="ground_contact"), NEVER),
        # without an ending the autopilot flies on, outside of what the model covers
        (flight(3.0, status="left_envelope"), 3.0),
    ],
)
def test_a_flight_leaves_at_the_first_look_outside_or_where_its_model_ends(run, left):
    found = probe(box())(run, SCENARIO)

    assert found == pytest.approx([left, run.t[-1], NEVER, NEVER])


@pytest.mark.parametrize(
    ("how", "after_s", "left", "ended_s"),
    [
        ("cut", 1.0, NEVER, 2.5),
        ("parachute", 1.0, NEVER, 2.5),
        # a manoeuvre stays above the floor
        ("turn_back", 1.0, 2.6, 2.5),
        ("circle", 1.0, 2.6, 2.5),
        # under the floor, 2.6 s, before the flight is ended
        ("cut", 1.2, 2.6, 2.7),
        ("cut", 1.1, NEVER, 2.6),  # at the sample of its ending too
        # the last sample, and later
        ("turn_back", 1.5, 2.6, 3.0),
        ("turn_back", 1.6, 2.6, NEVER),
    ],
)
def test_to_come_down_after_an_ending_is_no_exit_by_the_floor(how, after_s, left, ended_s):
    """Down at 8 m/s: under the floor, 20 m below the start, after 2.5 s."""
    table = {"fall_per_height": 0.0, "sink_mps": 5.0, "opens_s": 0.0}

    found = probe(box(), how, after_s, **table)(flight(3.0, climb=-8.0), FAULTY)

    assert found == pytest.approx([left, 3.0, ended_s, NEVER])


# Kinetic as potential energy: V^2 / 2 g, m.
RISE = V**2 / (2.0 * G)
FALL = 0.05
FAR = FALL * (200.0 + RISE)
FASTER = {"V_g": np.full(151, 30.0)}  # over ground than through the air
WIND = {"wind_north": np.full(151, 3.0), "wind_east": np.full(151, -4.0), **FASTER}


@pytest.mark.parametrize(
    ("how", "ending", "status", "wind", "reach"),
    [
        # 200 m above the ground and its speed, times the distance of a fall per height
        ("cut", {"fall_per_height": FALL}, "left_envelope", FASTER, FAR),
        ("turn_back", {"fall_per_height": FALL}, "diverged", {}, FAR),
        # a glide that is still in the air at the end of its record falls from there
        ("glide", {"fall_per_height": FALL}, "completed", {}, FAR),
        ("glide", {"fall_per_height": FALL}, "ground_contact", {}, 0.0),
        ("cut", {"fall_per_height": FALL}, "completed", {}, 0.0),
        ("circle", {}, "ground_contact", {}, 0.0),
        # without a declared fall it has left where its model ends
        ("cut", {}, "left_envelope", {}, 1e4),
        ("turn_back", {}, "left_envelope", {}, 1e4),
        # 0.4 s until it is open, then 5 m/s of wind while it sinks 200 m at 40 m/s
        ("parachute", {"sink_mps": 40.0, "opens_s": 0.4}, "completed", WIND, 12.0 + 25.0),
        ("parachute", {"sink_mps": 40.0, "opens_s": 0.4}, "ground_contact", WIND, 12.0 + 25.0),
        # a parachute does not fall as flights with other endings do
        ("parachute", {"sink_mps": 40.0, "opens_s": 0.0, "fall_per_height": FALL}, "completed",
         WIND, 25.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("beyond", [-0.5, 0.5])
def test_an_ended_flight_comes_down_inside_where_its_fall_is_shorter_than_the_room(
    how, ending, status, wind, reach, beyond
):
    # ended at 2 s: a parachute is judged from there, all others from their last place
    far = V * (2.0 if how == "parachute" else 3.0) + reach + beyond
    ring = ((-2e4, -2e4), (far, -2e4), (far, 2e4), (-2e4, 2e4))

    left = probe(volume(*ring), how, 0.5, **ending)(flight(3.0, status=status, **wind), FAULTY)[0]

    declared = "fall_per_height" in ending or how == "parachute" or reach == 0.0
    assert left == pytest.approx(NEVER if declared and beyond > 0.0 else 3.0)


# Flights are ended before their last sample, and at it.
@pytest.mark.parametrize("after_s", [0.5, 1.5])
@pytest.mark.parametrize(("room", "inside"), [(RISE + 0.1, True), (RISE - 0.1, False)])
def test_a_fall_stays_under_the_top_if_all_speed_becomes_height(room, inside, after_s):
    fallen = probe(wide(high=room), "cut", after_s, fall_per_height=0.0)

    left = fallen(flight(3.0, status="left_envelope"), FAULTY)[0]

    assert left == pytest.approx(NEVER if inside else 3.0)


def watching(tmp_path):
    """The alarms of a file: the airspeed is 25 m/s, to 1 m/s."""
    model = {"name": "airspeed", "target": "V_a", "terms": ["1"], "weights": [V]}
    alarms = {"models": [model], "middle": [0.0], "half": [1.0]}

    def change(tables):
        tables["rates"]["ending"]["monitor"] = "made_up.npz"
        tables["alarms"] = alarms

    return ft.load(changed(stated_hours(), tmp_path / "x.json", change)).alarms


@pytest.mark.parametrize(
    ("after_s", "after_alarm_s", "ended_s"),
    [(None, 0.0, 2.0), (None, 1.5, 3.5), (0.2, 1.5, 1.7), (4.0, 1.5, 3.5), (None, 5.0, NEVER)],
)
def test_the_first_of_alarm_and_fault_ends_a_flight(after_s, after_alarm_s, ended_s, tmp_path):
    """The airspeed changes by 100 m/s at 2 s, far beyond the limit, 1 m/s, within a sample."""
    t = np.arange(301) / RATE
    run = flight(V_a=np.where(t < 2.0, V, V + 100.0))
    alarms = watching(tmp_path)
    assert alarms.first(run) == pytest.approx(2.0)

    ended = probe(wide(), "turn_back", after_s, alarms, after_alarm_s=after_alarm_s)

    assert ended(run, FAULTY)[2] == pytest.approx(ended_s)


def test_a_flight_that_is_ended_leaves_its_route_where_its_law_has_planned_to():
    """Its commands are planned 0.4 s ahead, which is 10 m at 25 m/s; before the start is none."""
    for behind, at_m in ((0.0, 2.9 * V), (50.0, 2.9 * V - 50.0), (80.0, 0.0)):
        run = flight(along=V * np.arange(301) / RATE - behind)
        ended = probe(wide(), "turn_back", 1.0, lead_s=0.4)(run, FAULTY)
        assert ended == pytest.approx([NEVER, 6.0, 2.5, at_m])


def test_a_flight_without_a_sample_left_at_its_start():
    run = made_up_run({name: [] for name in ("north", "east", "h")}, [])
    assert probe(wide())(run, SCENARIO) == [0.0, 0.0, NEVER, NEVER]


def test_a_flight_leaves_into_an_area_to_stay_out_of():
    """A box with a hole from 60 m to 80 m ahead: on its edge after 2.4 s, seen inside at 2.5 s."""
    hole = ((60.0, -9.0), (80.0, -9.0), (80.0, 9.0), (60.0, 9.0))
    holed = replace(stated().volume, rings=(CORNERS, hole), outside=(False, True))
    assert probe(holed)(flight(), SCENARIO)[0] == pytest.approx(2.5)
    beside = replace(holed, rings=(CORNERS, tuple((n, e + 20.0) for n, e in hole)))
    assert probe(beside)(flight(), SCENARIO)[0] == pytest.approx(4.1)
    places = np.array([[70.0, 12.0, 3.0], [-90.0, 95.0, 60.0]])
    found = replace(beside, low=-20.0, high=HIGH).margins(places)
    assert found == pytest.approx(np.array([[-1.0, 47.0, 23.0], [5.0, -10.0, 80.0]]))


def test_the_words_of_a_volume_have_its_size_and_its_way_from_the_start():
    words = volume((-100.0, -2.0), (-100.0, 3.0), (250.0, 3.0), (250.0, -2.0), high=40.0).words
    assert "350 m by 5 m" in words
    assert "100 m south to 250 m north" in words
    assert "2 m west to 3 m east" in words
    assert "the ground to 40.0 m above" in words
    assert "from 5.0 m above the start to any height" in wide(low=5.0).words
    low = volume((10.0, 1.0), (20.0, 1.0), (20.0, 2.0)), volume((-20.0, -4.0), (-10.0, -2.0))
    assert "10 m north to 20 m north" in low[0].words
    assert "4 m west to 2 m west" in low[1].words
    holed = replace(stated().volume, rings=(CORNERS, CORNERS), outside=(False, True))
    assert "200 m by 200 m without 1 areas" in holed.words
    assert "all but" in replace(holed, outside=(True, True)).words
    near = replace(holed, rings=(CORNERS, tuple((n + 5e-7, e) for n, e in CORNERS)))
    far = replace(holed, rings=(CORNERS, tuple((n + 5e-6, e) for n, e in CORNERS)))
    assert [holed.differs(x) for x in (near, far, box())] == [False, True, True]
