"""The spread of a forecast of wind along a route: Open-Meteo's JSON and CSV, and NetCDF.

Wind speed and direction of each hour or quarter of an hour, in the unit of ``hourly_units``:

- at heights over ground, of a forecast (https://open-meteo.com/en/docs) or of the members of an
  ensemble (https://open-meteo.com/en/docs/ensemble-api): ``wind_speed_80m``, ``wind_direction_80m``
  and ``wind_speed_80m_member01``
- at pressures: ``wind_speed_850hPa`` with ``geopotential_height_850hPa`` above sea level, less the
  ``elevation`` of the ground
- of several models: ``wind_speed_80m_icon_d2``; a model without values at a height is left out
- as mean of an ensemble (https://open-meteo.com/en/docs/ensemble-mean-api) with the standard
  deviation of its members: ``wind_speed_100m_spread`` and, if there, ``wind_direction_100m_spread``
"""

import csv
import io
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, naming
from flighttune.base.files.budget import CSV, check_entries
from flighttune.base.files.table import abridged, file_text, json_tables
from flighttune.base.units import DEG
from flighttune.base.words import listed
from flighttune.campaigns.planning.netcdf import netcdf_tables
from flighttune.routes.maps import LatLon, json_number, json_part, north_east

# Names of a quantity at a height over ground, m, or a pressure, hPa, of a member of an ensemble or
# of the spread of its members, and of one of several models.
NAME = re.compile(
    r"(?:wind_?(speed|direction)|geopotential_(height))_(\d{1,5})(m|hPa)(?:_member(\d{1,4}))?(_spread)?"
    r"(?:_([a-z]\w*))?"
)

# Tables of values over time: Open-Meteo's answers have one of them, as asked for.
OVER_TIME = "hourly", "minutely_15"

# Units of the wind speed by their names in `hourly_units`, m/s.
SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mp/h": 0.44704, "kn": 1852.0 / 3600.0}
UNITS: Mapping[str, Mapping[str, float]] = {
    "speed": SPEEDS,
    "direction": {"°": 1.0},
    "height": {"m": 1.0, "ft": 0.3048},
}

# Half of the drawn range of a mean wind, in standard deviations of the ensemble's members.
DEVIATIONS = 2.0

# Most winds of a forecast: 50 members over 16 days have 300,000 at 15 levels.
MAX_WINDS = 500_000

# Lowest speed of a wind, m/s, which still has a direction.
CALM = 0.01

