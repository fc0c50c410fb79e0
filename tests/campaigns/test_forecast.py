"""A forecast of wind in the format of Open-Meteo, and flights that are drawn in its spread.

The format: https://open-meteo.com/en/docs and https://open-meteo.com/en/docs/ensemble-api.
"""

import json
import math
from contextlib import suppress
from itertools import product

import numpy as np
import pytest
from commands import flighttune
from plans import plan_file, waypoint
from scipy.io import netcdf_file

import flighttune as ft
from flighttune.campaigns.planning.forecast import load_forecast, outwards, sector, spread_of

START = 47.4, 8.5

# m/s and deg: the spread is rounded outwards to these
SPEED, DIRECTION = 0.1, 1.0


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


@pytest.mark.parametrize(
    ("over_ground", "times", "speeds"),
    [
        ((100.0, 100.0), "", (9.0, 13.0)),  # 4 + 5 to 4 + 2 + 2 + 5
        ((80.0, 120.0), "", (8.0, 14.0)),
        ((20.0, 80.0), "", (8.0, 12.0)),  # below the lowest level as at it
        ((100.0, 100.0), "@2026-11-29T01:00", (10.0, 12.0)),
        ((100.0, 100.0), "@2026-11-29T00:10/2026-11-29T00:50", (9.0, 12.0)),
        ((100.0, 100.0), "@2026-11-29T03:00+02:00", (10.0, 12.0)),
    ],
)
def test_the_spread_is_over_members_heights_and_times(tmp_path, over_ground, times, speeds):
    file = written(tmp_path / "f.json", forecast())

    spread = spread_of(f"{file}{times}", START, over_ground)

    assert spread.speed_mps == pytest.approx(speeds, abs=SPEED)
    assert spread.speed_mps[0] <= speeds[0] + 1e-9
    assert spread.speed_mps[1] >= speeds[1] - 1e-9
    assert spread.from_deg == pytest.approx((250.0, 260.0), abs=DIRECTION)


def test_a_level_that_does_not_matter_may_lack_values(tmp_path):
    tables = forecast()
    tables["hourly"]["wind_speed_80m"] = [None] * 3
    file = written(tmp_path / "f.json", tables)

    assert spread_of(file, START, (120.0, 120.0)).speed_mps == pytest.approx((10.0, 14.0))
    with pytest.raises(ft.InputError, match="must be numbers, got null"):
        spread_of(file, START, (110.0, 120.0))


@pytest.mark.parametrize(
    ("unit", "per_unit"),
    [("km/h", 1.0 / 3.6), ("mp/h", 1609.344 / 3600.0), ("kn", 1852.0 / 3600.0)],
)
def test_units_and_csv_give_the_same_wind(tmp_path, unit, per_unit):
    tables = forecast(unit=unit, per_unit=per_unit)
    file = tmp_path / "f.csv"
    file.write_text(as_csv(tables))
    metric = load_forecast(written(tmp_path / "m.json", forecast()))

    for other in (load_forecast(file), load_forecast(written(tmp_path / "f.json", tables))):
        assert other.wind == pytest.approx(metric.wind)
        assert [*other.times] == [*metric.times]
    # from the west-southwest it blows to the east-northeast
    north, east = metric.wind[0, 0, 0]
    assert (north, east) == pytest.approx(
        (8.0 * math.cos(math.radians(70.0)), 8.0 * math.sin(math.radians(70.0)))
    )


def test_unix_times_and_the_clock_of_a_place_are_the_same_hours(tmp_path):
    local, unix = forecast(), forecast()
    local["utc_offset_seconds"] = 3600
    unix["hourly"]["time"] = [1795906800 + 3600 * i for i in range(3)]  # 2026-11-28 23:00 UTC

    times = [load_forecast(written(tmp_path / "f.json", x)).times for x in (local, unix)]
    assert times[0] == times[1]


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


@pytest.mark.parametrize("as_written", [json.dumps, as_csv])
def test_pressure_levels_are_as_high_as_their_geopotential_over_the_ground(tmp_path, as_written):
    suffix = "json" if as_written is json.dumps else "csv"
    by_height, by_pressure = tmp_path / f"h.{suffix}", tmp_path / f"p.{suffix}"
    by_height.write_text(as_written(forecast()))
    by_pressure.write_text(as_written(at_pressures()))
    for heights in ((100.0, 100.0), (60.0, 120.0)):
        one, other = (spread_of(x, START, heights) for x in (by_height, by_pressure))
        assert one[:2] == other[:2]


