"""Fences: the room across a path, the flights counted inside, and corridors on maps."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from commands import answer, flighttune
from made_up_band import about_of, band_flights
from scipy.stats import binomtest

import flighttune as ft
from flighttune.claims.counted_flights import check_one_path, plan_of
from flighttune.routes import fence as fences
from flighttune.routes import maps
from flighttune.routes.path import Ability, Waypoint, plan

ORIGIN = (47.0, 8.0)
ABILITY = Ability(V_a=25.0, wind=8.0, phi=0.6, phi_rate=0.4, gamma=(-0.2, 0.2), g=9.81)

# The edge is at 30 m to the left of a leg to the north, 40 m to the right.
BOX = ((-50.0, -30.0), (-50.0, 40.0), (900.0, 40.0), (900.0, -30.0))

# A zone 25 m to the right of the leg.
SQUARE = ((300.0, 25.0), (310.0, 25.0), (310.0, 35.0), (300.0, 35.0))

STRAIGHT = "[{north_m = 0.0, east_m = 0.0}, {north_m = 800.0, east_m = 0.0}]"
KEYS = f"route.waypoint={STRAIGHT}", "route.lat_deg=47.0", "route.lon_deg=8.0"
SETTINGS = [word for key in KEYS for word in ("--set", key)]


def fence_file(path, *rings, origin=ORIGIN, **properties):
    """A polygon from north and east of the start, m."""
    degrees = [
        maps.on_earth(np.array([*ring, ring[0]], dtype=float), origin)[:, ::-1].tolist()
        for ring in rings
    ]
    geometry = {"type": "Polygon", "coordinates": degrees}
    path.write_text(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    return path


@pytest.fixture
def box(tmp_path):
    return fence_file(tmp_path / "box.geojson", BOX)


def made_up_counted(**changes):
    """40 flights along 800 m that come 2 m off; three 45 m to the right at 400 m, one is lost."""
    changes = {
        "route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)],
        "route.lat_deg": 47.0,
        "route.lon_deg": 8.0,
    } | changes
    drawn = ft.flights("circuit", changes=changes).starting(1.0).plan(plant="kinematic")
    extremes = np.tile(np.array([-2.0, 2.0], dtype=np.float32), (40, 200, 2, 1))
    extremes[5:8, 100, 0, 1] = 45.0
    extremes[20] = [-np.inf, np.inf]
    about = about_of(
        signals={"cross_track": "m", "height_err": "m"}, half=np.ones((200, 2)),
        plan=drawn.with_runs(50).as_dict(), epsilon=0.25, confidence=0.9,
    )  # fmt: skip
    along = band_flights(np.linspace(0.0, 800.0, 201), over="along", central=drawn.campaign.central)
    return ft.Band(about=about, flights=along, extremes=extremes, wind=np.zeros((40, 0)))


@pytest.fixture(scope="module")
def band():
    return made_up_counted()


def test_a_leg_in_a_rectangle_has_the_distances_of_its_edges(tmp_path):
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0, up=16.0)], ABILITY)
    needle = ((150.04, 28.0), (150.06, 28.0), (150.05, 27.0))  # between two points of the path
    heights = {"min_up_m": -20.0, "max_up_m": 50.0}
    file = fence_file(tmp_path / "f.geojson", BOX, SQUARE, needle, **heights)
    windows = np.array([0.0, 200.0, 400.0, 800.0])
    room = fences.room_along(
        fences.read_fence(file, ORIGIN), leg, windows, widest=50.0, overlap=0.0
    )

    # left, right; up to the ceiling where the window is highest, down to the floor where lowest
    expected = [[30, 27, 46, 20], [30, 25, 42, 24], [30, 40, 34, 28]]
    assert room.limits.reshape(3, 4) == pytest.approx(np.array(expected), abs=fences.SCAN_STEP)
    nearest = room.nearest(np.array([[10.0, 21.0], [5.0, 5.0]]))
    assert nearest["edge"] in ("edge 1 of zone 1", "edge 2 of zone 1")  # at the corner
    assert nearest == {
        "margin_m": pytest.approx(4.0, abs=fences.SCAN_STEP),
        "side": "right",
        "edge": nearest["edge"],
        "along_m": pytest.approx(305.0, abs=5.0 + fences.SCAN_STEP),
        "stretch": "leg to waypoint 2",
    }


@pytest.mark.parametrize(
    ("first", "sag", "overlap", "right"),
    [(320, 0, 0, 40), (320, 5, 0, 35), (312, 5, 0, 20), (320, 0, 30, 25)],
)
def test_the_sag_of_edges_and_the_overlap_of_windows_take_room(
    tmp_path, first, sag, overlap, right
):
    """The edge is at 40 m to the right, the zone up to 310 m along at 25 m."""
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    fence = fences.read_fence(fence_file(tmp_path / "f.geojson", BOX, SQUARE), ORIGIN)
    sagging = replace(fence, sag=fence.sag + sag)
    room = fences.room_along(sagging, leg, np.array([first, 500.0]), widest=50.0, overlap=overlap)

    assert room.limits[0, 0, 1] == pytest.approx(right, abs=fences.SCAN_STEP)


@pytest.mark.parametrize(("climb", "below", "above"), [(40.0, 20.0, 10.0), (-15.0, 5.0, 50.0)])
def test_heights_between_the_places_of_a_scan_take_room(tmp_path, climb, below, above):
    """Half a step of a slope is kept from floor and ceiling, -20 and 50 m."""
    end = Waypoint(north=800.0, east=0.0, up=2.0 * climb)
    leg = plan([Waypoint(north=0.0, east=0.0), end], ABILITY)
    file = fence_file(tmp_path / "f.geojson", BOX, min_up_m=-20.0, max_up_m=50.0)
    room = fences.room_along(
        fences.read_fence(file, ORIGIN), leg, np.array([0.0, 400.0]), widest=50.0, overlap=0.0
    )

    half = 0.5 * fences.SCAN_STEP * abs(climb) / 400.0
    assert room.limits[0, 1] == pytest.approx([above - half, below - half], abs=1e-6)


def test_a_zone_beyond_the_end_of_a_path_takes_room_within_the_overlap(tmp_path):
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    zone = ((804.0, 25.0), (814.0, 25.0), (814.0, 35.0), (804.0, 35.0))
    fence = fences.read_fence(fence_file(tmp_path / "f.geojson", BOX, zone), ORIGIN)
    for overlap, right, edges in ((0.0, 40.0, 4), (6.0, 25.0, 0)):
        room = fences.room_along(fence, leg, np.array([500.0, 800.0]), widest=50.0, overlap=overlap)
        assert room.limits[0, 0, 1] == pytest.approx(right, abs=fences.SCAN_STEP)
        assert room.edges[0, 0, 1].endswith("of zone 1") is (edges == 0)
        assert room.along.max() <= 800.0


@pytest.mark.parametrize("turns", [1.0, -1.0])
def test_a_needle_between_the_lines_that_a_turn_spreads_is_met(tmp_path, turns):
    """Lines across a circle of 200 m, `SCAN_STEP` apart on it, are 3.5 times as far apart there."""
    circles = Waypoint(north=0.0, east=0.0, turns=turns, radius=200.0)
    path = plan([Waypoint(north=-600.0, east=0.0), circles], ABILITY)
    north, east, _, _ = path.at(fences.SCAN_STEP * np.arange(path.length / fences.SCAN_STEP))
    top = int(north.argmax())
    between = np.array([north[top : top + 2].mean(), east[top : top + 2].mean()])
    out = between / np.hypot(*between)
    aside = 0.001 * np.array([-out[1], out[0]])
    needle = tuple(map(tuple, (700.0 * out, 750.0 * out + aside, 750.0 * out - aside)))
    box = ((-900.0, -900.0), (-900.0, 900.0), (900.0, 900.0), (900.0, -900.0))
    fence = fences.read_fence(fence_file(tmp_path / "f.geojson", box, needle), ORIGIN)
    room = fences.room_along(fence, path, np.array([0.0, path.length]), widest=600.0, overlap=0.0)

    assert room.limits[0, 0].min() == pytest.approx(500.0, abs=5.0 * fences.SCAN_STEP)


@pytest.mark.slow
def test_windows_of_a_fence_overlap_by_two_samples_at_the_largest_airspeed(tmp_path):
    """At 10 Hz two samples are 5 m at 25 m/s and 4 m at 20 m/s; the zone is 4.5 m beyond 404 m."""
    places = [{"north_m": 0.0, "east_m": 0.0}, {"north_m": 400.0, "east_m": 0.0, "V_mps": 20.0}]
    places.append({"north_m": 800.0, "east_m": 0.0})
    slower = made_up_counted(
        **{"route.waypoint": places, "route.holds_airspeed": True, "controller.rate_hz": 10.0},
        **{"limits.n_x": [-0.3, 0.3], "limits.n_x_rate_per_s": 1.0},
    )
    box = ((-50.0, -60.0), (-50.0, 60.0), (900.0, 60.0), (900.0, -60.0))
    zone = ((408.5, 40.0), (412.0, 40.0), (412.0, 50.0), (408.5, 50.0))
    file = fence_file(tmp_path / "f.geojson", box, zone)

    assert min(slower.flights.central.airspeeds) < 25.0
    assert slower.inside(json.loads(file.read_text())).outside == 4  # one of them was lost


def degrees(*places):
    """Latitude and longitude of places north and east of the start, m, as plans have them."""
    return maps.on_earth(np.array(places, dtype=float), ORIGIN).tolist()


def plan_with(path, polygons=(), circles=()):
    """A plan with areas: corners or centre and radius, m, and whether it is to stay in."""
    fence = {
        "version": 2,
        "polygons": [
            {"inclusion": inside, "polygon": degrees(*ring) if ring else [], "version": 1}
            for inside, ring in polygons
        ],
        "circles": [
            {"inclusion": inside, "circle": {"center": degrees(at)[0], "radius": radius}}
            for inside, at, radius in circles
        ],
    }
    path.write_text(json.dumps({"mission": {"items": []}, "geoFence": fence}))
    return path


def test_plans_before_2018_have_one_polygon_to_stay_in(tmp_path):
    old, new = tmp_path / "old.plan", plan_with(tmp_path / "new.plan", [(True, BOX)])
    fence = {"version": 1, "polygon": degrees(*BOX), "parameters": []}
    old.write_text(json.dumps({"mission": {}, "geoFence": fence}))

    assert fences.fence_tables([old]) == fences.fence_tables([new])


def test_a_file_that_is_asked_for_its_fence_has_one(tmp_path, box):
    none = plan_with(tmp_path / "none.plan")
    fences = "--fence", box, "--fence", none

    said = flighttune("mission", "circuit", "--plan", *SETTINGS, *fences, status=2)[1]
    assert "none.plan: must have a Polygon or circle for a fence, got none." in said


@pytest.mark.parametrize("fence", [False, {"polygons": ""}, {"circles": {}}])
def test_an_empty_value_of_another_kind_is_not_taken_for_a_plan_without_a_fence(tmp_path, fence):
    path = tmp_path / "x.plan"
    path.write_text(json.dumps({"mission": {}, "geoFence": fence}))

    with pytest.raises(ft.InputError, match=r"must be (an object|a list), got "):
        fences.fence_tables([path])


def limits_of(*files):
    """Room to the left and right of a leg of 800 m to the north, in three windows, m."""
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    fence = fences.read_fence(files[0], ORIGIN, fences.fence_tables(files))
    windows = np.array([0.0, 200.0, 400.0, 800.0])
    return fences.room_along(fence, leg, windows, widest=50.0, overlap=0.0).limits[:, 0]


def test_the_fence_of_a_plan_is_to_stay_in_some_areas_and_out_of_others(tmp_path):
    file = plan_with(tmp_path / "m.plan", polygons=[(True, BOX), (False, SQUARE)])

    expected = np.array([[30, 40], [30, 25], [30, 40]])
    assert limits_of(file) == pytest.approx(expected, abs=fences.SCAN_STEP)
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    nearest = fences.read_fence(file, ORIGIN).nearest(leg)
    assert nearest["margin_m"] == pytest.approx(25.0, abs=fences.SCAN_STEP)
    assert nearest["leaves_m"] is None


def test_circles_of_a_plan_are_on_the_safe_side_by_a_thousandth_of_their_radius(tmp_path):
    """At 150 m along the leg a circle of 60 m, 80 m aside, leaves 20 m; others leave chords."""
    circles = [(True, (400.0, 0.0), 450.0), (False, (150.0, -80.0), 60.0)]
    (left, right), *_, (_, at_the_end) = limits_of(plan_with(tmp_path / "m.plan", circles=circles))

    chord = np.sqrt(450.0**2 - 400.0**2)
    assert 20.0 - 0.2 <= left <= 20.0
    for side in (right, at_the_end):
        assert chord - 2.5 <= side <= chord


@pytest.mark.parametrize("outside", [True, False])
def test_a_ring_is_a_circle_where_all_its_corners_are_those_of_one(outside):
    corners = fences._circle((47.4, 8.5), 120.0, outside=outside)
    ring = [[lon, lat, 30.0] for lon, lat in [*corners, corners[0]]]

    centre, radius = fences.circle_of(ring, outside=outside)

    assert centre == pytest.approx((47.4, 8.5), abs=1e-7)
    assert radius == pytest.approx(120.0, abs=2e-3)
    outwards = [list(corner) for corner in ring]
    outwards[len(corners) // 4][0] += 1e-4  # of longitude: 7.5 m
    assert fences.circle_of(outwards, outside=outside) is None
    assert fences.circle_of(ring[1:], outside=outside) is None
    assert fences.circle_of([ring[0]] * len(ring), outside=outside) is None


def test_several_fences_of_several_kinds_hold_at_once(tmp_path):
    shape = json.loads(fence_file(tmp_path / "b.geojson", BOX).read_text())["geometry"]
    corners = " ".join(f"{lon},{lat},0" for lon, lat in shape["coordinates"][0])
    kml = tmp_path / "b.kml"
    kml.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon><outerBoundaryIs>'
        f"<LinearRing><coordinates>{corners}</coordinates></LinearRing></outerBoundaryIs>"
        "</Polygon></Placemark></kml>"
    )
    zone = plan_with(tmp_path / "m.plan", polygons=[(False, SQUARE)])
    narrow = ((-60.0, -20.0), (-60.0, 60.0), (950.0, 60.0), (950.0, -20.0))
    other = fence_file(tmp_path / "o.geojson", narrow)

    expected = np.array([[20, 40], [20, 25], [20, 40]])
    assert limits_of(kml, zone, other) == pytest.approx(expected, abs=fences.SCAN_STEP)


def test_the_highest_of_several_floors_and_the_lowest_ceiling_hold(tmp_path):
    deep = fence_file(tmp_path / "a.geojson", BOX, min_up_m=-20.0, max_up_m=60.0)
    high = fence_file(tmp_path / "b.geojson", BOX, min_up_m=-5.0, max_up_m=100.0)
    for files in ((deep, high), (high, deep)):
        fence = fences.read_fence(deep, ORIGIN, fences.fence_tables(files))
        assert (fence.low, fence.high) == (-5.0, 60.0)
    level = fences.read_fence(fence_file(tmp_path / "c.geojson", BOX, min_up_m=0.0), ORIGIN)
    assert (level.low, level.high) == (0.0, np.inf)


def round_corners(number):
    """So many corners around the leg from the start to 800 m north."""
    angles = np.arange(number) * (np.pi * 2.0 / number)
    return np.column_stack([400.0 + 900.0 * np.cos(angles), 900.0 * np.sin(angles)])


def test_a_fence_has_at_most_a_thousand_edges(tmp_path):
    many, most, others = map(round_corners, (1001, 600, 401))
    far = [[8.0, 47.0], [68.0, 47.0], [68.0, 80.0], [8.0, 80.0]]  # tens of km of sag
    long = tmp_path / "long.geojson"
    long.write_text(json.dumps({"type": "Polygon", "coordinates": [[*far, far[0]]]}))
    for file in (
        fence_file(tmp_path / "many.geojson", many),
        fence_file(tmp_path / "zone.geojson", most, 0.01 * others + [-300.0, 0.0]),
        long,
    ):
        with pytest.raises(ft.InputError, match="at most 1000 edges"):
            fences.read_fence(file, (47.0, 8.0))
    for areas in ({"polygons": [(True, many.tolist())]}, {"circles": [(False, (0, 0), 9.0)] * 334}):
        with pytest.raises(ft.InputError, match="at most 1000 edges"):
            fences.fence_tables([plan_with(tmp_path / "m.plan", **areas)])


@pytest.mark.parametrize(
    ("polygons", "circles", "says"),
    [
        ([(True, BOX), (True, [(n + 3000.0, e) for n, e in BOX])], [], "inside of area 2"),
        ([(True, BOX), (False, BOX)], [], "outside of exclusion 1"),
        ([], [(True, (400.0, 0.0), -5.0)], "`radius` of a circle must be positive, got -5"),
        ([], [], "must have a Polygon for a fence, got none"),
        ([(True, [])], [], "at least three corners, got 0"),
        ([("false", BOX)], [], "`inclusion` must be true or false, got 'false'"),
        ([], [(0, (400.0, 0.0), 5.0)], "`inclusion` must be true or false, got 0"),
    ],
)
def test_a_plan_whose_fence_cannot_hold_is_refused(tmp_path, polygons, circles, says):
    file = plan_with(tmp_path / "m.plan", polygons, circles)

    with pytest.raises(ft.InputError, match=says) as refusal:
        fences.read_fence(file, ORIGIN)
    assert str(refusal.value).startswith(str(file))


@pytest.mark.parametrize("origin", [ORIGIN, (-17.0, 179.9995)])
def test_px4_stays_inside_at_least_one_area_and_ardupilot_inside_all(tmp_path, origin):
    """PX4's Geofence::isInsidePolygonOrCircle; AC_PolyFence_loader without INCLUSION_UNION."""
    ahead, apart = ([(n + far, e) for n, e in BOX] for far in (500.0, 3000.0))

    def fence(firmware, *rings):
        areas = [{"polygon": maps.on_earth(np.array(ring), origin).tolist()} for ring in rings]
        tables = {"mission": {"firmwareType": firmware}, "geoFence": {"polygons": areas}}
        file = tmp_path / "m.plan"
        file.write_text(json.dumps(tables))
        return fences.read_fence(file, origin)

    (ring,) = fence(12, BOX, ahead).rings
    assert ring.max(axis=0) == pytest.approx(np.max(ahead, axis=0), abs=0.01)
    assert ring.min(axis=0) == pytest.approx(np.min(BOX, axis=0), abs=0.01)
    with pytest.raises(ft.InputError, match=r"area 2, .* for PX4"):
        fence(3, BOX, ahead)
    with pytest.raises(ft.InputError, match=r"areas .* must overlap"):
        fence(12, BOX, apart)
    with pytest.raises(ft.InputError, match=r"must not cross, got edge 1 of area 2 and edge 3"):
        fence(12, BOX, [BOX[0], BOX[2], BOX[1], BOX[3]])
    # four areas around a hole, which is in none of them
    west, east = ([(-50, e), (-50, e + 50), (900, e + 50), (900, e)] for e in (-30, 60))
    south, north = ([(n, -30), (n, 110), (n + 400, 110), (n + 400, -30)] for n in (-50, 500))
    around = fence(12, west, east, south, north)
    assert around.outside == (False, True)
    hole = around.rings[1]
    assert (*hole.min(axis=0), *hole.max(axis=0)) == pytest.approx((350, 20, 500, 60), abs=0.01)


