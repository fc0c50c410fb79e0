"""What is read of plans, waypoint files, KML and GeoJSON, and what is refused."""

import json
import math
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_LZMA, ZipFile

import numpy as np
import pytest
import shapely
from commands import answer, flighttune
from fuzzing import refused_apart
from plans import HOME, PATROL, item, plan_file, waypoint

import flighttune as ft
from flighttune.routes import maps, mission
from flighttune.routes.items import listed_places
from flighttune.routes.mission import read_route
from flighttune.routes.path import Ability, Stretch, Waypoint, plan

NO_PLACE = (0, 0, 0, 0)


def speed(value):
    return item(178, 0, value, -1, *NO_PLACE, frame=2)


# Commands without a place that leave the path as it is, with parameters as QGroundControl has them.
SPEED, CAMERA, GRIPPER = speed(22), item(206, 25), item(211, 1, 0)
REGION_OF_INTEREST = item(201, 0, 0, 0, 0, 47.402, 8.51, 0)
DELAY, RETURN = item(93, 30, -1, -1, -1, 0, 0, 0, frame=2), item(20, 0, 0, 0, *NO_PLACE, frame=2)
LAND = item(21, 0, 0, 0, 0, 47.39, 8.52, 0)
SCAN = {"type": "ComplexItem", "complexItemType": "StructureScan"}

PLACE = (47.405, 8.51, 60)
SCENARIO = """
title = "plan"
gains = ["paper"]
[flight]
V_a_mps = 25.0
duration_s = 900.0
{flight}
[route]
file = "m.plan"
[limits]
phi_deg = [-45.0, 45.0]
phi_rate_dps = 30.0
[[plant]]
kind = "kinematic"
"""


class Read:
    """What is read of a file: rows without their names, the names, and the notes."""

    def __init__(self, file, **options):
        self.file, (route, self.flight, _) = file, read_route(file, **options)
        self.names = [row.pop("name") for row in route["waypoint"]]
        self.rows, self.notes, self.rally = route["waypoint"], route["notes"], route.get("rally")

    def values(self, key):
        return [row.get(key) for row in self.rows]


@pytest.fixture
def read(tmp_path):
    """A reader of a plan with some items."""

    def read(*items, skip=False, **tables):
        return Read(plan_file(tmp_path / "m.plan", *items, **tables), skip=skip)

    return read


@pytest.fixture
def read_text(tmp_path):
    """A reader of a file with an ending and a text."""

    def read_text(ending, text):
        file = tmp_path / f"m{ending}"
        file.write_text(text if isinstance(text, str) else json.dumps(text))
        return Read(file)

    return read_text


def test_a_plan_gives_its_waypoints_with_heights_above_the_first(read):
    route = read(*PATROL)

    assert route.names == ["item 1", "item 2", "item 3", "item 4"]
    assert route.rows == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 30.0, "turns": -2.0, "radius_m": 180.0},
        {"lat_deg": 47.4, "lon_deg": 8.52, "up_m": 30.0},
    ]
    assert route.flight == {"h_m": 540.0, "ground_m": 480.0}
    assert route.notes == [
        "Flown of the plan: items 1, 2, 4 (NAV_WAYPOINT 16), item 3 (NAV_LOITER_TURNS 18)."
    ]


def test_a_home_position_of_zeros_far_from_the_route_is_no_place(read):
    """Take-offs and returns without a place lead nowhere then; the rest of the plan is flown."""
    route = read(item(22, 15, 0, 0, None, 0, 0, 50), *PATROL[:3], RETURN, home=(0, 0, 0))

    assert route.names == ["item 2", "item 3", "item 4"]
    assert route.flight == {"h_m": 60.0, "ground_m": 0.0}
    said = " ".join(route.notes)
    assert "item 1 (NAV_TAKEOFF 22, to or from a home without a place), item 5" in said
    assert "the route begins at item 2, and heights above home count from 0 m above" in said
    with pytest.raises(ft.InputError, match=r"`plannedHomePosition` .* near the route"):
        read(*PATROL, home=(0, 0, 0))
    with pytest.raises(ft.InputError, match=r"home, .* has no place"):
        read(PATROL[2], PATROL[1], home=(0, 0, 0))


@pytest.mark.parametrize("home", [None, (47.4, 8.5), (47.4, 8.5, None), (47.4, 8.5, "480"), "x"])
def test_a_plan_without_the_height_of_its_home_position_is_refused(read, home):
    """Heights above sea level and above home would be mixed, or count from no known height."""
    for items in (PATROL, PATROL[:3], (waypoint(*PLACE, frame=0), PATROL[3])):
        with pytest.raises(ft.InputError, match="sea level in `plannedHomePosition`"):
            read(*items, home=home)


def test_a_survey_is_the_items_that_it_consists_of(read):
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": list(PATROL[1:3])}}
    with pytest.raises(ft.InputError, match=r"item 4 \(NAV_SPLINE_WAYPOINT 82\)"):
        read(PATROL[0], survey, item(82, 0, 0, 0, 0, *PLACE))


def test_commands_without_a_place_are_left_out_by_number_and_name(read):
    route = read(PATROL[0], SPEED, CAMERA, *PATROL[1:], REGION_OF_INTEREST, GRIPPER, CAMERA)
    listed = (
        "item 2 (DO_CHANGE_SPEED 178). Not flown of the plan: "
        "items 3, 9 (DO_SET_CAM_TRIGG_DIST 206), item 7 (DO_SET_ROI 201), item 8 (DO_GRIPPER 211)."
    )

    assert listed in " ".join(flighttune("mission", "--plan", route.file)[0].split())
    assert listed in " ".join(answer("mission", "--plan", route.file)["notes"])
    assert route.rows == read(*PATROL).rows


