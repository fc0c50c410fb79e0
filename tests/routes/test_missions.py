"""What is flown of plans, waypoint files, KML and GeoJSON, and what is refused by its number."""

import json
import math
import tomllib
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from commands import answer, flighttune
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from plans import HOME, PATROL, item, plan_file, waypoint

import flighttune as ft

COMMANDS = tomllib.loads((ROOT / "flighttune/routes/commands.toml").read_text(encoding="utf-8"))
NO_PLACE = (0, 0, 0, 0)
PLACE = (47.405, 8.51, 60)
SPEED, RETURN = item(178, 0, 22, -1, *NO_PLACE, frame=2), item(20, 0, 0, 0, *NO_PLACE, frame=2)
CAMERA, DELAY = item(206, 25), item(93, 30, -1, -1, -1, 0, 0, 0, frame=2)
LAND = item(21, 0, 0, 0, 0, 47.39, 8.52, 0)
SCAN = {"type": "ComplexItem", "complexItemType": "StructureScan"}
AT_ONCE = {"route.turnaround_m": 1e5}


class Read:
    """What is flown of a file: rows of its waypoints, their names, the flight and the notes."""

    def __init__(self, file, **changes):
        self.planned = ft.route(file, changes=changes)
        scenario = self.planned.scenario
        self.file, self.notes = file, scenario.notes
        self.flight, self.rally = scenario.flight, scenario.route.rally
        self.names = [point.name for point in scenario.route.waypoint]
        self.rows = [
            point.model_dump(exclude_defaults=True, exclude={"name"}, exclude_none=True)
            for point in scenario.route.waypoint
        ]

    def values(self, key, default=None):
        return [row.get(key, default) for row in self.rows]


@pytest.fixture
def read(tmp_path):
    """A reader of a plan with some items."""

    def read(*items, skip=False, **tables):
        file = plan_file(tmp_path / "m.plan", *items, **tables)
        return Read(file, **({"route.skip": True} if skip else {}))

    return read


@pytest.fixture
def read_text(tmp_path):
    """A reader of a file with an ending and a text."""

    def read_text(ending, text):
        file = tmp_path / f"m{ending}"
        file.write_text(text if isinstance(text, str) else json.dumps(text))
        return Read(file)

    return read_text


def as_lines(items):
    """The items as a file of Mission Planner, behind its home."""
    rows = [(16, 0, [0, 0, 0, 0, *HOME])]
    rows += [(x["command"], x["frame"], x["params"]) for x in items]
    lines = ["QGC WPL 110"]
    for number, (command, frame, params) in enumerate(rows):
        values = [0 if x is None else x for x in [*params, *[0] * 7][:7]]
        lines.append("\t".join(map(str, [number, 0, frame, command, *values, 1])))
    return "\r\n".join(lines)


FLOWN = {16, 17, 18, 19, 31, 178, 177}
ENDS = {20: "after the end of item 3", 21: "after the end of item 3", 85: "after the end of item 3"}
BEFORE = {22: "in flight", 84: "in flight"}
RALLY, AREAS = 5100, range(5000, 5005)


@pytest.mark.parametrize("ending", [".plan", ".waypoints"])
@pytest.mark.parametrize(
    ("number", "name"), [(int(n), x) for of in COMMANDS.values() for n, x in of.items()]
)
def test_every_known_command_is_flown_left_out_or_refused_by_number_and_name(
    tmp_path, ending, number, name
):
    """Each row of the table of commands has its fate, in both files that hold commands."""
    params = {18: (2, 0, 150, 1), 19: (60, 0, 150, 1), 31: (1, 150, 0, 1), 17: (0, 0, 150, 0)}
    params |= {177: (2, 0, 0, 0), 178: (0, 22, -1, 0)}
    one = item(number, *params.get(number, (0, 0, 0, 0)), *(PLACE if number != 177 else (0, 0, 0)))
    items = [x | {"doJumpId": i} for i, x in enumerate([*PATROL[:2], one, PATROL[3]], start=1)]
    file = tmp_path / f"m{ending}"
    plan_file(file, *items) if ending == ".plan" else file.write_text(as_lines(items))
    said = f"item 3 ({name} {number}"
    if str(number) in COMMANDS["changing"] and number not in {*FLOWN, *ENDS}:
        with pytest.raises(ft.InputError) as refusal:
            ft.route(file)
        why = f", {BEFORE[number]}" if number in BEFORE else ""
        assert f"{said}{why})" in str(refusal.value)
        return
    notes = " ".join(ft.route(file, changes=AT_ONCE).scenario.notes)
    flown, _, left_out = notes.partition("Not flown of the plan")
    listed = f"3, 4 ({name} {number})" if number == 16 else said
    assert (listed in flown or f"items 1 to 4 ({name}" in flown) == (number in {*FLOWN, *ENDS})
    if number in ENDS:
        assert ENDS[number] in left_out
    elif number not in {*FLOWN, RALLY}:
        assert said in left_out


