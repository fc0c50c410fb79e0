"""Heights over a terrain that a raster file has."""

import math

import numpy as np
import pytest
from commands import answer, flighttune
from geographiclib.geodesic import Geodesic
from plans import HOME, PATROL, SLOPE, ground, plan_file, terrain, waypoint

import flighttune as ft
from flighttune.errors import InfeasibleError
from flighttune.references.maps import ground_at

pytest.importorskip("rasterio")


def test_a_planned_path_has_its_lowest_place_over_the_ground(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL)
    said = answer("mission", file, "--plan", "--terrain", terrain(tmp_path / "t.tif"))
    lowest = said["terrain"]["path"]

    # A level leg at 540 m towards 47.41, from whose end the ground falls: the turn is cut.
    radius = 6371e3 * math.pi / 180.0
    assert lowest["ground_m"] == pytest.approx(ground(lowest["lat_deg"]), abs=1e-6)
    assert 10.0 < lowest["over_ground_m"] < 10.0 + SLOPE * 250.0 / radius
    assert said["notes"][0].startswith("The planned path comes down to ")
    assert lowest["stretch"] in said["notes"][0]


def test_without_a_terrain_the_answer_says_that_none_was_looked_at(tmp_path):
    said = answer("mission", plan_file(tmp_path / "m.plan", *PATROL), "--plan")

    assert "terrain" not in said
    assert "Terrain was not looked at: `--terrain FILE` does." in said["notes"]


def test_heights_above_terrain_are_flown_over_it(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL[:2], waypoint(47.405, 8.52, 60, frame=10))
    planned = ft.route(file, terrain=terrain(tmp_path / "t.tif"))

    up = [point.up_m for point in planned.scenario.route.waypoint]
    assert up == pytest.approx([0.0, 0.0, ground(47.405) - HOME[2]], abs=1e-6)
    assert not any("unknown" in note for note in planned.scenario.notes)


def test_a_path_below_the_ground_is_a_no(tmp_path):
    low = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 60), waypoint(47.42, 8.5, 60))
    words = "mission", low, "--plan", "--terrain", terrain(tmp_path / "t.tif")
    stdout, _ = flighttune(*words, status=1)

    assert "The planned path is 40.0 m below the ground on the leg to item 2" in stdout
    with pytest.raises(InfeasibleError, match=r"40\.0 m below the ground"):
        ft.mission(low, terrain=words[-1])


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        ({"crs": None}, "must have a coordinate system .* got no such system"),
        ({"units": "US survey foot"}, "must have .* heights in m, got US survey foot"),
        ({"count": 3}, "must have .* one band of heights .* got 3 bands"),
        ({"crs": "EPSG:32732"}, "must have the height of"),
        ({"lost": 25}, "must have the height of"),
        ({"lost": 25, "nodata": None}, "must have the height of"),
    ],
)
def test_a_raster_that_does_not_say_enough_is_refused(tmp_path, made, reason):
    file = plan_file(tmp_path / "m.plan", *PATROL)

    with pytest.raises(ft.InputError, match=rf"t\.tif: {reason}"):
        ft.route(
            plan_file(file, *PATROL[:2], waypoint(47.405, 8.52, 60, frame=10)),
            terrain=terrain(tmp_path / "t.tif", **made),
        )


def test_a_tile_of_another_name_or_size_is_refused_with_what_it_must_be(tmp_path):
    pytest.importorskip("rasterio")
    for name, size in (("n.hgt", 2 * 1201**2), ("N47E008.hgt", 1000)):
        file = tmp_path / name
        file.write_bytes(bytes(size))
        with pytest.raises(ft.InputError, match=rf"{name}: .* N47E008\.hgt, .* 1201 or"):
            ground_at(file, np.array([[47.5, 8.5]]))


def test_a_place_that_the_projection_of_the_raster_lacks_is_refused(tmp_path):
    file = terrain(tmp_path / "t.tif", crs="EPSG:32632")

    with pytest.raises(ft.InputError, match=r"t\.tif: .* heights there"):
        ground_at(file, np.array([[0.0, 98.5]]))


def test_the_ground_is_that_of_a_plane_between_posts_on_a_grid_of_another_projection(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    # 48 N on the central meridian of zone 32: 500000 east, 0.9996 of the meridian's arc north.
    east, north, step = 500_000.0, 5_316_300.0, 25.0
    rows, columns = np.mgrid[:40, :60] + 0.5
    heights = -3.0 + 0.2 * (columns * step - 700.0) + 0.7 * (450.0 - rows * step)
    made = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    made["transform"] = rasterio.Affine(step, 0.0, east - 700.0, 0.0, -step, north + 450.0)
    with rasterio.open(tmp_path / "t.tif", "w", height=40, width=60, **made) as file:
        file.write(heights, 1)
    arc = Geodesic.WGS84.Inverse(0.0, 9.0, 48.0, 9.0)["s12"]
    up = 0.9996 * arc - north

    level, above = ground_at(tmp_path / "t.tif", np.array([[48.0, 9.0], [48.0, 9.002]]))

    assert level == pytest.approx(-3.0 + 0.7 * up, abs=1e-3)
    aside = Geodesic.WGS84.Inverse(48.0, 9.0, 48.0, 9.002)["s12"]
    assert above - level == pytest.approx(0.2 * 0.9996 * aside, abs=0.1)


def test_a_place_outside_of_the_raster_is_named(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL[:3], waypoint(47.4, 8.6, 60))
    words = "mission", file, "--plan", "--terrain", terrain(tmp_path / "t.tif")

    assert ", 8.5395" in flighttune(*words, status=2)[1]