def test_commands_that_change_the_flight_are_left_out_on_request_alone(read):
    items = *PATROL, DELAY, item(4242, 1)
    listed = "item 5 (NAV_DELAY 93), item 6 (command 4242)"

    with pytest.raises(ft.InputError) as refusal:
        read(*items)
    assert f"got {listed}; `--set route.skip=true`" in str(refusal.value)
    assert read(*items, skip=True).notes[1:] == [f"Not flown of the plan: {listed}."]


REFUSED = {
    "'StructureScan'": SCAN,
    "'CorridorScan', whose items are not in the file": {
        "type": "ComplexItem",
        "complexItemType": "CorridorScan",
        "TransectStyleComplexItem": {"Items": []},
    },
    "NAV_TAKEOFF 22, in flight": item(22, 15, 0, 0, None, *PLACE),
    "NAV_SPLINE_WAYPOINT 82": item(82, 0, 0, 0, None, *PLACE),
    "DO_SET_HOME 179": item(179, 1, 0, 0, *NO_PLACE),
    "command 4242": item(4242, 0, 0, 0, 0, *PLACE),
    "NAV_LOITER_TURNS 18, frame 2": item(18, 1, 0, 150, 1, *PLACE, frame=2),
}


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("name", REFUSED)
def test_a_position_that_is_not_flown_is_refused_by_number_and_name(read, name, skip):
    with pytest.raises(ft.InputError) as refusal:
        read(*PATROL[:2], REFUSED[name], *PATROL[2:], skip=skip)
    assert f"got item 3 ({name})." in str(refusal.value)


def test_a_take_off_with_a_place_is_where_the_route_begins(read):
    route = read(SPEED, item(22, 15, 0, 0, None, 47.39, 8.5, 50), *PATROL)

    assert route.values("lat_deg")[:2] == [47.39, 47.4]
    assert route.values("up_m")[:2] == [0.0, 10.0]
    assert route.flight["h_m"] == HOME[2] + 50.0
    assert "The route begins where the take-off of item 2 (NAV_TAKEOFF 22) ends." in route.notes


def test_what_of_a_waypoint_is_not_flown_is_said(read):
    assert read(*PATROL[:2], item(16, 10, 15, 0, None, *PLACE), PATROL[3]).notes[1:] == [
        "The hold time of item 3 (NAV_WAYPOINT 16), 10 s, is not flown.",
        "The radius of item 3 (NAV_WAYPOINT 16) is not used: the path passes inside of the corner.",
    ]


# Circles by time, without an end and to a height, as QGroundControl has their parameters, and keys
# of the waypoint that they become.
CIRCLES = {
    "without an end": (item(17, 0, 0, -200, None, *PLACE), {"turns": -2.0, "radius_m": 200.0}),
    "by time": (item(19, 90, 0, 220, 1, *PLACE), {"turns": 1.0, "radius_m": 220.0, "hold_s": 90.0}),
    "to a height": (
        item(31, 1, -210, 0, 1, *PLACE),
        {"turns": -1.0, "radius_m": 210.0, "spiral": True},
    ),
}


@pytest.mark.parametrize("kind", CIRCLES)
def test_loiters_become_turns(read, kind):
    loiter, keys = CIRCLES[kind]
    row = read(*PATROL[:2], loiter, PATROL[3]).rows[2]

    assert row == {"lat_deg": 47.405, "lon_deg": 8.51, "up_m": 0.0, **keys}


def jump(to, repeats):
    return item(177, to, repeats, 0, *NO_PLACE, frame=2)


def test_a_jump_repeats_its_items_as_often_as_it_says(read):
    items = *PATROL[:2], PATROL[3], jump(2, 2)
    route = read(*(dict(x, doJumpId=i) for i, x in enumerate(items, start=1)))

    assert route.values("lat_deg") == [47.4, *[47.41, 47.4] * 3]


@pytest.mark.parametrize("repeats", [-1, 11])
def test_a_jump_with_too_many_repeats_is_left_out_on_request(read, repeats):
    items = *PATROL[:2], PATROL[3], jump(2, repeats)
    items = [dict(x, doJumpId=i) for i, x in enumerate(items, start=1)]

    with pytest.raises(ft.InputError, match=r"item 4 .*; `--set route.skip=true` leaves it out"):
        read(*items)
    route = read(*items, skip=True)
    assert route.names == ["item 1", "item 2", "item 3"]
    assert "Not flown of the plan: item 4 (DO_JUMP 177, with too many repeats)." in route.notes


def test_an_item_that_a_jump_leaves_out_is_listed(read):
    items = PATROL[0], jump(4, 1), *PATROL[2:]
    route = read(*(dict(x, doJumpId=i) for i, x in enumerate(items, start=1)))

    assert route.names == ["item 1", "item 4"]
    assert "Not flown of the plan: item 3 (NAV_LOITER_TURNS 18, which a jump leaves out)." in (
        route.notes
    )


LANDING = {
    "type": "ComplexItem",
    "complexItemType": "fwLandingPattern",
    "altitudesAreRelative": True,
    "landCoordinate": [47.4, 8.51, 0],
    "landingApproachCoordinate": [47.39, 8.51, 40],
    "loiterRadius": 180,
    "loiterClockwise": False,
    "useLoiterToAlt": True,
}