def test_long_edges_that_cross_in_their_middle_are_refused(tmp_path):
    """A long edge is cut into straight parts: parts that meet do not cross, the edges do."""
    corners = [[8.5, 47.39], [8.52, 47.41], [8.52, 47.39], [8.5, 47.41]]
    file = tmp_path / "f.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]]}))

    with pytest.raises(ft.InputError, match="edge 1 and edge 3"):
        fences.read_fence(file, (47.4, 8.51))


@pytest.mark.parametrize("lon", [179.995, -179.995])
def test_a_fence_over_the_date_line_is_around_what_is_inside_of_it(tmp_path, lon):
    box = fence_file(tmp_path / "f.geojson", BOX, origin=(-17.0, lon))

    assert np.abs(fences.read_fence(box, (-17.0, lon)).start).max() == pytest.approx(900.0, abs=0.1)
    with pytest.raises(ft.InputError, match="the start must be inside"):
        fences.read_fence(box, (-17.0, lon - 0.01))


def test_a_long_edge_follows_its_parallel(tmp_path):
    """Edges are straight in longitude and latitude (RFC 7946); places on one along the parallel."""
    corners = [[8.2, 59.9], [8.2, 60.1], [7.8, 60.1], [7.8, 59.9]]
    file = tmp_path / "f.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]]}))
    fence = fences.read_fence(file, (60.0, 8.0))
    edge = [name == "edge 2" for name in fence.names[:-2]]
    start, end = fence.start[edge], fence.end[edge]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    for lon in np.linspace(7.8, 8.2, 101):
        place = np.array(maps.north_east((60.1, lon), (60.0, 8.0)))
        to = place - start
        off = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
        ahead = (to * along).sum(axis=1)
        on = (ahead > -0.1) & (ahead < np.linalg.norm(end - start, axis=1) + 0.1)
        assert (np.abs(off)[on] <= fence.sag[edge][on] + 0.001).any()

    assert fence.sag.max() <= 0.05
    # No part is needless: the sag falls with the square of their number
    assert fence.sag[edge].max() * (sum(edge) / (sum(edge) - 1.0)) ** 2 > 0.05
    assert fence.names[-2:] == ("ceiling", "floor")


