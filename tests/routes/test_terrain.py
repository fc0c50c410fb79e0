"""Heights over a terrain that a raster file has."""

import math
import re
import socket
import struct
from contextlib import suppress

import numpy as np
import pytest
from commands import answer, flighttune
from fuzzing import refused_apart
from geographiclib.geodesic import Geodesic
from plans import HOME, PATROL, SLOPE, ground, plan_file, terrain, waypoint
from scipy.ndimage import map_coordinates

import flighttune as ft

rasterio = pytest.importorskip("rasterio")


def heights(file, *places):
    """Heights of the ground at places, by a plan of waypoints 60 m above it and a low home."""
    plan = file.with_name("over.plan")
    items = [waypoint(*place, 60, frame=10) for place in places]
    plan_file(plan, *items, home=(47.4, 8.5, -400.0))
    made = ft.route(plan, terrain=file, changes={"route.gamma_deg": [-60.0, 60.0]}).scenario
    return [made.flight.h_m + point.up_m - 60.0 for point in made.route.waypoint]


HERE = (47.4, 8.5), (47.41, 8.51)


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
    file = tmp_path / name
    file.write_bytes(bytes(size))

    with pytest.raises(ft.InputError, match=rf"{name}: .* N47E008\.hgt, .* 1201 or"):
        heights(file, (47.5, 8.5), (47.6, 8.5))


def test_a_place_that_the_projection_of_the_raster_lacks_is_refused(tmp_path):
    file = terrain(tmp_path / "t.tif", crs="EPSG:32632")

    with pytest.raises(ft.InputError, match=r"t\.tif: .* heights there"):
        heights(file, (0.0, 98.5), (0.0, 98.6))


def test_the_ground_is_that_of_a_plane_between_posts_on_a_grid_of_another_projection(tmp_path):
    # 48 N on the central meridian of zone 32: 500000 east, 0.9996 of the meridian's arc north.
    east, north, step = 500_000.0, 5_316_300.0, 25.0
    rows, columns = np.mgrid[:40, :60] + 0.5
    plane = -3.0 + 0.2 * (columns * step - 700.0) + 0.7 * (450.0 - rows * step)
    made = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    made["transform"] = rasterio.Affine(step, 0.0, east - 700.0, 0.0, -step, north + 450.0)
    with rasterio.open(tmp_path / "t.tif", "w", height=40, width=60, **made) as file:
        file.write(plane, 1)
    arc = Geodesic.WGS84.Inverse(0.0, 9.0, 48.0, 9.0)["s12"]
    up = 0.9996 * arc - north

    level, above = heights(tmp_path / "t.tif", (48.0, 9.0), (48.0, 9.002))

    assert level == pytest.approx(-3.0 + 0.7 * up, abs=1e-3)
    aside = Geodesic.WGS84.Inverse(48.0, 9.0, 48.0, 9.002)["s12"]
    assert above - level == pytest.approx(0.2 * 0.9996 * aside, abs=0.1)


def test_posts_that_are_stored_in_other_steps_have_their_heights(tmp_path):
    """GDAL: a height is the number that is stored times the scale, plus the offset."""
    file = terrain(tmp_path / "t.tif")
    with rasterio.open(file, "r+") as data:
        data.scales, data.offsets = (0.5,), (150.0,)

    stored = np.array([ground(lat) for lat, _ in HERE])
    assert heights(file, *HERE) == pytest.approx(0.5 * stored + 150.0, abs=1e-6)


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


