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
from plans import PATROL, item, metres, plan_file, waypoint

import flighttune as ft

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


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """Two rows 80 m apart, a circle of 100 m that is too small, and a fence with a zone."""
    rows = [(47.4, 8.5), (47.41, 8.5), (47.41, 8.50106), (47.4, 8.50106)]
    return plan_file(
        tmp_path_factory.mktemp("mission") / "m.plan",
        *(waypoint(*row, 60) for row in rows),
        item(18, 1, 0, -100, 1, 47.40, 8.52, 80),
        waypoint(47.41, 8.53, 80),
        geoFence=fence_of(AREAS),
        rallyPoints={"points": [[47.401, 8.51, 70]], "version": 2},
    )


@pytest.fixture(scope="module")
def route(mission):
    return ft.route(mission)


@pytest.fixture(scope="module")
def corridor(route, band):
    """Windows of 100 m, 3 m to each side and 2 m up and down."""
    edges = np.append(np.arange(0.0, route.length, 100.0), route.length)
    windows = np.column_stack([edges[:-1], edges[1:]])
    wide = np.tile([3.0, 2.0], (len(windows), 1))
    return band.corridor()._replace(windows=windows, low=-wide, high=wide)


@pytest.fixture(scope="module")
def written(mission, route, corridor, tmp_path_factory):
    """The mission as each kind of file, and the maps with its corridor and the fence."""
    folder = tmp_path_factory.mktemp("written")
    fence = {"type": "Polygon", "coordinates": [closed(AREAS[0][1]), closed(AREAS[1][1])]}
    files = {ending: folder / f"out.{ending}" for ending in ("kml", "geojson")}
    for file in files.values():
        route.save(file, corridor, [fence])
    files["plan"] = folder / "out.plan"
    flighttune("mission", mission, "--plan", "--out", files["plan"])
    return files


def closed(ring):
    return [[lon, lat] for lat, lon in (*ring, ring[0])]


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
        assert one["autoContinue"] is True
        assert all(value is None or isinstance(value, int | float) for value in one["params"])


@pytest.mark.soak
def test_a_plan_is_one_of_qgroundcontrol_with_turns_as_they_are_flown(written, route):
    """MAVLink: 12 is PX4; QGroundControl: 1 is a fixed wing, and heights above home."""
    tables = json.loads(written["plan"].read_text())

    assert_plan(tables)
    mission = tables["mission"]
    keys = "firmwareType", "vehicleType", "globalPlanAltitudeMode", "cruiseSpeed", "hoverSpeed"
    assert [mission[key] for key in keys] == [12, 1, 1, 25.0, 5]
    assert mission["plannedHomePosition"] == [47.4, 8.5, 480.0]
    items, path = mission["items"], route.reference.path
    assert [x["doJumpId"] for x in items] == [*range(1, len(items) + 1)]
    takeoff, speed, *others = items
    assert (takeoff["command"], speed["command"], speed["frame"]) == (22, 178, 2)
    assert takeoff["params"] == [15, 0, 0, None, 47.4, 8.5, 60.0]
    assert speed["params"] == [0, 25.0, -1, 0, 0, 0, 0]
    assert {x["frame"] for x in others} == {3}
    passed = []  # in the middle of a turn, along a turn-around at 45 deg or less, at the end
    for x in path.stretches:
        if x.kind == "turn":
            passed.append([x.start + 0.5 * x.length])
        elif x.kind == "turn-around":
            count = math.ceil(x.length / (x.radius * math.pi / 4.0))
            passed.append((x.start + np.linspace(0.0, x.length, count + 1)).tolist())
    passed = [s for some in passed for s in some] + [path.length]
    expected = path.beside(np.array(passed)) + np.array([0.0, 0.0, 60.0])
    found = [(*metres(*x["params"][4:6]), x["params"][6]) for x in others if x["command"] == 16]
    assert np.array(found) == pytest.approx(expected, abs=0.01)
    assert {tuple(x["params"][:4]) for x in others if x["command"] == 16} == {(0, 0, 0, None)}
    (circle,) = (x for x in others if x["command"] == 18)
    (loiter,) = (x for x in path.stretches if x.kind == "loiter")
    assert circle["params"][:2] == [round(abs(loiter.turn) / math.tau, 2), 0]
    assert circle["params"][2] == pytest.approx(-155.9, abs=0.2)  # 33.3^2 / (g tan 36 deg)
    assert circle["params"][3:] == [1, 47.4, 8.52, 80.0]
    assert tables["rallyPoints"]["points"] == [[47.401, 8.51, 70.0]]
    read = [(x["version"], x["inclusion"], x["polygon"]) for x in tables["geoFence"]["polygons"]]
    assert read == [(1, *area) for area in AREAS]


