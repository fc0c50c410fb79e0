"""Heights over a terrain that a raster file has."""

import math
import re
import socket
import struct
from contextlib import suppress

import numpy as np
import pytest
from commands import answer, flighttune
from fuzzing import refused_apart, slow
from geographiclib.geodesic import Geodesic
from plans import HOME, PATROL, SLOPE, ground, plan_file, terrain, waypoint
from scipy.ndimage import map_coordinates

import flighttune as ft
from flighttune.routes import maps
from flighttune.routes.raster import ground_heights

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


@pytest.mark.soak
def test_a_path_below_the_ground_is_a_no(tmp_path):
    low = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 60), waypoint(47.42, 8.5, 60))
    words = "mission", low, "--plan", "--terrain", terrain(tmp_path / "t.tif")
    stdout, _ = flighttune(*words, status=1)

    first = stdout.splitlines()[0]
    assert first.startswith("No: the planned path is 40.0 m below the ground on the leg to item 2")
    assert "can be flown" not in stdout
    said = answer(*words, status=1)
    assert said["summary"][0] == said["verdict"]
    assert said["verdict"].startswith("No: the planned path is 40.0 m below the ground")
    with pytest.raises(ft.FlightTuneError, match=r"40\.0 m below the ground"):
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


@pytest.mark.parametrize(("name", "size"), [("n.hgt", 2 * 1201**2), ("N47E008.hgt", 1000)])
def test_a_tile_of_another_name_or_size_is_refused_with_what_it_must_be(tmp_path, name, size):
    pytest.importorskip("rasterio")
    file = tmp_path / name
    file.write_bytes(bytes(size))

    with pytest.raises(ft.InputError, match=rf"{name}: .* N47E008\.hgt, .* 1201 or"):
        maps.ground_at(file, np.array([[47.5, 8.5]]))


def test_a_place_that_the_projection_of_the_raster_lacks_is_refused(tmp_path):
    file = terrain(tmp_path / "t.tif", crs="EPSG:32632")

    with pytest.raises(ft.InputError, match=r"t\.tif: .* heights there"):
        maps.ground_at(file, np.array([[0.0, 98.5]]))


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

    level, above = maps.ground_at(tmp_path / "t.tif", np.array([[48.0, 9.0], [48.0, 9.002]]))

    assert level == pytest.approx(-3.0 + 0.7 * up, abs=1e-3)
    aside = Geodesic.WGS84.Inverse(48.0, 9.0, 48.0, 9.002)["s12"]
    assert above - level == pytest.approx(0.2 * 0.9996 * aside, abs=0.1)


def test_posts_that_are_stored_in_other_steps_have_their_heights(tmp_path):
    """GDAL: a height is the number that is stored times the scale, plus the offset."""
    rasterio = pytest.importorskip("rasterio")
    file, places = terrain(tmp_path / "t.tif"), np.array([[47.4, 8.5], [47.41, 8.51]])
    with rasterio.open(file, "r+") as data:
        data.scales, data.offsets = (0.5,), (150.0,)

    stored = [ground(lat) for lat, _ in places]
    assert ground_heights(file, places) == pytest.approx(0.5 * np.array(stored) + 150.0, abs=1e-6)


def test_a_place_outside_of_the_raster_is_named(tmp_path):
    file = plan_file(tmp_path / "m.plan", *PATROL[:3], waypoint(47.4, 8.6, 60))
    words = "mission", file, "--plan", "--terrain", terrain(tmp_path / "t.tif")

    assert ", 8.5395" in flighttune(*words, status=2)[1]


GRID = "+proj=longlat +ellps=bessel +nadgrids=/etc/passwd +no_defs"

POSTS = 1300, 1100  # more rows and columns than are read at once
LAYOUTS = {
    "strips": {},
    "one strip": {"blockysize": POSTS[0], "compress": "deflate"},
    "tiles": {"tiled": True, "blockxsize": 256, "blockysize": 128, "compress": "lzw"},
}


