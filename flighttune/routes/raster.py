"""Heights between the posts of a foreign raster: the only module that imports rasterio.

GDAL chooses a format by content, and some formats open other files and addresses. Here a file is
opened by one driver, without the files beside it, and only blocks near the requested places are
read.
"""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, need
from flighttune.base.files.budget import BLOCK, BLOCKS, RASTER
from flighttune.base.files.table import first_line

# Driver by the ending of a file; all others are GeoTIFF.
TILE, DRIVERS = ".hgt", {".hgt": "SRTMHGT"}

# GDAL options: only the file itself is opened, and 64 MB of its blocks are cached.
ALONE = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_GEOREF_SOURCES": "INTERNAL",
    "CPL_VSIL_CURL_ALLOWED_FILENAME": "none",
    "GDAL_CACHEMAX": 64,
}

# Maximum rows and columns of posts in one read.
SIDE = 512

METRES = "", "m", "metre", "meter", "metres", "meters"

# Lowest and highest land on Earth, roughly, m. A post beyond has no height, since some files do not
# state their value for a missing height.
LOWEST, HIGHEST = -500.0, 9000.0


@contextmanager
def _opened(file: Path) -> Iterator[Any]:
    """A raster, opened alone; every error of rasterio in the block becomes an InputError."""
    import rasterio

    try:
        with (
            warnings.catch_warnings(action="ignore"),  # a refusal tells the cause
            np.errstate(all="ignore"),
            rasterio.Env(**ALONE),
            # A `Path` cannot be an address, and it names exactly the file that was checked.
            rasterio.open(file.resolve(), driver=DRIVERS.get(file.suffix.lower(), "GTiff")) as data,
        ):
            yield data
    except InputError:
        raise
    except Exception as error:  # a damaged file raises a dozen kinds of errors
        reason = first_line(error if str(error) else type(error).__name__)
        if file.suffix.lower() == TILE:
            reason += "; .hgt files are named by a corner, as N47E008.hgt, and have 1201 or 3601 "
            reason += "posts to a side"
        raise InputError(
            f"must be a raster (GeoTIFF or .hgt) with heights there, got {reason}."
        ) from error


def ground_heights(file: Path, places: FloatArray) -> FloatArray:
    """Height, m, linear between posts, at places (n, 2) in deg; NaN if the file lacks it."""
    need("`--terrain`", "rasterio")
    from rasterio.warp import transform

    if not os.path.isfile(file):
        raise InputError("there is no such file of a terrain.")
    with _opened(file) as data:
        _check(file, data)
        x, y = transform("EPSG:4326", data.crs, places[:, 1], places[:, 0])
        cell = np.reshape(~data.transform, (3, 3))[1::-1] @ [x, y, np.ones(len(places))]
        at, last = cell - 0.5, np.array([data.height, data.width]) - 1.0  # row and column
        inside = ((at >= 0.0) & (at <= last[:, None])).all(axis=0)  # NaN fails this
        heights = np.full(len(places), np.nan)
        if inside.any():
            heights[inside] = _between_posts(data, at[:, inside])
    return heights


def _check(file: Path, data: Any) -> None:
    """Refuse a raster that lacks information, refers to other files or needs much memory."""
    unit = (data.units[0] or "") if data.count == 1 else f"{data.count} bands"
    numbers = data.count > 1 or np.dtype(data.dtypes[0]).kind in "iuf"
    if data.crs is None or unit.lower() not in METRES or not numbers:
        got = "no such system" if data.crs is None else unit if numbers else data.dtypes[0]
        raise InputError(f"must have a coordinate system and one band of heights in m, got {got}.")
    if not 0.0 < abs(data.transform.determinant) < np.inf or data.transform.is_identity:
        raise InputError(
            "must say in the file itself where its posts are, apart from each other, got a "
            f"transform of {[*data.transform[:6]]}."
        )
    if data.tags(ns="OVERVIEWS") or "grids=" in data.crs.to_wkt():
        raise InputError(
            "must have all its heights in the file itself, got one that names another."
        )
    _check_block(data)
    if any(flag.name == "per_dataset" for flag in data.mask_flag_enums[0]):
        import rasterio

        for number in range(2, BLOCK.entries):
            try:
                with rasterio.open(f"GTIFF_DIR:{number}:{file.resolve()}", driver="GTiff") as other:
                    _check_block(other)
            except rasterio.errors.RasterioIOError:
                break


def _check_block(data: Any) -> None:
    rows, columns = data.block_shapes[0]
    if (size := rows * columns * np.dtype(data.dtypes[0]).itemsize) > BLOCK.unpacked:
        raise InputError(
            f"must have blocks of at most {BLOCK.unpacked} bytes, got {size}: `gdal_translate -co "
            "TILED=YES` makes smaller ones."
        )


def _between_posts(data: Any, at: FloatArray) -> FloatArray:
    """Heights at rows and columns (2, n), from the surrounding posts only."""
    from rasterio.windows import Window
    from scipy.ndimage import map_coordinates

    size, heights = np.array([data.height, data.width]), np.empty(at.shape[1])
    low = np.floor(at).astype(int)
    order, ends = _parts(data, low, size)
    for part in np.split(order, ends):
        first = low[:, part].min(axis=1)
        stop = np.minimum(low[:, part].max(axis=1) + 2, size)
        window = Window(*first[::-1], *(stop - first)[::-1])
        posts = data.read(1, window=window, masked=True).astype(float).filled(np.nan)
        posts = posts * data.scales[0] + data.offsets[0]
        posts[(posts < LOWEST) | (posts > HIGHEST)] = np.nan
        heights[part] = map_coordinates(
            posts, at[:, part] - first[:, None], order=1, mode="nearest"
        )
    return heights


def _parts(
    data: Any, low: npt.NDArray[np.int_], size: npt.NDArray[np.int_]
) -> tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]:
    """Order of places in which each block is unpacked once, and where each part begins."""
    block = np.array(data.block_shapes[0])
    each = int(block.prod()) * np.dtype(data.dtypes[0]).itemsize
    (top, left), (below, right) = low // block[:, None], (low + 1) // block[:, None]
    index = [row * size[1] + column for row in (top, below) for column in (left, right)]
    read = each * len(np.unique(index))
    if read > RASTER.unpacked:
        raise InputError(
            f"must have at most {RASTER.unpacked} bytes in the blocks below the path, got {read}: "
            "`gdal_translate -co TILED=YES` makes smaller ones."
        )
    # Small blocks are read together, up to the size of the cache.
    wide = max(1, SIDE // int(block[1]))
    high = max(1, min(SIDE // int(block[0]), BLOCKS.unpacked // (each * wide)))
    group = low // (block * [high, wide])[:, None]
    keys = np.concatenate([group, low // SIDE])
    order = np.lexsort(keys[::-1])
    changes = (np.diff(keys[:, order], axis=1) != 0).any(axis=0)
    return order, np.flatnonzero(changes) + 1