def area_of(rings):
    """What rings of a fence have inside, m: of each whether to stay in, and its corners."""
    parts = {True: [], False: []}
    for inside, ring in rings:
        parts[inside].append(shapely.Polygon([metres(*place) for place in ring]))
    return shapely.union_all(parts[True]).difference(shapely.union_all(parts[False]))


def polygons(fence):
    return [(x["inclusion"], x["polygon"]) for x in fence["polygons"]]


def line_of(route):
    path = route.reference.path
    return shapely.LineString(np.column_stack([path.north, path.east])[path.s <= path.length])


@pytest.mark.soak
def test_the_corridor_of_a_plan_fits_a_vehicle_and_holds_all_of_it(route, corridor, tmp_path):
    """PX4 takes 64 vertices. The loss is at least how far the area goes beyond the corridor."""
    square = [[8.45, 47.35], [8.6, 47.35], [8.6, 47.5], [8.45, 47.5], [8.45, 47.35]]
    zone = closed([metres_away(47.4, 8.5, 300, -300 - 9 * k) for k in (0, 1, 2)])
    out, fence = tmp_path / "out.plan", {"type": "Polygon", "coordinates": [square, zone]}
    (said,) = route.save(out, corridor, [fence])
    tables = json.loads(out.read_text())
    rings = polygons(tables["geoFence"])
    area, vertices = area_of(rings), sum(len(ring) for _, ring in rings)

    assert_plan(tables)
    assert vertices <= 64
    assert f"has {vertices} vertices and circles" in said
    line = line_of(route)
    assert area.covers(line.buffer(2.99, cap_style="flat"))  # 3 m to each side
    loss = float(said.partition("goes up to ")[2].split()[0])
    assert line.buffer(3.0 + loss + 0.2).covers(area)
    assert not line.buffer(3.0 + 0.8 * loss).covers(area)


def metres_away(lat, lon, north, east):
    return [lat + north / 111_190.0, lon + east / 75_260.0]


def star(lat, lon, size, detail, corners=36):
    """Corners in and out by a detail about a circle, m."""
    angles = np.arange(corners) * (math.tau / corners)
    radii = size + detail * np.cos(0.5 * corners * angles)
    places = zip(radii * np.cos(angles), radii * np.sin(angles), strict=True)
    return [metres_away(lat, lon, *place) for place in places]


@pytest.mark.slow
@pytest.mark.parametrize(("wide", "far"), [(30.0, 200.0), (4.0, 700.0)])
def test_a_fence_of_too_many_vertices_becomes_smaller_and_its_zones_larger(fenced_leg, wide, far):
    """By no more than it says."""
    rings = [(True, star(47.405, 8.5, 2500.0, wide)), (False, star(47.405, 8.515, far, 8.0))]
    _, written, (said, _) = fenced_leg(*rings)
    after = polygons(written)

    assert sum(len(ring) for _, ring in after) <= 64
    lost = float(said.partition("is up to ")[2].split()[0])
    pairs = []
    for inside in (True, False):
        old, new = (
            shapely.union_all([area_of([(True, ring)]) for x, ring in some if x is inside])
            for some in (rings, after)
        )
        small, large = (new, old) if inside else (old, new)
        assert large.buffer(0.1).covers(small)
        assert small.buffer(lost + 0.2).covers(large)
        pairs.append((small, large))
    assert not all(small.buffer(0.9 * lost - 0.2).covers(large) for small, large in pairs)