def test_a_plan_gives_its_waypoints_with_heights_above_the_first(read):
    route = read(*PATROL)

    assert route.names == ["item 1", "item 2", "item 3", "item 4"]
    assert [{"up_m": 0.0, **row} for row in route.rows] == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 30.0, "turns": -2.0, "radius_m": 180.0},
        {"lat_deg": 47.4, "lon_deg": 8.52, "up_m": 30.0},
    ]
    assert (route.flight.h_m, route.flight.ground_m) == (540.0, 480.0)
    assert route.planned.conditions.startswith(
        "airspeed 25 m/s (assumed), turns for wind up to 8.33"
    )


@settings(max_examples=6)
@given(
    lat=st.floats(-80.0, 80.0),
    lon=st.floats(-180.0, 180.0),
    azimuth=st.floats(-180.0, 180.0),
    far=st.floats(1500.0, 20_000.0),
)
def test_a_leg_over_the_earth_has_the_length_and_azimuth_of_its_geodesic(
    tmp_path_factory, lat, lon, azimuth, far
):
    """By geographiclib, also over the date line; points in between lie on it."""
    end = Geodesic.WGS84.Direct(lat, lon, azimuth, far)
    line = {
        "type": "LineString",
        "coordinates": [[lon, lat, 100.0], [end["lon2"], end["lat2"], 100.0]],
    }
    file = tmp_path_factory.mktemp("leg") / "m.geojson"
    file.write_text(json.dumps(line))

    planned = ft.route(file)
    planned.save(file.with_name("again.geojson"))

    assert planned.length == pytest.approx(far, abs=1e-4)
    assert math.remainder(planned.stretches[0]["course"] - math.radians(azimuth), math.tau) == (
        pytest.approx(0.0, abs=1e-7)
    )
    places = json.loads(file.with_name("again.geojson").read_text())["features"][0]["geometry"]
    for lon_2, lat_2, height in places["coordinates"][:: len(places["coordinates"]) // 3]:
        back = Geodesic.WGS84.Inverse(lat, lon, lat_2, lon_2)
        assert height == 100.0
        if back["s12"] > 100.0:
            assert math.remainder(back["azi1"] - azimuth, 360.0) == pytest.approx(0.0, abs=1e-4)


def test_a_published_baseline_has_its_length_and_azimuth(tmp_path):
    """Flinders Peak to Buninyong, GDA Technical Manual: 54 972.271 m at 306 deg 52' 05.37"."""
    ends = [
        [144 + 25 / 60 + 29.5244 / 3600, -(37 + 57 / 60 + 3.7203 / 3600)],
        [143 + 55 / 60 + 35.3839 / 3600, -(37 + 39 / 60 + 10.1561 / 3600)],
    ]
    (tmp_path / "m.geojson").write_text(json.dumps({"type": "LineString", "coordinates": ends}))

    planned = ft.route(tmp_path / "m.geojson")

    assert planned.length == pytest.approx(54_972.271, abs=2e-3)
    azimuth = 306 + 52 / 60 + 5.37 / 3600
    assert math.degrees(planned.stretches[0]["course"]) == pytest.approx(azimuth, abs=3e-6)


SURVEY = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": [PATROL[1], PATROL[2]]}}
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
STOPS = {
    "stopTakingPhotos": True,
    "stopVideoPhotos": True,
    "useDoChangeSpeed": True,
    "finalApproachSpeed": 20,
}
OLD_LANDING = {key: x for key, x in LANDING.items() if not key.startswith(("alt", "landing"))} | {
    "loiterCoordinate": [47.39, 8.51, 520],
    "loiterAltitudeRelative": False,
    "landAltitudeRelative": True,
}
DOWN = [{"turns": -1.0, "radius_m": 180.0, "spiral": True, "up_m": -20.0}, {"up_m": -50.0}]


def numbered(*items):
    return [x | {"doJumpId": i} for i, x in enumerate(items, start=1)]


def jump(to, repeats):
    return item(177, to, repeats, 0, *NO_PLACE, frame=2)


VTOL = LANDING | {"complexItemType": "vtolLandingPattern"}
READ = [
    # items, keys of the last rows, words of the notes; also of another airspeed or none
    ([PATROL[0], SURVEY, PATROL[3]], [{"turns": -2.0, "radius_m": 180.0, "up_m": 30.0},
     {"up_m": 30.0}], "items 1, 2, 4"),
    ([item(22, 15, 0, 0, None, 47.39, 8.5, 50), *PATROL], [{"up_m": 40.0}],
     "begins where the take-off of item 1"),
    ([item(22, 15, 0, 0, None, 0, 0, 50), *PATROL[1:]], [{"up_m": 40.0, "lat_deg": 47.4}],
     "begins where the take"),
    ([*PATROL[:2], item(16, 10, 15, 0, None, *PLACE), PATROL[3]], [{"up_m": 0}, {"up_m": 30.0}],
     "(?s)hold time of item 3 .*10 s, is not.*radius of item 3 .*inside of the corner"),
    ([*PATROL[:2], item(17, 0, 0, -200, None, *PLACE), PATROL[3]], [{"turns": -2.0,
     "radius_m": 200.0, "up_m": 0}, {}], "without an end is flown as 2 turns"),
    ([*PATROL[:2], item(19, 90, 0, 220, 1, *PLACE), PATROL[3]], [{"turns": 1.0, "radius_m": 220.0,
     "hold_s": 90.0}, {}], None),
    ([*PATROL[:2], item(31, 1, -210, 0, 1, *PLACE), PATROL[3]], [{"turns": -1.0, "radius_m": 210.0,
     "spiral": True}, {}], None),
    ([*PATROL[:2], item(18, 2, 0, 200, 1, 0, 0, 0), PATROL[3]], [{"lat_deg": 47.41, "lon_deg": 8.5,
     "up_m": 0, "turns": 2.0}, {}], "Item 3 .* is at 0, 0: it circles"),
    ([*PATROL, item(18, 1, 0, 200, 1, *PLACE[:2], 0)], [{"up_m": 30.0}],
     "has the height 0, in ArduPilot that"),
    (numbered(*PATROL[:2], PATROL[3], jump(2, 10)), [{"lat_deg": 47.4},
     *({"lat_deg": x} for x in (47.41, 47.4) * 11)], None),
    (numbered(PATROL[0], jump(4, 1), *PATROL[2:]), [{"lat_deg": 47.4}],
     "item 3 .*, which a jump leaves out"),
    ([*PATROL, LANDING], DOWN,
     "(?s)item 5 .DO_LAND_START.*Item 7 .* is flown to 10 m above its place"),
    ([*PATROL, OLD_LANDING], DOWN, "Item 7 .NAV_LAND 21. is flown"),
    ([*PATROL, LANDING | {"useLoiterToAlt": False}], [{"up_m": -20.0, "lat_deg": 47.39},
     {"up_m": -50.0}], "Item 7"),
    ([*PATROL, VTOL], [DOWN[0], {"up_m": -20.0}], "ends above its place: the descent in hover"),
    ([*PATROL, LANDING | STOPS], [{"V_mps": 20.0}, *DOWN],
     "(?s)IMAGE_STOP_CAPTURE 2001.*item 8 .VIDEO_STOP_CAPTURE 2501.*Item 11"),
    ([*PATROL, RETURN, waypoint(47.5, 8.5, 60)], [{"lat_deg": 47.4, "up_m": 30.0}],
     "(?s)item 6 .NAV_WAYPOINT 16, after the end of item 5.*ends above home"),
    ([*PATROL[:2], waypoint(*PLACE, frame=10), waypoint(47.405, 8.52, 60,
     frame=10) | {"AMSLAltAboveTerrain": 600.0}], [{"up_m": 0}, {"up_m": 60.0}],
     "height of item 3 .* is above terrain, which is unknown"),
    ([item(18, 1, 0, 100, 1, 47.41, 8.5, 80), *PATROL[3:]], [{"lat_deg": HOME[0], "up_m": 0},
     {"turns": 1.0}, {"up_m": 10.0}], "begins above home"),
    ([*PATROL[:2], waypoint(47.41, 8.5, 90), PATROL[3]], [{"up_m": 30.0}, {"up_m": 30.0}],
     "Item 2 and item 3 have one place: it is passed at the height of item 3"),
    ([x | {"params": x["params"][:4], "coordinate": x["params"][4:]} for x in (*PATROL, RETURN)],
     [{"up_m": 30.0}, {"lat_deg": 47.4, "up_m": 30.0}], "Item 5 .* ends above home"),
    ([*PATROL[:2], PATROL[3] | {"autoContinue": False}], [{"up_m": 30.0}],
     "Item 3 .* waits until it is told"),
    ([PATROL[0], SPEED, *PATROL[1:3], item(178, 0, 20, -1, *NO_PLACE, frame=2), PATROL[3]],
     [{"V_mps": 20.0}, {}], "22 m/s by item 2, 20 m/s by item 5, each from its place on"),
    ([*PATROL[:3], SPEED, PATROL[3]], [{"V_mps": 22.0}, {}], "22 m/s by item 4, from its place on"),
    ([*PATROL[:3], waypoint(47.4, 8.52, 0)], [{"up_m": -60.0}], None),
    ([*PATROL[:2], waypoint(47.41, 8.50002, 90), PATROL[3]], [{"up_m": 30.0}] * 2, None),
    ([PATROL[0], SPEED, *PATROL, item(178, 0, 40, -1, *NO_PLACE, frame=2)], [{}],
     "Not flown.*item 7 .DO_CHANGE_SPEED"),
    ([*PATROL, LAND, item(84, 0, 0, 0, None, *PLACE), SCAN], [{"lat_deg": 47.39}],
     "items? 6 .*after the end of item 5"),
]  # fmt: skip


@pytest.mark.parametrize(("items", "last", "words"), READ)
def test_items_become_waypoints_and_what_is_not_flown_of_them_is_said(tmp_path, items, last, words):
    import re

    file = plan_file(tmp_path / "m.plan", *items, home=(47.4, 8.5, 480.0))
    lower = AT_ONCE | {"flight.ground_m": 400.0}
    route = Read(file, **lower)

    for row, expected in zip(route.rows[-len(last) :], last, strict=True):
        assert {"up_m": 0, **row} | expected == {"up_m": 0, **row}, (row, expected)
    if words:
        assert re.search(words, " ".join(route.notes)), route.notes
    else:
        assert not [
            x for x in route.notes if x[:17] not in ("Flown of the plan", "Turn-arounds at i")
        ]
    simple = all("command" in x and len(x["params"]) == 7 for x in items)
    # a line of Mission Planner has no height above sea level, and its last column is not read
    if simple and "AMSL" not in str(items) and all(x.get("autoContinue", True) for x in items):
        (tmp_path / "m.waypoints").write_text(as_lines(items))
        assert Read(tmp_path / "m.waypoints", **lower).rows == route.rows


SPEEDS = [
    # MAVLink: type, speed, throttle, relative; -1 no change, -2 the default
    ((1, 30, -1, 0), "a ground speed of 30 m/s, which is not flown: in still air"),
    ((2, 3, -1, 0), "a climb speed of 3 m/s"),
    ((3, 2, -1, 0), "a descent speed of 2 m/s"),
    ((9, 30, -1, 0), "a speed of type 9 of 30 m/s"),
    ((0, 3, -1, 1), "an airspeed of 3 m/s more"),
    ((0, -2, -1, 0), "the default speed of its vehicle"),
    ((0, -1, 40, 0), "a throttle of 40 %"),
    ((0, -1, 0.5, 0), "a throttle of 0.5 %"),
    ((1, 0.5, -1, 0), "a ground speed of 0.5 m/s"),
    ((0, -1, -1, 0), ""),
    ((0, -1, 0, 0), ""),
]


@pytest.mark.parametrize(("values", "said"), SPEEDS)
def test_a_change_of_speed_that_sets_no_airspeed_is_named_and_not_flown(read, values, said):
    route = read(PATROL[0], item(178, *values, 0, 0, 0), *PATROL[1:])

    assert (route.flight.V_a_mps, any(route.values("V_mps"))) == (25.0, False)
    assert "Not flown of the plan: item 2 (DO_CHANGE_SPEED 178)." in route.notes
    named = [note for note in route.notes if note.startswith("Item 2 (DO_CHANGE_SPEED 178) sets ")]
    assert [said in note for note in named] == [True] * bool(said)


def test_an_airspeed_is_flown_from_its_place_on_or_refused_by_its_item(tmp_path):
    """The Aerosonde flies 15 to 45 m/s."""
    slower = item(178, 0, 20, -1, *NO_PLACE, frame=2)
    route = ft.route(plan_file(tmp_path / "m.plan", *PATROL, slower, LAND))
    V = route.reference.V
    before = int(next(x.start for x in route.reference.path.stretches if x.name == "item 6"))
    assert (V[:before] == 25.0).all()
    assert V[-1] == pytest.approx(20.0)
    assert "airspeed 20 to 25 m/s (25 m/s at the start is assumed), turns" in route.conditions
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], item(178, 0, 150, -1, 0, 0, 0), *PATROL[2:])
    with pytest.raises(
        ft.InputError, match=r"item 3 \(DO_CHANGE_SPEED 178, to 150 m/s, .* 15 to 45"
    ):
        ft.route(file)
    assert "airspeed 25 m/s (assumed)" in ft.route(file, changes={"route.skip": True}).conditions
    assert "airspeed 30 m/s, turns" in ft.route(file, changes={"flight.V_a_mps": 30.0}).conditions


