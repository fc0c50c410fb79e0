"""What is read of plans, waypoint files, KML and GeoJSON, and what is refused."""

import json

import pytest
from commands import flighttune
from plans import HOME, PATROL, item, plan_file, waypoint

import flighttune as ft
from flighttune.references.mission import read_route

# Commands without a place that leave the path as it is, with parameters as QGroundControl has them.
SPEED, CAMERA, GRIPPER = item(178, 0, 22, -1, 0, 0, 0, 0, frame=2), item(206, 25), item(211, 1, 0)
REGION_OF_INTEREST = item(201, 0, 0, 0, 0, 47.402, 8.51, 0)

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


def notes_of(route):
    return route.route["notes"]


def rows_of(file, **options):
    """The waypoints without what messages call them."""
    rows = read_route(file, **options).route["waypoint"]
    return [{key: value for key, value in row.items() if key != "name"} for row in rows]


def names_of(file):
    return [row["name"] for row in read_route(file).route["waypoint"]]


def test_a_plan_gives_its_waypoints_with_heights_above_the_first(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    route = read_route(file)

    assert names_of(file) == ["item 1", "item 2", "item 3", "item 4"]
    assert rows_of(file) == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 30.0, "turns": -2.0, "radius_m": 180.0},
        {"lat_deg": 47.4, "lon_deg": 8.52, "up_m": 30.0},
    ]
    assert route.flight == {"h_m": 540.0, "ground_m": 480.0}
    assert notes_of(route) == [
        "Flown of the plan: items 1, 2, 4 (NAV_WAYPOINT 16), item 3 (NAV_LOITER_TURNS 18)."
    ]


def test_a_home_position_of_zeros_far_from_the_route_is_no_place(tmp_path):
    """Take-offs and returns without a place lead nowhere then; the rest of the plan is flown."""
    off, back = item(22, 15, 0, 0, None, 0, 0, 50), item(20, 0, 0, 0, 0, 0, 0, 0, frame=2)
    file = plan_file(tmp_path / "m.plan", off, *PATROL[:3], back, home=(0, 0, 0))

    assert names_of(file) == ["item 2", "item 3", "item 4"]
    assert read_route(file).flight == {"h_m": 60.0, "ground_m": 0.0}
    said = " ".join(notes_of(read_route(file)))
    assert "item 1 (NAV_TAKEOFF 22, to or from a home without a place), item 5" in said
    assert "the route begins at item 2, and heights above home count from 0 m above" in said
    with pytest.raises(ft.InputError, match=r"`plannedHomePosition` .* near the route"):
        read_route(plan_file(tmp_path / "a.plan", *PATROL, home=(0, 0, 0)))
    with pytest.raises(ft.InputError, match=r"home, .* has no place"):
        read_route(plan_file(tmp_path / "c.plan", PATROL[2], PATROL[1], home=(0, 0, 0)))


@pytest.mark.parametrize("home", [None, (47.4, 8.5), (47.4, 8.5, None), (47.4, 8.5, "480"), "x"])
def test_a_plan_without_the_height_of_its_home_position_is_refused(tmp_path, home):
    """Heights above sea level and above home would be mixed, or count from no known height."""
    for items in (PATROL, PATROL[:3], (waypoint(*PLACE, frame=0), PATROL[3])):
        with pytest.raises(ft.InputError, match="sea level in `plannedHomePosition`"):
            read_route(plan_file(tmp_path / "m.plan", *items, home=home))


def test_a_survey_is_the_items_that_it_consists_of(tmp_path):
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": list(PATROL[1:3])}}
    file = plan_file(tmp_path / "m.plan", PATROL[0], survey, item(82, 0, 0, 0, 0, *PLACE))

    with pytest.raises(ft.InputError, match=r"item 4 \(NAV_SPLINE_WAYPOINT 82\)"):
        read_route(file)


def test_commands_without_a_place_are_left_out_by_number_and_name(tmp_path):
    items = PATROL[0], SPEED, CAMERA, *PATROL[1:], REGION_OF_INTEREST, GRIPPER, CAMERA
    file = plan_file(tmp_path / "m.plan", *items)
    listed = (
        "item 2 (DO_CHANGE_SPEED 178). Not flown of the plan: "
        "items 3, 9 (DO_SET_CAM_TRIGG_DIST 206), item 7 (DO_SET_ROI 201), item 8 (DO_GRIPPER 211)."
    )

    assert rows_of(file) == rows_of(plan_file(tmp_path / "p.plan", *PATROL))
    assert listed in " ".join(flighttune("mission", "--plan", file)[0].split())
    assert listed in " ".join(
        json.loads(flighttune("mission", "--plan", file, "--json")[0])["notes"]
    )