def test_a_fence_of_64_vertices_is_written_as_it_is(fenced_leg):
    ring = star(47.405, 8.5, 2500.0, 30.0, corners=64)
    _, written, (said, _) = fenced_leg((True, ring))

    assert polygons(written) == [(True, ring)]
    assert "vertices and circles" not in said


def test_a_fence_that_no_detail_makes_fit_is_written_whole_with_a_word(fenced_leg):
    """22 triangles of 100 m, which have no details to leave out."""
    corners = [(200 * k, 500 + 300 * j) for j in (0, 1) for k in range(11)]
    zones = [
        (False, [metres_away(47.4, 8.5, n + a, e + b) for a, b in ((0, 0), (100, 0), (0, 100))])
        for n, e in corners
    ]
    fence, written, (said, _) = fenced_leg(*zones, AREAS[0], circles=[CIRCLE])

    assert len(written["polygons"]) == 23
    assert len(written["circles"]) == 1
    assert "has 71 vertices and circles, of which PX4 takes at most 64" in said.replace("\n", " ")
    assert area_of(polygons(written)).equals_exact(area_of(polygons(fence)), 0.01)


CIRCLE = {"circle": {"center": [47.43, 8.54], "radius": 100.0}, "inclusion": False}


def test_kml_has_styles_waypoints_fence_and_corridor(written, corridor):
    root = etree.parse(written["kml"]).getroot()
    styles = {f"#{x.get('id')}" for x in root.iter(f"{SEEN}Style")}

    assert {x.text for x in root.iter(f"{SEEN}styleUrl")} <= styles
    places = {x.findtext(f"{SEEN}name"): x for x in root.iter(f"{SEEN}Placemark")}
    pieces = [name for name in places if name.startswith("corridor")]
    assert pieces == [f"corridor from {low} m" for low, _ in corridor.windows]
    names = [name for name in places if name not in pieces]
    assert names[1:] == ["1", "2", "3", "4", "5", "6", "rally 1", "stay in", "stay out"]
    points = [x.findtext(f"{SEEN}coordinates") for x in root.iter(f"{SEEN}Point")]
    assert points[4] == "8.52,47.4,560.0"
    assert places[names[0]].findtext(f"{SEEN}description") == f"Corridor: {corridor.claim}."
    modes = [places[x].findtext(f".//{SEEN}altitudeMode") for x in (names[0], pieces[0], "stay in")]
    assert modes == ["absolute", "absolute", "clampToGround"]


def test_fastkml_reads_kml_and_finds_it_valid(written):
    text = written["kml"].read_text().partition("?>")[2]

    read = fastkml.KML.from_string(text, strict=True)
    (document,) = read.features
    assert document.features[0].geometry.geom_type == "LineString"
    assert fastkml.validator.validate(element=etree.fromstring(text.encode()))


