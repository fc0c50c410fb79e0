"""Plans and maps (KML, GeoJSON) of a mission, read back by lxml, fastkml and shapely."""

import json
import math
from xml.etree import ElementTree

import fastkml
import numpy as np
import pytest
import shapely
from commands import answer, flighttune
from lxml import etree
from places import SHIPPED_SCENARIOS
from plans import PATROL, item, plan_file, waypoint

import flighttune as ft
from flighttune.routes.maps import Corridor, north_east

SEEN = "{http://www.opengis.net/kml/2.2}"

# QGroundControl's developer guide, "Plan file format": the keys that each part must have.
REQUIRED = {
    "mission": "version firmwareType vehicleType cruiseSpeed hoverSpeed plannedHomePosition items",
    "geoFence": "version circles polygons",
    "rallyPoints": "version points",
}
OF_AN_ITEM = {"type", "autoContinue", "command", "doJumpId", "frame", "params"}

AREAS = (
    (True, [[47.38, 8.48], [47.38, 8.55], [47.43, 8.55], [47.43, 8.48]]),
    (False, [[47.425, 8.50], [47.425, 8.51], [47.428, 8.51]]),
)


def fence_of(areas=(), circles=()):
    polygons = [{"inclusion": inside, "polygon": ring} for inside, ring in areas]
    return {"version": 2, "circles": [*circles], "polygons": polygons}


@pytest.fixture
def fenced_leg(tmp_path):
    """A leg of 1.1 km with a fence, and the plan that `mission` writes of it."""
    out = tmp_path / "out.plan"

    def write(*areas, circles=(), status=0):
        fence = fence_of(areas, circles)
        file = plan_file(
            tmp_path / "m.plan", waypoint(47.4, 8.5, 60), waypoint(47.41, 8.5, 60), geoFence=fence
        )
        said = flighttune("mission", file, "--plan", "--out", out, status=status)
        return fence, json.loads(out.read_text())["geoFence"] if out.exists() else None, said

    return write


@pytest.fixture
def mission(tmp_path):
    """Two rows 80 m apart, a circle of 100 m that is too small, and a fence with a zone."""
    rows = [(47.4, 8.5), (47.41, 8.5), (47.41, 8.50106), (47.4, 8.50106)]
    return plan_file(
        tmp_path / "m.plan",
        *(waypoint(*row, 60) for row in rows),
        item(18, 1, 0, -100, 1, 47.40, 8.52, 80),
        waypoint(47.41, 8.53, 80),
        geoFence=fence_of(AREAS),
        rallyPoints={"points": [[47.401, 8.51, 70]], "version": 2},
    )


@pytest.fixture
def route(mission):
    return ft.route(mission)


@pytest.fixture
def corridor(route):
    """Windows of 100 m, 3 m to each side and 2 m up and down."""
    edges = np.append(np.arange(0.0, route.length, 100.0), route.length)
    windows = np.column_stack([edges[:-1], edges[1:]])
    wide = np.tile([3.0, 2.0], (len(windows), 1))
    return Corridor(windows, -wide, wide, "a claim")


def assert_plan(tables):
    """Held against what QGroundControl asks of a plan, whose numbers of version are 1 and 2."""
    assert (tables["fileType"], tables["version"]) == ("Plan", 1)
    assert "groundStation" in tables
    for part, keys in REQUIRED.items():
        assert {*keys.split()} <= tables[part].keys()
        assert tables[part]["version"] == 2
    for one in tables["mission"]["items"]:
        assert OF_AN_ITEM <= one.keys()
        assert (one["type"], len(one["params"])) == ("SimpleItem", 7)
        assert one["frame"] in (2, 3)
        assert all(value is None or isinstance(value, int | float) for value in one["params"])