def test_a_pressure_that_is_lower_at_an_hour_has_its_wind_there(tmp_path):
    tables = at_pressures(members=1)
    tables["hourly"]["geopotential_height_990hPa"] = [ELEVATION + up for up in (80.0, 60.0, 80.0)]
    file = written(tmp_path / "f.json", tables)
    least, _ = spread_of(f"{file}@2026-11-29T01:00", START, (80.0, 80.0)).speed_mps
    # By hand: 9 m/s at 60 m and 11 m/s at 120 m.
    assert least == pytest.approx(9.0 + 2.0 * 20.0 / 60.0, abs=SPEED)


def netcdf(path, change=lambda file: None, unit="hours since 2026-11-29 00:00:00.0"):
    """The members of `forecast` at 80 and 120 m in a file of SciPy's, packed as ERA5 packs them.

    At the grid points that are not next to `START` the wind is 30 m/s.
    """
    with netcdf_file(path, "w") as file:
        for name, values in (
            ("time", [0, 1, 2]), ("number", [0, 1]),
            ("latitude", [47.75, 47.5, 47.25]), ("longitude", [8.25, 8.5, 8.75, 9.0]),
        ):  # fmt: skip
            file.createDimension(name, None if name == "time" else len(values))
            file.createVariable(name, "i" if name == "time" else "d", (name,))[:] = values
        file.variables["time"].units = unit
        for level, part in product((80, 120), "uv"):
            wind = file.createVariable(f"{part}{level}", "h", tuple(file.dimensions))
            wind.units, wind.scale_factor, wind.add_offset = "m s**-1", 0.002, 1.0
            for hour, member in product(range(3), range(2)):
                speed = 4.0 + hour + 2.0 * member + 0.05 * level
                blows = math.radians(250.0 + 10.0 * member + 180.0)
                here = speed * (math.sin(blows) if part == "u" else math.cos(blows))
                packed = np.full((3, 4), 30.0)
                packed[1, 1] = here
                wind[hour, member] = np.round((packed - 1.0) / 0.002).astype("h")
        change(file)
    return path


@pytest.mark.parametrize(
    "unit", ["hours since 2026-11-29 00:00:00.0", "hours since 2026-11-29T01:00+01:00"]
)
def test_netcdf_has_the_wind_of_the_grid_point_next_to_the_mission(tmp_path, unit):
    file = netcdf(tmp_path / "f.nc", unit=unit)

    found, expected = load_forecast(file, START), load_forecast(written_forecast(tmp_path), START)

    assert found.place == (47.5, 8.5)
    assert [*found.times] == [*expected.times]
    assert found.levels == pytest.approx(expected.levels)
    assert found.wind == pytest.approx(expected.wind, abs=0.002)  # as packed
    assert found.kind == "2 members"


def written_forecast(folder):
    return written(folder / "f.json", forecast())


def without(name):
    return lambda file: file.variables.pop(name)


def with_unit(name, unit):
    return lambda file: setattr(file.variables[name], "units", unit)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without("v80"), "must have `v80` with `u80`, got none"),
        (without("latitude"), "`latitude` must be an axis of numbers, got none"),
        (with_unit("u80", "knots"), "`u80` must be in m s-1, got 'knots'"),
        (with_unit("time", "hours"), "`time` must be in hours since 2026-11-29 00:00 or alike"),
        (with_unit("time", "days since noon"), "`time` must be in hours since"),
    ],
)
def test_bad_netcdf_is_refused_in_a_line_that_names_the_file(tmp_path, change, words):
    file = netcdf(tmp_path / "f.nc", change)
    with pytest.raises(ft.InputError) as caught:
        load_forecast(file, START)
    said = str(caught.value)
    assert said.startswith(f"{file}: ")
    assert words in said
    assert "\n" not in said


def test_netcdf_4_is_refused_with_the_cure_and_a_damaged_file_in_a_line(tmp_path):
    file = tmp_path / "f.nc"
    file.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(
        ft.InputError, match=r"f.nc: .* got NetCDF 4: `nccopy -k classic f.nc OUT.nc`"
    ):
        load_forecast(file)
    whole = netcdf(file).read_bytes()
    file.write_bytes(whole[:900])
    with pytest.raises(ft.InputError, match=r"f.nc: must be a whole file of NetCDF classic"):
        load_forecast(file)
    rng = np.random.default_rng(1)
    for _ in range(60):  # another byte in its header, and another end
        bad = bytearray(whole[: rng.integers(4, len(whole))])
        bad[rng.integers(0, min(len(bad), 900))] = rng.integers(0, 256)
        file.write_bytes(bad)
        with suppress(ft.InputError):
            load_forecast(file, START)


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
    spread = spread_of(written(tmp_path / "f.json", mean_and(spreads)), START, (90.0, 100.0))
    assert spread.speed_mps == pytest.approx(speeds, abs=SPEED)
    assert spread.from_deg == pytest.approx(origins, abs=DIRECTION)
    assert "the mean of an ensemble and 2 of its spreads to each side" in spread.words


