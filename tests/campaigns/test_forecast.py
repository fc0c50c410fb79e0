"""A forecast of wind in the format of Open-Meteo, and flights that are drawn in its spread.

The format: https://open-meteo.com/en/docs and https://open-meteo.com/en/docs/ensemble-api.
"""

import json
import math
from contextlib import suppress
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from commands import flighttune
from plans import plan_file, waypoint
from scipy.io import netcdf_file

import flighttune as ft

# m/s and deg: the spread is rounded outwards to these
SPEED, DIRECTION = 0.1, 1.0

GROUND = 480.0


class Spread(NamedTuple):
    speed_mps: tuple
    from_deg: tuple
    words: str


@cache
def route_over(low, high):
    """A route in drawn wind between two heights over the ground, at 47.4, 8.5."""
    legs = [{"north_m": 900.0 * i, "east_m": 0.0, "up_m": i * (high - low)} for i in (0, 1)]
    place = {"route.lat_deg": 47.4, "route.lon_deg": 8.5, "route.waypoint": legs}
    level = {"flight.h_m": GROUND + low, "flight.ground_m": GROUND}
    return ft.flights("circuit_in_wind", changes=place | level)


def spread_of(source, over_ground=(100.0, 100.0)):
    """The range of the drawn wind, and what the notes of the route say of it."""
    campaign = route_over(*over_ground).in_wind(source, plans=False).campaign
    drawn = {x.key: x for x in campaign.disperse if x.key.startswith("wind.")}
    wind, ranges = campaign.nominal.wind, []
    for key in ("speed_mps", "from_deg"):
        low = getattr(wind, key)
        ranges.append((low, drawn[f"wind.{key}"].upper if f"wind.{key}" in drawn else low))
        assert f"wind.{key}" not in drawn or drawn[f"wind.{key}"].lower == low
    return Spread(*ranges, campaign.nominal.route.notes[-1])


def column(kind, level, member):
    return f"wind_{kind}_{level}m" + f"_member{member:02d}" * (member > 0)


def forecast(levels=(80, 120), members=2, hours=3, unit="m/s", per_unit=1.0, from_deg=250.0):
    """Each hour 1 m/s more, each member 2 m/s and 10 deg more, 0.05 m/s more a metre."""
    tables = {
        "latitude": 47.4, "longitude": 8.52, "generationtime_ms": 0.1, "utc_offset_seconds": 0,
        "timezone": "GMT", "timezone_abbreviation": "GMT", "elevation": 480.0,
        "hourly_units": {"time": "iso8601"},
        "hourly": {"time": [f"2026-11-29T{hour:02d}:00" for hour in range(hours)]},
    }  # fmt: skip
    for level in levels:
        for member in range(members):
            speeds = [
                (4.0 + hour + 2.0 * member + 0.05 * level) / per_unit for hour in range(hours)
            ]
            speed, origin = column("speed", level, member), column("direction", level, member)
            tables["hourly"] |= {speed: speeds, origin: [(from_deg + 10.0 * member) % 360] * hours}
            tables["hourly_units"] |= {speed: unit, origin: "°"}
    return tables


def written(path, tables):
    path.write_text(json.dumps(tables))
    return path


def as_csv(tables):
    """The same as the service writes it with ``format=csv``."""
    about = {key: tables[key] for key in tables if key not in ("hourly", "hourly_units")}
    about.pop("generationtime_ms")
    units, hourly = tables["hourly_units"], tables["hourly"]
    heads = ["time", *(f"{name} ({units[name]})" for name in hourly if name != "time")]
    lines = [",".join(about), ",".join(map(str, about.values())), "", ",".join(heads)]
    return "\n".join(
        [*lines, *(",".join(map(str, row)) for row in zip(*hourly.values(), strict=True))]
    )


ELEVATION = 480.0


