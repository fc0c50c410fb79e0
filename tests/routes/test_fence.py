"""Fences: the room across a path, the flights counted inside, and corridors on maps."""

import json
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import answer, flighttune
from scipy.stats import binomtest

from flighttune.campaign.band import plan_of
from flighttune.campaign.fence import corridor_of, count_inside, where_of
from flighttune.campaign.stated_set import planned
from flighttune.errors import InputError
from flighttune.guarantee.band import About, Band, save_band
from flighttune.routes.fence import SCAN_STEP, read_fence, room_along
from flighttune.routes.files import metres_per_degree, route_geojson, route_kml
from flighttune.routes.path import Ability, Waypoint, plan

ORIGIN = (47.0, 8.0)
PER_LAT, PER_LON = metres_per_degree(47.0)
ABILITY = Ability(V_a=25.0, wind=8.0, phi=0.6, phi_rate=0.4, gamma=(-0.2, 0.2), g=9.81)

# The edge is at 30 m to the left of a leg to the north, 40 m to the right.
BOX = ((-50.0, -30.0), (-50.0, 40.0), (900.0, 40.0), (900.0, -30.0))

STRAIGHT = "[{north_m = 0.0, east_m = 0.0}, {north_m = 800.0, east_m = 0.0}]"
SETTINGS = (
    "--set",
    f"route.waypoint={STRAIGHT}",
    "--set",
    "route.lat_deg=47.0",
    "--set",
    "route.lon_deg=8.0",
)