@pytest.mark.parametrize(
    ("angles", "ends"),
    [
        ([350.0, 10.5, 5.0], (350.0, 371.0)),
        ([90.0], (90.0, 90.0)),
        ([0.0, 100.0, 200.0, 300.0], (100.0, 360.0)),
        (np.arange(0.0, 360.0, 0.5), (0.0, 360.0)),
    ],
)
def test_a_sector_is_the_smallest_with_all_angles(angles, ends):
    assert sector(np.asarray(angles)) == ends


@pytest.mark.parametrize(
    ("spread", "whole"), [((3.2, 7.4), (3.0, 8.0)), ((4.0 - 1e-12, 8.0 + 1e-12), (4.0, 8.0))]
)
def test_speeds_are_rounded_outwards_but_for_the_rounding_of_a_product(spread, whole):
    assert outwards(*spread) == whole


def test_models_in_one_answer_are_drawn_from_like_each_alone(tmp_path):
    """As with ``models=icon_d2,gfs_seamless``; a third has no values here, which is null."""
    alone = {"icon_d2": forecast(), "gfs_seamless": forecast(from_deg=300.0)}
    both = forecast()
    for table in ("hourly", "hourly_units"):
        both[table] = {
            name if name == "time" else f"{name}_{model}": column
            for model, tables in alone.items()
            for name, column in tables[table].items()
        }
    for name in [x for x in both["hourly"] if x.endswith("icon_d2")]:
        nowhere = name.replace("icon_d2", "nowhere")
        both["hourly"][nowhere] = [None] * len(both["hourly"]["time"])
        both["hourly_units"][nowhere] = both["hourly_units"][name]

    of_both, *each = (
        spread_of(written(tmp_path / "f.json", x), (47.4, 8.52), (90.0, 100.0))
        for x in (both, *alone.values())
    )

    for at in (0, 1):
        end = (min, max)[at]
        assert of_both.speed_mps[at] == end(x.speed_mps[at] for x in each)
        assert of_both.from_deg[at] == end(x.from_deg[at] for x in each)
    assert "2 models" in of_both.words


def test_quarters_of_hours_are_read_as_hours_are(tmp_path):
    hourly = forecast()
    quarters = {key.replace("hourly", "minutely_15"): table for key, table in hourly.items()}

    said = [
        spread_of(written(tmp_path / "f.json", x), (47.4, 8.52), (90.0, 100.0))
        for x in (hourly, quarters)
    ]

    assert said[0] == said[1]


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


@pytest.mark.parametrize("case", BAD_PRESSURES)
def test_bad_pressure_levels_are_refused_in_a_line(tmp_path, case):
    change, words = BAD_PRESSURES[case]
    file = written(tmp_path / "f.json", bad(change, at_pressures))
    with pytest.raises(ft.FlightTuneError) as caught:
        spread_of(file, START, (100.0, 100.0))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_forecast_of_more_winds_than_any_has_is_refused(tmp_path):
    hours, tables = 7000, mean_and({S_SPREAD: 1.0})
    columns = tables["hourly"]
    columns |= {name: column * hours for name, column in columns.items()}
    columns["time"] = [1795906800 + 3600 * i for i in range(hours)]
    file = written(tmp_path / "f.json", tables)
    with pytest.raises(ft.InputError, match="`hourly` must have at most 500000 winds, got 518000"):
        spread_of(file, START, (90.0, 100.0))