def at_pressures(members=2):
    """The wind of `forecast` at 80 and 120 m over ground, given at 990 and 985 hPa."""
    tables, hourly = forecast(members=members), {}
    for name, column in tables["hourly"].items():
        hourly[name.replace("80m", "990hPa").replace("120m", "985hPa")] = column
    for pressure, height in (("990hPa", 80.0), ("985hPa", 120.0)):
        for member in range(members):
            name = f"geopotential_height_{pressure}" + f"_member{member:02d}" * (member > 0)
            hourly[name] = [ELEVATION + height] * 3
    units = {name: "m/s" if "speed" in name else "°" for name in hourly}
    units |= {name: "m" for name in hourly if "height" in name}
    return {**tables, "hourly": hourly, "hourly_units": units}


def netcdf(
    path, change=lambda file: None, unit="hours since 2026-11-29 00:00:00.0", every=1,
    number="number", order=(0, 1, 2, 3), version=1,
):  # fmt: skip
    """The members of `forecast` at 80 and 120 m in a file of SciPy's, packed as ERA5 packs them.

    At the grid points that are not next to the route the wind is 30 m/s.
    """
    with netcdf_file(path, "w", version=version) as file:
        for name, values in (
            ("time", [0, every, 2 * every]), (number, [0, 1]),
            ("latitude", [47.75, 47.5, 47.25]), ("longitude", [8.25, 8.5, 8.75, 9.0]),
        ):  # fmt: skip
            file.createDimension(name, None if name == "time" else len(values))
            file.createVariable(name, "i" if name == "time" else "d", (name,))[:] = values
        file.variables["time"].units = unit
        for level, part in product((80, 120), "uv"):
            wind = file.createVariable(
                f"{part}{level}", "h", [[*file.dimensions][i] for i in order]
            )
            wind.units, wind.scale_factor, wind.add_offset = "m s**-1", 0.002, 1.0
            for hour, member in product(range(3), range(2)):
                speed = 4.0 + hour + 2.0 * member + 0.05 * level
                blows = math.radians(250.0 + 10.0 * member + 180.0)
                here = speed * (math.sin(blows) if part == "u" else math.cos(blows))
                packed = np.full((3, 4), 30.0)
                packed[1, 1] = here
                at = [hour, member, slice(None), slice(None)]
                wind[tuple(at[i] for i in order)] = np.round((packed - 1.0) / 0.002)
        change(file)
    return path


def at_noon(hour):
    return f"2026-11-29T{hour:02d}:00"


UNIX = [1795910400 + 3600 * i for i in range(3)]  # 2026-11-29 00:00 UTC
CLOCK = [f"2026-11-29T{hour:02d}:00+05:00" for hour in (5, 6, 7)]
PER_UNIT = {"km/h": 1.0 / 3.6, "mp/h": 1609.344 / 3600.0, "kn": 1852.0 / 3600.0}


@pytest.mark.parametrize(
    ("over_ground", "times", "speeds"),
    [
        ((100.0, 100.0), "", (9.0, 13.0)),  # 4 + 5 to 4 + 2 + 2 + 5
        ((80.0, 120.0), "", (8.0, 14.0)),
        ((80.0, 105.0), "", (8.0, 13.25)),
        ((20.0, 80.0), "", (8.0, 12.0)),  # below the lowest level as at it
        ((100.0, 100.0), "@2026-11-29T01:00", (10.0, 12.0)),
        ((100.0, 100.0), "@2026-11-29T00:10/2026-11-29T00:50", (9.0, 12.0)),
        ((100.0, 100.0), "@2026-11-29T01:00/2026-11-29T02:00", (10.0, 13.0)),
        ((100.0, 100.0), "@2026-11-29T03:00+02:00", (10.0, 12.0)),
    ],
)
def test_the_spread_is_over_members_heights_and_times(tmp_path, over_ground, times, speeds):
    file = written(tmp_path / "f.json", forecast())

    spread = spread_of(f"{file}{times}", over_ground)

    assert spread.speed_mps == pytest.approx(speeds, abs=SPEED)
    assert spread.speed_mps[0] <= speeds[0] + 1e-9
    assert spread.speed_mps[1] >= speeds[1] - 1e-9
    assert spread.from_deg == pytest.approx((250.0, 260.0), abs=DIRECTION)
    assert "2 members" in spread.words
    low, high = spread.speed_mps
    assert f"{low:g} to {high:g} m/s from 250 to 260 deg" in spread.words


