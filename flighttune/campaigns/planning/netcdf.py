"""A forecast of wind in NetCDF, as tables of Open-Meteo: the grid point next to a place.

The file is of a classic format and follows the CF conventions 1.11 (https://cfconventions.org,
sections 4 and 8.1). It has eastward and northward wind at heights over ground, such as ``u100`` and
``v100`` (m/s) of ERA5, over time, latitude and longitude, and may have an ensemble (``number``).
"""

import io
import re
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, ScenarioError
from flighttune.base.files.table import MAX_BYTES, abridged
from flighttune.base.files.whole import allowed
from flighttune.base.units import DEG
from flighttune.routes.maps import LatLon

WIND = re.compile(r"([uv])(\d{1,5})")
SINCE = re.compile(r"(second|minute|hour|day)s? since (.+)")
SECONDS = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": 86_400.0}
METRES_PER_SECOND = "m s**-1", "m s-1", "m/s", "m.s-1"

# Names of each axis, and the order in which the values of a wind are read.
AXES = {
    "time": ("time", "valid_time"),
    "number": ("number", "realization", "member"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon"),
}
AXIS = {name: axis for axis, names in AXES.items() for name in names}

# What the reader of SciPy raises where a file is damaged.
DAMAGED = ValueError, TypeError, IndexError, KeyError, OverflowError, MemoryError, AttributeError

# The first bytes of HDF5, which NetCDF 4 is.
HDF5 = b"\x89HDF"


class Variable(NamedTuple):
    """A variable of a file: its axes, values (NaN where they are missing) and unit."""

    axes: tuple[str, ...]
    values: FloatArray
    unit: str


def netcdf_tables(path: Path, near: LatLon | None) -> dict[str, Any]:
    """The tables of JSON from a NetCDF file, at the grid point next to a place (deg), or the first.

    InputError names the file and the variable.
    """
    variables = _variables(path)
    lat, lon = (_axis(path, variables, name) for name in ("latitude", "longitude"))
    at = (float(lat[0]), float(lon[0])) if near is None else near
    i = int(np.abs(lat - at[0]).argmin())
    k = int(np.abs((lon - at[1] + 180.0) % 360.0 - 180.0).argmin())
    hourly: dict[str, Any] = {"time": _times(path, variables)}
    for name, eastward in variables.items():
        if (found := WIND.fullmatch(name)) is None or found[1] == "v":
            continue
        if (northward := variables.get(f"v{found[2]}")) is None:
            raise InputError(f"{path}: must have `v{found[2]}` with `{name}`, got none.")
        u, v = (_at(path, x, of, i, k) for of, x in ((name, eastward), ("v", northward)))
        if u.shape != v.shape or len(u) != len(hourly["time"]):
            raise InputError(f"{path}: `{name}` and `v{found[2]}` must have a value for each time.")
        origin = np.arctan2(-u, -v) / DEG % 360.0
        for member, columns in enumerate(zip(np.hypot(u, v).T, origin.T, strict=True)):
            for kind, column in zip(("speed", "direction"), columns, strict=True):
                key = f"wind_{kind}_{found[2]}m" + f"_member{member:02d}" * (member > 0)
                hourly[key] = [None if np.isnan(x) else float(x) for x in column]
    units = {key: "m/s" if "speed" in key else "°" for key in hourly}
    place = {"latitude": float(lat[i]), "longitude": float((lon[k] + 180.0) % 360.0 - 180.0)}
    return {**place, "utc_offset_seconds": 0, "hourly": hourly, "hourly_units": units}


def _variables(path: Path) -> dict[str, Variable]:
    """Winds and axes of a file of the classic formats."""
    with allowed(path, "readable", ScenarioError), path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise InputError(
            f"{path}: must have at most {MAX_BYTES} bytes, got more: cut it to the mission's area."
        )
    if data[:4] == HDF5:
        raise InputError(
            f"{path}: must be NetCDF classic, got NetCDF 4: `nccopy -k classic {path.name} OUT.nc` "
            "writes it."
        )
    from scipy.io import netcdf_file

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of missing values that a type does not have
            with netcdf_file(io.BytesIO(data), mmap=False, maskandscale=True) as file:
                return {
                    name: _variable(of)
                    for name, of in file.variables.items()
                    if name in AXIS or WIND.fullmatch(name)
                }
    except DAMAGED as error:
        raise InputError(f"{path}: must be a whole file of NetCDF classic: {error}.") from error


def _variable(of: Any) -> Variable:
    """A variable of SciPy's reader."""
    values = np.ma.filled(np.ma.asarray(of[:], dtype=float), np.nan)
    unit = getattr(of, "units", b"")
    axes = tuple(AXIS.get(name, str(name)) for name in of.dimensions)
    return Variable(axes, values, unit.decode("utf-8") if isinstance(unit, bytes) else str(unit))


def _axis(path: Path, variables: dict[str, Variable], axis: str) -> FloatArray:
    """The values of an axis; InputError without any."""
    found = [variables[name].values for name in AXES[axis] if name in variables]
    if not found or found[0].ndim > 1 or not found[0].size or not np.isfinite(found[0]).all():
        raise InputError(f"{path}: `{axis}` must be an axis of numbers, got none.")
    return np.atleast_1d(found[0])


def _times(path: Path, variables: dict[str, Variable]) -> list[float]:
    """Unix times of a file, s."""
    unit = next((variables[name].unit for name in AXES["time"] if name in variables), "")
    since = SINCE.fullmatch(unit)
    try:
        start = datetime.fromisoformat(since[2].strip().removesuffix(" UTC")) if since else None
    except ValueError:
        start = None
    if since is None or start is None:
        raise InputError(
            f"{path}: `time` must be in hours since 2026-11-29 00:00 or alike, got "
            f"{abridged(unit)}."
        )
    zero = (start if start.tzinfo else start.replace(tzinfo=UTC)).timestamp()
    return [float(x) for x in _axis(path, variables, "time") * SECONDS[since[1]] + zero]


def _at(path: Path, of: Variable, name: str, i: int, k: int) -> FloatArray:
    """Values of a wind at a grid point, (times, members)."""
    if of.unit not in METRES_PER_SECOND:
        raise InputError(f"{path}: `{name}` must be in m s-1, got {abridged(of.unit)}.")
    if {*of.axes} - {*AXES} or len({*of.axes}) < len(of.axes):
        raise InputError(
            f"{path}: `{name}` must be over {', '.join(AXES)}, got {', '.join(of.axes)}."
        )
    values = of.values
    for axis in [x for x in AXES if x not in of.axes]:
        values = np.expand_dims(values, -1)
        of = of._replace(axes=(*of.axes, axis))
    values = values.transpose([of.axes.index(axis) for axis in AXES])
    # an axis of one value may have been left out
    return values[:, :, min(i, values.shape[2] - 1), min(k, values.shape[3] - 1)]