def rough(path, **made):
    """A raster without a plane in it, and places all along it from north-west to south-east."""
    draw = np.random.default_rng(0)
    stored = draw.integers(0, 300, POSTS).astype("int16")
    made = {"driver": "GTiff", "count": 1, "dtype": "int16", "crs": "EPSG:4326", **made}
    made |= {"nodata": -32768, "height": POSTS[0], "width": POSTS[1]}
    made.setdefault("transform", rasterio.Affine(1e-3, 0.0, 8.0, 0.0, -1e-3, 47.0))
    with rasterio.open(path, "w", **made) as file:
        file.write(stored, 1)
    at = np.linspace(1.0, np.array(POSTS) - 2.0, 24) + draw.uniform(-1.0, 1.0, (24, 2))
    at[[9, 10]] = [511, 511], [512.3, 511.4]
    a, b, c, d, e, f, *_ = made["transform"]
    row, column = 0.5 + at.T
    x, y = a * column + b * row + c, d * column + e * row + f
    return stored, at, [*zip(y.tolist(), x.tolist(), strict=True)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_heights_read_in_parts_are_those_of_the_whole_raster(tmp_path, layout):
    stored, at, places = rough(tmp_path / "t.tif", **LAYOUTS[layout])
    order = np.delete(np.arange(24), 10)  # a place 140 m from the one before

    found = heights(tmp_path / "t.tif", *(places[i] for i in order))

    expected = map_coordinates(stored.astype(float), at.T, order=1, mode="nearest")
    assert found == pytest.approx(expected[order], abs=1e-6)
    near = heights(tmp_path / "t.tif", places[10], places[23])
    assert near == pytest.approx(expected[[10, 23]], abs=1e-6)


@pytest.mark.parametrize("side", range(4))
def test_a_raster_ends_at_the_centres_of_its_outer_posts(tmp_path, side):
    """A little within there is the height of the post, a little without there is none."""
    stored, _, _ = rough(tmp_path / "t.tif")
    row, column = [(0, 700), (700, 0), (POSTS[0] - 1, 700), (700, POSTS[1] - 1)][side]
    inwards = [(1, 0), (0, 1), (-1, 0), (0, -1)][side]

    def at(by):
        return 47.0 - 1e-3 * (row + 0.5 + by * inwards[0]), 8.0 + 1e-3 * (
            column + 0.5 + by * inwards[1]
        )

    found, _ = heights(tmp_path / "t.tif", at(1e-6), at(90.0))
    assert found == pytest.approx(stored[row, column], abs=1e-3)
    with pytest.raises(ft.InputError, match="must have the height of the ground"):
        heights(tmp_path / "t.tif", at(-1e-6), at(90.0))


@pytest.mark.parametrize(("height", "there"), [(-499.9, True), (-500.1, False), (9000.1, False)])
def test_a_post_lower_or_higher_than_any_land_has_no_height(tmp_path, height, there):
    file = terrain(tmp_path / "t.tif", lost=slice(None), value=height)
    if not there:
        with pytest.raises(ft.InputError, match="must have the height of the ground"):
            heights(file, *HERE)
        return
    with pytest.raises(ft.InputError, match="`ground_m`"):  # below home
        heights(file, *HERE)


def test_a_turned_raster_has_its_heights_where_they_are(tmp_path):
    c, s = 1e-3 * math.cos(0.5), 1e-3 * math.sin(0.5)
    turned = rasterio.Affine(c, s, 8.0, s, -c, 47.0)
    stored, _, places = rough(tmp_path / "t.tif", transform=turned)

    found = heights(tmp_path / "t.tif", places[9], places[23])

    assert found[0] == pytest.approx(stored[511, 511], abs=1e-3)


def test_a_raster_of_900_million_posts_is_read_beside_the_places_alone(tmp_path):
    made = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    made |= {"tiled": True, "compress": "deflate", "SPARSE_OK": True, "nodata": -9999.0}
    made |= {"transform": rasterio.Affine(1e-5, 0.0, 8.0, 0.0, -1e-5, 47.3)}
    with rasterio.open(tmp_path / "t.tif", "w", height=30000, width=30000, **made) as file:
        for k in range(0, 29000, 512):
            window = rasterio.windows.Window(k, k, 512, 512)
            file.write(np.full((512, 512), 700.0, "f4"), 1, window=window)
    places = [(47.3 - along, 8.0 + along) for along in np.linspace(1e-3, 0.28, 50).tolist()]

    def read():
        raise ft.InputError(f"{np.round(heights(tmp_path / 't.tif', *places), 6).tolist()}")

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
        heights(tmp_path / name, (47.0, 8.0), (47.01, 8.0))
    assert not connected()


def test_a_raster_that_names_another_file_is_refused(tmp_path, address):
    port, connected = address
    file = terrain(tmp_path / "t.tif", crs=rasterio.crs.CRS.from_proj4(GRID))
    with pytest.raises(ft.InputError, match=r"t\.tif: must have all its heights in the file"):
        heights(file, *HERE)

    file = terrain(tmp_path / "u.tif")
    with rasterio.open(file, "r+") as data:
        data.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=str(tmp_path / "gone.tif"))
    with pytest.raises(ft.InputError, match=r"u\.tif: must have all its heights in the file"):
        heights(file, *HERE)
    assert not connected()
    assert port


