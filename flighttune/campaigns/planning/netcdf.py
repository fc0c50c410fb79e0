"""A forecast of wind in NetCDF, as tables of Open-Meteo: the grid point next to a place.

The file is of a classic format and follows the CF conventions 1.11 (https://cfconventions.org,
sections 4 and 8.1). It has eastward and northward wind at heights over ground, such as ``u100`` and
``v100`` (m/s) of ERA5, over time, latitude and longitude, and may have an ensemble (``number``).

SciPy's reader copies every variable when it opens a file, so that windows over the same bytes take
memory without a bound. Here the header is read, and of each wind the grid point alone.
"""

import math
import re
import struct
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.budget import HEADER, NETCDF, file_bytes
from flighttune.base.files.table import abridged
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

# Numbers of the lists and types of a header, and what reading one that is damaged raises:
# https://docs.unidata.ucar.edu/nug/current/file_format_specifications.html
DIMENSION, VARIABLE, ATTRIBUTE = 10, 11, 12
TYPES = {1: "i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
DAMAGED = struct.error, ValueError, TypeError, IndexError, KeyError, OverflowError

# Attributes of a variable that are read, and the values of those that it lacks.
READ = "units", "scale_factor", "add_offset", "_FillValue", "missing_value"
EMPTY, NONE, ZERO, ONE = np.array([], "S1"), np.array([], ">f4"), np.zeros(1), np.ones(1)

# The first bytes of HDF5, which NetCDF 4 is.
HDF5 = b"\x89HDF"


Raw: TypeAlias = npt.NDArray[Any]
T = TypeVar("T")


class Variable(NamedTuple):
    """A variable of a file: its axes, its values in the file's bytes, and its attributes."""

    axes: tuple[str, ...]
    raw: Raw
    unit: str
    scale: float
    offset: float
    missing: Raw  # values in place of those that are missing

    def floats(self, raw: Raw) -> FloatArray:
        """Some of the values as numbers, NaN where they are missing."""
        values = raw.astype(float)
        values[np.isin(raw, self.missing)] = np.nan
        with np.errstate(all="ignore"):  # what is not finite is refused later
            return values * self.scale + self.offset


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
    count = 0
    for name in variables:
        if (found := WIND.fullmatch(name)) is None or found[1] == "v":
            continue
        if f"v{found[2]}" not in variables:
            raise InputError(f"{path}: must have `v{found[2]}` with `{name}`, got none.")
        u, v = (_at(path, variables[x], x, i, k) for x in (name, f"v{found[2]}"))
        if (count := count + u.size + v.size) > NETCDF.entries:
            raise InputError(
                f"{path}: must have at most {NETCDF.entries} winds at a place, got more."
            )
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
    data = file_bytes(path, NETCDF, InputError, "cut it to the mission's area")
    if data[:4] == HDF5:
        raise InputError(
            f"{path}: must be NetCDF classic, got NetCDF 4: `nccopy -k classic {path.name} OUT.nc` "
            "writes it."
        )
    try:
        return _Header(data).variables()
    except DAMAGED as error:
        raise InputError(f"{path}: must be a whole file of NetCDF classic: {error}.") from error


class _Stated(NamedTuple):
    """What the header states of a variable."""

    name: str
    dimensions: list[int]
    attributes: dict[str, Raw]
    kind: "np.dtype[Any]"
    begin: int


class _Header:
    """Reader of the header of a file."""

    def __init__(self, data: bytes) -> None:
        if data[:4] not in (b"CDF\1", b"CDF\2"):
            raise ValueError("it must begin with CDF")
        self._data, self._at, self._far = data, 4, data[3] == 2

    def variables(self) -> dict[str, Variable]:
        """Winds and axes, as views of the bytes of the file."""
        records = self._number()
        dimensions = self._list(DIMENSION, self._dimension)
        self._list(ATTRIBUTE, self._attribute)
        stated = self._list(VARIABLE, self._variable)
        shapes = [[dimensions[i][1] for i in of.dimensions] for of in stated]
        # A variable over the dimension of length 0, which grows, has a part in each record.
        growing = [shape[:1] == [0] for shape in shapes]
        parts = [
            math.prod(shape[grows:]) * of.kind.itemsize
            for of, shape, grows in zip(stated, shapes, growing, strict=True)
        ]
        inside = [part for part, grows in zip(parts, growing, strict=True) if grows]
        record = inside[0] if len(inside) == 1 else sum(part + -part % 4 for part in inside)
        found = {}
        for of, shape, grows in zip(stated, shapes, growing, strict=True):
            if of.name not in AXIS and not WIND.fullmatch(of.name):
                continue
            steps = [math.prod(shape[i:]) * of.kind.itemsize for i in range(1, len(shape) + 1)]
            if grows:
                shape[0], steps[0] = records, record
            raw = np.ndarray(shape, of.kind, self._data, of.begin, steps)
            over = [dimensions[i][0] for i in of.dimensions]
            found[of.name] = Variable(
                axes=tuple(AXIS.get(name, name) for name in over),
                raw=raw,
                unit=of.attributes.get("units", EMPTY).tobytes().decode("utf-8"),
                scale=float(of.attributes.get("scale_factor", ONE)[0]),
                offset=float(of.attributes.get("add_offset", ZERO)[0]),
                missing=of.attributes.get("_FillValue", of.attributes.get("missing_value", NONE)),
            )
            if {raw.dtype.kind, found[of.name].missing.dtype.kind} - {*"if"}:
                raise ValueError(f"`{abridged(of.name)}` must have numbers")
        return found

    def _number(self) -> int:
        self._at += 4
        return int(struct.unpack_from(">I", self._data, self._at - 4)[0])

    def _bytes(self, length: int) -> bytes:
        """Bytes, after which the header goes on at a multiple of four."""
        text = self._data[self._at : self._at + length]
        self._at += length + -length % 4
        return text

    def _name(self) -> str:
        return self._bytes(self._number()).decode("utf-8")

    def _list(self, kind: int, read: Callable[[], T]) -> list[T]:
        stated, count = self._number(), self._number()
        if stated not in (kind, 0) or count > HEADER.entries or (count and not stated):
            raise ValueError(f"a list of its header must have at most {HEADER.entries} entries")
        return [read() for _ in range(count)]

    def _dimension(self) -> tuple[str, int]:
        return self._name(), self._number()

    def _attribute(self) -> tuple[str, Raw]:
        name, kind, count = self._name(), np.dtype(TYPES[self._number()]), self._number()
        return name, np.frombuffer(self._bytes(count * kind.itemsize), kind)

    def _variable(self) -> _Stated:
        name, count = self._name(), self._number()
        if count > HEADER.depth:
            raise ValueError(f"`{abridged(name)}` must have at most {HEADER.depth} axes")
        dimensions = [self._number() for _ in range(count)]
        attributes = {key: x for key, x in self._list(ATTRIBUTE, self._attribute) if key in READ}
        kind, _ = np.dtype(TYPES[self._number()]), self._number()  # its size follows from its shape
        if not self._far:
            return _Stated(name, dimensions, attributes, kind, self._number())
        self._at += 8
        (begin,) = struct.unpack_from(">q", self._data, self._at - 8)
        return _Stated(name, dimensions, attributes, kind, begin)


def _axis(path: Path, variables: dict[str, Variable], axis: str) -> FloatArray:
    """The values of an axis; InputError without any."""
    stated = next((variables[name] for name in AXES[axis] if name in variables), None)
    raw = np.array([]) if stated is None else np.atleast_1d(stated.raw)
    if raw.size > NETCDF.entries:
        raise InputError(
            f"{path}: `{axis}` must have at most {NETCDF.entries} numbers, got {raw.size}."
        )
    values = raw if stated is None else stated.floats(raw)
    if values.ndim > 1 or not values.size or not np.isfinite(values).all():
        raise InputError(f"{path}: `{axis}` must be an axis of numbers, got none.")
    return values


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
    raw = of.raw
    for axis in [x for x in AXES if x not in of.axes]:
        raw = np.expand_dims(raw, -1)
        of = of._replace(axes=(*of.axes, axis))
    raw = raw.transpose([of.axes.index(axis) for axis in AXES])
    if not 0 < math.prod(raw.shape[:2]) <= NETCDF.entries or not raw.size:
        raise InputError(
            f"{path}: `{name}` must have 1 to {NETCDF.entries} values at a place, got "
            f"{math.prod(raw.shape[:2])}."
        )
    # an axis of one value may have been left out
    return of.floats(raw[:, :, min(i, raw.shape[2] - 1), min(k, raw.shape[3] - 1)])