def bent_path():
    corners = [(0, 0), (600, 0), (700, 500), (200, 700), (-300, 300)]
    return plan([Waypoint(north=n, east=e) for n, e in corners], ABILITY)


@pytest.mark.parametrize(("east", "side"), [(0.05, "right"), (-0.05, "left")])
def test_an_edge_that_nearly_touches_a_path_is_on_its_own_side(tmp_path, east, side):
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    far = -90.0 if east > 0.0 else 90.0
    box = (-50, east), (900, east), (900, far), (-50, far)

    nearest = fences.read_fence(fence_file(tmp_path / "box.geojson", box), ORIGIN).nearest(leg)

    assert nearest["side"] == side
    assert nearest["margin_m"] == pytest.approx(0.05, abs=0.01)


def test_the_nearest_edge_is_named_by_its_zone_whatever_zones_come_before(tmp_path):
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0)], ABILITY)
    box, triangle = ((-50, -90), (-50, 90), (900, 90), (900, -90)), ((9, 60), (9, 80), (99, 70))
    for i, zones in enumerate(([SQUARE], [triangle, SQUARE], [triangle, triangle[::-1], SQUARE])):
        apart = [[(n + 150 * k, e) for n, e in zone] for k, zone in enumerate(zones[:-1])]
        rings = [box, *apart, zones[-1]]
        fence = fences.read_fence(fence_file(tmp_path / f"{i}.geojson", *rings), ORIGIN)
        nearest = fence.nearest(leg)
        named = (nearest["edge"], nearest["side"])
        assert named == (f"edge 1 of zone {len(zones)}", "right")
        assert nearest["margin_m"] == pytest.approx(25.0, abs=0.05)


