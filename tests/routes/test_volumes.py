"""Volumes around a path as GeoJSON and KML: read by lxml, fastkml and shapely, and as a fence."""

import json

import numpy as np
import pytest
import shapely
from commands import answer
from lxml import etree
from plans import ABILITY, Waypoint, plan, plan_file, waypoint

import flighttune as ft
from flighttune.routes.volumes import NAMES, Volume, VolumesMap, rings_around

GEOGRAPHY, CONTINGENCY, BUFFER = NAMES

SEEN = "{http://www.opengis.net/kml/2.2}"

# m: the sizes of volumes are written in decimetres, places in 1e-8 deg
DECIMETRE = 0.1

# m: the chords of a round end lie outside the width
OUTSIDE = 1.0

GROUND, OVER_GROUND = 480.0, 300.0

# Around a triangle whose ends are 75 m apart, so that the contingency volume alone has a hole.
VOLUMES = {
    GEOGRAPHY: Volume(10.0, 290.0, 310.0, "at most 1 % leave it"),
    CONTINGENCY: Volume(60.0, 280.0, 320.0, "room to turn back"),
    BUFFER: Volume(380.0, 0.0, 320.0, "as wide as it is high"),
}


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """A mission over level ground."""
    places = [(47.4, 8.5), (47.406, 8.5), (47.403, 8.51), (47.4, 8.501)]
    items = [waypoint(*place, OVER_GROUND) for place in places]
    return plan_file(tmp_path_factory.mktemp("m") / "m.plan", *items, home=(47.4, 8.5, GROUND))


@pytest.fixture(scope="module")
def volumes(mission):
    """The volumes around it."""
    return VolumesMap(ft.route(mission).where, GROUND, VOLUMES)


@pytest.fixture
def written(volumes, tmp_path):
    """The file of the volumes by its ending."""
    files = {ending: tmp_path / f"v{ending}" for ending in (".geojson", ".kml")}
    files[".geojson"].write_text(volumes.geojson())
    files[".kml"].write_text(volumes.kml("Survey of a field"))
    return files


def test_kml_has_the_areas_of_geojson_at_heights_above_sea_level(written):
    root = etree.parse(written[".kml"]).getroot()
    features = json.loads(written[".geojson"].read_text())["features"]
    marks = {x.findtext(f"{SEEN}name"): x for x in root.iter(f"{SEEN}Placemark")}

    for feature in features:
        name, area = feature["properties"]["name"], shapely.geometry.shape(feature["geometry"])
        assert area.is_valid
        polygons = [*marks[name].iter(f"{SEEN}Polygon")]
        ends = [VOLUMES[name].low, VOLUMES[name].high] if name != BUFFER else [None]
        for polygon, over_ground in zip(polygons, ends, strict=True):
            modes = {x.text for x in polygon.iter(f"{SEEN}altitudeMode")}
            rings = [
                [[*map(float, point.split(","))] for point in x.text.split()]
                for x in polygon.iter(f"{SEEN}coordinates")
            ]
            drawn = shapely.Polygon(rings[0], rings[1:])
            assert shapely.equals(shapely.force_2d(drawn), area)
            if over_ground is None:
                assert modes == {"clampToGround"}
                continue
            assert modes == {"absolute"}
            (height,) = {point[2] for ring in rings for point in ring}
            assert height == pytest.approx(GROUND + over_ground, abs=DECIMETRE)
        data = {x.get("name"): float(x[0].text) for x in marks[name].iter(f"{SEEN}Data")}
        stated = feature["properties"]
        assert data == {key: stated[key] for key in data}
        assert {*data} == {"width_m", "min_over_ground_m", "max_over_ground_m"}
    assert [len(x["geometry"]["coordinates"]) for x in features] == [1, 2, 1]


@pytest.mark.soak
@pytest.mark.parametrize(("ending", "margin"), [(".geojson", 20.0), (".kml", 60.0)])
def test_the_contingency_volume_is_a_fence_with_its_hole(mission, written, ending, margin):
    """Heights, above the start, are in GeoJSON alone."""
    said = answer("mission", mission, "--plan", "--fence", written[ending])
    (nearest,) = said["fence"]["nearest"]

    assert nearest["leaves_m"] is None
    assert nearest["margin_m"] == pytest.approx(margin, abs=OUTSIDE)


def test_sizes_of_a_volume_are_rounded_outwards_to_decimetres():
    volume = Volume(12.34, -3.21, 45.67, "")

    assert volume.outwards[:3] == pytest.approx((12.4, -3.3, 45.7))
    assert volume.outwards.outwards == volume.outwards


@pytest.mark.parametrize("turns", [1.0, -1.0, 0.0])
def test_the_area_around_a_path_holds_every_place_within_its_width(turns):
    """The places lie outside of circles of 60 m, and around both ends of the path or of a leg."""
    ability = ABILITY | {"V_a": 15.0, "wind": 0.0, "phi": 0.7, "phi_rate": 1.0}
    circles = Waypoint(north=300.0, east=0.0, turns=turns, radius=60.0 if turns else None)
    path = plan([Waypoint(north=0.0, east=0.0), circles], ability)
    width, around = 40.0 if turns == 0.0 else 4.0, np.linspace(0.0, 2.0 * np.pi, 2000)
    s = np.linspace(0.0, path.length, 3000)

    outer, *inner = rings_around(path, width)

    ends = path.beside(np.array([0.0, path.length]))[:, None, :2]
    rings = (ends + width * np.stack([np.cos(around), np.sin(around)], axis=1)).reshape(-1, 2)
    sides = [path.beside(s, side * width)[:, :2] for side in (-1.0, 1.0)]
    area = shapely.Polygon(outer, inner)
    assert shapely.covers(area, shapely.points(np.concatenate([rings, *sides]))).all()
    # a chord of 10 m is 10^2 / (8 * 60) m from the circle
    assert area.area < shapely.LineString(path.beside(s)[:, :2]).buffer(width + 0.25).area
