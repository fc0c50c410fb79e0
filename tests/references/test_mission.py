"""What is read of plans of QGroundControl and GeoJSON, and what is refused."""

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


def test_a_plan_gives_its_waypoints_with_heights_above_the_first(tmp_path):
    route = read_route(plan_file(tmp_path / "m.plan", *PATROL))

    assert route.waypoint == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 30.0, "turns": -2.0, "radius_m": 180.0},
        {"lat_deg": 47.4, "lon_deg": 8.52, "up_m": 30.0},
    ]
    assert route.flight == {"h_m": 540.0, "ground_m": 480.0}
    assert route.notes == []


def test_a_home_position_of_zeros_far_from_the_route_is_refused(tmp_path):
    with pytest.raises(ft.InputError, match=r"`plannedHomePosition` .* near the route"):
        read_route(plan_file(tmp_path / "m.plan", *PATROL[:3], home=(0, 0, 0)))


@pytest.mark.parametrize("home", [None, (47.4, 8.5), (47.4, 8.5, None), (47.4, 8.5, "480"), "x"])
def test_a_plan_without_the_height_of_its_home_position_is_refused(tmp_path, home):
    """Heights above sea level and above home would be mixed, or count from no known height."""
    for items in (PATROL, PATROL[:3], (waypoint(*PLACE, frame=0), PATROL[3])):
        with pytest.raises(ft.InputError, match="sea level in `plannedHomePosition`"):
            read_route(plan_file(tmp_path / "m.plan", *items, home=home))


def test_a_survey_is_the_items_that_it_consists_of(tmp_path):
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": list(PATROL[1:3])}}
    file = plan_file(tmp_path / "m.plan", PATROL[0], survey, item(21, 0, 0, 0, 0, *PLACE))

    with pytest.raises(ft.InputError, match=r"item 4 \(NAV_LAND 21\)"):
        read_route(file)


def test_commands_without_a_place_are_left_out_by_number_and_name(tmp_path):
    items = PATROL[0], SPEED, CAMERA, *PATROL[1:], REGION_OF_INTEREST, GRIPPER, CAMERA
    file = plan_file(tmp_path / "m.plan", *items)
    listed = (
        "Not flown of the plan: item 2 (DO_CHANGE_SPEED 178), "
        "items 3, 9 (DO_SET_CAM_TRIGG_DIST 206), item 7 (DO_SET_ROI 201), item 8 (DO_GRIPPER 211)."
    )

    assert read_route(file).waypoint == read_route(plan_file(tmp_path / "p.plan", *PATROL)).waypoint
    assert listed in " ".join(flighttune("route", file)[0].split())
    assert listed in json.loads(flighttune("route", file, "--json")[0])["notes"]


def test_commands_that_change_the_flight_are_left_out_on_request_alone(tmp_path):
    home, jump, other = item(20), item(177, 2, 3, 0, 0, 0, 0, 0, frame=2), item(4242, 1)
    file = plan_file(tmp_path / "m.plan", *PATROL, jump, other, home)
    listed = "item 5 (DO_JUMP 177), item 6 (command 4242), item 7 (NAV_RETURN_TO_LAUNCH 20)"

    with pytest.raises(ft.InputError) as refusal:
        read_route(file)
    assert f"got {listed}; `--skip` or" in str(refusal.value)
    assert read_route(file, skip=True).notes == [f"Not flown of the plan: {listed}."]