@pytest.mark.parametrize(
    ("spreads", "words"),
    [
        ({S_SPREAD: -1.0}, f"`{S_SPREAD}` must not be negative"),
        ({S_SPREAD: 1.0, D_SPREAD: -1.0}, f"`{D_SPREAD}` must not be negative"),
        ({S_SPREAD: None}, "must be numbers, got null"),
        (
            {S_SPREAD: 1.0, "wind_speed_10m": 3.0, "wind_direction_10m": 250.0},
            "10m_spread, got none",
        ),
    ],
)
def test_bad_spreads_are_refused_in_a_line(tmp_path, spreads, words):
    file = written(tmp_path / "f.json", mean_and(spreads))
    with pytest.raises(ft.InputError, match=words):
        spread_of(file, START, (90.0, 100.0))


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_a_line_that_names_the_file(tmp_path, case):
    change, words = BAD[case]
    file = written(tmp_path / "f.json", bad(change))

    with pytest.raises(ft.FlightTuneError) as caught:
        spread_of(file, START, (100.0, 100.0))

    said = str(caught.value)
    assert said.startswith(f"{file}: ")
    assert words in said
    assert "\n" not in said


def test_times_with_an_offset_are_not_by_the_clock_of_the_file(tmp_path):
    tables = forecast() | {"utc_offset_seconds": 3600}
    tables["hourly"]["time"] = [f"2026-11-29T{hour:02d}:00+05:00" for hour in (5, 6, 7)]
    loaded = load_forecast(written(tmp_path / "f.json", tables))
    assert [time.isoformat() for time in loaded.times] == [
        f"2026-11-29T{hour:02d}:00:00+01:00" for hour in (1, 2, 3)
    ]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace(",0,", f",{'9' * 200_000},", 1), "must be CSV"),
        (lambda text: text.replace("wind_speed_120m (", "wind_speed_80m ("), "each column once"),
    ],
)
def test_a_csv_that_cannot_be_read_is_refused(tmp_path, change, words):
    file = tmp_path / "f.csv"
    file.write_text(change(as_csv(forecast())))
    with pytest.raises(ft.InputError, match=words) as caught:
        load_forecast(file)
    assert str(caught.value).startswith(f"{file}: ")


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
        spread_of(f"{tmp_path / name}{times}", START, (100.0, 100.0))
    assert str(tmp_path / name) in str(caught.value)


@pytest.mark.soak
def test_flights_of_a_mission_draw_their_wind_within_the_forecast(tmp_path):
    plan = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 100), waypoint(47.41, 8.5, 110))
    file = written(tmp_path / "f.json", forecast(from_deg=355.0))
    calm = ft.flights(plan)

    flights = calm.in_wind(file)
    drawn, before = (
        [x.plan().with_runs(40).scenario_of(i).wind for i in range(40)] for x in (flights, calm)
    )

    assert max(x.speed_mps for x in before) <= 8.0 < min(x.speed_mps for x in drawn)
    speeds, origins = ([getattr(x, key) for x in drawn] for key in ("speed_mps", "from_deg"))
    # by hand: 100 to 110 m over ground, three hours, two members; all of the range is drawn
    assert (min(speeds), max(speeds)) == pytest.approx((9.0, 13.5), abs=0.5)
    assert (min(origins), max(origins)) == pytest.approx((355.0, 365.0), abs=1.0)
    others = [
        [x.key for x in of.campaign.disperse if not x.key.startswith("wind.")]
        for of in (flights, calm)
    ]
    assert others[0] == others[1]
    assert flights.campaign.nominal.turbulence == calm.campaign.nominal.turbulence
    assert "f.json of 2026-11-29 00:00 to 2026-11-29 02:00 UTC" in flights.campaign.title
    assert "9 to 13.5 m/s from 355 to 365 deg" in flights.campaign.nominal.route.notes[-1]


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


@pytest.mark.soak
def test_the_answer_and_the_claim_of_a_mission_name_the_wind_and_its_forecast(tmp_path):
    plan = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 80), waypoint(47.404, 8.5, 80))
    file = written(tmp_path / "f.json", forecast(hours=2))
    few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7}

    odds = ft.mission(plan, wind=f"{file}@2026-11-29T01:00", **few)

    answer = odds.answer()
    assert "in wind 9 to 11 m/s from 250 to 260 deg, light turbulence" in answer.summary[-1]
    words = f"from {file}, 2026-11-29 01:00 UTC (2 members): 9 to 11 m/s from 250 to 260 deg."
    assert any(line.endswith(words) for line in answer.changed)
    assert "in the wind of f.json of 2026-11-29 01:00 UTC" in odds.band.sentence
    with pytest.raises(ft.InputError, match="`wind` must be absent for a band"):
        ft.mission(odds.band, wind=file)


def test_a_scenario_without_drawn_flights_takes_no_forecast(tmp_path):
    file = written(tmp_path / "f.json", forecast())
    with pytest.raises(ft.InputError, match="`wind` must be with a mission"):
        ft.flights("circuit").in_wind(file)