def test_commands_that_change_the_flight_are_left_out_on_request_alone(tmp_path):
    delay, other = item(93, 30, -1, -1, -1, 0, 0, 0, frame=2), item(4242, 1)
    file = plan_file(tmp_path / "m.plan", *PATROL, delay, other)
    listed = "item 5 (NAV_DELAY 93), item 6 (command 4242)"

    with pytest.raises(ft.InputError) as refusal:
        read_route(file)
    assert f"got {listed}; `--set route.skip=true`" in str(refusal.value)
    assert notes_of(read_route(file, skip=True))[1:] == [f"Not flown of the plan: {listed}."]


REFUSED = {
    "'StructureScan'": {"type": "ComplexItem", "complexItemType": "StructureScan"},
    "'CorridorScan'": {
        "type": "ComplexItem",
        "complexItemType": "CorridorScan",
        "TransectStyleComplexItem": {"Items": []},
    },
    "NAV_TAKEOFF 22, in flight": item(22, 15, 0, 0, None, *PLACE),
    "NAV_SPLINE_WAYPOINT 82": item(82, 0, 0, 0, None, *PLACE),
    "DO_SET_HOME 179": item(179, 1, 0, 0, 0, 0, 0, 0),
    "command 4242": item(4242, 0, 0, 0, 0, *PLACE),
    "NAV_LOITER_TURNS 18, frame 2": item(18, 1, 0, 150, 1, *PLACE, frame=2),
}


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("name", REFUSED)
def test_a_position_that_is_not_flown_is_refused_by_number_and_name(tmp_path, name, skip):
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], REFUSED[name], *PATROL[2:])

    with pytest.raises(ft.InputError) as refusal:
        read_route(file, skip=skip)
    assert f"got item 3 ({name})." in str(refusal.value)


def test_a_take_off_with_a_place_is_where_the_route_begins(tmp_path):
    items = SPEED, item(22, 15, 0, 0, None, 47.39, 8.5, 50), *PATROL
    route = read_route(plan_file(tmp_path / "m.plan", *items))

    first = route.route["waypoint"][:2]
    assert [row["lat_deg"] for row in first] == [47.39, 47.4]
    assert [row["up_m"] for row in first] == [0.0, 10.0]
    assert route.flight["h_m"] == HOME[2] + 50.0
    begins = "The route begins where the take-off of item 2 (NAV_TAKEOFF 22) ends."
    assert begins in notes_of(route)


def test_a_loiter_of_no_turns_is_refused(tmp_path):
    file = plan_file(tmp_path / "m.plan", PATROL[0], item(18, 0, 0, 0, 1, *PLACE), PATROL[3])

    with pytest.raises(ft.InputError, match=r"`turns` .*item 2 .*got 0"):
        read_route(file)


def test_shapes_beside_the_line_are_said_to_be_left(tmp_path):
    file = tmp_path / "m.geojson"
    line = {"type": "LineString", "coordinates": [[8.5, 47.4, 548.0], [8.5, 47.42, 548.0]]}
    shapes = line, {"type": "Point", "coordinates": [8.5, 47.4]}
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))

    assert notes_of(read_route(file)) == ["Of the shapes in the file the LineString alone is read."]


