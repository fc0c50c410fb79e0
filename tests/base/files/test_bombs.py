"""A file that is small or simple takes no more memory than its format may, whoever made it."""

import io
import struct
import sys
import zipfile
from functools import partial
from hashlib import sha256

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from forging import sealed
from fuzzing import refused_apart
from readers import (
    kept_flights,
    read_description,
    read_fence,
    read_forecast,
    read_model,
    read_parameters,
    read_rates,
    read_route,
    read_terrain,
)

import flighttune as ft

MOST = 500e6
"""Memory that reading any file may take beside the program, bytes."""

MB = 1_000_000
BLANK = f"SHA-256={'0' * 64}"


def padded(text):
    data = text.encode()
    return struct.pack(">i", len(data)) + data + b"\0" * (-len(data) % 4)


def netcdf(winds=0, *, axis=1, dimensions=3, side=1000):
    """Winds that are windows over the same bytes, or a header of many dimensions."""
    unit = b"\0\0\0\x0c" + struct.pack(">i", 1) + padded("units") + b"\0\0\0\2"
    names = [*("time", "latitude", "longitude"), *(f"d{i}" for i in range(3, dimensions))]
    lengths = [axis, side, side, *[1] * (dimensions - 3)]
    sides = b"".join(padded(x) + struct.pack(">i", n) for x, n in zip(names, lengths, strict=True))

    def head(at):
        about = [(x, [i], "hours since 2026-11-29 00:00") for i, x in enumerate(names[:3])]
        about += [(f"{q}{i}", [0, 1, 2], "m s-1") for i in range(1, winds + 1) for q in "uv"]
        made = b"CDF\2" + struct.pack(">iii", 0, 10, dimensions) + sides + bytes(8)
        made += struct.pack(">ii", 11, len(about))
        for name, over, words in about:
            made += padded(name) + struct.pack(f">{len(over) + 1}i", len(over), *over)
            made += unit + padded(words) + struct.pack(">iiq", 1, MB, at)
        return made

    return head(len(head(0))) + b"\5" * (axis * side * side)


def zipped(members, packing=zipfile.ZIP_DEFLATED):
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", packing) as file:
        for name, data in members:
            file.writestr(name, data)
    return sink.getvalue()


def array(shape, kind, data=b""):
    sink = io.BytesIO()
    head = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(sink, head)
    return sink.getvalue() + data


def claim(kind):
    sink = io.BytesIO()
    np.lib.format.write_array(sink, np.array(f'{{"format": "flighttune {kind} 1"}}'))
    return sink.getvalue()


def parquet(table, **options):
    """A table as a recorded flight with the right hash."""
    sink = io.BytesIO()
    table = table.replace_schema_metadata({"flighttune.file": BLANK})
    pq.write_table(table, sink, compression="zstd", **options)
    return sealed(sink.getvalue())


def columns(number, rows):
    """Columns of one number again and again."""
    return parquet(pa.table({f"c{i}": pa.array(np.zeros(rows)) for i in range(number)}))


def torn_page():
    """A column whose page has no whole header."""
    data = parquet(pa.table({"x": np.zeros(50_000)}), use_dictionary=False)
    return sealed(data[:4] + b"\xff" * 20 + data[24:])


def raster(side):
    rasterio = pytest.importorskip("rasterio")
    options = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "float32"}
    options |= {"crs": "EPSG:4326", "compress": "deflate", "blockysize": side}
    options["transform"] = rasterio.transform.from_origin(8.0, 48.0, 1e-4, 1e-4)
    with rasterio.MemoryFile() as memory:
        with memory.open(**options) as file:
            file.write(np.zeros((1, side, side), np.float32))
        return memory.read()


def hashed(text):
    return f"{sha256(text.encode()).hexdigest()} {text}\n"


def nested(opens, closes, depth=100_000):
    return opens * depth + closes * depth