def test_a_plan_is_one_of_qgroundcontrol_with_turns_as_they_are_flown(mission, route, tmp_path):
    out = tmp_path / "out.plan"
    flighttune("mission", mission, "--plan", "--out", out)
    tables = json.loads(out.read_text())

    assert_plan(tables)
    items = tables["mission"]["items"]
    assert [x["doJumpId"] for x in items] == [*range(1, len(items) + 1)]
    assert [x["command"] for x in items[:2]] == [22, 178]
    (circle,) = (x for x in items if x["command"] == 18)
    assert circle["params"][4:6] == pytest.approx([47.40, 8.52], abs=1e-7)
    assert circle["params"][2] == pytest.approx(-155.9, abs=0.2)  # 33.3^2 / (g tan 36 deg)
    # The turn-around is passed through both waypoints of its leg, and goes beyond them.
    places = np.array([x["params"][4:6] for x in items if x["command"] == 16])
    for corner in ((47.41, 8.5), (47.41, 8.50106)):
        assert np.abs(places - corner).max(axis=1).min() < 2e-6
    assert places[:, 0].max() > 47.4115
    heights = {x["params"][6] for x in items if x["command"] in (16, 22)}
    assert {60.0, 80.0} <= heights
    assert tables["mission"]["plannedHomePosition"][2] == 480.0
    assert tables["rallyPoints"]["points"] == [[47.401, 8.51, 70.0]]
    read = [(x["inclusion"], x["polygon"]) for x in tables["geoFence"]["polygons"]]
    assert read == list(AREAS)


def area_of(fence, origin):
    """What a fence has inside, m, and its number of vertices."""
    parts = {True: [], False: []}
    for one in fence["polygons"]:
        corners = [north_east((lat, lon), origin) for lat, lon in one["polygon"]]
        parts[one["inclusion"]].append(shapely.Polygon(corners))
    inside = shapely.union_all(parts[True]).difference(shapely.union_all(parts[False]))
    return inside, sum(len(one["polygon"]) for one in fence["polygons"])


@pytest.mark.slow
def test_the_corridor_of_a_plan_fits_a_vehicle_and_holds_all_of_it(route, corridor, tmp_path):
    """PX4 takes 64 vertices. The loss is at least how far the area goes beyond the corridor."""
    square = [[8.45, 47.35], [8.6, 47.35], [8.6, 47.5], [8.45, 47.5], [8.45, 47.35]]
    out = tmp_path / "out.plan"
    (said,) = route.save(out, corridor, [{"type": "Polygon", "coordinates": [square]}])
    tables = json.loads(out.read_text())
    area, vertices = area_of(tables["geoFence"], route.where[1])

    assert_plan(tables)
    assert vertices <= 64
    assert f"has {vertices} vertices and circles" in said
    path = route.reference.path
    line = shapely.LineString(np.column_stack([path.north, path.east])[path.s <= path.length])
    assert area.covers(line.buffer(2.99, cap_style="flat"))  # 3 m to each side
    loss = float(said.partition("goes up to ")[2].split()[0])
    assert line.buffer(3.0 + loss + 0.2).covers(area)
    assert not line.buffer(3.0 + 0.8 * loss).covers(area)


@pytest.mark.slow
def test_a_fence_of_too_many_vertices_becomes_smaller_and_its_zones_larger(fenced_leg):
    """100 corners 2 km around the start, in and out by 4 m, and a zone like it 400 m wide."""

    def star(lat, lon, size, detail):
        angles = np.arange(100) * np.pi / 50.0
        radii = size + detail * np.cos(50.0 * angles)
        north, east = radii * np.cos(angles), radii * np.sin(angles)
        return np.column_stack([lat + north / 111_190.0, lon + east / 75_260.0]).tolist()

    rings = [(True, star(47.4, 8.5, 2000.0, 4.0)), (False, star(47.41, 8.512, 200.0, 2.0))]
    fence, written, (said, _) = fenced_leg(*rings)
    before, _ = area_of(fence, (47.4, 8.5))
    after, vertices = area_of(written, (47.4, 8.5))

    assert vertices <= 64
    assert "m narrower" in said
    assert before.buffer(0.1).covers(after)
    assert after.area > 0.9 * before.area