def test_the_margin_of_a_path_is_the_distance_that_shapely_finds(tmp_path):
    """Negative by how far it is outside, where it leaves an area or crosses a zone."""
    path, wide = bent_path(), ((-600, -300), (1200, -300), (1200, 1200), (-600, 1200))
    areas = {
        "wide": [wide],
        "zone": [wide, ((500, 150), (720, 250), (450, 350))],
        "area": [((-400, -80), (500, -60), (500, 520), (-420, 200))],
    }
    points = shapely.points(np.column_stack([path.north, path.east])[path.s <= path.length])
    for name, rings in areas.items():
        fence = fences.read_fence(fence_file(tmp_path / f"{name}.geojson", *rings), ORIGIN)
        area = shapely.Polygon(rings[0], rings[1:])
        signed = np.where(area.contains(points), 1.0, -1.0) * area.boundary.distance(points)
        nearest = fence.nearest(path)

        assert nearest["margin_m"] == pytest.approx(signed.min(), abs=0.01), name
        i = signed.argmin()  # from there to the nearest place of an edge
        north, east = np.diff(shapely.shortest_line(points[i], area.boundary).coords, axis=0)[0]
        right = np.cos(path.course[i]) * east - np.sin(path.course[i]) * north
        assert nearest["side"] == ("right" if right > 0.0 else "left"), name
        out = np.flatnonzero(signed < 0.0)
        assert nearest["leaves_m"] == (pytest.approx(out[0], abs=1.0) if len(out) else None)


