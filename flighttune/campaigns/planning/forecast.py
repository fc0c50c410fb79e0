"""The spread of a forecast of wind along a route: JSON and CSV of Open-Meteo, read strictly.

Wind speed and direction at heights over ground, hour by hour, of a forecast
(https://open-meteo.com/en/docs) or of the members of an ensemble
(https://open-meteo.com/en/docs/ensemble-api): ``wind_speed_80m``, ``wind_direction_80m`` and
``wind_speed_80m_member01``, in the unit of ``hourly_units``.
"""

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, naming
from flighttune.base.files.table import abridged, file_text, json_tables
from flighttune.base.units import DEG
from flighttune.routes.maps import LatLon, json_number, json_part, north_east

# Names of the two quantities at a height over ground, m, and of a member of an ensemble.
NAME = re.compile(r"wind_?(speed|direction)_(\d+)m(?:_member(\d+))?")

# Units of the wind speed by their names in `hourly_units`, m/s.
SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mp/h": 0.44704, "kn": 1852.0 / 3600.0}
DEGREES = ("°",)

# Largest distance of the forecast from the mission's start, m: models have cells of up to 50 km.
FARTHEST = 50_000.0


class Spread(NamedTuple):
    """The range of a forecast wind, and its origin in words."""

    speed_mps: tuple[float, float]
    from_deg: tuple[float, float]  # rising, clockwise from north; the end may exceed 360
    source: str  # file and times
    words: str  # a sentence


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindForecast:
    """A forecast of wind over time at heights over ground at one place."""

    file: str
    place: LatLon
    times: Sequence[datetime]  # rising, with the offset of the file
    levels: FloatArray  # (levels,), m over ground, rising
    wind: FloatArray  # (times, levels, members, 2): velocity to north and east, m/s; may be NaN

    def spread(self, start: LatLon, over_ground: tuple[float, float], during: str) -> Spread:
        """The range of the wind at heights over ground (m), at the start of a route.

        `during`: ``FROM``, ``FROM/TO`` in ISO 8601, by the clock of the file if without an offset;
        empty for all times of the file. Of an interval the times in it and next to it count.
        Between levels the wind is linear, and below the lowest level it is that of this level.
        """
        if math.hypot(*north_east(self.place, start)) > FARTHEST:
            raise InputError(
                f"`latitude` and `longitude` must be within {FARTHEST / 1e3:g} km of the mission, "
                f"which starts at {start[0]:.4f}, {start[1]:.4f}, got {self.place[0]:g}, "
                f"{self.place[1]:g}."
            )
        if (high := over_ground[1]) > self.levels[-1]:
            raise InputError(
                f"`wind_speed_..m` must reach the height of the mission, {high:.0f} m over ground, "
                f"got {', '.join(f'{x:g}' for x in self.levels)} m."
            )
        begin, end = self._during(during)
        wind = self._at_heights(over_ground)[begin : end + 1]
        if np.isnan(wind).any():
            lost = begin + int(np.argwhere(np.isnan(wind))[0, 0])
            raise InputError(f"the wind at {self._said(lost)} must be numbers, got null.")
        speed = np.hypot(*np.moveaxis(wind, -1, 0)).ravel()
        # Rounded outwards: the wind comes from where it does not blow to.
        slowest, fastest = (x / 10.0 for x in outwards(10.0 * speed.min(), 10.0 * speed.max()))
        origins = sector(np.arctan2(-wind[..., 1], -wind[..., 0]).ravel() / DEG)
        members = self.wind.shape[2]
        when = self._said(begin, end)
        how = f"{members} members" if members > 1 else "one forecast without its error"
        return Spread(
            speed_mps=(slowest, fastest),
            from_deg=origins,
            source=f"{Path(self.file).name} of {when}",
            words=f"The wind is drawn from {self.file}, {when} ({how}): "
            f"{ends((slowest, fastest))} m/s from {ends(origins)} deg.",
        )

    def _at_heights(self, over_ground: tuple[float, float]) -> FloatArray:
        """Wind at the ends of a range of heights and between, (times, heights, members, 2)."""
        low, high = (float(np.clip(x, self.levels[0], self.levels[-1])) for x in over_ground)
        between = self.levels[(self.levels > low) & (self.levels < high)].tolist()
        winds = []
        for height in dict.fromkeys((low, *between, high)):
            i = int(np.searchsorted(self.levels, height))
            # At a level, nulls of the one below do not matter.
            below = i if height == self.levels[i] else i - 1
            step = self.levels[i] - self.levels[below]
            share = (height - self.levels[below]) / step if step else 1.0
            winds.append((1.0 - share) * self.wind[:, below] + share * self.wind[:, i])
        return np.stack(winds, axis=1)

    def _during(self, during: str) -> tuple[int, int]:
        """Places of the first and the last time that surround an interval."""
        if not during:
            return 0, len(self.times) - 1
        try:
            asked = [datetime.fromisoformat(text) for text in during.split("/")]
        except ValueError:
            asked = []
        zone = self.times[0].tzinfo
        asked = [time if time.tzinfo else time.replace(tzinfo=zone) for time in asked]
        if len(asked) not in (1, 2) or asked[0] > asked[-1]:
            raise InputError(
                f"the time after @ must be TIME or FROM/TO as 2026-11-29T12:00, got {during}."
            )
        if asked[0] < self.times[0] or asked[-1] > self.times[-1]:
            last = len(self.times) - 1
            raise InputError(f"`time` must reach over {during}, got {self._said(0, last)}.")
        first = max(i for i, time in enumerate(self.times) if time <= asked[0])
        return first, next(i for i, time in enumerate(self.times) if time >= asked[-1])

    def _said(self, *places: int) -> str:
        """Times as a person writes them, each once."""
        times = [self.times[i] for i in dict.fromkeys(places)]
        offset = times[0].utcoffset()
        zone = "UTC" + (f"{times[0]:%z}" if offset else "")
        return f"{' to '.join(f'{time:%Y-%m-%d %H:%M}' for time in times)} {zone}"