def rough(path, seed=0, **made):
    """A raster without a plane in it, posts of which are lost, and places all over it."""
    rasterio = pytest.importorskip("rasterio")
    draw = np.random.default_rng(seed)
    heights = draw.integers(0, 3000, POSTS).astype("int16")
    heights[draw.random(POSTS) < 1e-5] = -32768
    made = {"driver": "GTiff", "count": 1, "dtype": "int16", "crs": "EPSG:4326", **made}
    made |= {"nodata": -32768, "height": POSTS[0], "width": POSTS[1]}
    made.setdefault("transform", rasterio.Affine(1e-3, 0.0, 8.0, 0.0, -1e-3, 47.0))
    with rasterio.open(path, "w", **made) as file:
        file.write(heights, 1)
    at = draw.uniform(0.0, np.array(POSTS)[:, None] - 1.0, (2, 3000))
    at[:, :8] = [[0, 0, POSTS[0] - 1] * 2 + [511, 512], [0, POSTS[1] - 1] * 3 + [511, 512]]
    a, b, c, d, e, f, *_ = made["transform"]
    x, y = a * (at[1] + 0.5) + b * (at[0] + 0.5) + c, d * (at[1] + 0.5) + e * (at[0] + 0.5) + f
    return heights, made["transform"], np.column_stack([y, x])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_heights_read_in_parts_are_those_of_the_whole_raster_to_the_bit(tmp_path, layout):
    heights, transform, places = rough(tmp_path / "t.tif", **LAYOUTS[layout])
    whole = np.where(heights == -32768, np.nan, heights)
    at = (np.reshape(~transform, (3, 3)) @ [*places.T[::-1], np.ones(len(places))])[1::-1] - 0.5
    at = at.clip(0.0, np.array(POSTS)[:, None] - 1.0)
    expected = map_coordinates(whole, at, order=1, mode="nearest")

    there = ((at > 1e-6) & (at < np.array(POSTS)[:, None] - 1.0 - 1e-6)).all(axis=0)
    found = ground_heights(tmp_path / "t.tif", places)

    assert there.sum() > 2900
    assert np.array_equal(found[there], expected[there], equal_nan=True)