@pytest.mark.slow
def test_a_path_outside_has_a_margin_in_metres(band, tmp_path):
    """A zone across the leg, 100 m deep: flights come 2 m off, and the path is 50 m inside."""
    zone = ((300.0, -60.0), (400.0, -60.0), (400.0, 50.0), (300.0, 50.0))
    far = ((-500.0, -500.0), (-500.0, 500.0), (1500.0, 500.0), (1500.0, -500.0))
    tables = json.loads(fence_file(tmp_path / "z.geojson", far, zone).read_text())
    of_flights, of_band = band.inside(tables).nearest

    for nearest, reach in ((of_flights, 2.0), (of_band, band.scale)):
        assert nearest["margin_m"] == pytest.approx(-50.0 - reach, abs=0.1)
        assert nearest["edge"].endswith("of zone 1")
        assert nearest["leaves_m"] == 300.0


MISSION_PLANNER = """QGC WPL 110
0 1 0 16 0 0 0 0 47.0 8.0 430 1
"""


def planner_fence(path, *areas):
    """A file of Mission Planner: commands of MAVLink with their first parameter and corners."""
    rows = [
        (command, first, place) for command, first, places in areas for place in degrees(*places)
    ]
    lines = [
        f"{i} 0 3 {command} {first} 0 0 0 {lat:.9f} {lon:.9f} 0 1"
        for i, (command, first, (lat, lon)) in enumerate(rows, start=1)
    ]
    path.write_text(MISSION_PLANNER + "\n".join(lines))
    return path


