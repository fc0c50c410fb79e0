"""Maps of routes: GeoJSON and KML."""

import json
import math
from xml.etree import ElementTree

import pytest
from commands import answer, flighttune
from places import SHIPPED_SCENARIOS
from plans import PATROL, plan_file

from flighttune.references.maps import north_east

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


def test_a_route_that_no_flight_ends_in_time_is_refused_before_its_table(tmp_path, monkeypatch):
    """The last point has latitude and longitude swapped; flights of a file end after 10 000 s."""
    monkeypatch.setattr("flighttune.references.path._path", None)
    line = tmp_path / "far.geojson"
    swapped = '{"type": "LineString", "coordinates": [[8.5, 47.3], [8.51, 47.3], [47.31, 8.5]]}'
    line.write_text(swapped)
    _, said = flighttune("mission", "--plan", line, status=2)

    assert f"{line}: `waypoints`: point 3 must be reached within `duration_s`, 10000 s" in said
    assert "at 33.3 m/s" in said


@pytest.fixture
def maps(tmp_path):
    """What is printed of a plan, the points of its KML, and the line of its GeoJSON."""
    file = plan_file(tmp_path / "m.plan", *PATROL)
    kml, geojson = tmp_path / "m.kml", tmp_path / "m.geojson"
    printed, _ = flighttune("mission", "--plan", file, "--out", kml)
    flighttune("mission", "--plan", file, "--out", geojson)
    line = json.loads(geojson.read_text())["features"][0]["geometry"]
    return printed, kml_points(kml), line


def test_route_prints_the_stretches_and_writes_what_maps_read(maps):
    printed, points, line = maps

    assert "loiter" in printed
    assert "180" in printed
    assert [list(point) for point in points] == line["coordinates"]
    assert points[0][:2] == (8.5, 47.4)
    assert points[-1][:2] == pytest.approx((8.52, 47.4), abs=1e-5)
    beside = [math.hypot(*north_east((lat, lon), (47.41, 8.52))) for lon, lat, _ in points]
    assert min(beside) == pytest.approx(180.0, abs=0.1)


def test_heights_on_a_map_are_those_of_the_plan_above_sea_level(maps, tmp_path):
    """The home position is at 480 m; the plan begins 60 m above it and ends at 570 m."""
    _, points, line = maps
    again = tmp_path / "again.kml"

    assert (points[0][2], points[-1][2]) == pytest.approx((540.0, 570.0), abs=CENTIMETRE)

    # What route writes it reads again at the same heights.
    line["coordinates"] = line["coordinates"][:2]
    (tmp_path / "leg.geojson").write_text(json.dumps(line))
    flighttune("mission", "--plan", tmp_path / "leg.geojson", "--out", again)
    assert kml_points(again)[0][2] == pytest.approx(540.0, abs=CENTIMETRE)


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