# Largest gap between directions, deg, at which the wind counts as from anywhere.
GAP = 10.0

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
    levels: FloatArray  # (times, levels, members), m over ground, rising; may be NaN
    wind: FloatArray  # (times, levels, members, 2): velocity to north and east, m/s; may be NaN
    kind: str  # what the members are, in words

    def spread(self, start: LatLon, over_ground: tuple[float, float], during: str) -> Spread:
        """The range of the wind at heights over ground (m), at the start of a route.

        `during`: ``FROM``, ``FROM/TO`` in ISO 8601, by the clock of the file if without an offset;
        empty for all times of the file. Of an interval the times in it and next to it count.
        Between levels the wind is linear, and below the lowest level it is that of this level.
        """
        # A latitude beyond a pole is at no distance: NaN.
        if not math.hypot(*north_east(self.place, start)) <= FARTHEST:
            raise InputError(
                f"`latitude` and `longitude` must be within {FARTHEST / 1e3:g} km of the mission, "
                f"which starts at {start[0]:.4f}, {start[1]:.4f}, got {self.place[0]:g}, "
                f"{self.place[1]:g}."
            )
        begin, end = self._during(during)
        inside = slice(begin, end + 1)
        if (lost := np.isnan(self.levels[inside]).any(axis=(1, 2))).any():
            when = self._said(begin + int(lost.argmax()))
            raise InputError(f"`geopotential_height_..` at {when} must be numbers, got null.")
        top = self.levels[inside].max(axis=1)
        if (high := over_ground[1]) > (lowest := float(top.min())):
            raise InputError(
                f"`wind_speed_..` must reach the height of the mission, {high:.0f} m over ground, "
                f"got {lowest:.0f} m."
            )
        wind = np.concatenate([*self._at_heights(over_ground, inside)])
        speed = np.hypot(*wind.T)
        # Rounded outwards: the wind comes from where it does not blow to.
        slowest, fastest = (x / 10.0 for x in outwards(10.0 * speed.min(), 10.0 * speed.max()))
        origins = sector(np.arctan2(-wind[:, 1], -wind[:, 0]) / DEG)
        when, how = self._said(begin, end), self.kind
        return Spread(
            speed_mps=(slowest, fastest),
            from_deg=origins,
            source=f"{Path(self.file).name} of {when}",
            words=f"The wind is drawn from {self.file}, {when} ({how}): "
            f"{ends((slowest, fastest))} m/s from {ends(origins)} deg.",
        )

    def _at_heights(self, over_ground: tuple[float, float], inside: slice) -> Iterator[FloatArray]:
        """Wind at the ends of a range of heights and at levels between, (winds, 2), by member."""
        times = range(*inside.indices(len(self.times)))
        for time, member in product(times, range(self.levels.shape[2])):
            levels, winds = self.levels[time, :, member], self.wind[time, :, member]
            low, high = np.clip(over_ground, levels[0], levels[-1]).tolist()
            between = levels[(levels > low) & (levels < high)].tolist()
            at = []
            for height in dict.fromkeys((low, *between, high)):
                i = int(np.searchsorted(levels, height))
                # At a level, nulls of the one below do not matter.
                below = i if height == levels[i] else i - 1
                step = levels[i] - levels[below]
                share = (height - levels[below]) / step if step else 1.0
                at.append((1.0 - share) * winds[below] + share * winds[i])
            if np.isnan(at).any():
                raise InputError(f"the wind at {self._said(time)} must be numbers, got null.")
            yield np.array(at)

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
    if gaps.max() <= GAP:
        return 0.0, 360.0
    begin = float(rising[(int(gaps.argmax()) + 1) % len(rising)])
    low, high = outwards(begin, begin + 360.0 - float(gaps.max()))
    return (low, high) if high - low < 360.0 else (0.0, 360.0)


def spread_of(source: str | Path, start: LatLon, over_ground: tuple[float, float]) -> Spread:
    """The spread of a forecast, ``FILE`` or ``FILE@TIMES``, at a mission's heights (m)."""
    text = str(source)
    file, _, during = (text, "", "") if os.path.exists(text) else text.rpartition("@")
    forecast = load_forecast(file or text, start)
    with naming(file or text):
        return forecast.spread(start, over_ground, during)


def load_forecast(path: str | Path, near: LatLon | None = None) -> WindForecast:
    """Read a forecast of wind, of a grid next to a place; InputError names file and key."""
    file, kind = Path(path), Path(path).suffix.lower()
    if kind not in (".json", ".csv", ".nc"):
        raise InputError(f"{file}: must be a forecast .json, .csv or .nc, got {file.suffix}.")
    if kind == ".nc":
        tables = netcdf_tables(file, near)
    else:
        tables = json_tables(file) if kind == ".json" else _csv_tables(file)
    with naming(file):
        if tables.get("error") is True:
            raise InputError(f"must be a forecast, got the error {abridged(tables.get('reason'))}.")
        if (over_time := next((key for key in OVER_TIME if key in tables), None)) is None:
            got = ", ".join(key for key, table in tables.items() if isinstance(table, dict))
            raise InputError(f"must have {' or '.join(OVER_TIME)}, got {abridged(got or None)}.")
        hourly, units = (json_part(tables, key, dict) for key in (over_time, f"{over_time}_units"))
        lat, lon = (json_number(tables.get(key), f"`{key}`") for key in ("latitude", "longitude"))
        times = _times(
            hourly, json_number(tables.get("utc_offset_seconds"), "`utc_offset_seconds`")
        )
        columns: dict[_Of, FloatArray] = {}
        for name in filter(NAME.fullmatch, hourly):
            if _of(name) in columns:
                raise InputError(f"`hourly` must have {_of(name).name} once, got it twice.")
            columns[_of(name)] = _column(name, hourly, units, len(times))
        winds, heights, kind = _winds(columns, len(times), tables)
        rising = np.argsort(heights, axis=1, kind="stable")
        return WindForecast(
            file=str(path),
            place=(lat, lon),
            times=times,
            levels=np.take_along_axis(heights, rising, axis=1),
            wind=np.take_along_axis(winds, rising[..., None], axis=1),
            kind=kind,
        )