def test_fences_of_mission_planner_are_read_in_both_forms(tmp_path):
    """MAVLink: 5000 to return to, 5001 and 5002 corners with their count, 5003 and 5004 circles."""
    centre = [(150.0, -80.0)]
    home, box, square = (5000, 0, [(0.0, 0.0)]), (5001, 4, BOX), (5002, 4, SQUARE)
    file = planner_fence(tmp_path / "f.waypoints", home, box, square, (5004, 60, centre))
    same = plan_with(
        tmp_path / "m.plan", [(True, BOX), (False, SQUARE)], [(False, centre[0], 60.0)]
    )

    assert limits_of(file) == pytest.approx(limits_of(same), abs=fences.SCAN_STEP)
    whole = planner_fence(tmp_path / "c.txt", (5003, 450, [(400.0, 0.0)]))
    assert limits_of(whole) == pytest.approx(
        limits_of(plan_with(tmp_path / "c.plan", circles=[(True, (400.0, 0.0), 450.0)]))
    )
    lines = "\n".join(f"{lat:.9f} {lon:.9f}" for lat, lon in degrees((0.0, 0.0), *BOX, BOX[0]))
    old = tmp_path / "old.fen"
    old.write_text(f"# saved by Mission Planner\n{lines}\n")
    assert limits_of(old) == pytest.approx(np.array([[30, 40]] * 3), abs=fences.SCAN_STEP)
    # MAVProxy writes no home.
    homeless = tmp_path / "h.waypoints"
    homeless.write_text(file.read_text().replace(MISSION_PLANNER.splitlines()[1], ""))
    assert fences.fence_tables([homeless]) == fences.fence_tables([file])
    homeless.write_text(whole.read_text().replace(MISSION_PLANNER.splitlines()[1], ""))
    assert fences.fence_tables([homeless]) == fences.fence_tables([whole])
    short = planner_fence(tmp_path / "s.waypoints", (5001, 5, BOX))
    with pytest.raises(ft.InputError, match="its 5 corners, got 4"):
        fences.fence_tables([short])
    with pytest.raises(ft.InputError, match=r"must be a plan, .*\.xml"):
        fences.fence_tables([tmp_path / "f.xml"])


def test_every_place_within_the_limits_is_inside(tmp_path):
    path = bent_path()
    outer = ((-400, -80), (640, -60), (780, 520), (150, 800), (-420, 200), (100, 430), (200, 150))
    zone = ((500, 150), (560, 250), (450, 350))
    fence = fences.read_fence(fence_file(tmp_path / "f.geojson", outer, zone), ORIGIN)
    area = shapely.Polygon(outer, [zone])
    windows = np.linspace(0.0, path.length, 41)
    room = fences.room_along(fence, path, windows, widest=300.0, overlap=0.0)

    assert np.isfinite(room.limits[:, 0]).all()
    s = np.linspace(0.0, path.length, 20_001)[:-1]
    limits = np.minimum(room.limits[:, 0], 300.0)
    left, right = limits[np.searchsorted(windows, s, side="right") - 1].T
    north, east, course = (np.interp(s, path.s, x) for x in (path.north, path.east, path.course))
    for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
        e = part * np.where(part < 0.0, left, right)
        places = north - e * np.sin(course), east + e * np.cos(course)
        assert shapely.contains_xy(area, *places).all()


def test_flights_are_counted_of_which_it_is_certain(band, box):
    counted = band.inside(json.loads(box.read_text()))

    # Three are outside to the right; one did not arrive.
    assert counted.outside == 4
    assert counted.heights == "no floor and no ceiling"
    bound = binomtest(4, 40, alternative="less").proportion_ci(0.9, method="exact").high
    assert counted.epsilon == pytest.approx(bound, rel=1e-9)
    assert counted.supported == (bound <= 0.25)
    of_flights, of_band = counted.nearest
    assert of_flights["margin_m"] == pytest.approx(40.0 - 45.0, abs=fences.SCAN_STEP)
    assert (of_flights["side"], of_flights["edge"]) == ("right", "edge 2")
    assert 400.0 - 1.0 - fences.SCAN_STEP <= of_flights["along_m"] <= 500.0
    assert of_band["margin_m"] == pytest.approx(30.0 - band.scale, abs=fences.SCAN_STEP)


def test_a_sure_no_supports_no_epsilon(band, box):
    """Four of 40 outside are far more than a hundredth."""
    about = replace(band.about, until_sure=True, epsilon=0.01)
    counted = replace(band, about=about).inside(json.loads(box.read_text()))

    assert "is not certainly inside the fence with probability above 0.01" in counted.sentence
    assert (counted.epsilon, counted.supported) == (1.0, False)


def test_each_of_several_fences_takes_its_part_of_the_confidence_and_any_can_decide(
    band, box, tmp_path
):
    """Of 40 flights 6 may be outside: 4 leave the box, and all leave one of a metre."""
    narrow = fence_file(tmp_path / "n.geojson", [(n, e / 30.0) for n, e in BOX])
    wide, tight = (json.loads(file.read_text()) for file in (box, narrow))

    assert not band.with_fence(wide).decided
    for first, last in ((wide, tight), (tight, wide)):
        both = band.with_fence(first).with_fence(last)
        assert both.decided
        assert both.confidence == pytest.approx(1.0 - 3 * 0.1)
        assert "0.7 (shared by the band and 2 fences)" in both.sentence