def with_models():
    both = {"hourly": {"time": forecast()["hourly"]["time"]}, "hourly_units": {"time": "iso8601"}}
    for model, tables in (("icon_d2", forecast()), ("gfs_seamless", forecast(from_deg=300.0))):
        for table in both:
            both[table] |= {f"{x}_{model}": y for x, y in tables[table].items() if x != "time"}
    for name in [x for x in both["hourly"] if x.endswith("icon_d2")]:
        nowhere = name.replace("icon_d2", "nowhere")
        both["hourly"][nowhere] = [None] * 3
        both["hourly_units"][nowhere] = both["hourly_units"][name]
    return forecast() | both


def timed(times, **more):
    tables = forecast() | more
    tables["hourly"]["time"] = times
    return tables


SAME = {
    **{f"CSV in {unit}": as_csv(forecast(unit=unit, per_unit=x)) for unit, x in PER_UNIT.items()},
    **{f"JSON in {unit}": forecast(unit=unit, per_unit=x) for unit, x in PER_UNIT.items()},
    "Unix times": timed(UNIX),
    "an offset": timed(CLOCK),
    "quarters": {k.replace("hourly", "minutely_15"): x for k, x in forecast().items()},
    "pressures": at_pressures(),
    "pressures as CSV": as_csv(at_pressures()),
    "NetCDF": netcdf,
    "NetCDF from another zone": lambda x: netcdf(x, unit="hours since 2026-11-29T01:00+01:00"),
    "NetCDF by the minute": lambda x: netcdf(x, unit="minutes since 2026-11-29 00:00", every=60),
    "NetCDF without an ensemble's second name": lambda x: netcdf(x, number="realization"),
    "NetCDF in another order": lambda x: netcdf(x, order=(0, 2, 3, 1)),
    "NetCDF of 64 bits": lambda x: netcdf(x, version=2),
}


@pytest.mark.parametrize("form", SAME)
@pytest.mark.parametrize("over_ground", [(100.0, 100.0), (60.0, 120.0)])
def test_one_wind_in_every_form_is_drawn_from_alike(tmp_path, form, over_ground):
    made, plain = SAME[form], written(tmp_path / "plain.json", forecast())
    suffix = "nc" if "NetCDF" in form else "csv" if isinstance(made, str) else "json"
    file = tmp_path / f"f.{suffix}"
    if suffix == "nc":
        made(file)
    else:
        file.write_text(made if suffix == "csv" else json.dumps(made))

    for during in ("", "@2026-11-29T01:00"):
        one, other = (spread_of(f"{x}{during}", over_ground) for x in (plain, file))
        tolerance = 0.11 if suffix == "nc" else 0.0  # as packed
        for at in (0, 1):
            assert other[at] == pytest.approx(one[at], abs=tolerance * 10.0**at)
        assert "2 members" in other.words


def test_a_clock_ahead_of_utc_is_that_of_the_times_without_an_offset(tmp_path):
    file = written(
        tmp_path / "f.json", timed([at_noon(x) for x in (6, 7, 8)], utc_offset_seconds=3600)
    )

    assert spread_of(f"{file}@2026-11-29T07:00").speed_mps == pytest.approx((10.0, 12.0))
    assert spread_of(f"{file}@2026-11-29T06:00+00:00").speed_mps == pytest.approx((10.0, 12.0))
    assert "2026-11-29 07:00 UTC+0100" in spread_of(f"{file}@2026-11-29T07:00").words


def test_models_in_one_answer_are_drawn_from_like_each_alone(tmp_path):
    """As with ``models=icon_d2,gfs_seamless``; a third has no values here, which is null."""
    both = spread_of(written(tmp_path / "f.json", with_models()))

    assert both.speed_mps == pytest.approx((9.0, 13.0))
    assert both.from_deg == (250.0, 310.0)
    assert "2 models, 4 members" in both.words