def test_what_of_a_waypoint_is_not_flown_is_said(tmp_path):
    waiting = item(16, 10, 15, 0, None, *PLACE)
    notes = notes_of(read_route(plan_file(tmp_path / "m.plan", *PATROL[:2], waiting, PATROL[3])))

    assert notes[1:] == [
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
def test_loiters_become_turns(tmp_path, kind):
    loiter, keys = CIRCLES[kind]
    row = rows_of(plan_file(tmp_path / "m.plan", *PATROL[:2], loiter, PATROL[3]))[2]

    assert row == {"lat_deg": 47.405, "lon_deg": 8.51, "up_m": 0.0, **keys}


def test_a_jump_repeats_its_items_as_often_as_it_says(tmp_path):
    jump = item(177, 2, 2, 0, 0, 0, 0, 0, frame=2)
    items = [dict(x, doJumpId=i) for i, x in enumerate((*PATROL[:2], PATROL[3], jump), start=1)]
    rows = rows_of(plan_file(tmp_path / "m.plan", *items))

    assert [row["lat_deg"] for row in rows] == [47.4, *[47.41, 47.4] * 3]


@pytest.mark.parametrize("repeats", [-1, 11])
def test_a_jump_without_an_end_or_with_many_repeats_is_refused(tmp_path, repeats):
    jump = dict(item(177, 1, repeats, 0, 0, 0, 0, 0, frame=2), doJumpId=1)

    with pytest.raises(ft.InputError, match=rf"item 5 .*at most 10 times, got {repeats}"):
        read_route(plan_file(tmp_path / "m.plan", *PATROL, jump))


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
def test_what_is_true_or_false_is_nothing_else(tmp_path, key, value):
    last = (LANDING if key in LANDING else PATROL[3]) | {key: value}
    with pytest.raises(ft.InputError, match=rf"m\.plan: .*`{key}` must be true or false, got "):
        read_route(plan_file(tmp_path / "m.plan", *PATROL[:3], last))


@pytest.mark.parametrize("speed", [0, -25, 1e308, float("nan"), "25", None, True])
def test_a_cruise_speed_that_no_aircraft_has_is_refused(tmp_path, speed):
    mission = {"plannedHomePosition": HOME, "items": PATROL, "cruiseSpeed": speed}
    with pytest.raises(ft.InputError, match=r"m\.plan: .*`cruiseSpeed` must be "):
        read_route(plan_file(tmp_path / "m.plan", mission=mission))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frame": False}, "`frame` must be a number, got False"),
        ({"params": [True, 0, 0, None, 47.4, 8.5, 60]}, "every parameter .* got True"),
        ({"command": 178, "params": ""}, "`params` must be a list, got ''"),
        ({"command": 18, "params": [1, 0, False, None, 47.4, 8.5, 60]}, "`radius_m` .* got False"),
    ],
)
def test_an_empty_or_false_value_of_an_item_is_no_number(tmp_path, changes, says):
    with pytest.raises(ft.InputError, match=says):
        read_route(plan_file(tmp_path / "m.plan", PATROL[0], PATROL[1] | changes, *PATROL[2:]))


@pytest.mark.parametrize("home", [(91, 8.5, 480), (47.4, -181, 480), (float("nan"), 8.5, 480)])
def test_a_home_position_beyond_the_earth_is_refused(tmp_path, home):
    with pytest.raises(ft.InputError, match=r"(home p|plannedHomeP)osition.* must "):
        read_route(plan_file(tmp_path / "m.plan", *PATROL, home=home))


def test_a_landing_pattern_is_a_circle_down_and_a_final_to_a_height_above_its_place(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL, LANDING)
    route = read_route(file)

    assert rows_of(file)[-2:] == [
        {"lat_deg": 47.39, "lon_deg": 8.51, "up_m": -20.0}
        | {"turns": -1.0, "radius_m": 180.0, "spiral": True},
        {"lat_deg": 47.4, "lon_deg": 8.51, "up_m": -50.0},
    ]
    assert "Item 7 (NAV_LAND 21) is flown to 10 m above its place." in notes_of(route)
    assert "item 5 (DO_LAND_START 189)" in notes_of(route)[1]


def test_a_return_ends_above_home_and_what_follows_is_not_flown(tmp_path):
    items = *PATROL, item(20, 0, 0, 0, 0, 0, 0, 0, frame=2), waypoint(47.5, 8.5, 60)
    file = plan_file(tmp_path / "m.plan", *items, home=(47.402, 8.503, 480.0))
    route = read_route(file)

    assert rows_of(file)[-1] == {"lat_deg": 47.402, "lon_deg": 8.503, "up_m": 30.0}
    assert "item 6 (NAV_WAYPOINT 16, after the end of item 5)" in notes_of(route)[1]