@pytest.mark.parametrize(
    "key", ["altitudesAreRelative", "loiterClockwise", "useLoiterToAlt", "autoContinue"]
)
@pytest.mark.parametrize("value", ["false", 0, None, []])
def test_what_is_true_or_false_is_nothing_else(read, key, value):
    last = (LANDING if key in LANDING else PATROL[3]) | {key: value}
    with pytest.raises(ft.InputError, match=rf"m\.plan: .*`{key}` must be true or false, got "):
        read(*PATROL[:3], last)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frame": False}, "`frame` must be a number, got False"),
        ({"params": [True, 0, 0, None, 47.4, 8.5, 60]}, "every parameter .* got True"),
        ({"command": 178, "params": ""}, "`params` must be a list, got ''"),
        ({"command": 18, "params": [1, 0, False, None, 47.4, 8.5, 60]}, "`radius_m` .* got False"),
        (item(18, 0, 0, 0, 1, *PLACE), "`turns` .*item 2 .*got 0"),
        ({"params": [0, 0, 0, None, "47.4", 8.5, 60]}, r"`lat_deg` of item 2 .* got '47.4'"),
        (jump(7, 1), "item 2 .*must lead to an item, got 7"),
        *((jump(1, n) | {"doJumpId": 1}, rf"item 2 .*at most 10 times, got {n}") for n in (-1, 11)),
    ],
)
def test_a_value_of_an_item_that_cannot_be_flown_is_refused(read, changes, says):
    with pytest.raises(ft.InputError, match=says):
        read(PATROL[0], PATROL[1] | changes, *PATROL[2:])


HOMES = (91, 8.5, 480), (47.4, -181, 480), (float("nan"), 8.5, 480)
CRUISE_SPEEDS = 0, -25, 1e308, float("nan"), "25", None, True


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        *(("plannedHomePosition", home, "(home p|plannedHomeP)osition") for home in HOMES),
        *(("cruiseSpeed", speed, "`cruiseSpeed`") for speed in CRUISE_SPEEDS),
    ],
)
def test_a_home_beyond_the_earth_and_an_impossible_speed_are_refused(read, key, value, named):
    mission = {"plannedHomePosition": HOME, "items": PATROL, key: value}
    with pytest.raises(ft.InputError, match=rf"m\.plan: .*{named}.* must "):
        read(mission=mission)


def test_a_landing_pattern_is_a_circle_down_and_a_final_to_a_height_above_its_place(read):
    route = read(*PATROL, LANDING)

    assert route.rows[-2:] == [
        {"lat_deg": 47.39, "lon_deg": 8.51, "up_m": -20.0}
        | {"turns": -1.0, "radius_m": 180.0, "spiral": True},
        {"lat_deg": 47.4, "lon_deg": 8.51, "up_m": -50.0},
    ]
    assert "Item 7 (NAV_LAND 21) is flown to 10 m above its place." in route.notes
    assert "item 5 (DO_LAND_START 189)" in route.notes[1]


def test_landing_patterns_of_version_1_have_a_kind_of_height_for_each_of_their_places(read):
    """QGroundControl: ``loiterAltitudeRelative`` and ``landAltitudeRelative``, before version 2."""
    old = {key: x for key, x in LANDING.items() if not key.startswith(("alt", "landing"))}
    old |= {"loiterCoordinate": [47.39, 8.51, 520], "landCoordinate": [47.4, 8.51, 0]}
    old |= {"loiterAltitudeRelative": False, "landAltitudeRelative": True}

    assert read(*PATROL, old).rows[-2:] == read(*PATROL, LANDING).rows[-2:]  # home is at 480 m


def test_the_items_of_a_landing_pattern_are_counted_as_the_vehicle_gets_them(read):
    """QGroundControl sends two items that stop photos, one that stops a video, and the speed."""
    stops = {"stopTakingPhotos": True, "stopVideoPhotos": True}
    slower = {"useDoChangeSpeed": True, "finalApproachSpeed": 20}
    route = read(*PATROL, LANDING | stops | slower)

    assert "Item 11 (NAV_LAND 21) is flown to 10 m above its place." in route.notes
    assert "item 7 (IMAGE_STOP_CAPTURE 2001), item 8 (VIDEO_STOP_CAPTURE 2501)" in route.notes[1]
    assert route.rows[-3]["V_mps"] == 20.0


def test_items_of_plans_before_2018_have_their_place_beside_four_parameters(read):
    old = [
        x | {"params": x["params"][:4], "coordinate": x["params"][4:]} for x in (*PATROL, RETURN)
    ]

    assert read(*old).rows == read(*PATROL, RETURN).rows


def test_a_return_ends_above_home_and_what_follows_is_not_flown(read):
    route = read(*PATROL, RETURN, waypoint(47.5, 8.5, 60), home=(47.402, 8.503, 480.0))

    assert route.rows[-1] == {"lat_deg": 47.402, "lon_deg": 8.503, "up_m": 30.0}
    assert "item 6 (NAV_WAYPOINT 16, after the end of item 5)" in route.notes[1]


def test_heights_above_terrain_are_said_to_count_from_home(read):
    known = waypoint(47.405, 8.52, 60, frame=10) | {"AMSLAltAboveTerrain": 600.0}
    route = read(*PATROL[:2], waypoint(*PLACE, frame=10), known)

    assert route.values("up_m") == [0.0, 0.0, 0.0, 60.0]
    assert [note for note in route.notes if "terrain" in note] == [
        "The height of item 3 (NAV_WAYPOINT 16) is above terrain, which is unknown: "
        "it counts from home."
    ]


def test_airspeeds_of_a_plan_are_flown_from_their_places_on(read):
    throttle = item(178, 0, -1, 40, *NO_PLACE, frame=2)
    route = read(PATROL[0], SPEED, throttle, *PATROL[1:3], speed(20), PATROL[3])

    assert route.flight["V_a_mps"] == 22.0
    assert route.values("V_mps") == [22.0, None, 20.0, None]
    assert route.notes[-1] == (
        "The plan sets an airspeed of 22 m/s by item 2, 20 m/s by item 6, each from its place on "
        "where the law holds the airspeed (`holds_airspeed` of [route])."
    )
    said, _ = flighttune("mission", "--plan", route.file)
    assert "airspeed 20 to 22 m/s, turns for" in said
    whole = flighttune("mission", "--plan", route.file, "--set", "flight.V_a_mps=24")[0]
    assert "airspeed 24 m/s, turns for" in whole


