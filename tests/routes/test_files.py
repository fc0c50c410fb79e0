"""Files of routes: plans of QGroundControl, GeoJSON and KML."""

import json
import math
from xml.etree import ElementTree

import pytest
from commands import flighttune

from flighttune.errors import InputError
from flighttune.routes.files import metres_per_degree, read_route

HOME = (47.4, 8.5, 480.0)


def item(command, *params, frame=3):
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def plan_file(path, *items):
    mission = {"plannedHomePosition": list(HOME), "items": list(items)}
    path.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
    return path


PLAN = (
    item(22, 15, 0, 0, None, 47.4, 8.5, 50),
    item(16, 0, 0, 0, None, 47.4, 8.5, 60),
    item(16, 0, 0, 0, None, 47.41, 8.5, 60),
    item(18, 2, 0, -180, 1, 47.41, 8.52, 90),
    item(16, 0, 0, 0, None, 47.4, 8.52, 570, frame=0),
)


def test_a_plan_gives_its_waypoints_with_heights_above_the_first(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PLAN)

    with pytest.raises(InputError, match=r"item 1 .*22"):
        read_route(file)
    assert read_route(file, skip=True) == [
        {"lat_deg": 47.4, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.5, "up_m": 0.0},
        {"lat_deg": 47.41, "lon_deg": 8.52, "up_m": 30.0, "turns": -2.0, "radius_m": 180.0},
        {"lat_deg": 47.4, "lon_deg": 8.52, "up_m": 30.0},
    ]


def test_a_survey_is_the_items_that_it_consists_of(tmp_path):
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": list(PLAN[1:3])}}

    assert len(read_route(plan_file(tmp_path / "m.plan", survey, PLAN[3]))) == 3


@pytest.mark.parametrize(
    "text", ["{}", "[]", '{"mission": {}}', '{"mission": {"items": [{}]}}', '{"type": "Feature"}']
)
def test_another_file_is_refused(tmp_path, text):
    file = tmp_path / "m.json"
    file.write_text(text)

    with pytest.raises(InputError, match=r"m\.json"):
        read_route(file)


def test_a_degree_is_as_long_as_on_the_ellipsoid():
    """Lengths at 0, 45 and 60 deg from the tables of WGS 84 (NIMA TR8350.2)."""
    assert metres_per_degree(0.0) == pytest.approx((110_574.3, 111_319.5), abs=0.1)
    assert metres_per_degree(45.0) == pytest.approx((111_132.0, 78_846.8), abs=0.3)
    assert metres_per_degree(60.0) == pytest.approx((111_412.2, 55_800.0), abs=0.3)


def test_route_prints_the_stretches_and_writes_what_maps_read(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PLAN)
    kml, geojson = tmp_path / "m.kml", tmp_path / "m.geojson"
    printed, _ = flighttune("route", file, "--skip", "--out", kml)
    flighttune("route", file, "--skip", "--out", geojson)

    assert "loiter" in printed
    assert "180" in printed
    line = json.loads(geojson.read_text())["features"][0]["geometry"]
    text = ElementTree.parse(kml).findtext(".//{http://www.opengis.net/kml/2.2}coordinates")
    points = [tuple(map(float, point.split(","))) for point in text.split()]
    assert [list(point) for point in points] == line["coordinates"]
    assert points[0][:2] == (8.5, 47.4)
    assert points[-1][:2] == pytest.approx((8.52, 47.4), abs=1e-5)
    per_lat, per_lon = metres_per_degree(47.4)
    circling = min(points, key=lambda point: point[0] - 0 * point[1])
    assert circling[0] <= 8.5 + 1e-9
    beside = [math.hypot((lat - 47.41) * per_lat, (lon - 8.52) * per_lon) for lon, lat, _ in points]
    assert min(beside) == pytest.approx(180.0, abs=0.1)