def test_heights_above_terrain_are_said_to_count_from_home(tmp_path):
    items = *PATROL[:2], waypoint(*PLACE, frame=10), waypoint(47.405, 8.52, 60, frame=10)
    known = dict(items[3], AMSLAltAboveTerrain=600.0)
    route = read_route(plan_file(tmp_path / "m.plan", *items[:3], known))

    assert [row["up_m"] for row in route.route["waypoint"]] == [0.0, 0.0, 0.0, 60.0]
    assert [note for note in notes_of(route) if "terrain" in note] == [
        "The height of item 3 (NAV_WAYPOINT 16) is above terrain, which is unknown: "
        "it counts from home."
    ]


def test_airspeeds_of_a_plan_are_flown_from_their_places_on(tmp_path):
    slow = item(178, 0, 20, -1, 0, 0, 0, 0, frame=2)
    throttle = item(178, 0, -1, 40, 0, 0, 0, 0, frame=2)
    file = plan_file(tmp_path / "m.plan", PATROL[0], SPEED, throttle, *PATROL[1:3], slow, PATROL[3])

    assert read_route(file).flight["V_a_mps"] == 22.0
    rows = read_route(file).route["waypoint"]
    assert [row.get("V_mps") for row in rows] == [22.0, None, 20.0, None]
    assert notes_of(read_route(file))[-1] == (
        "The plan sets an airspeed of 22 m/s by item 2, 20 m/s by item 6, each from its place on "
        "where the law holds the airspeed (`holds_airspeed` of [route])."
    )
    said, _ = flighttune("mission", "--plan", file)
    assert "airspeed 20 to 22 m/s, turns for" in said
    whole = flighttune("mission", "--plan", file, "--set", "flight.V_a_mps=24")[0]
    assert "airspeed 24 m/s, turns for" in whole


@pytest.mark.parametrize(("speed", "flown"), [(20, 20.0), (12, None)])
def test_a_change_of_speed_before_the_landing_leaves_what_comes_before_as_it_is(
    tmp_path, speed, flown
):
    """One that the aircraft does not fly is said: the Aerosonde flies 15 to 45 m/s."""
    slow, land = item(178, 0, speed, -1, 0, 0, 0, 0, frame=2), item(21, 0, 0, 0, 0, 47.39, 8.52, 0)
    route = ft.route(plan_file(tmp_path / "m.plan", *PATROL, slow, land))
    V, stretches = route.reference.V, route.reference.path.stretches

    before = int(next(x.start for x in stretches if x.name == "item 6"))
    assert (V[:before] == 25.0).all()  # at which the Aerosonde is identified
    assert V[-1] == pytest.approx(flown or 25.0)
    said = [note for note in route.scenario.notes if "is not flown" in note]
    assert ["12 m/s from item 4 on" in note for note in said] == [True] * (flown is None)


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
def test_a_change_of_speed_that_sets_no_airspeed_is_named_and_not_flown(tmp_path, values, said):
    """The speed of the next leg is no airspeed where the first parameter says another."""
    file = plan_file(tmp_path / "m.plan", PATROL[0], item(178, *values, 0, 0, 0), *PATROL[1:])
    route = read_route(file)

    assert "V_a_mps" not in route.flight
    assert not any("V_mps" in row for row in rows_of(file))
    assert "Not flown of the plan: item 2 (DO_CHANGE_SPEED 178)." in notes_of(route)
    named = [note for note in notes_of(route) if note.startswith("Item 2 (DO_CHANGE_SPEED 178) ")]
    assert [said in note for note in named] == [True] * bool(said)


def test_an_airspeed_set_where_no_flight_comes_is_not_flown(tmp_path):
    """The largest airspeed of a plan is not that after its last waypoint or its return."""
    fast, home = item(178, 0, 40, -1, 0, 0, 0, 0, frame=2), item(20, 0, 0, 0, 0, 0, 0, 0, frame=2)
    for i, items in enumerate(((*PATROL, fast), (*PATROL, home, fast, waypoint(*PLACE)))):
        route = read_route(plan_file(tmp_path / f"{i}.plan", PATROL[0], SPEED, *items))
        assert route.flight["V_a_mps"] == 22.0
        assert any("DO_CHANGE_SPEED" in note for note in notes_of(route) if note[:3] == "Not")


def test_rally_points_are_read_with_heights_above_the_first_waypoint(tmp_path):
    rally = {"points": [[47.401, 8.51, 70]], "version": 2}
    file = plan_file(tmp_path / "m.plan", *PATROL, rallyPoints=rally)

    assert read_route(file).route["rally"] == [{"lat_deg": 47.401, "lon_deg": 8.51, "up_m": 10.0}]


WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t488\t1
1\t0\t3\t22\t15\t0\t0\t0\t0\t0\t50\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.41\t8.5\t80\t1
3\t0\t0\t16\t0\t0\t0\t0\t47.41\t8.52\t588\t1
"""


def test_waypoints_of_mission_planner_are_read(tmp_path):
    file = tmp_path / "m.waypoints"
    text = WAYPOINTS.replace("\n2", "\n\n  # the second leg\n2")  # pymavlink leaves both out
    file.write_text(text.replace("\n", "\r\n"))
    route = read_route(file)

    assert rows_of(file) == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 30.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 50.0},
    ]
    assert route.flight == {"h_m": 538.0, "ground_m": 488.0}


@pytest.mark.parametrize(
    "wrong",
    [
        *("", "QGC WPL 110\n", WAYPOINTS.replace("588", "588\t5")),
        WAYPOINTS.replace("\t16\t", "\t16.9\t"),
        *(WAYPOINTS.replace("110", other) for other in ("120", "", "110 2")),
    ],
)
def test_waypoints_that_are_none_are_refused(tmp_path, wrong):
    file = tmp_path / "m.waypoints"
    file.write_text(wrong)

    with pytest.raises(ft.InputError, match=r"m\.waypoints"):
        read_route(file)


KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><LineString>
<altitudeMode>{}</altitudeMode><coordinates>8.5,47.4,548 8.5,47.42,560</coordinates>
</LineString></Placemark></Document></kml>
"""


def test_a_line_of_kml_is_read(tmp_path):
    file = tmp_path / "m.kml"
    file.write_text(KML.format("absolute"))

    assert [row["up_m"] for row in rows_of(file)] == [0.0, 12.0]
    assert read_route(file).flight == {"h_m": 548.0}
    file.write_text(KML.format("relativeToGround"))
    assert read_route(file).flight == {}
    assert "above the ground" in notes_of(read_route(file))[0]


def test_the_airspeed_and_the_wind_that_are_assumed_are_in_the_first_lines(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    stated = ("--set", "flight.V_a_mps=24", "--set", "route.wind_mps=5")

    assert (
        "For jsbsim:aerosonde: airspeed 25 m/s (assumed), turns for wind up to 8.33 m/s (assumed), "
        "start 540 m above sea level."
    ) in " ".join(flighttune("mission", "--plan", file)[0].split()[:60])
    conditions = json.loads(flighttune("mission", "--plan", file, *stated, "--json")[0])[
        "conditions"
    ]
    assert conditions == "airspeed 24 m/s, turns for wind up to 5 m/s, start 540 m above sea level"


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


def test_a_line_has_heights_at_every_point_or_at_none(tmp_path):
    file = tmp_path / "line.geojson"

    def line(*points):
        file.write_text(json.dumps({"type": "LineString", "coordinates": points}))
        return read_route(file)

    assert line([8.5, 47.4, 548.0], [8.5, 47.42, 560.0]).flight == {"h_m": 548.0}
    for height in ([], [0.0]):
        route = line([8.5, 47.4, *height], [8.5, 47.42, *height])
        assert (route.flight, len(route.route["waypoint"])) == ({}, 2)
        assert notes_of(route) == ["The file has no heights: the route is level, at `h_m`."]
    with pytest.raises(ft.InputError, match="a height at every point"):
        line([8.5, 47.4, 548.0], [8.5, 47.42])


@pytest.mark.parametrize(
    "text", ["{}", "[]", '{"mission": {}}', '{"mission": {"items": [{}]}}', '{"type": "Feature"}']
)
def test_another_file_is_refused(tmp_path, text):
    file = tmp_path / "m.json"
    file.write_text(text)

    with pytest.raises(ft.InputError, match=r"m\.json") as refusal:
        read_route(file)
    assert "Error" not in str(refusal.value)


@pytest.mark.parametrize("ending", [".mission", ".kmz", ".xml"])
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
    [
        item(84, 0, 0, 0, None, *PLACE),
        item(4242, 0, 0, 0, 0, *PLACE),
        item(93, 30, -1, -1, -1, 0, 0, 0, frame=2),
        item(177, 1, -1, 0, 0, 0, 0, 0, frame=2),
        {"type": "ComplexItem", "complexItemType": "StructureScan"},
    ],
)
def test_whatever_follows_a_landing_is_not_flown(tmp_path, after):
    land = item(21, 0, 0, 0, 0, 47.39, 8.52, 0)
    file = plan_file(tmp_path / "m.plan", *PATROL, land, after, waypoint(*PLACE))

    assert names_of(file)[-1] == "item 5"
    said = notes_of(read_route(file))[1]
    assert said.startswith("Not flown of the plan: item 6")
    assert "item 7 (NAV_WAYPOINT 16, after the end of item 5)" in said