def test_a_change_of_speed_before_the_landing_leaves_what_comes_before_as_it_is(tmp_path):
    route = ft.route(plan_file(tmp_path / "m.plan", *PATROL, speed(20), LAND))
    V, stretches = route.reference.V, route.reference.path.stretches

    before = int(next(x.start for x in stretches if x.name == "item 6"))
    assert (V[:before] == 25.0).all()  # at which the Aerosonde is identified
    assert V[-1] == pytest.approx(20.0)
    assert "airspeed 20 to 25 m/s (25 m/s at the start is assumed), turns" in route.conditions


@pytest.mark.parametrize("number", [1, 3])
def test_an_airspeed_that_the_aircraft_does_not_fly_is_refused_by_its_item(tmp_path, number):
    """The Aerosonde flies 15 to 45 m/s."""
    items = [*PATROL]
    items.insert(number - 1, speed(150))
    file = plan_file(tmp_path / "m.plan", *items)
    named = f"item {number} (DO_CHANGE_SPEED 178, to 150 m/s, but the aircraft flies 15 to 45)"

    with pytest.raises(ft.InputError) as refusal:
        ft.route(file)
    assert str(refusal.value).endswith(f"{named}; `--set route.skip=true` leaves it out.")
    left_out = ft.route(file, changes={"route.skip": True})
    assert f"Not flown of the plan: {named}." in left_out.scenario.notes
    assert "airspeed 25 m/s (assumed)" in left_out.conditions
    whole = ft.route(file, changes={"flight.V_a_mps": 30.0})
    assert "airspeed 30 m/s, turns" in whole.conditions
    assert not any("DO_CHANGE" in note for note in whole.scenario.notes if note[0] == "F")


@pytest.mark.parametrize(
    ("values", "said"),  # MAVLink: type, speed, throttle, relative; -1 no change, -2 the default
    [
        ((1, 30, -1, 0), "sets a ground speed of 30 m/s, which is not flown: in still air"),
        ((2, 3, -1, 0), "sets a climb speed of 3 m/s, which is not flown."),
        ((3, 2, -1, 0), "sets a descent speed of 2 m/s, which is not flown."),
        ((9, 30, -1, 0), "sets a speed of type 9 of 30 m/s, which is not flown."),
        ((0, 3, -1, 1), "sets an airspeed of 3 m/s more, which is not flown."),
        ((0, -2, -1, 0), "sets the default speed of its vehicle, which is not flown."),
        ((0, -1, 40, 0), "sets a throttle of 40 %, which is not flown."),
        ((0, -1, -1, 0), None),
    ],
)
def test_a_change_of_speed_that_sets_no_airspeed_is_named_and_not_flown(read, values, said):
    """The speed of the next leg is no airspeed where the first parameter says another."""
    route = read(PATROL[0], item(178, *values, 0, 0, 0), *PATROL[1:])

    assert "V_a_mps" not in route.flight
    assert not any(route.values("V_mps"))
    assert "Not flown of the plan: item 2 (DO_CHANGE_SPEED 178)." in route.notes
    named = [note for note in route.notes if note.startswith("Item 2 (DO_CHANGE_SPEED 178) ")]
    assert [said in note for note in named] == [True] * bool(said)


@pytest.mark.parametrize("last", [(speed(40),), (RETURN, speed(40), waypoint(*PLACE))])
def test_an_airspeed_set_where_no_flight_comes_is_not_flown(read, last):
    """The largest airspeed of a plan is not that after its last waypoint or its return."""
    route = read(PATROL[0], SPEED, *PATROL, *last)

    assert route.flight["V_a_mps"] == 22.0
    assert any("DO_CHANGE_SPEED" in note for note in route.notes if note[:3] == "Not")


def test_rally_points_are_read_with_heights_above_the_first_waypoint(read):
    rally = {"points": [[47.401, 8.51, 70]], "version": 2}

    assert read(*PATROL, rallyPoints=rally).rally == [
        {"lat_deg": 47.401, "lon_deg": 8.51, "up_m": 10.0}
    ]


WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t488\t1
1\t0\t3\t22\t15\t0\t0\t0\t0\t0\t50\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.5\t80\t1
3\t0\t0\t16\t0\t0\t0\t0\t47.41\t8.52\t588\t1
"""


# Web planners begin with the first waypoint, as item 0 or 1; some write the take-off twice.
WITHOUT_HOME = """QGC WPL 110
0\t1\t3\t16\t0\t0\t0\t0\t47.40\t8.5\t80\t1
1\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.5\t80\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.52\t110\t1
"""
TWO_TAKEOFFS = """QGC WPL 110
1\t1\t3\t22\t15\t0\t0\t0\t47.40\t8.5\t80\t1
1\t1\t3\t22\t15\t0\t0\t0\t47.40\t8.5\t80\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.5\t80\t1
3\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.52\t110\t1
"""


@pytest.mark.parametrize(
    ("text", "names", "first"),
    [
        (WITHOUT_HOME, ["item 0", "item 1", "item 2"], "item 0 (NAV_WAYPOINT 16, frame 3)"),
        (WITHOUT_HOME.replace("0\t1\t3\t16", "0\t1\t3\t22"), ["item 0", "item 1", "item 2"],
         "item 0 (NAV_TAKEOFF 22, frame 3)"),
        (WITHOUT_HOME.replace("\t3\t16\t", "\t10\t16\t"), ["item 0", "item 1", "item 2"],
         "item 0 (NAV_WAYPOINT 16, frame 10)"),
        (TWO_TAKEOFFS, ["item 1", "item 3", "item 4"], "item 1 (NAV_TAKEOFF 22, frame 3)"),
    ],
)  # fmt: skip
def test_a_first_line_that_is_no_home_is_part_of_the_route(read_text, text, names, first):
    route = read_text(".waypoints", text)

    assert route.names == names
    assert route.values("lat_deg") == [47.4, 47.41, 47.41]
    assert route.values("up_m") == [0.0, 0.0, 30.0]
    assert route.flight == {"h_m": 80.0, "ground_m": 0.0}
    (said,) = (note for note in route.notes if "no home" in note)
    assert f"its first line is {first}, which is part of the route" in said


def test_heights_of_a_file_without_a_home_are_stated_by_the_keys_that_it_names(tmp_path):
    file = tmp_path / "m.waypoints"
    file.write_text(WITHOUT_HOME)
    heights = "--set", "flight.h_m=510", "--set", "flight.ground_m=430"

    assert "start 510 m above sea level" in flighttune("mission", file, "--plan", *heights)[0]
    file.write_text(WITHOUT_HOME.replace("2\t0\t3", "2\t0\t0"))
    assert (
        "heights above sea level and above home are in one file"
        in (flighttune("mission", file, "--plan", status=2)[1])
    )
    file.write_text(WITHOUT_HOME.replace("0\t1\t3\t16", "7\t1\t3\t16"))
    said = flighttune("mission", file, "--plan", status=2)[1]
    assert "the first line must be item 0 or 1, got item 7" in said


def test_a_take_off_elsewhere_after_the_first_is_refused(read_text):
    with pytest.raises(ft.InputError, match=r"item 2 \(NAV_TAKEOFF 22, in flight\)"):
        read_text(".waypoints", TWO_TAKEOFFS.replace("47.40\t", "47.4001\t", 1))


def test_a_home_at_the_height_0_above_itself_stays_a_home(read_text):
    text = WAYPOINTS.replace("0\t1\t0\t16", "0\t1\t3\t16").replace("\t488\t", "\t0\t")
    text = text.replace("3\t0\t0\t16", "3\t0\t3\t16")

    assert read_text(".waypoints", text).names == ["item 1", "item 2", "item 3"]


def test_waypoints_of_mission_planner_are_read(read_text):
    text = WAYPOINTS.replace("\n2", "\n\n  # the second leg\n2")  # pymavlink leaves both out
    route = read_text(".waypoints", text.replace("\n", "\r\n"))

    assert route.rows == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 30.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 50.0},
    ]
    assert route.flight == {"h_m": 538.0, "ground_m": 488.0}


KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><LineString>
<altitudeMode>{}</altitudeMode><coordinates>8.5,47.4,548 8.5,47.42,560</coordinates>
</LineString></Placemark></Document></kml>
"""


@pytest.mark.parametrize(("inside", "words"), [(100_000, "LineString"), (100_001, "200000 places")])
def test_the_places_of_all_rings_of_a_map_count_together(read_text, inside, words):
    around, hole = (f"<coordinates>{'8.5,47.4 ' * n}</coordinates>" for n in (100_000, inside))
    rings = f"<outerBoundaryIs>{around}</outerBoundaryIs><innerBoundaryIs>{hole}</innerBoundaryIs>"
    text = f"<kml><Placemark><Polygon>{rings}</Polygon></Placemark></kml>"

    with pytest.raises(ft.InputError, match=words):
        read_text(".kml", text)


def test_a_line_of_kml_is_read(read_text):
    route = read_text(".kml", KML.format("absolute"))

    assert route.values("up_m") == [0.0, 12.0]
    assert route.flight == {"h_m": 548.0}
    above_ground = read_text(".kml", KML.format("relativeToGround"))
    assert above_ground.flight == {}
    assert "above the ground" in above_ground.notes[0]
    # KML: its heights are to be ignored.
    clamped = read_text(".kml", KML.format("clampToGround"))
    assert clamped.flight == {}
    assert clamped.values("up_m") == [0.0, 0.0]
    assert "no heights that count, as its line is clampToGround" in clamped.notes[0]
    with pytest.raises(ft.InputError, match=r"without blanks .* got '8.5,'"):
        read_text(".kml", KML.format("absolute").replace("8.5,", "8.5, "))


def archive(path, **texts):
    with ZipFile(path, "w", ZIP_DEFLATED) as file:
        for name, text in texts.items():
            file.writestr(f"{name}.kml", text)
    return path


def test_a_kmz_is_read_as_the_kml_that_it_holds(read_text, tmp_path):
    route = Read(archive(tmp_path / "m.kmz", doc=KML.format("absolute")))

    assert route.rows == read_text(".kml", KML.format("absolute")).rows
    assert "The path can be flown" in flighttune("mission", "--plan", route.file)[0]


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({}, "must hold one .kml file, got 0."),
        ({"a": "", "b": ""}, "must hold one .kml file, got 2: 'a.kml, b.kml'."),
        ({"a": " " * 17_000_000}, "its .kml must have at most 16000000 bytes, got more."),
        (None, "must be a zip archive with a .kml file, got File is not a zip file."),
    ],
)
def test_a_kmz_without_one_kml_of_an_ordinary_size_is_refused(tmp_path, texts, says):
    file = tmp_path / "m.kmz"
    file.write_text("no archive") if texts is None else archive(file, **texts)

    with pytest.raises(ft.InputError) as refusal:
        read_route(file)
    assert str(refusal.value) == f"{file}: {says}"


@pytest.mark.slow
@pytest.mark.parametrize("packing", [ZIP_BZIP2, ZIP_LZMA])
def test_a_kmz_of_a_packing_that_cannot_be_bounded_is_refused_unread(tmp_path, packing):
    """Of 724 bytes bzip2 makes 670 MB, which would be in memory before they are counted."""
    with ZipFile(tmp_path / "m.kmz", "w", packing) as file:
        file.writestr("doc.kml", KML.format("absolute") + " " * 15_000_000)

    said, grown = refused_apart(lambda: read_route(tmp_path / "m.kmz"))

    assert said.endswith("`doc.kml` must be stored or deflated, got another compression.")
    assert grown < 8_000_000


def line(*points):
    return {"type": "LineString", "coordinates": points}