CHANGED = [
    # what is put in place of item 2 of four, and words of the refusal
    ({"frame": False}, "`frame` must be a number, got False"),
    ({"params": [True, 0, 0, None, 47.4, 8.5, 60]}, "every parameter .* got True"),
    ({"command": 178, "params": ""}, "`params` must be a list, got ''"),
    ({"command": "16"}, "`command` of item 2 must be a number, got '16'"),
    ({"command": 18, "params": [1, 0, False, None, 47.4, 8.5, 60]}, "`radius_m` .* got False"),
    (item(18, 0, 0, 0, 1, *PLACE), "`turns` .*item 2 .*got 0"),
    ({"params": [0, 0, 0, None, "47.4", 8.5, 60]}, r"`lat_deg` of item 2 .* got '47.4'"),
    ({"params": [0, 0, 0, None, 86.0, 8.5, 60]}, "item 2 .* latitude up to 85"),
    ({"params": [0, 0, 0, None, 47.4, 181.0, 60]}, "item 2 .* longitude up to 180"),
    ({"params": [0, 0, 0, None, 0, 0, 60]},
     r"item 2 \(NAV_WAYPOINT 16, at 0, 0, which is no place"),
    (jump(7, 1), "item 2 .*must lead to an item, got 7"),
    (jump(1, -1) | {"doJumpId": 1}, "item 2 .*at most 10 times, got -1, without an end"),
    (jump(1, 11) | {"doJumpId": 1}, "item 2 .*at most 10 times, got 11"),
    (item(18, 1, 0, 150, 1, *PLACE, frame=2), r"item 2 \(NAV_LOITER_TURNS 18, frame 2\)"),
    (item(179, 1, 0, 0, *NO_PLACE), r"item 2 \(DO_SET_HOME 179\)"),
    (item(4242, 0, 0, 0, 0, *PLACE), r"item 2 \(command 4242\)"),
    (SCAN, r"item 2 \('StructureScan'\)"),
    ({"type": "ComplexItem", "complexItemType": "CorridorScan",
     "TransectStyleComplexItem": {"Items": []}}, "'CorridorScan', whose items are not in the file"),
    ({"autoContinue": "false"}, "`autoContinue` must be true or false, got 'false'"),
    (LANDING | {"loiterClockwise": 0}, "`loiterClockwise` must be true or false, got 0"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "says"), CHANGED)