def test_circles_at_zeros_are_around_the_item_before_as_arduplane_flies_them(tmp_path):
    """ArduPilot, Location::sanitize: zeros are where the vehicle is, and its height."""
    circle = item(18, 2, 0, 200, 1, 0, 0, 0)
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], circle, PATROL[3])
    row = rows_of(file)[2]

    assert (row["lat_deg"], row["lon_deg"], row["up_m"]) == (47.41, 8.5, 0.0)
    assert "Item 3 (NAV_LOITER_TURNS 18) is at 0, 0: it circles around the item before" in " ".join(
        notes_of(read_route(file))
    )
    nowhere = r"item 4 \(NAV_LOITER_TURNS 18, at 0, 0: around where it is then"
    with pytest.raises(ft.InputError, match=nowhere):
        read_route(plan_file(tmp_path / "t.plan", *PATROL[:3], circle))
    for command in (16, 21, 85):
        item_at_zeros = item(command, 0, 0, 0, None, 0, 0, 50)
        with pytest.raises(ft.InputError, match=r"item 3 \(.*, at 0, 0, which is no place\)"):
            read_route(plan_file(tmp_path / "w.plan", *PATROL[:2], item_at_zeros))


def test_a_waypoint_at_the_height_of_home_is_refused_by_its_item_and_the_key_of_the_ground(
    tmp_path,
):
    low = waypoint(47.41, 8.52, 0), waypoint(47.4, 8.52, 60)
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], CAMERA, *low)

    with pytest.raises(ft.InputError, match=r"`ground_m`, 480 .* got 480 m at item 4\."):
        ft.route(file)
    flown = ft.route(file, changes={"flight.ground_m": 400.0}).scenario.flight
    assert (flown.h_m, flown.ground_m) == (540.0, 400.0)


def test_sentences_count_items_as_the_file_does_and_points_of_a_line(tmp_path):
    """What is not flown counts too: the climb of 300 m over 1.5 km is to item 5."""
    high = waypoint(47.41, 8.52, 360)
    with pytest.raises(ft.InputError, match=r"of item 5 .*item 4"):
        ft.route(plan_file(tmp_path / "m.plan", PATROL[0], SPEED, CAMERA, PATROL[1], high))
    file = tmp_path / "m.kml"
    file.write_text(KML.format("absolute").replace("47.42,560", "47.40001,560"))
    with pytest.raises(ft.InputError, match="point 2"):
        ft.route(file, changes={"route.turnaround_m": 0.0})


def test_equal_neighbours_are_one_waypoint(tmp_path):
    """QGroundControl writes home into its KML at the ground, and at the height of the flight."""
    file = tmp_path / "m.kml"
    file.write_text(KML.format("absolute").replace("8.5,47.4,548 ", "8.5,47.4,488 8.5,47.4,548 "))

    assert [row["up_m"] for row in rows_of(file)] == [0.0, 12.0]
    assert read_route(file).flight == {"h_m": 548.0}
    said = "have one place: it is passed at the height of"
    assert notes_of(read_route(file)) == [f"Point 1 and point 2 {said} point 2."]
    plan = plan_file(tmp_path / "m.plan", *PATROL[:2], waypoint(47.41, 8.5, 90), PATROL[3])
    assert [row["up_m"] for row in rows_of(plan)] == [0.0, 30.0, 30.0]
    assert f"Item 2 and item 3 {said} item 3." in notes_of(read_route(plan))


def test_a_wind_faster_than_the_aircraft_gives_a_sentence_and_no_infinity(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    said, _ = flighttune("mission", "--plan", file, "--set", "route.wind_mps=30")

    assert "without an end against a wind of 30 m/s" in said
    assert not any(word in said for word in (" inf ", "∞"))