def test_shapes_beside_the_line_are_said_to_be_left(read_text):
    shapes = line([8.5, 47.4, 548.0], [8.5, 47.42, 548.0]), {"type": "Point"}
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    route = read_text(".geojson", {"type": "FeatureCollection", "features": features})

    assert route.notes == ["Of the shapes in the file the line alone is read."]


def test_a_line_has_heights_at_every_point_or_at_none(read_text):
    high = read_text(".geojson", line([8.5, 47.4, 548.0], [8.5, 47.42, 560.0]))

    assert high.flight == {"h_m": 548.0}
    for height in ([], [0.0]):
        route = read_text(".geojson", line([8.5, 47.4, *height], [8.5, 47.42, *height]))
        assert (route.flight, len(route.rows)) == ({}, 2)
        assert route.notes == ["The file has no heights: the route is level, at `h_m`."]
    with pytest.raises(ft.InputError, match="a height at every point"):
        read_text(".geojson", line([8.5, 47.4, 548.0], [8.5, 47.42]))


def test_the_airspeed_and_the_wind_that_are_assumed_are_in_the_first_lines(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    stated = ("--set", "flight.V_a_mps=24", "--set", "route.wind_mps=5")

    assert (
        "For jsbsim:aerosonde: airspeed 25 m/s (assumed), turns for wind up to 8.33 m/s (assumed), "
        "start 540 m above sea level."
    ) in " ".join(flighttune("mission", "--plan", file)[0].split()[:60])
    conditions = answer("mission", "--plan", file, *stated)["conditions"]
    assert conditions == "airspeed 24 m/s, turns for wind up to 5 m/s, start 540 m above sea level"


def test_numbers_of_a_route_have_the_digits_of_a_map(tmp_path):
    legs = [waypoint(47.4 + 0.001 * (k % 2), 8.5 + 0.0004 * (k // 2), 60) for k in range(6)]
    file = plan_file(tmp_path / "m.plan", *PATROL[:1], *legs, home=(47.4, 8.5, 486.963))

    said, *_ = flighttune("mission", "--plan", file)

    said = " ".join(said.split())
    assert "start 547 m above sea level" in said  # the first waypoint is 60 m above home
    assert "Turn-arounds at items 3 to 6 go up to" in said


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["item 9", "item 3", "item 9"], "items 3, 9"),
        (["item 3", "home", "item 4", "item 5"], "items 3 to 5, home"),
        (["item 12"], "item 12"),
        (["north corner", "item 2b"], "north corner, item 2b"),
    ],
)
def test_places_are_listed_once_and_numbers_share_one_word(names, said):
    assert listed_places(names) == said


def test_a_scenario_has_the_heights_and_the_notes_of_its_plan(tmp_path):
    plan_file(tmp_path / "m.plan", *PATROL, CAMERA)
    file = tmp_path / "m.toml"
    file.write_text(SCENARIO.format(flight=""))
    scenario = ft.load_scenario(file)

    assert (scenario.flight.h_m, scenario.flight.ground_m) == (540.0, 480.0)
    assert "Not flown of the plan: item 5 (DO_SET_CAM_TRIGG_DIST 206)." in scenario.notes
    file.write_text(SCENARIO.format(flight="h_m = 1000.0"))
    with pytest.raises(ft.InputError, match=r"`h_m` .*540, .*m\.plan, .*1000 m"):
        ft.load_scenario(file)


TRACK = """<kml xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:Track>
<altitudeMode>absolute</altitudeMode><when>2026-05-01T10:00:00Z</when>
<gx:coord>8.5 47.4 548</gx:coord><gx:coord>8.5 47.42 560</gx:coord></gx:Track></Placemark></kml>
"""
POINT = "<kml><Placemark><Point><coordinates>8.5,47.4</coordinates></Point></Placemark></kml>"
LINE = line([8.5, 47.4, 548.0], [8.5, 47.42, 560.0])
LINES = {"type": "MultiLineString", "coordinates": [LINE["coordinates"]]}


@pytest.mark.parametrize(
    ("ending", "text"),
    [
        (".kml", TRACK),
        (".geojson", {"type": "Feature", "properties": {}, "geometry": LINES}),
        (".geojson", {"type": "GeometryCollection", "geometries": [LINE]}),
        (".geojson", LINE | {"crs": {"properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}}),
    ],
)
def test_a_track_and_a_collection_of_one_line_are_read_as_the_line(read_text, ending, text):
    assert read_text(ending, text).rows == read_text(".geojson", LINE).rows


@pytest.mark.parametrize(
    ("ending", "text", "says"),
    [
        (".kml", POINT, "must have one LineString, or in KML one track, got 1 of Point"),
        (".geojson", LINES | {"coordinates": [LINE["coordinates"]] * 2}, "got 2 of LineString"),
        (".geojson", LINE | {"crs": {"properties": {"name": "EPSG:4314"}}}, "got 'EPSG:4314'"),
        (".geojson", line([-33.9, 151.2], [-33.8, 151.2]), "point 1 must have a latitude up to 85"),
        (".kml", KML.format("absolute").replace(",548", ";548"), "got '8.5,47.4;548'"),
        (".waypoints", WAYPOINTS.replace(".", ","), r"12 numbers with points .* got '0 1 0 16 "),
        (".waypoints", WAYPOINTS.replace("110", "120"), "got 'QGC WPL 120'"),
        (".plan", "{}", "got none with `mission`"),
    ],
)
def test_a_line_that_cannot_be_read_is_refused_by_what_is_wrong(read_text, ending, text, says):
    with pytest.raises(ft.InputError, match=says):
        read_text(ending, text)


@pytest.mark.parametrize("key", ["type", "command", "frame", "params"])
def test_an_item_that_lacks_a_key_is_refused_by_its_number(read, key):
    less = {name: value for name, value in PATROL[1].items() if name != key}

    with pytest.raises(ft.InputError, match=rf"item 2 .* `{key}`, got none"):
        read(PATROL[0], less, *PATROL[2:])


@pytest.mark.parametrize(
    ("items", "points", "words"),
    [
        ((), [[47.4, 8.5, 60]] * 2, "got 0 and 2 rally points"),
        (PATROL, [[47.4, 8.5]], r"point 1 .* got None"),
    ],
    ids=["alone", "no height"],
)
def test_rally_points_are_beside_a_route_and_whole(read, items, points, words):
    with pytest.raises(ft.InputError, match=words):
        read(*items, rallyPoints={"points": points})


def test_what_holds_for_several_items_is_said_once(read):
    high = [waypoint(*PLACE[:1], 8.51 + 0.01 * i, 60, frame=10) for i in range(4)]

    assert [note for note in read(*high).notes if "terrain" in note] == [
        "The height of items 1 to 4 (NAV_WAYPOINT 16) is above terrain, which is unknown: it "
        "counts from home."
    ]


NO_WAYPOINTS = (
    *("", "QGC WPL 110\n", WAYPOINTS.replace("588", "588\t5")),
    WAYPOINTS.replace("\t16\t", "\t16.9\t"),
    *(WAYPOINTS.replace("110", other) for other in ("", "110 2")),
    "\n".join(WAYPOINTS.splitlines()[::2]),  # without home
)
NO_PLAN = "{}", "[]", '{"mission": {}}', '{"mission": {"items": [{}]}}', '{"type": "Feature"}'


@pytest.mark.parametrize(
    ("ending", "text"),
    [*((".waypoints", text) for text in NO_WAYPOINTS), *((".json", text) for text in NO_PLAN)],
)
def test_another_file_is_refused(read_text, ending, text):
    with pytest.raises(ft.InputError, match=rf"m\{ending}") as refusal:
        read_text(ending, text)
    assert "Error" not in str(refusal.value)


@pytest.mark.parametrize("ending", [".mission", ".gpx", ".xml"])
def test_files_of_other_programs_are_refused_in_one_line_that_names_what_is_read(tmp_path, ending):
    file = tmp_path / f"m{ending}"
    file.write_text("")
    (tmp_path / "s.toml").write_text(SCENARIO.format(flight="").replace("m.plan", file.name))

    for source in (file, tmp_path / "s.toml"):
        said = flighttune("mission", "--plan", source, status=2)[1]
        assert (
            "must be a plan of QGroundControl, waypoints of Mission Planner, or KML or Geo" in said
        )
        assert f"got {ending}" in said
        assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    "after",
    [item(84, 0, 0, 0, None, *PLACE), item(4242, 0, 0, 0, 0, *PLACE), DELAY, jump(1, -1), SCAN],
)
def test_whatever_follows_a_landing_is_not_flown(read, after):
    route = read(*PATROL, LAND, after, waypoint(*PLACE))

    assert route.names[-1] == "item 5"
    assert route.notes[1].startswith("Not flown of the plan: item 6")
    assert "item 7 (NAV_WAYPOINT 16, after the end of item 5)" in route.notes[1]


def test_circles_at_zeros_are_around_the_item_before_as_arduplane_flies_them(read):
    """ArduPilot, Location::sanitize: zeros are where the vehicle is, and its height."""
    circle = item(18, 2, 0, 200, 1, 0, 0, 0)
    route = read(*PATROL[:2], circle, PATROL[3])
    said = "Item 3 (NAV_LOITER_TURNS 18) is at 0, 0: it circles around the item before"

    assert [*route.rows[2].values()][:3] == [47.41, 8.5, 0.0]
    assert said in " ".join(route.notes)
    nowhere = r"item 4 \(NAV_LOITER_TURNS 18, at 0, 0: around where it is then"
    with pytest.raises(ft.InputError, match=nowhere):
        read(*PATROL[:3], circle)
    for command in (16, 21, 85):
        with pytest.raises(ft.InputError, match=r"item 3 \(.*, which is no place\)"):
            read(*PATROL[:2], item(command, 0, 0, 0, None, 0, 0, 50))


def test_a_waypoint_at_the_height_of_home_is_refused_by_its_item_and_the_key_of_the_ground(
    tmp_path,
):
    low = waypoint(47.41, 8.52, 0), waypoint(47.4, 8.52, 60)
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], CAMERA, *low)

    with pytest.raises(ft.InputError, match=r"`ground_m`, 480 .* at item 4\."):
        ft.route(file)
    flown = ft.route(file, changes={"flight.ground_m": 400.0}).scenario.flight
    assert (flown.h_m, flown.ground_m) == (540.0, 400.0)


def test_sentences_count_items_as_the_file_does_and_points_of_a_line(tmp_path, read_text):
    """What is not flown counts too: the climb of 300 m over 1.5 km is to item 5."""
    high = waypoint(47.41, 8.52, 360)
    with pytest.raises(ft.InputError, match=r"of item 5 .*item 4"):
        ft.route(plan_file(tmp_path / "m.plan", PATROL[0], SPEED, CAMERA, PATROL[1], high))
    near = read_text(".kml", KML.format("absolute").replace("47.42,560", "47.40001,560"))
    with pytest.raises(ft.InputError, match="point 2"):
        ft.route(near.file, changes={"route.turnaround_m": 0.0})


def test_equal_neighbours_are_one_waypoint(read, read_text):
    """QGroundControl writes home into its KML at the ground, and at the height of the flight."""
    twice = KML.format("absolute").replace("8.5,47.4,548 ", "8.5,47.4,488 8.5,47.4,548 ")
    route, plan = read_text(".kml", twice), read(*PATROL[:2], waypoint(47.41, 8.5, 90), PATROL[3])
    said = "have one place: it is passed at the height of"

    assert route.values("up_m") == [0.0, 12.0]
    assert route.flight == {"h_m": 548.0}
    assert route.notes == [f"Point 1 and point 2 {said} point 2."]
    assert plan.values("up_m") == [0.0, 30.0, 30.0]
    assert f"Item 2 and item 3 {said} item 3." in plan.notes


def test_a_wind_faster_than_the_aircraft_gives_a_sentence_and_no_infinity(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    said, _ = flighttune("mission", "--plan", file, "--set", "route.wind_mps=30")

    assert "without an end against a wind of 30 m/s" in said
    assert not any(word in said for word in (" inf ", "∞"))


@pytest.mark.parametrize(
    ("kind", "start", "length", "radius", "passed"),
    [
        ("leg", 100.0, 50.0, math.inf, []),
        ("turn", 100.0, 50.0, 200.0, [125.0]),
        ("turn-around", 100.0, 50.0, 200.0, [100.0, 125.0, 150.0]),
        # 1000 m at a radius of 100 m turn by 10 rad, in parts of up to 45 deg
        ("turn-around", 0.0, 1000.0, 100.0, np.linspace(0.0, 1000.0, 14)),
    ],
)
def test_a_turn_is_passed_in_its_middle_and_a_turn_around_every_45_degrees(
    kind, start, length, radius, passed
):
    stretch = Stretch(kind, 2, start, length, 0.0, 0.0, radius, 0.0, 0.0, "waypoint 2")

    assert list(mission._passed(stretch)) == pytest.approx(list(passed))


@pytest.mark.parametrize(
    ("ends", "beyond"), [((0, 0, 10, 10), 0.0), ((-3, 0, 10, 10), 3.0), ((-3, -4, 10, 10), 5.0)]
)
def test_an_area_goes_beyond_another_as_far_as_its_farthest_place(ends, beyond):
    found = mission._beyond(shapely.box(0, 0, 10, 10), shapely.box(*ends))

    # in 14 halvings of a diagonal of up to 20 m; round ends of a buffer lie 0.5 % inside
    assert beyond - 1e-9 <= found <= 1.01 * beyond + 20.0 / 2**14 + 1e-9


def test_areas_without_details_stay_on_the_safe_side():
    area = shapely.Polygon([(0, 0), (0, 100), (50, 100.5), (100, 100), (100, 0)])

    zone, room = (mission._changed(area, outside, 2.0) for outside in (True, False))

    assert zone.covers(area.buffer(-1e-9))
    assert area.covers(room)
    assert zone.bounds == pytest.approx((-2.0, -2.0, 102.0, 102.5), abs=1.0)
    assert room.bounds == pytest.approx((2.0, 2.0, 98.0, 98.5), abs=1.0)
    assert len(room.exterior.coords) < len(area.exterior.coords)


def test_rings_of_an_area_say_which_are_holes():
    outer, hole = (shapely.box(*ends).exterior.coords for ends in ((0, 0, 90, 90), (9, 9, 20, 20)))
    shape = shapely.Polygon(outer, [hole])
    two = shapely.MultiPolygon([shape, shapely.box(200, 0, 300, 50)])

    rings = mission._rings(two, False, (47.0, 8.0))

    assert [out for _, out in rings] == [False, True, False]
    assert mission._vertices(rings) == 12
    (ring, _), *_ = mission._rings(shape, True, (47.0, 8.0))
    again = mission._polygon(ring, (47.0, 8.0))
    assert again.bounds == pytest.approx((0.0, 0.0, 90.0, 90.0), abs=0.01)
    assert mission._rings(shapely.Polygon(), False, (47.0, 8.0)) == []


def test_circles_that_are_first_are_reached_from_above_home(read):
    route = read(item(18, 1, 0, 100, 1, 47.41, 8.5, 80), *PATROL[3:])

    assert route.names[:2] == ["home", "item 1"]
    assert route.rows[0] == {"lat_deg": HOME[0], "lon_deg": HOME[1], "up_m": 0.0}
    assert route.flight["h_m"] == HOME[2] + 80.0
    assert "The route begins above home." in route.notes


def test_rally_points_among_the_items_are_no_part_of_the_route(read_text):
    rally = "4\t0\t3\t5100\t0\t0\t0\t0\t47.401\t8.51\t70\t1\n"

    route = read_text(".waypoints", WAYPOINTS + rally)

    assert route.names == read_text(".waypoints", WAYPOINTS).names
    assert route.rally == [{"lat_deg": 47.401, "lon_deg": 8.51, "up_m": 20.0}]


def test_the_text_of_an_element_of_kml_ends_where_another_begins():
    text = KML.format("absolute").replace("47.42,560", "47.42,560<more/>8.5,47.43,570")
    text = text.replace("<LineString>", "<name>Leg <b>not this</b> one</name><LineString>")

    (line,) = maps.kml_features(text)

    assert line["geometry"]["coordinates"] == [[8.5, 47.4, 548.0], [8.5, 47.42, 560.0]]
    assert line["properties"] == {"name": "Leg"}


@pytest.mark.slow
def test_a_map_with_more_areas_than_vehicles_take_is_written_whole_with_a_word():
    """22 triangles have 66 corners, 21 have 63."""
    legs = [Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)]
    path = plan(legs, Ability(V_a=25.0, wind=8.0, phi=0.6, phi_rate=0.4, gamma=(-0.2, 0.2), g=9.8))
    where = path, (47.0, 8.0), 500.0
    around = np.array([[0.0, 50.0], [30.0, 50.0], [0.0, 90.0], [0.0, 50.0]])
    triangles = [
        (maps.on_earth(around + np.array([north, 0.0]), where[1])[:, ::-1].tolist(), True)
        for north in 35.0 * np.arange(22)
    ]

    areas, said = mission._fewer_vertices(maps.RouteMap(where, "many", areas=triangles))
    few, nothing = mission._fewer_vertices(maps.RouteMap(where, "few", areas=triangles[:21]))

    assert areas == triangles
    assert said.startswith("has 66 vertices")
    assert (few, nothing) == (triangles[:21], "")