def test_an_item_that_cannot_be_flown_is_refused_by_its_number_with_and_without_skip(
    read, changes, says
):
    whole = (
        PATROL[1] | changes if "type" not in changes or changes["type"] == "SimpleItem" else changes
    )
    with pytest.raises(ft.InputError, match=says) as refusal:
        read(PATROL[0], whole, *PATROL[2:])
    assert "\n" not in str(refusal.value)


def test_a_plan_has_at_most_5000_items_and_may_be_slow(read):
    mission = {"plannedHomePosition": [*HOME], "items": [*PATROL, *[CAMERA] * 4996]}
    assert len(read(mission=mission | {"cruiseSpeed": 0.5}).names) == 4
    with pytest.raises(ft.InputError, match="at most 5000"):
        read(*mission["items"], CAMERA)


@pytest.mark.parametrize("key", ["type", "command", "frame", "params"])
def test_an_item_that_lacks_a_key_is_refused_by_its_number(read, key):
    less = {name: value for name, value in PATROL[1].items() if name != key}
    with pytest.raises(ft.InputError, match=rf"item 2 .* `{key}`, got none"):
        read(PATROL[0], less, *PATROL[2:])


@pytest.mark.parametrize(
    "extra", [DELAY, item(4242, 1), item(177, 2, 11, 0, *NO_PLACE, frame=2) | {"doJumpId": 9}]
)
def test_commands_that_change_the_flight_are_left_out_on_request_alone(read, extra):
    items = [x | {"doJumpId": i} for i, x in enumerate(PATROL, start=1)]
    with pytest.raises(ft.InputError, match=r"item 5 .*`--set route.skip=true` leaves"):
        read(*items, extra)
    route = read(*items, extra, skip=True)
    assert len(route.names) == 4
    assert any(note.startswith("Not flown of the plan: item 5 (") for note in route.notes)