def fence_file(path, *rings, **properties):
    """A polygon from north and east of the start, m."""
    degrees = [
        [[8.0 + east / PER_LON, 47.0 + north / PER_LAT] for north, east in (*ring, ring[0])]
        for ring in rings
    ]
    geometry = {"type": "Polygon", "coordinates": degrees}
    path.write_text(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    return path


@pytest.fixture
def box(tmp_path):
    return fence_file(tmp_path / "box.geojson", BOX)


@pytest.fixture(scope="module")
def band():
    """40 flights along 800 m that come 2 m off; three 45 m to the right at 400 m, one is lost."""
    changes = {
        "route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)],
        "route.lat_deg": 47.0,
        "route.lon_deg": 8.0,
    }
    extremes = np.tile(np.array([-2.0, 2.0], dtype=np.float32), (40, 8, 2, 1))
    extremes[5:8, 4, 0, 1] = 45.0
    extremes[20] = [-np.inf, np.inf]
    about = About(
        signals={"cross_track": "m", "height_err": "m"},
        over="along",
        edges=np.linspace(0.0, 800.0, 9),
        coefficients=np.zeros((1, 8, 2)),
        half=np.ones((8, 2)),
        predicted_from=None,
        distribution="a made-up campaign",
        plan=planned("circuit", plant="kinematic", start_deg=1.0, changes=changes).as_dict(),
        learned=10,
        readings=(40,),
        epsilon=0.25,
        confidence=0.9,
        scale=None,
    )
    counted = Band(about=about, extremes=extremes, wind=np.zeros((40, 0)))
    return counted.claiming(0.25, 0.9)


def test_a_leg_in_a_rectangle_has_the_distances_of_its_edges(tmp_path):
    leg = plan([Waypoint(north=0.0, east=0.0), Waypoint(north=800.0, east=0.0, up=16.0)], ABILITY)
    zone = ((300.0, 25.0), (310.0, 25.0), (310.0, 35.0), (300.0, 35.0))
    needle = ((150.04, 28.0), (150.06, 28.0), (150.05, 27.0))  # between two points of the path
    heights = {"min_up_m": -20.0, "max_up_m": 50.0}
    file = fence_file(tmp_path / "f.geojson", BOX, zone, needle, **heights)
    windows = np.array([0.0, 200.0, 400.0, 800.0])
    room = room_along(read_fence(file, ORIGIN), leg, windows, widest=50.0, overlap=0.0)

    # left, right; up to the ceiling where the window is highest, down to the floor where lowest
    expected = [[30, 27, 46, 20], [30, 25, 42, 24], [30, 40, 34, 28]]
    assert room.limits.reshape(3, 4) == pytest.approx(np.array(expected), abs=SCAN_STEP)
    nearest = room.nearest(np.array([[10.0, 21.0], [5.0, 5.0]]))
    assert nearest == {
        "margin_m": pytest.approx(4.0, abs=SCAN_STEP),
        "side": "right",
        "edge": "edge 1 of zone 1",
        "along_m": pytest.approx(305.0, abs=5.0 + SCAN_STEP),
        "stretch": "leg to waypoint 2",
    }


def winding(places, ring):
    """How often a ring goes around each place: the sum of the angles under which edges appear."""
    to = [np.arctan2(*(np.array(corner)[:, None] - places)) for corner in (*ring, ring[0])]
    turned = sum(np.angle(np.exp(1j * (b - a))) for a, b in pairwise(to))
    return np.round(turned / (2.0 * np.pi))


def test_every_place_within_the_limits_is_inside(tmp_path):
    corners = [(0, 0), (600, 0), (700, 500), (200, 700), (-300, 300)]
    path = plan([Waypoint(north=n, east=e) for n, e in corners], ABILITY)
    outer = ((-400, -80), (640, -60), (780, 520), (150, 800), (-420, 200), (100, 430), (200, 150))
    zone = ((500, 150), (560, 250), (450, 350))
    fence = read_fence(fence_file(tmp_path / "f.geojson", outer, zone), ORIGIN)
    windows = np.linspace(0.0, path.length, 41)
    room = room_along(fence, path, windows, widest=300.0, overlap=0.0)

    assert np.isfinite(room.limits[:, 0]).all()
    s = np.linspace(0.0, path.length, 20_001)[:-1]
    limits = np.minimum(room.limits[:, 0], 300.0)
    left, right = limits[np.searchsorted(windows, s, side="right") - 1].T
    north, east, course = (np.interp(s, path.s, x) for x in (path.north, path.east, path.course))
    for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
        e = part * np.where(part < 0.0, left, right)
        places = np.stack([north - e * np.sin(course), east + e * np.cos(course)])
        assert (winding(places, outer) != 0).all()
        assert (winding(places, zone) == 0).all()


def test_flights_are_counted_of_which_it_is_certain(band, box):
    counted = count_inside(band, box)

    # Three are outside to the right; one did not arrive.
    assert counted.outside == 4
    bound = binomtest(4, 40, alternative="less").proportion_ci(0.9, method="exact").high
    assert counted.epsilon == pytest.approx(bound, rel=1e-9)
    assert counted.supported == (bound <= 0.25)
    of_flights, of_band = counted.nearest
    assert of_flights["margin_m"] == pytest.approx(40.0 - 45.0, abs=SCAN_STEP)
    assert (of_flights["side"], of_flights["edge"]) == ("right", "edge 2")
    assert 400.0 - 1.0 - SCAN_STEP <= of_flights["along_m"] <= 500.0
    assert of_band["margin_m"] == pytest.approx(30.0 - band.scale, abs=SCAN_STEP)


def test_the_answer_is_no_where_the_count_does_not_support_it(band, box, tmp_path):
    save_band(band, tmp_path / "b.npz")
    command = ("band", tmp_path / "b.npz", "--fence", box)
    narrow = fence_file(tmp_path / "n.geojson", [(n, e / 30.0) for n, e in BOX])

    assert answer(*command)["fence"]["supported"]
    assert not answer(*command, "--epsilon", 0.15, status=1)["fence"]["supported"]
    assert answer(*command[:-1], narrow, status=1)["fence"]["outside"] == 40


@pytest.mark.parametrize(
    ("rings", "properties", "says"),
    [
        ([[BOX[0], BOX[2], BOX[1], BOX[3]]], {}, "must not cross, got edge 1 and edge 3"),
        ([BOX, [(0, 20), (0, 60), (9, 60)]], {}, "must not cross, got edge 2 and edge 1 of zone"),
        ([BOX[:2]], {}, "at least three corners, got 2"),
        ([[*BOX, (1e8, 0.0)]], {}, "latitudes up to 85"),
        ([[*BOX, (float("nan"), 0.0)]], {}, "got 8 and nan"),
        ([[(n + 90.0, e) for n, e in BOX]], {}, "the start must be inside"),
        ([BOX, [(-9, -9), (-9, 9), (9, 9), (9, -9)]], {}, "the start must be inside"),
        ([BOX], {"min_up_m": 50.0, "max_up_m": -9.0}, "got 50 and -9"),
        ([BOX], {"max_up_m": float("nan")}, "got -inf and nan"),
        ([BOX], {"max_up_m": "high"}, "ValueError"),
    ],
)
def test_what_is_no_fence_is_refused_in_one_line(tmp_path, rings, properties, says):
    file = fence_file(tmp_path / "f.geojson", *rings, **properties)

    with pytest.raises(InputError, match=says) as refusal:
        read_fence(file, ORIGIN)
    assert str(refusal.value).startswith(str(file))
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_a_fence_is_for_one_polygon_and_for_bands_on_a_route(band, box, tmp_path):
    line = tmp_path / "line.geojson"
    line.write_text('{"type": "LineString", "coordinates": [[8, 47], [8, 48]]}')

    with pytest.raises(InputError, match="one Polygon, got 0"):
        read_fence(line, ORIGIN)
    assert "`route` must be" in flighttune("band", "mission", "--fence", box, status=2)[1]
    signal = ("--start-deg", 1, "--signal", "chi_err")
    assert (
        "of cross_track and" in flighttune("band", "circuit", *signal, "--fence", box, status=2)[1]
    )


def test_maps_show_the_corridor_as_wide_and_high_as_the_band(band, tmp_path):
    where = where_of(plan_of(band).campaign.central)
    corridor = corridor_of(band, where)._replace(high=np.tile([7.0, 3.0], (8, 1)))
    line, *pieces = json.loads(route_geojson(where, "a leg", corridor))["features"]

    assert line == json.loads(route_geojson(where, "a leg"))["features"][0]
    assert len(pieces) == 8
    for window, piece in enumerate(pieces):
        lon, lat = np.array(piece["geometry"]["coordinates"][0]).T
        assert np.ptp((lon - 8.0) * PER_LON) == pytest.approx(7.0 + band.scale, abs=0.01)
        assert ((lon - 8.0) * PER_LON).max() == pytest.approx(7.0, abs=0.01)
        assert (lat.min() - 47.0) * PER_LAT == pytest.approx(100.0 * window, abs=0.01)
        assert piece["properties"]["min_up_m"] == -3.0
        assert piece["properties"]["max_up_m"] == pytest.approx(band.scale, abs=0.01)
    kml = ElementTree.fromstring(route_kml(where, "a leg", corridor))
    rings = kml.findall(".//{*}LinearRing/{*}coordinates")
    heights = {float(point.split(",")[2]) for ring in rings for point in ring.text.split()}
    assert heights == {997.0, round(1000.0 + band.scale, 2)}


def test_the_corridor_of_another_route_is_refused(band, tmp_path):
    save_band(band, tmp_path / "b.npz")
    out = ("--band", tmp_path / "b.npz", "--out", tmp_path / "c.kml")

    flighttune("route", "circuit", *SETTINGS, *out)
    assert "of this route" in flighttune("route", "circuit", *out, status=2)[1]