@pytest.mark.parametrize(
    ("origins", "ends"),
    [
        ((350.0, 10.5, 5.0), (350.0, 371.0)),
        ((90.0, 90.0, 90.0), (90.0, 90.0)),
        ((0.0, 100.0, 200.0, 300.0), (100.0, 360.0)),
        ((0.4, 90.2), (0.0, 91.0)),
        (np.arange(0.0, 360.0, 9.5), (0.0, 360.0)),
        ((270.0, 90.0, 359.9), (270.0, 450.0)),
    ],
)
def test_directions_are_the_smallest_sector_with_all_of_them(tmp_path, origins, ends):
    tables = forecast(levels=(100,), members=1, hours=len(origins))
    tables["hourly"]["time"] = [UNIX[0] + 3600 * i for i in range(len(origins))]
    tables["hourly"]["wind_direction_100m"] = [*map(float, origins)]

    assert spread_of(written(tmp_path / "f.json", tables)).from_deg == ends


@pytest.mark.parametrize(
    ("speeds", "ends"), [((3.21, 7.39), (3.2, 7.4)), ((4.0 - 1e-9, 8.0 + 1e-9), (4.0, 8.0))]
)
def test_speeds_are_rounded_outwards_but_for_the_rounding_of_a_product(tmp_path, speeds, ends):
    tables = forecast(levels=(100,), members=1, hours=2)
    tables["hourly"]["wind_speed_100m"] = [*speeds]

    assert spread_of(written(tmp_path / "f.json", tables)).speed_mps == ends


def test_a_level_that_does_not_matter_may_lack_values(tmp_path):
    tables = forecast()
    tables["hourly"]["wind_speed_80m"] = [None] * 3
    file = written(tmp_path / "f.json", tables)

    assert spread_of(file, (120.0, 120.0)).speed_mps == pytest.approx((10.0, 14.0))
    with pytest.raises(ft.InputError, match="must be numbers, got null"):
        spread_of(file, (110.0, 120.0))


def test_a_pressure_that_is_lower_at_an_hour_has_its_wind_there(tmp_path):
    tables = at_pressures(members=1)
    tables["hourly"]["geopotential_height_990hPa"] = [ELEVATION + up for up in (80.0, 60.0, 80.0)]
    file = written(tmp_path / "f.json", tables)

    least, _ = spread_of(f"{file}@2026-11-29T01:00", (80.0, 80.0)).speed_mps
    # By hand: 9 m/s at 60 m and 11 m/s at 120 m.
    assert least == pytest.approx(9.0 + 2.0 * 20.0 / 60.0, abs=SPEED)


def without(name):
    return lambda file: file.variables.pop(name)


def with_unit(name, unit):
    return lambda file: setattr(file.variables[name], "units", unit)


def mean_and(spreads, from_deg=250.0, speed=8.0):
    """The mean wind of an ensemble at 100 m, with some of its spreads, over one hour."""
    columns = {"wind_speed_100m": speed, "wind_direction_100m": from_deg, **spreads}
    tables = forecast(levels=(), hours=1)
    for name, value in columns.items():
        tables["hourly"][name] = [value]
        tables["hourly_units"][name] = "m/s" if "speed" in name else "°"
    return tables


S_SPREAD, D_SPREAD = "wind_speed_100m_spread", "wind_direction_100m_spread"


@pytest.mark.parametrize(
    ("spreads", "speeds", "origins"),
    [
        ({S_SPREAD: 1.5, D_SPREAD: 12.0}, (5.0, 11.0), (226.0, 274.0)),
        # Without one of direction it is as wide across as along: asin(4 / 8).
        ({S_SPREAD: 2.0}, (4.0, 12.0), (220.0, 280.0)),
        ({S_SPREAD: 4.5}, (0.0, 17.0), (0.0, 360.0)),
        ({S_SPREAD: 1.0, D_SPREAD: 50.0}, (6.0, 10.0), (150.0, 350.0)),
        ({S_SPREAD: 1.0, D_SPREAD: 100.0}, (6.0, 10.0), (0.0, 360.0)),
    ],
)
def test_a_mean_wind_is_drawn_from_two_spreads_to_each_side(tmp_path, spreads, speeds, origins):
    spread = spread_of(written(tmp_path / "f.json", mean_and(spreads)), (90.0, 100.0))
    assert spread.speed_mps == pytest.approx(speeds, abs=SPEED)
    assert spread.from_deg == pytest.approx(origins, abs=DIRECTION)
    assert "the mean of an ensemble and 2 of its spreads to each side" in spread.words