MISSIONS = [
    ({"plannedHomePosition": [91, 8.5, 480]}, "latitude up to 90"),
    ({"plannedHomePosition": [47.4, -181, 480]}, "longitude up to 180"),
    ({"plannedHomePosition": [math.nan, 8.5, 480]}, "must "),
    ({"plannedHomePosition": None}, "sea level in `plannedHomePosition`"),
    ({"plannedHomePosition": [47.4, 8.5]}, "sea level in `plannedHomePosition`"),
    ({"plannedHomePosition": [0, 0, 0]}, r"`plannedHomePosition` .* near the route"),
    *[({"cruiseSpeed": x}, "`cruiseSpeed`") for x in (0, -25, 1e308, math.nan, "25", None, True)],
    ({"items": []}, "must have at least 2 waypoints, got 0; `--fence`"),
    ({"items": [*PATROL, *[PATROL[0]] * 4998]}, "must be at most 5000"),
]


@pytest.mark.parametrize(("changes", "words"), MISSIONS)
def test_a_plan_whose_home_or_speed_cannot_be_is_refused(read, changes, words):
    mission = {"plannedHomePosition": [*HOME], "items": [*PATROL]} | changes
    with pytest.raises(ft.InputError, match=rf"m\.plan: .*{words}"):
        read(mission=mission)