class _Of(NamedTuple):
    """What a column is of."""

    quantity: str  # speed, direction or height
    level: int
    unit: str  # of the level: m or hPa
    member: int = 0
    spread: bool = False
    model: str = ""  # of several

    @property
    def name(self) -> str:
        """The name of the column."""
        start = "geopotential" if self.quantity == "height" else "wind"
        member = f"_member{self.member:02d}" * (self.member > 0)
        of_model = f"_{self.model}" if self.model else ""
        spread = "_spread" * self.spread
        return f"{start}_{self.quantity}_{self.level}{self.unit}{member}{spread}{of_model}"


Columns: TypeAlias = Mapping[_Of, FloatArray]


def _of(name: str) -> _Of:
    """What the column of a name is of."""
    found = NAME.fullmatch(name)
    assert found is not None  # of the columns that are read
    speed, height, level, unit, member, spread, model = found.groups()
    return _Of(speed or height, int(level), unit, int(member or 0), bool(spread), model or "")


def _column_of(columns: Columns, of: _Of) -> FloatArray:
    """A column; InputError if the file lacks it."""
    if (column := columns.get(of)) is None:
        raise InputError(f"`hourly` must have {of.name}, got none.")
    return column


def _winds(
    columns: Columns, count: int, tables: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray, str]:
    """Wind, (times, levels, members, 2), its heights over ground, m, and what members are."""
    of_wind = [x for x in columns if x.quantity != "height" and not x.spread]
    levels = sorted({(x.unit, x.level) for x in of_wind})
    if not levels:
        raise InputError("`hourly` must have wind_speed_80m or another height, got none.")
    # Beside others, a model has nulls where it has no values: outside of its area, or at a height.
    empty = {x.model for x in of_wind if x.model and np.isnan(columns[x]).all()}
    of_wind = [x for x in of_wind if x.model not in empty]
    if not of_wind:
        raise InputError(
            f"`hourly` must have values of a model, got null of {listed(sorted(empty))}."
        )
    members = sorted({(x.model, x.member) for x in of_wind})
    spread = any(x.spread and x.quantity == "speed" for x in columns)
    # A member at every corner of the range, and between its directions for `sector`.
    ends = [*product((-1.0, 1.0), np.linspace(-1.0, 1.0, 37).tolist())] if spread else [(0.0, 0.0)]
    if (number := count * len(levels) * len(members) * len(ends)) > MAX_WINDS:
        raise InputError(f"`hourly` must have at most {MAX_WINDS} winds, got {number}.")
    winds = np.empty((count, len(levels), len(members) * len(ends), 2))
    heights = np.empty(winds.shape[:3])
    for i, (unit, level) in enumerate(levels):
        for k, (model, member) in enumerate(members):
            of = _Of("speed", level, unit, member, model=model)
            speed, origin = (
                _column_of(columns, of._replace(quantity=x)) for x in ("speed", "direction")
            )
            more, aside = _half_range(columns, of) if spread else (0.0, 0.0)
            across = slice(k * len(ends), (k + 1) * len(ends))
            heights[:, i, across] = _over_ground(columns, of, tables)[:, None]
            around = (
                _velocity(np.maximum(speed + a * more, CALM), origin + b * aside) for a, b in ends
            )
            winds[:, i, across] = np.stack([*around], axis=1)
    kind = f"{len(members)} members" if len(members) > 1 else "one forecast without its error"
    if len(models := {model for model, _ in members}) > 1:
        kind = f"{len(models)} models" + f", {len(members)} members" * (len(members) > len(models))
    if spread:
        kind = f"the mean of an ensemble and {DEVIATIONS:g} of its spreads to each side"
    return winds, heights, kind