def test_kml_has_styles_waypoints_fence_and_corridor(mission, route, corridor, tmp_path):
    out = tmp_path / "out.kml"
    flighttune("mission", mission, "--plan", "--out", out)
    root = etree.parse(out).getroot()
    styles = {f"#{x.get('id')}" for x in root.iter(f"{SEEN}Style")}

    assert {x.text for x in root.iter(f"{SEEN}styleUrl")} <= styles
    names = [x.findtext(f"{SEEN}name") for x in root.iter(f"{SEEN}Placemark")]
    assert names[1:] == ["1", "2", "3", "4", "5", "6", "rally 1", "stay in", "stay out"]
    points = [x.findtext(f"{SEEN}coordinates") for x in root.iter(f"{SEEN}Point")]
    assert points[4] == "8.52,47.4,560.0"
    route.save(out, corridor)
    places = etree.parse(out).getroot().iter(f"{SEEN}Placemark")
    pieces = [x for x in places if x.findtext(f"{SEEN}name", "").startswith("corridor")]
    assert len(pieces) == len(corridor.windows)


def test_fastkml_reads_kml_and_finds_it_valid(route, corridor, tmp_path):
    out = tmp_path / "out.kml"
    route.save(out, corridor)
    text = out.read_text().partition("?>")[2]

    read = fastkml.KML.from_string(text, strict=True)
    (document,) = read.features
    assert document.features[0].geometry.geom_type == "LineString"
    assert fastkml.validator.validate(element=etree.fromstring(text.encode()))


def test_shapely_reads_geojson_whose_shapes_are_valid(mission, route, corridor, tmp_path):
    out = tmp_path / "out.geojson"
    fence = {"type": "Polygon", "coordinates": [[[*ring[::-1]] for ring in AREAS[0][1]]]}
    route.save(out, corridor, [fence])
    shapes = [
        shapely.geometry.shape(x["geometry"]) for x in json.loads(out.read_text())["features"]
    ]
    line, *others = shapes

    assert [shape.geom_type for shape in others].count("Point") == 7
    windows = [shape for shape in others if shape.geom_type == "Polygon"][:-1]
    assert len(windows) == len(corridor.windows)
    assert all(shape.is_valid for shape in shapes)
    assert shapely.union_all(windows).buffer(1e-7).covers(shapely.force_2d(line))
    north, east = north_east(line.coords[-1][1::-1], (47.4, 8.5))
    assert (north, east) == pytest.approx(north_east((47.41, 8.53), (47.4, 8.5)), abs=0.1)


@pytest.mark.parametrize("ending", ["plan", "kml", "geojson"])
def test_a_written_route_is_read_back_as_the_same_path(route, corridor, tmp_path, ending):
    """A map also with its corridor; the fence of a plan is another part, and slow to make."""
    out = tmp_path / f"out.{ending}"
    route.save(out, None if ending == "plan" else corridor)

    again = ft.route(out)
    read, planned = again.reference.path, route.reference.path

    assert again.scenario.flight.h_m == pytest.approx(route.scenario.flight.h_m, abs=CENTIMETRE)
    apart = read.beside(read.points(10.0)) - planned.beside(planned.points(10.0))
    assert np.abs(apart).max() < 1e-6  # m


def test_a_fence_that_crosses_itself_is_not_written(fenced_leg):
    ring = [(47.39, 8.49), (47.42, 8.51), (47.42, 8.49), (47.39, 8.51)]
    _, written, (_, said) = fenced_leg((True, ring), status=2)

    assert "must not cross" in said
    assert written is None


def test_circles_of_a_plan_stay_circles(fenced_leg):
    circles = [{"circle": {"center": [47.43, 8.54], "radius": 100.0}, "inclusion": False}]
    _, written, _ = fenced_leg(circles=circles)

    assert written["polygons"] == []
    assert [{k: x[k] for k in ("circle", "inclusion")} for x in written["circles"]] == circles