BOMBS = {
    "TOML of lists": ("x.toml", read_rates, lambda: f"flights = [{'[],' * 4 * MB}]"),
    "TOML of words": ("x.toml", ft.load_scenario, lambda: "a" * 15 * MB),
    "TOML of digits": ("x.toml", ft.load_scenario, lambda: f"seed = {'9' * MB}"),
    "JSON of objects": ("x.json", ft.load_gains, lambda: '{"K_P": [' + "{}," * 5 * MB + "0]}"),
    "JSON of texts": ("x.json", read_forecast, lambda: '{"hourly": [' + '"ab",' * 3 * MB + "0]}"),
    "JSON as large as it may be": (
        "x.json",
        read_forecast,
        lambda: '{"hourly": {"time": [' + "10.5," * 2 * MB + "0]}}",
    ),
    "JSON of as many objects as it may have": (
        "x.geojson",
        read_route,
        lambda: '{"type": [' + '{"a":""},' * MB + "0]}",
    ),
    "JSON in itself": ("x.geojson", read_route, lambda: nested('{"a":', "}") + "1"),
    "JSON of digits": ("x.geojson", read_route, lambda: '{"type": ' + "9" * 4000 + "}"),
    "plan of items": ("x.plan", read_route, lambda: '{"mission":{"items":[' + "{}," * 5 * MB),
    "CSV": ("x.csv", read_forecast, lambda: "latitude\n1\ntime\n" + "12," * 5 * MB),
    "CSV as large as it may be": (
        "x.csv",
        read_forecast,
        lambda: "latitude\n1\ntime\n" + "12345," * 2 * MB,
    ),
    "NetCDF of windows": ("x.nc", read_forecast, lambda: netcdf(120)),
    "NetCDF of an axis": ("x.nc", read_forecast, lambda: netcdf(2, axis=15 * MB, side=1)),
    "NetCDF of dimensions": ("x.nc", read_forecast, lambda: netcdf(dimensions=900_000, side=1)),
    "KML": ("x.kml", read_route, lambda: f"<kml>{'<Placemark/>' * MB}</kml>"),
    "KML of places": (
        "x.kml",
        read_route,
        lambda: f"<kml><LineString><coordinates>{'1,2 ' * 3 * MB}</coordinates></LineString></kml>",
    ),
    "KMZ": ("x.kmz", read_route, lambda: zipped([("x.kml", b" " * 300 * MB)])),
    "KMZ of bzip2": (
        "x.kmz",
        read_route,
        lambda: zipped([("x.kml", b" " * 80 * MB)], zipfile.ZIP_BZIP2),
    ),
    "KMZ of members": (
        "x.kmz",
        read_route,
        lambda: zipped(((f"{i}", b"") for i in range(100_000)), zipfile.ZIP_STORED),
    ),
    "waypoints": ("x.waypoints", read_route, lambda: "QGC WPL 110\n" + "12 " * 5 * MB),
    "fence": ("x.fen", read_fence, lambda: "1 2\n" * 3 * MB),
    "parameters": ("x.param", read_parameters, lambda: "A,1\n" * 3 * MB),
    "model": ("x-set.xml", read_description, lambda: f"<a>{'<a/>' * 9 * MB}</a>"),
    "model of an aircraft": ("aircraft.xml", read_model, lambda: f"<a>{'<a/>' * 9 * MB}</a>"),
    "model as large as it may be": (
        "x-set.xml",
        read_description,
        lambda: f"<a>{'<abcdefgh/>' * 500_000}</a>",
    ),
    "model in itself": ("x-set.xml", read_description, lambda: nested("<a>", "</a>")),
    "arrays": (
        "x.npz",
        ft.load,
        lambda: zipped([("claim.npy", claim("tube")), ("bounds.npy", bytes(300 * MB))]),
    ),
    "array of a shape": (
        "x.npz",
        ft.load,
        lambda: zipped([("claim.npy", claim("tube")), ("bounds.npy", array((10**9,), "<f8"))]),
    ),
    "arrays of members": (
        "x.npz",
        ft.load,
        lambda: zipped(
            [("claim.npy", claim("tube")), *((f"{i}.npy", b"") for i in range(100_000))],
            zipfile.ZIP_STORED,
        ),
    ),
    "Parquet": ("x.parquet", ft.load, lambda: columns(40, MB)),
    "Parquet of numbers": ("x.parquet", ft.load, lambda: columns(23, 1_500_000)),
    "Parquet of texts": (
        "x.parquet",
        ft.load,
        lambda: parquet(pa.table({"t": ["x" * 1000] * 300_000}), use_dictionary=False),
    ),
    "Parquet of a torn page": ("x.parquet", ft.load, torn_page),
    "raster": ("x.tif", read_terrain, lambda: raster(9000)),
    "recording": ("x.rrd", ft.load, lambda: b"RRF2" + bytes(20 * MB)),
    "flights kept": ("x.jsonl", kept_flights, lambda: hashed(nested('{"of":[', "]}"))),
    "one line of flights kept": ("x.jsonl", kept_flights, lambda: b"x" * 60 * MB),
}
"""Name of a file, its reader and its maker."""


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", BOMBS)
def test_a_file_takes_no_more_memory_than_its_format_may(tmp_path, name):
    file, read, made = BOMBS[name]
    path, data = tmp_path / file, made()
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    del data

    said, took = refused_apart(partial(read, path))

    sys.stdout.write(f"{name}: {path.stat().st_size} bytes, {took / 1e6:.0f} MB: {said[-80:]}\n")
    assert took < MOST, said
    assert "\n" not in said
    assert len(said) < 1000


def test_a_name_of_any_length_is_told_in_a_line(tmp_path):
    for name in ("x" * 300, f"{'x' * 200}@{'y' * 300}", "/".join(["x" * 200] * 30)):
        for ending in (".json", ".toml", ".nc", ".plan", ".tif", ".xml"):
            path = tmp_path / f"{name}{ending}"
            for read in (
                read_rates,
                read_forecast,
                read_fence,
                read_terrain,
                read_route,
                read_parameters,
            ):
                with pytest.raises(ft.FlightTuneError) as refusal:
                    read(path)
                assert len(str(refusal.value).splitlines()) == 1