def _velocity(speed: FloatArray, origin: FloatArray) -> FloatArray:
    """Velocity to north and east, (times, 2), of winds from `origin` (deg)."""
    return np.column_stack([-speed * np.cos(origin * DEG), -speed * np.sin(origin * DEG)])


def _half_range(columns: Columns, of: _Of) -> tuple[FloatArray, FloatArray]:
    """Half of the range of speed (m/s) and of direction (deg) around a mean wind."""
    more = DEVIATIONS * _column_of(columns, of._replace(spread=True))
    aside = columns.get(of._replace(quantity="direction", spread=True))
    if aside is None:  # as far aside as along
        share = more / np.maximum(columns[of], CALM)
        return more, np.where(share < 1.0, np.arcsin(np.minimum(share, 1.0)) / DEG, 180.0)
    return more, np.minimum(DEVIATIONS * aside, 180.0)


def _over_ground(columns: Columns, of: _Of, tables: Mapping[str, Any]) -> FloatArray:
    """Height over ground of a level, (times,), m."""
    if of.unit == "m":
        return np.full(len(columns[of]), float(of.level))
    ground = json_number(tables.get("elevation"), "`elevation`")
    return _column_of(columns, of._replace(quantity="height")) - ground


def _times(hourly: Mapping[str, Any], offset_s: float) -> list[datetime]:
    """The times of a file: ISO 8601 by its clock, or Unix times."""
    zone = timezone(timedelta(seconds=offset_s)) if abs(offset_s) < 86_400.0 else UTC
    stated = json_part(hourly, "time", list)
    try:
        times = [
            datetime.fromtimestamp(x, zone)
            if isinstance(x, int | float)
            else _by_clock(datetime.fromisoformat(x), zone)
            for x in stated
        ]
    except (TypeError, ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"`time` must be ISO 8601 or Unix times, got {abridged(stated)}."
        ) from error
    if not times or any(a >= b for a, b in pairwise(times)):
        raise InputError(f"`time` must have rising times, got {abridged(stated)}.")
    return times


def _by_clock(time: datetime, zone: tzinfo) -> datetime:
    """A time in a zone; one without an offset is by its clock."""
    return time.astimezone(zone) if time.tzinfo else time.replace(tzinfo=zone)


def _column(
    name: str, hourly: Mapping[str, Any], units: Mapping[str, Any], count: int
) -> FloatArray:
    """The values of a column in m/s, deg or m; NaN for null."""
    of, unit = _of(name), units.get(name)
    allowed = UNITS[of.quantity]
    if not isinstance(unit, str) or unit not in allowed:
        raise InputError(
            f"`hourly_units.{name}` must be {' or '.join(allowed)}, got {abridged(unit)}."
        )
    values = json_part(hourly, name, list)
    if len(values) != count:
        raise InputError(f"`{name}` must have {count} values as `time`, got {len(values)}.")
    numbers = np.array([json_number(value, f"`{name}`", math.nan) for value in values])
    if (of.quantity == "speed" or of.spread) and (numbers < 0.0).any():
        raise InputError(f"`{name}` must not be negative, got {np.nanmin(numbers):g} {unit}.")
    return numbers * allowed[unit]


def _csv_tables(file: Path) -> dict[str, Any]:
    """The tables of JSON from CSV: lines about the place, then columns named ``NAME (UNIT)``."""
    text = file_text(file, CSV)
    with naming(file):
        check_entries(text, CSV)
    try:
        rows = [row for row in csv.reader(io.StringIO(text)) if row]
    except csv.Error as error:
        raise InputError(f"{file}: must be CSV of Open-Meteo: {error}.") from error
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
    if len({*heads}) < len(heads):
        raise InputError(f"{file}: must have each column once, got {abridged(heads)}.")
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
