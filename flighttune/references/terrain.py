"""Heights of the ground from a raster file, and how far above it a path or corridor is."""

from pathlib import Path
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError, need
from flighttune.references.maps import Corridor, Where, on_earth

# Distance between the places at which the ground is looked at, m.
APART = 5.0

METRES = "", "m", "metre", "meter", "metres", "meters"

# Lowest and highest land there is, roughly, m: a post beyond has no height, in a file that does not
# say which value stands for none.
LOWEST, HIGHEST = -500.0, 9000.0


def ground_at(file: str | Path, places: FloatArray) -> FloatArray:
    """Height of the ground at places (n, 2), latitude and longitude in deg, above sea level, m.

    It is linear between the posts of a file that rasterio reads, such as GeoTIFF and .hgt. Raises
    InputError if it cannot be read, is not in metres, or has no height at a place.
    """
    need("`--terrain`", "rasterio")
    import rasterio
    from rasterio._err import CPLE_BaseError  # of a place that a projection does not have
    from rasterio.warp import transform
    from rasterio.windows import Window
    from scipy.ndimage import map_coordinates

    if not Path(file).is_file():
        raise InputError(f"{file}: there is no such file of a terrain.")
    try:
        with rasterio.open(file) as data, np.errstate(invalid="ignore"):
            unit = (data.units[0] or "") if data.count == 1 else f"{data.count} bands"
            if data.crs is None or unit.lower() not in METRES:
                got = "no such system" if data.crs is None else unit
                raise InputError(
                    f"{file}: must have a coordinate system and one band of heights in m, got "
                    f"{got}."
                )
            x, y = transform("EPSG:4326", data.crs, places[:, 1], places[:, 0])
            cell = np.reshape(~data.transform, (3, 3))[1::-1] @ [x, y, np.ones(len(places))]
            at, last = cell - 0.5, np.array([data.height, data.width]) - 1.0  # row and column
            outside = ~((at >= 0.0) & (at <= last[:, None])).all(axis=0)  # also catches NaN
            if outside.any():
                raise _none_at(file, *places[outside][0])
            first, size = np.floor(at.min(axis=1)), np.ceil(np.ptp(at, axis=1)) + 2.0
            window = Window(first[1], first[0], *np.minimum(size, last - first + 1.0)[::-1])
            posts = data.read(1, window=window, masked=True).astype(float).filled(np.nan)
            posts = posts * data.scales[0] + data.offsets[0]
            posts[(posts < LOWEST) | (posts > HIGHEST)] = np.nan
    except (rasterio.errors.RasterioError, CPLE_BaseError) as error:
        reason = str(error).rstrip(".")
        raise InputError(f"{file}: must be a raster with heights there, got {reason}.") from error
    heights = map_coordinates(posts, at - first[:, None], order=1, mode="nearest")
    if (lost := np.isnan(heights)).any():
        raise _none_at(file, *places[lost][0])
    return heights


def _none_at(file: str | Path, lat: float, lon: float) -> InputError:
    return InputError(f"{file}: must have the height of the ground at {lat:.5f}, {lon:.5f} deg.")


def clearance(file: str | Path, where: Where, corridor: Corridor | None = None) -> dict[str, Any]:
    """The lowest place over the ground of a path, or of its corridor, looked at every 5 m.

    Returns its height over the ground (m, negative below it), distance along the path (m), stretch,
    latitude and longitude (deg), the height of the ground there (m), and the file.
    """
    path, origin, h_0 = where
    s, right, below = path.points(APART), np.zeros(()), np.zeros(())
    if corridor is not None:
        window = np.searchsorted(corridor.windows[:, 1], s).clip(max=len(corridor.low) - 1)
        (left, _), (far, lowest) = corridor.low[window].T, corridor.high[window].T
        shares = np.linspace(0.0, 1.0, 2 + int((far - left).max() / APART))[:, None]
        right, s = (left + shares * (far - left)).ravel(), np.tile(s, len(shares))
        below = np.tile(lowest, len(shares))
    places = path.beside(s, right, below)
    on_map = on_earth(places, origin)
    ground = ground_at(file, on_map)
    over = h_0 + places[:, 2] - ground
    i = int(np.argmin(over))
    return {
        "over_ground_m": float(over[i]),
        "along_m": float(s[i]),
        "stretch": path.stretch_at(float(s[i])).words,
        **dict(zip(("lat_deg", "lon_deg"), on_map[i].tolist(), strict=True)),
        "ground_m": float(ground[i]),
        "file": str(file),
    }


def clearance_words(subject: str, lowest: dict[str, Any]) -> str:
    """How low something comes over the ground, in a sentence."""
    place = "on the {stretch}, {along_m:.0f} m along, at {lat_deg:.5f}, {lon_deg:.5f}"
    ground = "the ground is {ground_m:.0f} m above sea level there ({file})"
    over = lowest["over_ground_m"]
    how = f"comes down to {over:.1f} m over" if over >= 0.0 else f"is {-over:.1f} m below"
    return f"{subject} {how} the ground {place}; {ground}.".format(**lowest)


NOT_SEEN = "Terrain was not looked at: `--terrain FILE` does."