def test_a_home_of_zeros_far_from_the_route_is_no_place(read):
    route = read(item(22, 15, 0, 0, None, 0, 0, 50), *PATROL[:3], RETURN, home=(0, 0, 0))

    assert route.names == ["item 2", "item 3", "item 4"]
    assert (route.flight.h_m, route.flight.ground_m) == (60.0, 0.0)
    said = " ".join(route.notes)
    assert "item 1 (NAV_TAKEOFF 22, to or from a home without a place), item 5" in said
    assert "the route begins at item 2, and heights above home count from 0 m above" in said
    with pytest.raises(ft.InputError, match=r"home, .* has no place"):
        read(PATROL[2], PATROL[1], home=(0, 0, 0))


@pytest.mark.parametrize("home", [(0, 0, 480), (None, None, 480)])
def test_a_home_of_zeros_or_nothing_is_a_place_near_zeros_alone(read, home):
    near = waypoint(0.01, 0.01, 60), waypoint(0.02, 0.01, 60), RETURN
    far = waypoint(3.0, 2.5, 60), waypoint(3.01, 2.5, 60), RETURN

    assert [(x["lat_deg"], x["lon_deg"]) for x in read(*near, home=home).rows][-1] == (0.0, 0.0)
    lost = read(*far, home=home)
    assert lost.values("lat_deg") == [3.0, 3.01]
    assert lost.flight.h_m == 540.0
    assert any("count from 480 m above sea level" in note for note in lost.notes)


def test_rally_points_have_heights_above_the_first_waypoint(read, read_text):
    points = [[47.401, 8.51, 70]]
    for found in (
        read(*PATROL, rallyPoints={"points": points}).rally,
        read_text(".waypoints", as_lines([*PATROL, item(5100, 0, 0, 0, 0, *points[0])])).rally,
    ):
        assert [(x.lat_deg, x.lon_deg, x.up_m) for x in found] == [(47.401, 8.51, 10.0)]
    alone, flat = {"points": points * 2}, {"points": [[47.4, 8.5]]}
    for items, rally, words in (
        ((), alone, "0 and 2 rally"),
        (PATROL, flat, "point 1 .* got None"),
    ):
        with pytest.raises(ft.InputError, match=words):
            read(*items, rallyPoints=rally)


def lines(*rows):
    return "QGC WPL 110\n" + "\n".join(" ".join(row.split()) for row in rows) + "\n"


FIRST = "0 1 3 16 0 0 0 0 47.40 8.5 80 1"
REST = "1 0 3 16 0 0 0 0 47.41 8.5 80 1", "# a comment", "2 0 3 16 0 0 0 0 47.41 8.52 110 1"
TAKE_OFF = "1 1 3 22 15 0 0 0 47.40 8.5 80 1"


