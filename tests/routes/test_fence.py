"""Fences: the margin of a path as shapely finds it, the flights counted inside, and refusals."""

import json
import math

import numpy as np
import pytest
import shapely
from commands import answer, flighttune
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

import flighttune as ft

ORIGIN = (47.0, 8.0)
# The edge is at 30 m to the left of a leg to the north, 40 m to the right; a zone at 25 m.
BOX = ((-50.0, -30.0), (-50.0, 40.0), (900.0, 40.0), (900.0, -30.0))
SQUARE = ((300.0, 25.0), (310.0, 25.0), (310.0, 35.0), (300.0, 35.0))
LEG = ((0.0, 0.0), (800.0, 0.0))
BENT = ((0, 0), (600, 0), (700, 500), (200, 700), (-300, 300))


def degrees(*places, origin=ORIGIN):
    """Latitude and longitude of places north and east of a start, m."""
    found = []
    for north, east in places:
        azimuth, far = math.degrees(math.atan2(east, north)), math.hypot(north, east)
        if not math.isfinite(far):
            found.append([far, far])
            continue
        end = Geodesic.WGS84.Direct(*origin, azimuth, far)
        found.append([end["lat2"], end["lon2"]])
    return found


def fence_file(path, *rings, origin=ORIGIN, **properties):
    """A polygon from north and east of the start, m."""
    closed = [[x[::-1] for x in degrees(*ring, ring[0], origin=origin)] for ring in rings]
    geometry = {"type": "Polygon", "coordinates": closed}
    path.write_text(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    return path


def plan_with(path, polygons=(), circles=(), origin=ORIGIN, **mission):
    """A plan with areas: corners or centre and radius, m, and whether it is to stay in."""
    fence = {
        "version": 2,
        "polygons": [
            {"inclusion": inside, "polygon": degrees(*ring, origin=origin)}
            for inside, ring in polygons
        ],
        "circles": [
            {
                "inclusion": inside,
                "circle": {"center": degrees(at, origin=origin)[0], "radius": radius},
            }
            for inside, at, radius in circles
        ],
    }
    path.write_text(json.dumps({"mission": {"items": [], **mission}, "geoFence": fence}))
    return path


def planner(path, *areas):
    """A file of Mission Planner: commands of MAVLink with their first parameter and corners."""
    rows = [(code, first, at) for code, first, places in areas for at in degrees(*places)]
    lines = ["QGC WPL 110", "0 1 0 16 0 0 0 0 47.0 8.0 430 1"]
    lines += [
        f"{i} 0 3 {code} {first} 0 0 0 {lat:.9f} {lon:.9f} 0 1"
        for i, (code, first, (lat, lon)) in enumerate(rows, 1)
    ]
    path.write_text("\n".join(lines))
    return path


def words(points, origin, more):
    stated = ", ".join(f"{{north_m = {n}, east_m = {e}, up_m = {u}}}" for n, e, u in points)
    keys = {
        "route.waypoint": f"[{stated}]",
        "route.lat_deg": origin[0],
        "route.lon_deg": origin[1],
        **more,
    }
    return [word for key, x in keys.items() for word in ("--set", f"{key}={x}")]


def nearest(*files, points=LEG, origin=ORIGIN, ups=(0.0,), **more):
    """The nearest place to each fence of a path, as `mission --plan` says it."""
    ups = [*ups, *[ups[-1]] * len(points)][: len(points)]
    set_to = words([(n, e, u) for (n, e), u in zip(points, ups, strict=True)], origin, more)
    fences = [word for file in files for word in ("--fence", file)]
    said = answer("mission", "circuit", "--plan", *fences, *set_to, status=None)
    assert said["verdict"].startswith("No") == (said["fence"]["nearest"][0]["leaves_m"] is not None)
    return said["fence"]["nearest"][0]


NEAREST = [
    # rings, properties, end of the leg, margin, side, edge, along
    ([BOX], {}, 0.0, 30.0, "left", "edge 4", None),
    ([BOX, SQUARE], {}, 0.0, 25.0, "right", "edge 1 of zone 1", 300.0),
    ([BOX, ((9, 60), (9, 80), (99, 70)), SQUARE], {}, 0.0, 25.0, "right", "edge 1 of zone 2",
     300.0),
    ([BOX], {"max_up_m": 25.0}, 16.0, 9.0, "up", "ceiling", 800.0),
    ([BOX], {"min_up_m": -20.0}, -16.0, 4.0, "down", "floor", 800.0),
    ([BOX], {"max_up_m": 10.0}, 16.0, -6.0, "up", "ceiling", 800.0),
    ([((-50, 0.05), (900, 0.05), (900, -90.0), (-50, -90.0))], {}, 0.0, 0.05, "right", "edge 1",
     None),
    ([((-50, -0.05), (900, -0.05), (900, 90.0), (-50, 90.0))], {}, 0.0, 0.05, "left", "edge 1",
     None),
    # properties of other programs say nothing
    ([BOX], {"fill": "#f00", "stroke-width": 2, "fid": 7, "OBJECTID": 8, "Name": "x", "title": "a"},
     0.0, 30.0, "left", "edge 4", None),
]  # fmt: skip


@pytest.mark.parametrize(("rings", "properties", "up", "margin", "side", "edge", "along"), NEAREST)
def test_the_nearest_place_of_a_fence_has_its_margin_side_and_edge(
    tmp_path, rings, properties, up, margin, side, edge, along
):
    found = nearest(fence_file(tmp_path / "f.geojson", *rings, **properties), ups=(0.0, up))

    assert found["margin_m"] == pytest.approx(margin, abs=0.1)
    assert (found["side"], found["edge"]) == (side, edge)
    assert along is None or found["along_m"] == pytest.approx(along, abs=2.0)
    assert (found["leaves_m"] is None) == (margin > 0.0)
    if along is not None:
        assert found["stretch"] == "leg to waypoint 2"


AREAS = {
    "wide": [((-600, -300), (1200, -300), (1200, 1200), (-600, 1200))],
    "zone": [
        ((-600, -300), (1200, -300), (1200, 1200), (-600, 1200)),
        ((500, 150), (720, 250), (450, 350)),
    ],
    "area": [((-400, -80), (500, -60), (500, 520), (-420, 200))],
}


@pytest.mark.parametrize("name", AREAS)
@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_the_margin_of_a_path_is_the_distance_that_shapely_finds(tmp_path, name, mirrored):
    """Negative by how far it is outside; a mirrored path and fence have the other side."""
    points = [(n, mirrored * e) for n, e in BENT]
    rings = [[(n, mirrored * e) for n, e in ring] for ring in AREAS[name]]
    stated = [{"north_m": n, "east_m": e} for n, e in points]
    path = ft.route("circuit", changes={"route.waypoint": stated}).reference.path
    found = nearest(fence_file(tmp_path / "f.geojson", *rings), points=points)

    area = shapely.Polygon(rings[0], rings[1:])
    places = shapely.points(np.column_stack([path.north, path.east])[path.s <= path.length])
    signed = np.where(area.contains(places), 1.0, -1.0) * area.boundary.distance(places)
    assert found["margin_m"] == pytest.approx(signed.min(), abs=0.02)
    i = signed.argmin()
    north, east = np.diff(shapely.shortest_line(places[i], area.boundary).coords, axis=0)[0]
    right = np.cos(path.course[i]) * east - np.sin(path.course[i]) * north
    assert found["side"] == ("right" if right > 0.0 else "left")
    out = np.flatnonzero(signed < 0.0)
    assert found["leaves_m"] == (pytest.approx(out[0], abs=1.0) if len(out) else None)


@settings(max_examples=5)
@given(
    left=st.floats(5.0, 80.0),
    right=st.floats(5.0, 80.0),
    lon=st.sampled_from([8.0, 179.999, -179.999]),
)
def test_a_box_has_the_margin_of_its_nearer_side_also_over_the_date_line(
    tmp_path_factory, left, right, lon
):
    file = tmp_path_factory.mktemp("box") / "f.geojson"
    box = ((-500, -left), (-500, right), (1400, right), (1400, -left))

    found = nearest(fence_file(file, box, origin=(-17.0, lon)), origin=(-17.0, lon))

    assert found["margin_m"] == pytest.approx(min(left, right), abs=0.1)


def test_a_long_edge_follows_its_parallel(tmp_path):
    """Straight in longitude and latitude (RFC 7946): 17 m beside the great circle of its ends."""
    corners = [[8.2, 59.9], [8.2, 60.1], [7.8, 60.1], [7.8, 59.9]]
    (tmp_path / "f.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]]})
    )

    found = nearest(tmp_path / "f.geojson", origin=(60.0, 8.0), points=((0, 0), (11_000.0, 0.0)))

    to_edge = Geodesic.WGS84.Inverse(60.0, 8.0, 60.1, 8.0)["s12"] - 11_000.0
    assert found["margin_m"] == pytest.approx(to_edge, abs=0.06)


SQUARES = [(True, BOX), (False, SQUARE)]
CIRCLES = [(True, (400.0, 0.0), 450.0), (False, (150.0, -80.0), 60.0)]
FORMS = {
    "plan": lambda p: plan_with(p / "m.plan", SQUARES),
    "waypoints": lambda p: planner(
        p / "f.waypoints", (5000, 0, [(0, 0)]), (5001, 4, BOX), (5002, 4, SQUARE)
    ),
    "geojson": lambda p: fence_file(p / "f.geojson", BOX, SQUARE),
    "kml": lambda p: kml(p / "f.kml", BOX, SQUARE),
    "two files": lambda p: (kml(p / "f.kml", BOX), plan_with(p / "m.plan", [(False, SQUARE)])),
    "px4": lambda p: plan_with(
        p / "m.plan",
        [
            (True, BOX[:1] + BOX[1:2] + ((500.0, 40.0), (500.0, -30.0))),
            (True, ((400.0, -30.0), (400.0, 40.0), (900.0, 40.0), (900.0, -30.0))),
            (False, SQUARE),
        ],
        firmwareType=12,
    ),
    "circles": lambda p: plan_with(p / "m.plan", circles=CIRCLES),
    "circles of a planner": lambda p: planner(
        p / "f.txt", (5003, 450, [(400, 0)]), (5004, 60, [(150, -80)])
    ),
    "circles without a home": lambda p: without_home(
        planner(p / "f.txt", (5003, 450, [(400, 0)]), (5004, 60, [(150, -80)]))
    ),
    "old": lambda p: old_plan(p / "old.plan"),
    "corners": lambda p: corners(p / "old.fen"),
}


def kml(path, *rings):
    bounds = ["outerBoundaryIs", *["innerBoundaryIs"] * (len(rings) - 1)]
    texts = [" ".join(f"{lon},{lat},0" for lat, lon in degrees(*ring, ring[0])) for ring in rings]
    rows = "".join(
        f"<{b}><LinearRing><coordinates>{x}</coordinates></LinearRing></{b}>"
        for b, x in zip(bounds, texts, strict=True)
    )
    path.write_text(f"<kml><Placemark><Polygon>{rows}</Polygon></Placemark></kml>")
    return path


def without_home(path):
    path.write_text("\n".join(x for x in path.read_text().splitlines() if " 16 " not in x))
    return path


def old_plan(path):
    fence = {"version": 1, "polygon": degrees(*BOX), "parameters": []}
    path.write_text(json.dumps({"mission": {}, "geoFence": fence}))
    return path


def corners(path):
    lines = "\n".join(f"{lat:.9f} {lon:.9f}" for lat, lon in degrees((0.0, 0.0), *BOX, BOX[0]))
    path.write_text(f"# saved by Mission Planner\n{lines}\n")
    return path


@pytest.mark.parametrize("form", FORMS)
def test_the_same_fence_is_read_in_every_file_that_holds_one(tmp_path, form):
    """A circle lies on the safe side by a thousandth of its radius at most."""
    files = FORMS[form](tmp_path)
    found = nearest(*(files if isinstance(files, tuple) else [files]))

    expected, slack = {"old": (30.0, 0.1), "corners": (30.0, 0.1)}.get(form, (25.0, 0.1))
    if "circles" in form:
        expected, slack = 20.0 - 0.05, 0.2
    assert found["margin_m"] == pytest.approx(expected, abs=slack)
    assert found["leaves_m"] is None


AREA = ([(n + 3000.0, e) for n, e in BOX],)
MANY = [(900.0 * math.cos(0.006 * k), 900.0 * math.sin(0.006 * k)) for k in range(1001)]
REFUSED = [
    (lambda p: fence_file(p, [BOX[0], BOX[2], BOX[1], BOX[3]]),
     "must not cross, got edge 1 and edge 3"),
    (lambda p: fence_file(p, BOX, [(0, 20), (0, 60), (9, 60)]),
     "must not cross, got edge 2 and edge 1 of zone"),
    (lambda p: fence_file(p, BOX[:2]), "at least three corners, got 2"),
    (lambda p: fence_file(p, [*BOX, (4.5e6, 0.0)]), "latitudes up to 85"),
    (lambda p: fence_file(p, [*BOX, (math.nan, 0.0)]),
     "every coordinate must be a number, got nan"),
    (lambda p: fence_file(p, [(n + 90.0, e) for n, e in BOX]), "the start must be inside"),
    (lambda p: fence_file(p, BOX, [(-9, -9), (-9, 9), (9, 9), (9, -9)]),
     "the start must be inside"),
    (lambda p: fence_file(p, BOX, min_up_m=50.0, max_up_m=-9.0), "got 50 and -9"),
    (lambda p: fence_file(p, BOX, min_up_m=5.0, max_up_m=50.0), "got 5 and 50"),
    (lambda p: fence_file(p, BOX, max_up_m=-5.0), "got -inf and -5"),
    (lambda p: fence_file(p, BOX, min_up_m=0.0, max_up_m=0.0), "got 0 and 0"),
    (lambda p: fence_file(p, BOX, exclusion=True, max_up_m=50.0),
     "must be absent of an area to stay out"),
    (lambda p: fence_file(p, BOX, exclusion="false"),
     "`exclusion` must be true or false, got 'false'"),
    (lambda p: fence_file(p, BOX, max_up_m=math.nan), "`max_up_m` must be a number, got nan"),
    (lambda p: fence_file(p, BOX, max_up_m=50.0, maxAltitude=30.0), "got 'maxAltitude'"),
    (lambda p: fence_file(p, MANY), "at most 1000 edges"),
    (lambda p: plan_with(p, [(True, BOX), (True, *AREA)]), "inside of area 2"),
    (lambda p: plan_with(p, [(True, BOX), (True, *AREA)], firmwareType=12),
     "areas .* must overlap"),
    (lambda p: plan_with(p, [(True, BOX), (False, BOX)]), "outside of exclusion 1"),
    (lambda p: plan_with(p, circles=[(True, (400.0, 0.0), -5.0)]),
     "`radius` of a circle must be positive, got -5"),
    (lambda p: plan_with(p), "must have a Polygon or circle for a fence, got none"),
    (lambda p: plan_with(p, [(True, [])]), "at least three corners, got 0"),
    (lambda p: plan_with(p, [("false", BOX)]), "`inclusion` must be true or false, got 'false'"),
    (lambda p: plan_with(p, circles=[(False, (0, 0), 9.0)] * 334), "at most 1000 edges"),
    (lambda p: (plan_with(p,
     geo=0) and p.write_text('{"mission": {}, "geoFence": {"polygons": ""}}') and p),
     "must be a list"),
    (lambda p: p.write_text('{"mission": {}, "geoFence": false}') and p, "must be an object"),
    (lambda p: planner(p.with_suffix(".waypoints"), (5001, 5, BOX)), "its 5 corners, got 4"),
    (lambda p: p.with_suffix(".xml"), r"must be a plan, .*\.xml"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "says"), REFUSED)
def test_what_is_no_fence_is_refused_in_one_line_that_names_its_file(tmp_path, make, says):
    import re

    file = make(
        tmp_path / "f.plan"
        if "plan_with" in make.__code__.co_names or "write_text" in make.__code__.co_names
        else tmp_path / "f.geojson"
    )
    set_to = words([(n, e, 0.0) for n, e in LEG], ORIGIN, {})
    said = flighttune("mission", "circuit", "--plan", "--fence", file, *set_to, status=2)[1]

    assert re.search(says, said), said
    assert file.name in said
    assert len(said.splitlines()) == 1


def counted(band, *rings, **properties):
    """How many flights of the band leave a fence about its start, and the nearest place to it."""
    closed = [[x[::-1] for x in degrees(*ring, ring[0], origin=(47.4, 8.5))] for ring in rings]
    geometry = {"type": "Polygon", "coordinates": closed}
    found = band.inside({"type": "Feature", "properties": properties, "geometry": geometry})
    return found, found.nearest[0]


def about(left, right, ends=(-50.0, 250.0)):
    return ((ends[0], -left), (ends[0], right), (ends[1], right), (ends[1], -left))


@pytest.mark.soak
def test_flights_are_counted_outside_by_the_bound_of_clopper_and_pearson(band):
    """By SciPy. A fence of centimetres has all flights outside, one of metres none."""
    n = len(band.extremes)
    for wide, outside in ((30.0, 0), (0.01, n)):
        found, _ = counted(band, about(wide, 2.0 * wide))

        assert found.outside == outside
        bound = binomtest(outside, n, alternative="less").proportion_ci(0.9, method="exact").high
        assert found.epsilon == pytest.approx(bound if bound < 1.0 else 1.0, rel=1e-9)


SPIKE = ((73.0, 9.0), (74.0, 9.0), (73.5, 12.0))
ROOM = [
    # rings, properties, by how much the nearest side or height is inside, of what and where
    ([about(9.0, 30.0)], {}, lambda low, high: 9.0 + low[:, 0].min(), ("left", "edge 4"), None),
    ([about(30.0, 9.0)], {}, lambda low, high: 9.0 - high[:, 0].max(), ("right", "edge 2"), None),
    ([about(30.0, 30.0), SPIKE], {}, lambda low, high: 9.0 - high[72:75, 0].max(), ("right",
     "of zone 1"), 73.0),
    ([about(30.0, 30.0), [(n, -e) for n, e in SPIKE]], {}, lambda low, high: 9.0 + low[72:75,
     0].min(), ("left", "of zone 1"), 73.0),
    ([about(30.0, 30.0)], {"max_up_m": 7.0}, lambda low, high: 7.0 + low[:, 1].min(), ("up",
     "ceiling"), None),
    ([about(30.0, 30.0)], {"min_up_m": -7.0}, lambda low, high: 7.0 - high[:, 1].max(), ("down",
     "floor"), None),
    # a side that closes in: 10 m to the right at the start, 4 m less at 150 m
    ([((-50.0, -30.0), (-50.0, 11.333), (250.0, 3.333), (250.0, -30.0))], {}, lambda low,
     high: (10.0 - (np.arange(150) + 0.5) / 37.5 - high[:, 0]).min(), ("right", "edge 2"), None),
]  # fmt: skip


@pytest.mark.parametrize(("rings", "properties", "left", "of", "along"), ROOM)
def test_flights_have_the_room_that_their_largest_strays_leave(
    band, rings, properties, left, of, along
):
    """Less than 0.15 m less, by which edges are widened between the points of a path."""
    low, high = band.extremes.min(axis=(0, 3)), band.extremes.max(axis=(0, 3))
    found, nearest = counted(band, *rings, **properties)

    assert found.outside == 0
    assert nearest["margin_m"] == pytest.approx(left(low, high) - 0.07, abs=0.08)
    assert (nearest["side"], of[1] in nearest["edge"]) == (of[0], True)
    assert along is None or nearest["along_m"] == pytest.approx(along, abs=2.0)
    assert nearest["stretch"] == "leg to waypoint 2"


def test_a_path_outside_of_a_fence_counts_from_its_nearest_edge(band):
    found, nearest = counted(band, about(30.0, 30.0), ((70.0, -5.0), (70.0, 2.0), (80.0, 2.0)))

    assert found.outside == len(band.extremes)
    assert nearest["margin_m"] < 0.0
    assert nearest["edge"].endswith("of zone 1")