def bad(change, forecast=forecast):
    tables = forecast()
    change(tables)
    return tables


SPEED_80, FROM_80 = "wind_speed_80m", "wind_direction_80m"
BAD = {
    "units": (lambda x: x["hourly_units"].update({SPEED_80: "Bft"}), "hourly_units.wind_speed_80m"),
    "no unit": (lambda x: x["hourly_units"].pop(FROM_80), "must be °, got None"),
    "negative": (lambda x: x["hourly"].update({SPEED_80: [1, -2, 3]}), "must not be negative"),
    "short": (lambda x: x["hourly"].update({SPEED_80: [1.0]}), "must have 3 values as `time`"),
    "text": (lambda x: x["hourly"].update({SPEED_80: [1, "a", 3]}), "must be a number, got 'a'"),
    "null": (
        lambda x: x["hourly"].update({SPEED_80: [1, None, 3]}),
        "2026-11-29 01:00 UTC must be",
    ),
    "no direction": (lambda x: x["hourly"].pop(FROM_80), "must have wind_direction_80m"),
    "no member": (lambda x: x["hourly"].pop(f"{SPEED_80}_member01"), "wind_speed_80m_member01"),
    "no wind": (lambda x: x.update(hourly={"time": x["hourly"]["time"]}), "another height"),
    "no times": (lambda x: x["hourly"].update(time=[]), "must have rising times"),
    "no place": (lambda x: x.pop("latitude"), "`latitude` must be a number"),
    "elsewhere": (lambda x: x.update(latitude=52.5), "within 50 km of the mission"),
    "beyond a pole": (lambda x: x.update(latitude=200.0), "within 50 km of the mission"),
    "twice": (
        lambda x: (
            x["hourly"].update({SPEED_80.replace("d_s", "ds"): [1.0] * 3})
            or x["hourly_units"].update({SPEED_80.replace("d_s", "ds"): "m/s"})
        ),
        "must have wind_speed_80m once",
    ),
    "no height": (
        lambda x: x.update(hourly={"time": [0], f"wind_speed_{'9' * 5000}m": [1.0]}),
        "another height",
    ),
    "an error": (lambda x: x.update(error=True, reason="Parameter out of range"), "out of range"),
    "a time": (lambda x: x.update(current=x.pop("hourly")), "must have hourly or minutely_15"),
    "low": (lambda x: [x["hourly"].pop(k) for k in [*x["hourly"]] if "120m" in k], "100 m over"),
}


HEIGHT_990 = "geopotential_height_990hPa"
BAD_PRESSURES = {
    "no height": (lambda x: x["hourly"].pop(HEIGHT_990), f"must have {HEIGHT_990}, got none"),
    "no ground": (lambda x: x.pop("elevation"), "`elevation` must be a number"),
    "unit": (lambda x: x["hourly_units"].update({HEIGHT_990: "hPa"}), "must be m or ft, got 'hPa'"),
    "null": (
        lambda x: x["hourly"].update({HEIGHT_990: [1, 2, None]}),
        "`geopotential_height_..` at 2026-11-29 02:00 UTC must be numbers, got null",
    ),
}