def test_a_fence_needs_one_start_for_all_flights(band, box):
    """Starts are drawn over 4.4 km; waypoints in m make the same path about each of them."""
    plan = json.loads(json.dumps(band.about.plan))
    drawn = {"key": "route.lat_deg", "distribution": "uniform", "lower": 46.98, "upper": 47.02}
    plan["campaign"]["disperse"].append(drawn)
    moved = replace(band, about=replace(band.about, plan=plan))

    with pytest.raises(ft.InputError, match=r"one path .*draw 10"):
        check_one_path(plan_of(moved), moved.draws.tolist())


def test_draws_of_the_wind_alone_have_one_path(band, monkeypatch):
    wind = {"distribution": "uniform", "lower": 0.0, "upper": 2.0}
    plan = json.loads(json.dumps(band.about.plan))
    plan["campaign"]["disperse"] = [{"key": f"wind.{x}", **wind} for x in ("speed_mps", "from_deg")]
    windy = plan_of(replace(band, about=replace(band.about, plan=plan)))
    monkeypatch.setattr(ft.Plan, "scenario_of", None)

    check_one_path(windy, band.draws.tolist())


def test_the_answer_is_no_where_the_count_does_not_support_it(band, box, tmp_path):
    band.save(tmp_path / "b.npz")
    command = ("mission", tmp_path / "b.npz", "--fence", box)
    narrow = fence_file(tmp_path / "n.geojson", [(n, e / 30.0) for n, e in BOX])

    assert answer(*command)["fence"]["supported"]
    assert not answer(*command, "--epsilon", 0.15, status=1)["fence"]["supported"]
    assert answer(*command[:-1], narrow, status=1)["fence"]["outside"] == 40


def test_a_count_that_ended_early_claims_nothing_and_can_go_on(band, box, tmp_path):
    """Of 40 flights planned 24 were flown: the others count as outside until they are."""
    part = replace(band, extremes=band.extremes[:24], wind=band.wind[:24])
    counted = part.inside(json.loads(box.read_text()))

    assert not part.claims
    assert part.sentence.startswith("nothing is claimed: the count ended after 24 of 40 flights")
    assert counted.outside == 4
    with pytest.raises(ft.InputError, match="the band must have a claim, got none"):
        ft.worst(part, workers=1)
    bound = binomtest(4 + 16, 40, alternative="less").proportion_ci(0.9, method="exact").high
    assert counted.epsilon == pytest.approx(bound, rel=1e-9)
    part.save(tmp_path / "p.npz")
    with np.load(tmp_path / "p.npz") as arrays:
        assert len(arrays["extremes"]) == 24


def test_a_fence_is_kept_with_its_band_and_shares_its_confidence_and_page(band, box, tmp_path):
    file, page = tmp_path / "b.npz", tmp_path / "b.html"
    band.save(file)

    said = answer("mission", file, "--fence", box)
    answer("report", file, "--out", page)

    assert said["confidence"] == pytest.approx(0.8)
    assert "confidence 0.8 (shared by the band and its fence)" in said["verdict"]
    assert "confidence 0.8 (shared by the band and its fence)" in said["sentence"]
    assert ft.load(file).about.fences == (json.loads(box.read_text()),)
    text = page.read_text()
    assert "36 of 40 fresh flights are certainly inside" in text
    assert text.count("fence</button>") == text.count("Map</") == 1


@pytest.mark.counts
def test_flights_that_start_the_other_way_are_not_counted_inside_a_wall_behind_them(tmp_path):
    """A wall is 30 m behind the start; at 25 m/s and 45 deg a turn takes 65 m of radius."""
    wall = fence_file(tmp_path / "wall.geojson", [(-30, -500), (-30, 500), (900, 500), (900, -500)])
    file = tmp_path / "b.npz"
    made = ("--plant", "kinematic", "--epsilon", 0.1, "--confidence", 0.9, "--learn", 10)
    made += ("--flights", 22, "--out", file, *SETTINGS, "--set", "flight.duration_s=60")
    for turned, outside in ((("--set", "flight.chi_deg=170"), 22), ((), 0)):
        lost = int(bool(turned))
        answer("band", "circuit", "--start-deg", 2, *made, *turned, status=lost)
        said = answer("mission", file, "--fence", wall, status=lost)
        assert said["fence"]["outside"] == outside


def test_properties_of_other_programs_say_nothing_about_a_fence(tmp_path):
    """https://github.com/mapbox/simplestyle-spec, and a row number of a database."""
    style = {"fill": "#f00", "fill-opacity": 0.5, "stroke": "#0f0", "stroke-width": 2, "title": "a"}
    file = fence_file(tmp_path / "f.geojson", BOX, fid=7, OBJECTID=8, Name="x", **style)

    assert len(fences.read_fence(file, ORIGIN).start) == len(BOX)