def test_a_turned_raster_has_its_heights_where_they_are(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    c, s = 1e-3 * math.cos(0.5), 1e-3 * math.sin(0.5)
    turned = rasterio.Affine(c, s, 8.0, s, -c, 47.0)
    heights, _, places = rough(tmp_path / "t.tif", transform=turned)

    found = ground_heights(tmp_path / "t.tif", places[6:8])

    assert found == pytest.approx([heights[511, 511], heights[512, 512]], abs=1e-3)


def test_a_raster_of_900_million_posts_is_read_beside_the_places_alone(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    made = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    made |= {"tiled": True, "compress": "deflate", "SPARSE_OK": True, "nodata": -9999.0}
    made |= {"transform": rasterio.Affine(1e-5, 0.0, 8.0, 0.0, -1e-5, 47.3)}
    with rasterio.open(tmp_path / "t.tif", "w", height=30000, width=30000, **made) as file:
        for k in range(0, 29000, 512):
            window = rasterio.windows.Window(k, k, 512, 512)
            file.write(np.full((512, 512), 700.0, "f4"), 1, window=window)
    along = np.linspace(1e-3, 0.28, 50)
    places = np.column_stack([47.3 - along, 8.0 + along])

    def read():
        raise ft.InputError(f"{maps.ground_at(tmp_path / 't.tif', places).round(6).tolist()}")

    said, grown = refused_apart(read)

    assert said == f"{[700.0] * 50}"
    assert grown < 150_000_000  # all posts have 3.6 GB


VRT = """<VRTDataset rasterXSize="40" rasterYSize="40"><SRS>EPSG:4326</SRS>
<GeoTransform>7.9,0.01,0,47.1,0,-0.01</GeoTransform><VRTRasterBand dataType="Byte" band="1"
subClass="VRTRawRasterBand"><SourceFilename relativetoVRT="1">secret.txt</SourceFilename>
<ImageOffset>0</ImageOffset><PixelOffset>1</PixelOffset><LineOffset>10</LineOffset></VRTRasterBand>
</VRTDataset>"""
WMS = """<GDAL_WMS><Service name="TMS"><ServerUrl>http://127.0.0.1:{port}/${{z}}/${{x}}/${{y}}
</ServerUrl></Service><DataWindow><UpperLeftX>7</UpperLeftX><UpperLeftY>48</UpperLeftY><LowerRightX>9
</LowerRightX><LowerRightY>46</LowerRightY><SizeX>40</SizeX><SizeY>40</SizeY></DataWindow>
<Projection>EPSG:4326</Projection><BandsCount>1</BandsCount></GDAL_WMS>"""
REMOTE = """<VRTDataset rasterXSize="40" rasterYSize="40"><SRS>EPSG:4326</SRS><GeoTransform>
7.9,0.01,0,47.1,0,-0.01</GeoTransform><VRTRasterBand dataType="Float32" band="1"><SimpleSource>
<SourceFilename relativeToVRT="0">/vsicurl/http://127.0.0.1:{port}/x.tif</SourceFilename>
<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"""


@pytest.fixture
def address():
    """A listening port, and whether anybody has connected to it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)

        def connected():
            with suppress(BlockingIOError):
                server.accept()[0].close()
                return True
            return False

        yield server.getsockname()[1], connected


@pytest.mark.parametrize("name", ["t.tif", "N47E008.hgt", "t.vrt", "t.xml"])
@pytest.mark.parametrize("text", [VRT, WMS, REMOTE], ids=["file", "service", "address"])
def test_a_raster_of_another_format_opens_no_connection_and_no_file(tmp_path, address, name, text):
    port, connected = address
    (tmp_path / "secret.txt").write_text("abcdefghij" * 200)
    (tmp_path / name).write_text(text.format(port=port))

    with pytest.raises(ft.InputError, match=rf"{name}: must be a raster \(GeoTIFF or \.hgt\)"):
        maps.ground_at(tmp_path / name, np.array([[47.0, 8.0]]))
    assert not connected()


def test_a_raster_that_names_another_file_is_refused(tmp_path, address):
    rasterio = pytest.importorskip("rasterio")
    port, connected = address
    file = terrain(tmp_path / "t.tif", crs=rasterio.crs.CRS.from_proj4(GRID))
    with pytest.raises(ft.InputError, match=r"t\.tif: must have all its heights in the file"):
        maps.ground_at(file, np.array([[47.4, 8.5]]))

    file = terrain(tmp_path / "u.tif")
    with rasterio.open(file, "r+") as data:
        data.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=str(tmp_path / "gone.tif"))
    with pytest.raises(ft.InputError, match=r"u\.tif: must have all its heights in the file"):
        maps.ground_at(file, np.array([[47.4, 8.5]]))
    assert not connected()
    assert port


def test_files_beside_a_raster_change_nothing(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    file = terrain(tmp_path / "t.tif")
    expected = maps.ground_at(file, np.array([[47.4, 8.5]]))

    (tmp_path / "t.tif.aux.xml").write_text(
        '<PAMDataset><GeoTransform>8.4,0.001,0,47.5,0,-0.001</GeoTransform><PAMRasterBand band="1">'
        "<Scale>2</Scale></PAMRasterBand></PAMDataset>"
    )
    terrain(tmp_path / "none.tif", dtype="uint8", nodata=None, lost=slice(None))
    with rasterio.open(tmp_path / "none.tif", "r+") as mask:
        mask.update_tags(INTERNAL_MASK_FLAGS_1="2")
    (tmp_path / "none.tif").rename(tmp_path / "t.tif.msk")

    assert maps.ground_at(file, np.array([[47.4, 8.5]])) == expected


def huge_block(path, mask=False):
    """A raster of one block of 400 MB, which a few bytes stand for, or with such a mask."""
    rasterio = pytest.importorskip("rasterio")
    made = {"driver": "GTiff", "count": 1, "dtype": "uint8", "crs": "EPSG:4326", "tiled": True}
    made |= {"transform": rasterio.Affine(1e-5, 0.0, 8.0, 0.0, -1e-5, 47.3), "SPARSE_OK": True}
    side = 256 if mask else 20_000
    with (
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
        rasterio.open(
            path, "w", height=300, width=300, blockxsize=side, blockysize=side, **made
        ) as file,
    ):
        if mask:
            file.write_mask(np.ones((300, 300), "u1"))
    if mask:
        data = bytearray(path.read_bytes())
        (first,) = struct.unpack_from("<I", data, 4)
        (second,) = struct.unpack_from("<I", data, first + 2 + 12 * count_at(data, first))
        for entry in range(second + 2, second + 2 + 12 * count_at(data, second), 12):
            if struct.unpack_from("<H", data, entry)[0] in (322, 323):  # width, height of a tile
                struct.pack_into("<HII", data, entry + 2, 4, 1, 20_000)
        path.write_bytes(data)
    return path


def count_at(data, place):
    return struct.unpack_from("<H", data, place)[0]


@pytest.mark.parametrize("mask", [False, True])
def test_a_block_that_unpacks_to_much_is_refused_unread(tmp_path, mask):
    file = huge_block(tmp_path / "t.tif", mask)

    said, grown = refused_apart(lambda: maps.ground_at(file, np.array([[47.299, 8.001]])))

    assert re.search(r"t\.tif: must have blocks of at most 64000000 bytes, got 400000000", said)
    assert grown < 100_000_000


@pytest.mark.parametrize("flat", [(0.0, 0.0), (1e-3, 0.0), (math.nan, 1.0), (math.inf, 1.0)])
def test_a_raster_whose_posts_have_no_place_is_refused(tmp_path, flat):
    rasterio = pytest.importorskip("rasterio")
    file = terrain(tmp_path / "t.tif")
    with rasterio.open(file, "r+") as data:
        data.transform = rasterio.Affine(flat[0], 0.0, 7.9, 0.0, flat[1], 47.1)

    with pytest.raises(ft.InputError, match=r"t\.tif: must .*(transform|height of the ground)"):
        maps.ground_at(file, np.array([[47.4, 8.5]]))


def test_a_tag_that_is_no_text_is_refused_in_one_line(tmp_path):
    file = terrain(tmp_path / "t.tif", units="metre")
    file.write_bytes(file.read_bytes().replace(b"metre", b"me\xff\xfee"))

    with pytest.raises(ft.InputError, match=r"t\.tif: must be a raster .* got .*decode"):
        maps.ground_at(file, np.array([[47.4, 8.5]]))


@pytest.mark.soak
@pytest.mark.parametrize("to_the_right", [*slow(False), True])
def test_a_corridor_is_lowest_over_the_ground_at_its_side_that_is_uphill(tmp_path, to_the_right):
    """East or west on a plane that rises to the north: an edge of its lower side."""
    legs = [waypoint(47.4, 8.5, 60), waypoint(47.4, 8.52, 60)]
    file = plan_file(tmp_path / "m.plan", *(reversed(legs) if to_the_right else legs))
    planned = ft.route(file)
    left, right = (-20.0, 300.0) if to_the_right else (-300.0, 20.0)
    window = np.array([[0.0, planned.where[0].length]])
    corridor = maps.Corridor(window, np.array([[left, -5.0]]), np.array([[right, 15.0]]), "")

    found = maps.clearance(terrain(tmp_path / "t.tif"), planned.where, corridor)

    uphill = SLOPE * 300.0 / (6371e3 * math.pi / 180.0)
    assert found["over_ground_m"] == pytest.approx(60.0 - 15.0 - uphill, abs=0.2)