BAD_SPREADS = {
    "negative": ({S_SPREAD: -1.0}, f"`{S_SPREAD}` must not be negative"),
    "negative angle": ({S_SPREAD: 1.0, D_SPREAD: -1.0}, f"`{D_SPREAD}` must not be negative"),
    "null": ({S_SPREAD: None}, "must be numbers, got null"),
    "no spread": ({S_SPREAD: 1.0, "wind_speed_10m": 3.0, "wind_direction_10m": 250.0}, "got none"),
}
NETCDF = {
    "no v": (without("v80"), "must have `v80` with `u80`, got none"),
    "no axis": (without("latitude"), "`latitude` must be an axis of numbers, got none"),
    "knots": (with_unit("u80", "knots"), "`u80` must be in m s-1, got 'knots'"),
    "no zero": (
        with_unit("time", "hours"),
        "`time` must be in hours since 2026-11-29 00:00 or alike",
    ),
    "no date": (with_unit("time", "days since noon"), "`time` must be in hours since"),
}
CSV = {
    "too long": (lambda x: x.replace(",0,", f",{'9' * 200_000},", 1), "must be CSV"),
    "twice": (lambda x: x.replace("wind_speed_120m (", "wind_speed_80m ("), "each column once"),
    "short": (lambda x: x[: x.rindex(",")], "row 3 of `time` must have 9 values, got 8"),
    "word": (lambda x: x.replace(",250.0,", ",west,", 1), "must be a number, got 'west'"),
    "no head": (lambda x: x.partition("time,")[2], "must begin with lines of latitude"),
}
REFUSED = [
    *((f"{name}.json", json.dumps(bad(*case)), words) for name, (*case, words) in BAD.items()),
    *(
        (f"{name}.json", json.dumps(bad(case, at_pressures)), words)
        for name, (case, words) in BAD_PRESSURES.items()
    ),
    *((f"{name}.json", json.dumps(mean_and(x)), words) for name, (x, words) in BAD_SPREADS.items()),
    *((f"{name}.csv", change(as_csv(forecast())), words) for name, (change, words) in CSV.items()),
    *((f"{name}.nc", change, words) for name, (change, words) in NETCDF.items()),
]


@pytest.mark.parametrize(("name", "made", "words"), REFUSED, ids=[x[0] for x in REFUSED])
def test_bad_input_is_refused_in_a_line_that_names_the_file(tmp_path, name, made, words):
    file = tmp_path / name
    netcdf(file, made) if name.endswith(".nc") else file.write_text(made)

    with pytest.raises(ft.FlightTuneError) as caught:
        spread_of(file)

    said = str(caught.value)
    assert said.startswith(f"{file}: ")
    assert words in said
    assert "\n" not in said


def test_netcdf_4_is_refused_with_the_cure_and_a_damaged_file_in_a_line(tmp_path):
    file = tmp_path / "f.nc"
    file.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(ft.InputError, match=r"f.nc: .* `nccopy -k classic f.nc OUT.nc`"):
        spread_of(file)
    whole, rng = netcdf(file).read_bytes(), np.random.default_rng(1)
    file.write_bytes(whole[:900])
    with pytest.raises(ft.InputError, match=r"f.nc: must be a whole file of NetCDF classic"):
        spread_of(file)
    for _ in range(60):  # another byte in its header, and another end
        damaged = bytearray(whole[: rng.integers(4, len(whole))])
        damaged[rng.integers(0, min(len(damaged), 900))] = rng.integers(0, 256)
        file.write_bytes(damaged)
        with suppress(ft.FlightTuneError):
            spread_of(file)


def test_a_forecast_of_more_winds_than_any_has_is_refused(tmp_path):
    hours, tables = 7000, mean_and({S_SPREAD: 1.0})
    columns = tables["hourly"]
    columns |= {name: column * hours for name, column in columns.items()}
    columns["time"] = [1795906800 + 3600 * i for i in range(hours)]
    file = written(tmp_path / "f.json", tables)
    with pytest.raises(ft.InputError, match="`hourly` must have at most 500000 winds, got 518000"):
        spread_of(file, (90.0, 100.0))