@pytest.mark.parametrize(
    ("rings", "properties", "says"),
    [
        ([[BOX[0], BOX[2], BOX[1], BOX[3]]], {}, "must not cross, got edge 1 and edge 3"),
        ([BOX, [(0, 20), (0, 60), (9, 60)]], {}, "must not cross, got edge 2 and edge 1 of zone"),
        ([BOX[:2]], {}, "at least three corners, got 2"),
        ([[*BOX, (4.5e6, 0.0)]], {}, "latitudes up to 85"),
        ([[*BOX, (float("nan"), 0.0)]], {}, "every coordinate must be a number, got nan"),
        ([[(n + 90.0, e) for n, e in BOX]], {}, "the start must be inside"),
        ([BOX, [(-9, -9), (-9, 9), (9, 9), (9, -9)]], {}, "the start must be inside"),
        ([BOX], {"min_up_m": 50.0, "max_up_m": -9.0}, "got 50 and -9"),
        ([BOX], {"min_up_m": 5.0, "max_up_m": 50.0}, "got 5 and 50"),
        ([BOX], {"max_up_m": -5.0}, "got -inf and -5"),
        ([BOX], {"min_up_m": 0.0, "max_up_m": 0.0}, "got 0 and 0"),
        ([BOX], {"exclusion": True, "max_up_m": 50.0}, "must be absent of an area to stay out"),
        ([BOX], {"exclusion": "false"}, "`exclusion` must be true or false, got 'false'"),
        ([BOX], {"max_up_m": float("nan")}, "`max_up_m` must be a number, got nan"),
        ([BOX], {"max_up_m": 50.0, "maxAltitude": 30.0}, "got 'maxAltitude'"),
    ],
)
def test_what_is_no_fence_is_refused_in_one_line(tmp_path, rings, properties, says):
    file = fence_file(tmp_path / "f.geojson", *rings, **properties)

    with pytest.raises(ft.InputError, match=says) as refusal:
        fences.read_fence(file, ORIGIN)
    assert str(refusal.value).startswith(str(file))
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_a_fence_is_for_polygons_and_for_bands_on_a_route(band, box, tmp_path):
    line = tmp_path / "line.geojson"
    line.write_text('{"type": "LineString", "coordinates": [[8, 47], [8, 48]]}')

    with pytest.raises(ft.InputError, match="a Polygon for a fence"):
        fences.read_fence(line, ORIGIN)
    assert "`route` must be" in flighttune("mission", "mission", "--fence", box, status=2)[1]
    about = replace(
        band.about,
        signals={"cross_track": "m"},
        coefficients=band.about.coefficients[..., :1],
        half=band.about.half[:, :1],
    )
    beside = replace(band, about=about, extremes=band.extremes[:, :, :1])
    beside.save(tmp_path / "b.npz")
    said = flighttune("mission", tmp_path / "b.npz", "--fence", box, status=2)[1]
    assert "of cross_track and" in said


def test_maps_show_the_corridor_as_wide_and_high_as_the_band(band, tmp_path):
    where = band.flights.route.where
    corridor = band.corridor(where)._replace(high=np.tile([7.0, 3.0], (200, 1)))
    drawn = maps.RouteMap(where, "a leg", corridor=corridor)
    line, *pieces = json.loads(drawn.geojson())["features"]

    alone = json.loads(maps.RouteMap(where, "a leg").geojson())["features"][0]
    assert line["geometry"] == alone["geometry"]
    assert line["properties"]["corridor"] == band.sentence
    assert len(pieces) == 200
    for window, piece in enumerate(pieces):
        corners = piece["geometry"]["coordinates"][0]
        north, east = np.array([maps.north_east((lat, lon), ORIGIN) for lon, lat in corners]).T
        assert np.ptp(east) == pytest.approx(7.0 + band.scale, abs=0.01)
        assert east.max() == pytest.approx(7.0, abs=0.01)
        assert north.min() == pytest.approx(4.0 * window, abs=0.01)
        assert piece["properties"]["min_up_m"] == -3.0
        assert piece["properties"]["max_up_m"] == pytest.approx(band.scale, abs=0.01)
    kml = ElementTree.fromstring(drawn.kml())
    assert kml.findtext(".//{*}Placemark/{*}description") == f"Corridor: {band.sentence}."
    rings = kml.findall(".//{*}LinearRing/{*}coordinates")
    heights = {float(point.split(",")[2]) for ring in rings for point in ring.text.split()}
    assert heights == {997.0, round(1000.0 + band.scale, 2)}


def test_a_window_of_a_climb_is_as_high_as_its_ends():
    """16 m up in 800 m: 4 and 8 m in the middle, and 1 m to the next point of the path."""
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0, up=16.0)], ABILITY)
    room = maps.Corridor(np.array([[200.0, 400.0]]), *np.array([[[-2.0, -3.0]], [[2.0, 5.0]]]), "")

    drawn = maps.RouteMap((leg, ORIGIN, 1000.0), "a climb", corridor=room)

    _, piece = json.loads(drawn.geojson())["features"]
    said = [piece["properties"][key] for key in ("min_up_m", "max_up_m")]
    assert said == pytest.approx([4.0 - 5.0, 8.0 + 3.0], abs=0.05)


def test_the_route_of_a_band_is_written_with_its_corridor(band, tmp_path):
    band.save(tmp_path / "b.npz")

    said = answer("mission", tmp_path / "b.npz", "--plan", "--out", tmp_path / "c.kml")

    assert said["length_m"] == pytest.approx(800.0)
    assert "Corridor: a new flight leaves the band" in (tmp_path / "c.kml").read_text()