LANDING = {"type": "ComplexItem", "complexItemType": "fwLandingPattern", "landCoordinate": [*PLACE]}
REFUSED = {
    "'fwLandingPattern'": LANDING,
    "'survey'": {"type": "ComplexItem", "complexItemType": "survey"},
    "'CorridorScan'": {
        "type": "ComplexItem",
        "complexItemType": "CorridorScan",
        "TransectStyleComplexItem": {"Items": []},
    },
    "NAV_LOITER_UNLIM 17": item(17, 0, 0, 120, None, *PLACE),
    "NAV_LOITER_TIME 19": item(19, 60, 0, 150, 1, *PLACE),
    "NAV_LAND 21": item(21, 25, 0, 0, None, 47.405, 8.51, 0),
    "NAV_TAKEOFF 22": item(22, 15, 0, 0, None, *PLACE),
    "NAV_LOITER_TO_ALT 31": item(31, 1, 120, 0, 1, *PLACE),
    "NAV_SPLINE_WAYPOINT 82": item(82, 0, 0, 0, None, *PLACE),
    "NAV_VTOL_TAKEOFF 84": item(84, 0, 0, 0, None, *PLACE),
    "NAV_VTOL_LAND 85": item(85, 0, 0, 0, None, *PLACE),
    "DO_SET_HOME 179": item(179, 1, 0, 0, 0, 0, 0, 0),
    "command 4242": item(4242, 0, 0, 0, 0, *PLACE),
    "NAV_WAYPOINT 16, frame 10: above terrain": waypoint(*PLACE, frame=10),
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

    assert [row["lat_deg"] for row in route.waypoint[:2]] == [47.39, 47.4]
    assert [row["up_m"] for row in route.waypoint[:2]] == [0.0, 10.0]
    assert route.flight["h_m"] == HOME[2] + 50.0
    assert route.notes[1] == "The route begins where the take-off of item 2 ends."


def test_a_loiter_of_no_turns_is_refused(tmp_path):
    file = plan_file(tmp_path / "m.plan", PATROL[0], item(18, 0, 0, 0, 1, *PLACE), PATROL[3])

    with pytest.raises(ft.InputError, match=r"`turns` of item 2 .*got 0"):
        read_route(file)


def test_shapes_beside_the_line_are_said_to_be_left(tmp_path):
    file = tmp_path / "m.geojson"
    line = {"type": "LineString", "coordinates": [[8.5, 47.4, 548.0], [8.5, 47.42, 548.0]]}
    shapes = line, {"type": "Point", "coordinates": [8.5, 47.4]}
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))

    assert read_route(file).notes == ["Of the shapes in the file the LineString alone is read."]


def test_what_of_a_plan_is_not_read_is_said(tmp_path):
    waiting = item(16, 10, 0, 0, None, *PLACE)
    circle = {"circle": {"center": [47.4, 8.5], "radius": 900}, "inclusion": True}
    fence = {"circles": [circle], "polygons": [], "version": 2}
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], waiting, PATROL[3], geoFence=fence)

    assert read_route(file).notes == [
        "Not flown of the plan: item 3 (hold time or radius of NAV_WAYPOINT 16).",
        "Its fence is not read; `flighttune band --fence` takes one in GeoJSON.",
    ]


def test_the_airspeed_and_the_wind_that_are_assumed_are_in_the_first_lines(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    stated = ("--set", "flight.V_a_mps=24", "--set", "route.wind_mps=5")

    assert flighttune("route", file)[0].splitlines()[0] == (
        "m: airspeed 25 m/s (assumed), turns for wind up to 8.33 m/s (assumed), "
        "start 540 m above sea level"
    )
    conditions = json.loads(flighttune("route", file, *stated, "--json")[0])["conditions"]
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
        assert (route.flight, len(route.waypoint)) == ({}, 2)
        assert route.notes == ["The file has no heights: the route is level, at `h_m`."]
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


@pytest.mark.parametrize("ending", [".waypoints", ".kml"])
def test_files_of_other_programs_are_refused_in_one_line_with_a_way_out(tmp_path, ending):
    file = tmp_path / f"m{ending}"
    file.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t488\t1\n")
    (tmp_path / "s.toml").write_text(SCENARIO.format(flight="").replace("m.plan", file.name))

    for source in (file, tmp_path / "s.toml"):
        said = flighttune("route", source, status=2)[1]
        assert (
            f"must be a plan of QGroundControl (.plan) or GeoJSON (.geojson), got {ending}" in said
        )
        assert len(said.splitlines()) == 1