def test_files_beside_a_raster_change_nothing(tmp_path):
    file = terrain(tmp_path / "t.tif")
    expected = heights(file, *HERE)

    (tmp_path / "t.tif.aux.xml").write_text(
        '<PAMDataset><GeoTransform>8.4,0.001,0,47.5,0,-0.001</GeoTransform><PAMRasterBand band="1">'
        "<Scale>2</Scale></PAMRasterBand></PAMDataset>"
    )
    terrain(tmp_path / "none.tif", dtype="uint8", nodata=None, lost=slice(None))
    with rasterio.open(tmp_path / "none.tif", "r+") as mask:
        mask.update_tags(INTERNAL_MASK_FLAGS_1="2")
    (tmp_path / "none.tif").rename(tmp_path / "t.tif.msk")

    assert heights(file, *HERE) == expected


def huge_block(path, mask=False):
    """A raster of one block of 400 MB, which a few bytes stand for, or with such a mask."""
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

    said, grown = refused_apart(lambda: heights(file, (47.299, 8.001), (47.2985, 8.0015)))

    assert re.search(r"t\.tif: must have blocks of at most 64000000 bytes, got 400000000", said)
    assert grown < 100_000_000


@pytest.mark.parametrize("flat", [(0.0, 0.0), (1e-3, 0.0), (math.nan, 1.0), (math.inf, 1.0)])
def test_a_raster_whose_posts_have_no_place_is_refused(tmp_path, flat):
    file = terrain(tmp_path / "t.tif")
    with rasterio.open(file, "r+") as data:
        data.transform = rasterio.Affine(flat[0], 0.0, 7.9, 0.0, flat[1], 47.1)

    with pytest.raises(ft.InputError, match=r"t\.tif: must .*(transform|height of the ground)"):
        heights(file, *HERE)


def test_a_tag_that_is_no_text_is_refused_in_one_line(tmp_path):
    file = terrain(tmp_path / "t.tif", units="metre")
    file.write_bytes(file.read_bytes().replace(b"metre", b"me\xff\xfee"))

    with pytest.raises(ft.InputError, match=r"t\.tif: must be a raster .* got .*decode"):
        heights(file, *HERE)


def test_a_corridor_is_lowest_over_the_ground_at_its_lower_corner_uphill(band, band_file, tmp_path):
    """On a plane that rises to the east; the leg goes north, and the corridor is below 1000 m."""
    east = 8.49 + 1e-3 * (np.arange(60) + 0.5)
    made = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": "EPSG:4326"}
    made["transform"] = rasterio.Affine(1e-3, 0.0, 8.49, 0.0, -1e-3, 47.43)
    with rasterio.open(tmp_path / "t.tif", "w", height=50, width=60, **made) as file:
        file.write(np.tile(700.0 + 20_000.0 * (east - 8.5), (50, 1)), 1)

    found = answer("mission", band_file, "--plan", "--terrain", tmp_path / "t.tif")["terrain"]

    lowest, corridor = found["corridor"], band.corridor()
    rise = 20_000.0 * 0.001 / Geodesic.WGS84.Inverse(47.4, 8.5, 47.4, 8.501)["s12"]
    over = 300.0 - corridor.high[:, 1] - rise * corridor.high[:, 0]
    along = np.searchsorted(corridor.windows[:, 1], np.append(np.arange(0.0, 150.0, 5.0), 150.0))
    assert lowest["over_ground_m"] == pytest.approx(over[along.clip(max=149)].min(), abs=1e-3)
    assert lowest["ground_m"] == pytest.approx(700.0 + 20_000.0 * (lowest["lon_deg"] - 8.5))
    assert found["path"]["over_ground_m"] == pytest.approx(300.0, abs=1e-6)