@pytest.mark.parametrize(
    ("text", "names", "first"),
    [
        (lines(FIRST, *REST), "item 0,item 1,item 2", "item 0 (NAV_WAYPOINT 16, frame 3)"),
        (lines(FIRST.replace(" 16 ", " 22 "), *REST), "item 0,item 1,item 2",
         "item 0 (NAV_TAKEOFF 22, frame 3)"),
        (lines(TAKE_OFF, TAKE_OFF, *REST), "item 1,item 3,item 4",
         "item 1 (NAV_TAKEOFF 22, frame 3)"),
        (lines("0 1 3 16 0 0 0 0 47.4 8.49 0 1", FIRST, *REST), "item 1,item 2,item 3", ""),
        (lines("0 1 0 16 0 0 0 0 47.4 8.49 430 1", FIRST, *REST), "item 1,item 2,item 3", ""),
    ],
)  # fmt: skip
def test_a_first_line_that_is_no_home_is_part_of_the_route(read_text, text, names, first):
    route = read_text(".waypoints", text)

    assert route.names == names.split(",")
    assert route.values("up_m", 0.0)[-1] == 30.0
    said = [note for note in route.notes if "no home" in note]
    assert [f"its first line is {first}, which is part of the route" in x for x in said] == [
        True
    ] * bool(first)
    assert route.flight.h_m == (510.0 if " 430 " in text else 80.0)