def ends(pair: tuple[float, float]) -> str:
    """Both ends of a range; one number if they are equal."""
    return " to ".join(dict.fromkeys(f"{x:g}" for x in pair))


def outwards(low: float, high: float) -> tuple[float, float]:
    """The whole numbers around a range, whose ends may be off by rounding."""
    return float(math.floor(round(low, 6))), float(math.ceil(round(high, 6)))


def sector(angles: FloatArray) -> tuple[float, float]:
    """The smallest sector with all angles, in whole degrees outwards: begin, and end above it."""
    rising = np.sort(angles.round(6) % 360.0)
    gaps = np.diff(rising, append=rising[0] + 360.0)
    begin = float(rising[(int(gaps.argmax()) + 1) % len(rising)])
    low, high = outwards(begin, begin + 360.0 - float(gaps.max()))
    return (low, high) if high - low < 360.0 else (0.0, 360.0)


def spread_of(source: str | Path, start: LatLon, over_ground: tuple[float, float]) -> Spread:
    """The spread of a forecast, ``FILE`` or ``FILE@TIMES``, at a mission's heights (m)."""
    text = str(source)
    file, _, during = (text, "", "") if Path(text).exists() else text.rpartition("@")
    forecast = load_forecast(file or text)
    with naming(file or text):
        return forecast.spread(start, over_ground, during)


def load_forecast(path: str | Path) -> WindForecast:
    """Read a forecast of wind; InputError names file and key."""
    file = Path(path)
    if file.suffix.lower() not in (".json", ".csv"):
        raise InputError(f"{file}: must be a forecast .json or .csv, got {file.suffix}.")
    tables = json_tables(file) if file.suffix.lower() == ".json" else _csv_tables(file)
    with naming(file):
        hourly, units = (json_part(tables, key, dict) for key in ("hourly", "hourly_units"))
        lat, lon = (json_number(tables.get(key), f"`{key}`") for key in ("latitude", "longitude"))
        times = _times(
            hourly, json_number(tables.get("utc_offset_seconds"), "`utc_offset_seconds`")
        )
        columns = {
            name: _column(name, hourly, units, len(times))
            for name in hourly
            if NAME.fullmatch(name)
        }
        levels = sorted({_of(name)[1] for name in columns})
        members = sorted({_of(name)[2] for name in columns})
        if not levels:
            raise InputError("`hourly` must have wind_speed_80m or another height, got none.")
        names = {_of(name): name for name in columns}
        wind = np.empty((len(times), len(levels), len(members), 2))
        for i, level in enumerate(levels):
            for k, member in enumerate(members):
                speed, origin = (
                    columns[_named(names, kind, level, member)] for kind in ("speed", "direction")
                )
                wind[:, i, k] = np.column_stack(
                    [-speed * np.cos(origin * DEG), -speed * np.sin(origin * DEG)]
                )
        return WindForecast(
            file=str(path), place=(lat, lon), times=times, levels=np.array(levels, float), wind=wind
        )