CENTIMETRE = 0.01


def kml_points(path):
    """Longitude, latitude and height of the points of the path in a KML file."""
    text = ElementTree.parse(path).findtext(".//{*}coordinates")
    return [tuple(map(float, point.split(","))) for point in text.split()]


def test_a_route_over_the_date_line_is_short(tmp_path):
    """On the equator of WGS 84 a degree of longitude is 111 319.49 m."""
    line = tmp_path / "date.geojson"
    line.write_text('{"type": "LineString", "coordinates": [[179.995, 0], [-179.99, 0]]}')

    assert answer("mission", "--plan", line)["length_m"] == pytest.approx(
        0.015 * 111_319.49, abs=0.1
    )


def test_a_route_that_no_flight_ends_in_time_is_refused_before_its_table(tmp_path):
    """The last point has latitude and longitude swapped; flights of a file end after 10 000 s."""
    line = tmp_path / "far.geojson"
    swapped = '{"type": "LineString", "coordinates": [[8.5, 47.3], [8.51, 47.3], [47.31, 8.5]]}'
    line.write_text(swapped)
    _, said = flighttune("mission", "--plan", line, status=2)

    assert f"{line}: `waypoints`: point 3 must be reached within `duration_s`, 10000 s" in said
    assert "at 33.3 m/s" in said


def test_a_map_has_the_path_at_the_heights_of_the_plan_above_sea_level(tmp_path):
    """The home position is at 480 m; the plan begins 60 m above it and ends at 570 m."""
    file = plan_file(tmp_path / "m.plan", *PATROL)
    printed, _ = flighttune("mission", "--plan", file, "--out", tmp_path / "m.kml")
    flighttune("mission", "--plan", file, "--out", tmp_path / "m.geojson")
    points = kml_points(tmp_path / "m.kml")
    (line, *_) = json.loads((tmp_path / "m.geojson").read_text())["features"]

    assert "loiter" in printed
    assert [list(point) for point in points] == line["geometry"]["coordinates"]
    assert points[0][:2] == (8.5, 47.4)
    assert points[-1][:2] == pytest.approx((8.52, 47.4), abs=1e-5)
    assert (points[0][2], points[-1][2]) == pytest.approx((540.0, 570.0), abs=CENTIMETRE)
    beside = [math.hypot(*north_east((lat, lon), (47.41, 8.52))) for lon, lat, _ in points]
    assert min(beside) == pytest.approx(180.0, abs=0.1)


@pytest.mark.parametrize("name", ["survey", "approach"])
def test_the_shipped_plans_begin_at_550_m_read_directly_and_by_their_scenario(tmp_path, name):
    plan = (SHIPPED_SCENARIOS / f"{name}.toml").with_suffix(".plan")
    for source, skip in ((name, ()), (plan, ("--set", "route.skip=true"))):
        flighttune("mission", "--plan", source, *skip, "--out", tmp_path / "r.kml")
        assert kml_points(tmp_path / "r.kml")[0][2] == 550.0


def test_a_title_with_control_characters_gives_xml(tmp_path):
    file = plan_file(tmp_path / "x\x01\x1b.plan", *PATROL)
    flighttune("mission", "--plan", file, "--out", tmp_path / "m.kml")

    name = ElementTree.parse(tmp_path / "m.kml").findtext(".//{*}name")
    assert name == "x  "


def test_route_does_not_write_over_the_file_that_it_reads(tmp_path):
    file = plan_file(tmp_path / "m.geojson", *PATROL)
    text = file.read_text()
    (tmp_path / "link.geojson").symlink_to(file)

    for out in (file, tmp_path / "link.geojson"):
        _, said = flighttune("mission", "--plan", file, "--out", out, status=2)
        assert "`--out` must be another file" in said
    assert file.read_text() == text