@pytest.mark.parametrize(
    ("name", "times", "words"),
    [
        ("f.json", "@noon", "must be TIME or FROM/TO"),
        ("f.json", "@2026-11-29T02:00/2026-11-29T01:00", "must be TIME or FROM/TO"),
        ("f.json", "@2026-11-30T02:00", "`time` must reach over 2026-11-30T02:00"),
        ("f.txt", "", "must be a forecast .json, .csv or .nc"),
        ("f.csv", "", "must begin with lines of latitude"),
        ("no.json", "", "must be readable"),
    ],
)
def test_times_and_files_that_do_not_fit_are_refused(tmp_path, name, times, words):
    for file in ("f.json", "f.txt", "f.csv"):
        written(tmp_path / file, forecast())

    with pytest.raises(ft.FlightTuneError, match=words) as caught:
        spread_of(f"{tmp_path / name}{times}")
    assert str(tmp_path / name) in str(caught.value)


CLIMBING = (47.4, 8.5, 100), (47.41, 8.5, 110), (47.41, 8.515, 105)
"""Latitude and longitude, deg, and height over the start, m, of a route with a turn."""


def test_a_single_wind_is_not_drawn_but_fixed(tmp_path):
    plan = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 80), waypoint(47.41, 8.5, 80))
    file = written(tmp_path / "f.json", forecast(members=1, hours=1))

    campaign = ft.flights(plan).in_wind(file).campaign

    assert not [x.key for x in campaign.disperse if x.key.startswith("wind.from")]
    assert campaign.nominal.wind.from_deg == 250.0
    assert campaign.nominal.wind.speed_mps == pytest.approx(8.0, abs=SPEED)
    assert "one forecast without its error" in campaign.nominal.route.notes[-1]


@pytest.mark.parametrize(
    ("tables", "times"),
    [
        ({"levels": (80, 120), "members": 5, "from_deg": 355.0}, ""),
        ({"levels": (80, 120), "members": 1, "hours": 1}, ""),
        ({"members": 2, "hours": 9}, "@2026-11-29T07:30/2026-11-29T08:00"),
        ({"members": 1, "hours": 1, "per_unit": 1e3}, ""),  # calm
    ],
)
def test_turns_and_times_are_planned_for_the_largest_wind_that_is_drawn(tmp_path, tables, times):
    plan = plan_file(tmp_path / "m.plan", *(waypoint(*x) for x in CLIMBING))
    file = written(tmp_path / "f.json", forecast(**tables))

    campaign = ft.flights(plan).in_wind(f"{file}{times}").campaign

    fixed = campaign.nominal.wind.speed_mps
    drawn = [x.upper for x in campaign.disperse if x.key == "wind.speed_mps"]
    fastest = max([fixed, *drawn])
    flown = ft.route(campaign.nominal)
    assert flown.wind == pytest.approx(fastest, abs=1e-9)
    assert f"turns for wind up to {fastest:.3g} m/s, " in flown.conditions
    slowest = flown.reference.V.min()
    if fastest:
        in_wind = flown.length / (slowest - fastest)
        assert f"at most {in_wind:.0f} s in a wind of" in flown.answer().verdict
    rolls = [x["roll_downwind"] for x in flown.stretches]
    assert max(rolls) <= np.deg2rad(45.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("turns for wind up to 13.5 m/s", "9 to 13.5 m/s from 250 to 260 deg")),
        (("--set", "route.wind_mps=15"), ("turns for wind up to 15 m/s", "The path can be flown")),
        (("--set", "route.wind_mps=5"), ("Yes, but turns and times are planned for wind up to 5",)),
    ],
)
def test_a_forecast_is_looked_at_before_any_flight(tmp_path, options, words):
    """The user's own wind of the turns wins, and is told if the forecast has more."""
    plan = plan_file(tmp_path / "m.plan", *(waypoint(*x) for x in CLIMBING))
    file = written(tmp_path / "f.json", forecast())

    said, _ = flighttune("mission", plan, "--wind", file, "--plan", *options)

    for words_of_it in words:
        assert words_of_it in " ".join(said.split())


def test_a_scenario_without_drawn_flights_takes_no_forecast(tmp_path):
    file = written(tmp_path / "f.json", forecast())
    with pytest.raises(ft.InputError, match="`wind` must be with a mission"):
        ft.flights("circuit").in_wind(file)