LINE = {"type": "LineString", "coordinates": [[8.5, 47.4, 548.0], [8.5, 47.42, 560.0]]}
LINES = {"type": "MultiLineString", "coordinates": [LINE["coordinates"]]}
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>Leg</name><LineString>
<altitudeMode>{}</altitudeMode><coordinates>8.5,47.4,548 8.5,47.42,560</coordinates>
</LineString></Placemark></Document></kml>
"""
TRACK = """<kml xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:Track>
<altitudeMode>absolute</altitudeMode><when>2026-05-01T10:00:00Z</when>
<gx:coord>8.5 47.4 548</gx:coord><gx:coord>8.5 47.42 560</gx:coord></gx:Track></Placemark></kml>
"""
CRS = {"crs": {"properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}}
ABSOLUTE = KML.format("absolute")


def collection(*shapes):
    return {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes],
    }


SAME = [
    (".kml", ABSOLUTE),
    (".kml", TRACK),
    (".geojson", LINE),
    (".geojson", LINE | CRS),
    (".geojson", {"type": "Feature", "properties": {}, "geometry": LINES}),
    (".geojson", {"type": "GeometryCollection", "geometries": [LINE]}),
    (".json", collection(LINE, {"type": "Point"}, None)),
    (".kml", ABSOLUTE.replace("47.42,560", "47.42,560<more/>8.5,47.43,570")),
    # home at the ground, and at the height of the flight
    (".kml", ABSOLUTE.replace("8.5,47.4,548 ", "8.5,47.4,488 8.5,47.4,548 ")),
]


@pytest.mark.parametrize(("ending", "text"), SAME)
def test_one_line_is_the_same_route_in_every_file_that_holds_it(read_text, tmp_path, ending, text):
    route = read_text(ending, text)

    assert [(r["lat_deg"], r["lon_deg"], r.get("up_m", 0.0)) for r in route.rows] == [
        (47.4, 8.5, 0.0),
        (47.42, 8.5, 12.0),
    ]
    assert route.flight.h_m == 548.0
    assert any("the line alone is read" in x for x in route.notes) == ("Point" in str(text))
    if ending == ".kml":
        with ZipFile(tmp_path / "m.kmz", "w", ZIP_DEFLATED) as file:
            file.writestr("doc.KML", text)
        assert Read(tmp_path / "m.kmz").rows == route.rows


@pytest.mark.parametrize(
    ("ending", "text", "up", "words"),
    [
        (".kml", KML.format("relativeToGround"), 12.0, "above the ground"),
        (".kml", KML.format("clampToGround"), 0.0, "no heights that count, as its line is clamp"),
        (".geojson", LINE | {"coordinates": [[8.5, 47.4], [8.5, 47.42]]}, 0.0,
         "no heights: the route is level"),
        (".geojson", LINE | {"coordinates": [[8.5, 47.4, 0], [8.5, 47.42, 0]]}, 0.0,
         "no heights: the route"),
    ],
)  # fmt: skip
def test_heights_that_do_not_count_leave_that_of_the_start_to_the_user(
    read_text, ending, text, up, words
):
    route = read_text(ending, text)

    assert route.values("up_m", 0.0) == [0.0, up]
    assert any(words in note for note in route.notes)
    assert route.flight.h_m == 1000.0


POINT = "<kml><Placemark><Point><coordinates>8.5,47.4</coordinates></Point></Placemark></kml>"
GOOD = lines("0 1 0 16 0 0 0 0 47.4 8.5 488 1", *REST)
REFUSED = [
    (".kml", POINT, "must have one LineString, or in KML one track, got 1 of Point"),
    (".geojson", LINES | {"coordinates": [LINE["coordinates"]] * 2}, "got 2 of LineString"),
    (".geojson", LINE | {"crs": {"properties": {"name": "EPSG:4314"}}}, "got 'EPSG:4314'"),
    (".geojson", LINE | {"coordinates": [[-33.9, 151.2], [-33.8, 151.2]]},
     "point 1 must have a latitude up to 85"),
    (".geojson", LINE | {"coordinates": [[8.5, 47.4, 5.0], [8.5, 47.42]]},
     "a height at every point"),
    (".kml", ABSOLUTE.replace(",548", ";548"), "got '8.5,47.4;548'"),
    (".kml", ABSOLUTE.replace("8.5,", "8.5, "), r"without blanks .* got '8.5,'"),
    (".kml", "<!DOCTYPE x><kml/>", "without a document type"),
    (".kml", "<kml><x></kml>", "must be KML: "),
    (".kml", f"<kml><LineString>{'<a>' * 200}", "nested so deeply"),
    (".kml", ABSOLUTE.replace("<coord", "<Point/><coord"), "no Point inside a LineString"),
    (".waypoints", GOOD.replace(".", ","), "12 numbers with points .* got '0 1 0 16 "),
    (".waypoints", GOOD.replace("110\n", "120\n"), "got 'QGC WPL 120'"),
    (".waypoints", "", "must begin with QGC"),
    (".waypoints", GOOD.replace("0 1 0 16", "7 1 3 16"),
     "the first line must be item 0 or 1, got item 7"),
    (".waypoints", lines(FIRST, REST[0], REST[2].replace("2 0 3", "2 0 0")),
     "above sea level and above home"),
    (".waypoints", lines(TAKE_OFF, TAKE_OFF.replace("47.40", "47.4001"), *REST),
     r"item 2 \(NAV_TAKEOFF 22, in fl"),
    (".plan", "{}", "got none with `mission`"),
    (".plan", '{"mission": {"items": [{}]}}', "must "),
    (".json", "[]", "must "),
    (".gpx", "", "must be a plan of QGroundControl, waypoints .* got .gpx"),
]  # fmt: skip


@pytest.mark.parametrize(("ending", "text", "says"), REFUSED)
def test_a_file_that_cannot_be_read_is_refused_by_what_is_wrong(read_text, ending, text, says):
    with pytest.raises(ft.InputError, match=says) as refusal:
        read_text(ending, text)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({}, "must hold one .kml file, got 0"),
        ({"a": "", "b": ""}, "got 2: 'a.kml, b.kml'"),
        ({"a": " " * 17_000_000}, "at most 16000000 bytes"),
        (None, "must be a zip archive"),
    ],
)
@pytest.mark.parametrize("packing", [ZIP_DEFLATED, ZIP_BZIP2])
def test_a_kmz_without_one_kml_of_an_ordinary_size_is_refused(tmp_path, texts, says, packing):
    file = tmp_path / "m.kmz"
    file.write_text("no archive")
    if texts is not None:
        with ZipFile(file, "w", packing) as archive:
            for name, text in texts.items():
                archive.writestr(f"{name}.kml", text)

    with pytest.raises(
        ft.InputError, match="compression" if texts and packing == ZIP_BZIP2 else says
    ):
        ft.route(file)


def test_heights_and_items_of_a_file_are_those_of_the_sentences_of_a_command(tmp_path):
    low = waypoint(47.41, 8.52, 0), waypoint(47.4, 8.52, 60)
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], CAMERA, *low)
    with pytest.raises(ft.InputError, match=r"`ground_m`, 480 .* at item 4\."):
        ft.route(file)
    assert ft.route(file, changes={"flight.ground_m": 400.0}).scenario.flight.ground_m == 400.0
    file = plan_file(
        tmp_path / "m.plan", PATROL[0], SPEED, CAMERA, PATROL[1], waypoint(47.41, 8.52, 360)
    )
    with pytest.raises(ft.InputError, match=r"of item 5 .*item 4"):
        ft.route(file)
    legs = [waypoint(47.4 + 0.001 * (k % 2), 8.5 + 0.0004 * (k // 2), 60) for k in range(6)]
    said = answer("mission", plan_file(tmp_path / "m.plan", PATROL[0], *legs), "--plan")
    assert any(
        x.startswith("Turn-arounds at items 3 to 6 go up to")
        for x in [*said["summary"], *said["notes"]]
    )
    said, _ = flighttune(
        "mission",
        "--plan",
        file,
        "--set",
        "route.wind_mps=30",
        "--set",
        "route.skip=true",
        status=None,
    )
    assert not any(word in said for word in (" inf ", "∞"))
    assert np.isfinite(ft.route(plan_file(file, *PATROL)).time)