def _of(name: str) -> tuple[str, int, int]:
    """Quantity, height and member of a column; empty values for another column."""
    found = NAME.fullmatch(name)
    return (found[1], int(found[2]), int(found[3] or 0)) if found else ("", 0, 0)


def _named(names: Mapping[tuple[str, int, int], str], kind: str, level: int, member: int) -> str:
    """The name of a column; InputError if the file lacks it."""
    if (name := names.get((kind, level, member))) is None:
        of_member = f"_member{member:02d}" * (member > 0)
        raise InputError(f"`hourly` must have wind_{kind}_{level}m{of_member}, got none.")
    return name


def _times(hourly: Mapping[str, Any], offset_s: float) -> list[datetime]:
    """The times of a file: ISO 8601 by its clock, or Unix times."""
    zone = timezone(timedelta(seconds=offset_s)) if abs(offset_s) < 86_400.0 else UTC
    stated = json_part(hourly, "time", list)
    try:
        times = [
            datetime.fromtimestamp(x, zone)
            if isinstance(x, int | float)
            else datetime.fromisoformat(x).replace(tzinfo=zone)
            for x in stated
        ]
    except (TypeError, ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"`time` must be ISO 8601 or Unix times, got {abridged(stated)}."
        ) from error
    if not times or any(a >= b for a, b in pairwise(times)):
        raise InputError(f"`time` must have rising times, got {abridged(stated)}.")
    return times


def _column(
    name: str, hourly: Mapping[str, Any], units: Mapping[str, Any], count: int
) -> npt.NDArray[np.float64]:
    """The values of a column in m/s or deg; NaN for null."""
    unit, speed = units.get(name), _of(name)[0] == "speed"
    allowed = [*SPEEDS] if speed else [*DEGREES]
    if unit not in allowed:
        raise InputError(
            f"`hourly_units.{name}` must be {' or '.join(allowed)}, got {abridged(unit)}."
        )
    values = json_part(hourly, name, list)
    if len(values) != count:
        raise InputError(f"`{name}` must have {count} values as `time`, got {len(values)}.")
    numbers = np.array([json_number(value, f"`{name}`", math.nan) for value in values])
    if speed and (numbers < 0.0).any():
        raise InputError(f"`{name}` must not be negative, got {np.nanmin(numbers):g} {unit}.")
    return numbers * (SPEEDS[unit] if speed else 1.0)


def _csv_tables(file: Path) -> dict[str, Any]:
    """The tables of JSON from CSV: lines about the place, then columns named ``NAME (UNIT)``."""
    text = file_text(file)
    rows = [row for row in csv.reader(io.StringIO(text)) if row]
    if len(rows) < 3 or rows[0][0] != "latitude" or rows[2][0] != "time":
        raise InputError(
            f"{file}: must begin with lines of latitude, ... and of time, ..., as a CSV of "
            f"Open-Meteo, got {abridged(text.partition(chr(10))[0])}."
        )
    about, heads, lines = dict(zip(*rows[:2], strict=False)), rows[2], rows[3:]
    for number, line in enumerate(lines, start=1):
        if len(line) != len(heads):
            raise InputError(
                f"{file}: row {number} of `time` must have {len(heads)} values, got {len(line)}."
            )
    named = [re.fullmatch(r"(\w+)(?: \((.*)\))?", head) for head in heads]
    columns = [(x[1], x[2]) if x else (head, "") for x, head in zip(named, heads, strict=True)]
    values = {
        name: [line[i] if name == "time" else _number(line[i]) for line in lines]
        for i, (name, _) in enumerate(columns)
    }
    return {**{key: _number(x) for key, x in about.items()}, "hourly": values} | {
        "hourly_units": dict(columns)
    }


def _number(text: str) -> float | str | None:
    """A number of CSV; the text itself if it is none, None if it is empty or NaN."""
    try:
        value = float(text) if text else math.nan
    except ValueError:
        return text
    return None if math.isnan(value) else value