def test_shapely_reads_geojson_whose_shapes_are_valid(written, route, corridor):
    """A window is a ring about the path, with the extremes of its height; half a turn is dense."""
    features = json.loads(written["geojson"].read_text())["features"]
    shapes = [shapely.geometry.shape(x["geometry"]) for x in features]
    line, *others = shapes

    assert [shape.geom_type for shape in others].count("Point") == 7
    assert all(shape.is_valid for shape in shapes)
    assert features[0]["properties"]["corridor"] == corridor.claim
    path = route.reference.path
    points = np.array([(*metres(lat, lon), up) for lon, lat, up in line.coords])
    expected = path.beside(path.points(10.0)) + np.array([0.0, 0.0, 540.0])
    assert points == pytest.approx(expected, abs=0.01)
    windows = [x for x in features if x["properties"]["name"] == "corridor"]
    flat = line_of(route)
    for x, (begin, end) in zip(windows, corridor.windows, strict=True):
        ring = shapely.LinearRing(
            [metres(lat, lon) for lon, lat in x["geometry"]["coordinates"][0]]
        )
        assert not ring.is_ccw  # north to the right: on a map it is
        assert shapely.Polygon(ring).area == pytest.approx(6.0 * (end - begin), rel=2e-3)
        assert np.median([abs(flat.distance(shapely.Point(c)) - 3.0) for c in ring.coords]) < 0.01
        stated, inside = x["properties"], (path.s >= begin - 1.0) & (path.s <= end + 1.0)
        assert (stated["from_m"], stated["to_m"]) == pytest.approx((begin, end), abs=0.006)
        ups = path.up[inside].min() - 2.0, path.up[inside].max() + 2.0
        assert (stated["min_up_m"], stated["max_up_m"]) == pytest.approx(ups, abs=0.15)
    zones = [x["properties"]["exclusion"] for x in features if x["properties"]["name"] == "fence"]
    assert zones == [False, True]


def test_a_corridor_of_a_band_is_drawn_where_its_bounds_are(band, band_file, tmp_path):
    """On a leg to the north east is to the right; heights are those of the flight less below."""
    for ending in ("geojson", "kml"):
        said = answer("mission", band_file, "--plan", "--out", tmp_path / f"c.{ending}")
        assert said["length_m"] == pytest.approx(150.0)
    line, *pieces = json.loads((tmp_path / "c.geojson").read_text())["features"]
    corridor = band.corridor()
    assert line["properties"]["corridor"] == corridor.claim == band.sentence
    windows = [x for x in pieces if x["properties"].get("name") == "corridor"]
    places = etree.parse(tmp_path / "c.kml").getroot().iter(f"{SEEN}Placemark")
    drawn = [x for x in places if x.findtext(f"{SEEN}name").startswith("corridor")]
    rows = zip(windows, drawn, corridor.windows, corridor.low, corridor.high, strict=True)
    for piece, shape, (begin, end), low, high in list(rows)[::30]:
        places = np.array([metres(lat, lon) for lon, lat in piece["geometry"]["coordinates"][0]])
        assert [*places.min(axis=0)] == pytest.approx([begin, low[0]], abs=0.01)
        assert [*places.max(axis=0)] == pytest.approx([end, high[0]], abs=0.01)
        stated = [piece["properties"][key] for key in ("min_up_m", "max_up_m")]
        assert stated == pytest.approx([-high[1], -low[1]], abs=0.006)
        texts = [x.text.split() for x in shape.iter(f"{SEEN}coordinates")]
        heights = [{float(point.split(",")[2]) for point in text} for text in texts]
        assert [*map(len, heights)] == [1, 1]
        assert [min(x) for x in heights] == pytest.approx([1e3 - high[1], 1e3 - low[1]], abs=0.01)


@pytest.mark.parametrize("ending", ["plan", "kml", "geojson"])
def test_a_written_route_is_read_back_as_the_same_path(route, written, ending):
    """A map also with its corridor; the fence of a plan is another part, and slow to make."""
    again = ft.route(written[ending])
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
    circles = [CIRCLE, {"circle": {"center": [47.4, 8.51], "radius": 3000.0}, "inclusion": True}]
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
    beside = [math.hypot(*metres(lat, lon, (47.41, 8.52))) for lon, lat, _ in points]
    assert min(beside) == pytest.approx(180.0, abs=0.1)


def test_a_shipped_plan_begins_at_550_m_read_directly_and_by_its_scenario(tmp_path):
    plan = SHIPPED_SCENARIOS / "approach.plan"
    for source, skip in (("approach", ()), (plan, ("--set", "route.skip=true"))):
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
