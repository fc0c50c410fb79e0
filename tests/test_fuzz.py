"""No file, whatever is in it, is a fault of flighttune: it is read, or refused in one line."""

import io
import json
import math
import re
import shutil
import sys
import time
import tomllib
import zipfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from fuzzing import (
    files,
    limited,
    marked,
    mutated,
    peak_bytes,
    text_files,
    to_json,
    to_toml,
    torn,
    xml_files,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_files import sampled as sampled_log
from log_files import write_dataflash, write_tlog, write_ulog
from made_up import shortened
from places import SHIPPED_AIRCRAFT, SHIPPED_SCENARIOS
from plans import HOME, PATROL, item, plan_file, terrain
from readers import (
    kept_flights,
    read_description,
    read_fence,
    read_forecast,
    read_parameters,
    read_rates,
    read_route,
    read_terrain,
)
from scipy.io import netcdf_file

import flighttune as ft
from flighttune.base.files import load as sealing

G_0 = 9.80665

CASES = [pytest.param(20, marks=pytest.mark.slow), pytest.param(1000, marks=pytest.mark.counts)]
"""Files of each kind, in the short and in the long run."""

SAMPLE = 40
"""One of so many files that are accepted is put to all its uses, in a process of its own."""

LOAD_S, USE_S, ROOM, LOAD_ROOM = 10.0, 120.0, 2 << 30, 500 << 20
"""Processor time for reading a file and for all its uses, s; memory for these, bytes."""

LONG_S = 60.0
"""Campaigns whose flights last longer are not flown, s."""

LONGEST_LINE = 10_000

GAINS = {"K_P": [[1.7, 0.6], [-0.6, 2.0]], "K_I": [[3.5, 0.2], [-0.2, 3.5]]}
DIAGONAL = {"K_P": np.diag([1.5, 1.4]), "K_I": np.diag([0.9, 0.8])}


def shipped(name):
    """A shipped scenario or campaign without what would take long: requirements and tuning."""
    tables = tomllib.loads((SHIPPED_SCENARIOS / f"{name}.toml").read_text(encoding="utf-8"))
    return {**{key: tables[key] for key in tables if key != "expect"}, "gains": ["paper"]}


SCENARIO = {
    **shipped("level_turn"),
    "law": [
        {"name": "paper", "kind": "paper"},
        {"name": "mine", "kind": "exact", "priority": "chi", "lift_floor": 0.3, "braking": 2.0},
        {"name": "own", "kind": "python", "module": "own.py", "class": "Own"},
    ],
    "gains": ["paper", {"name": "mine", **GAINS}],
    "reference": {
        "chi_deg": [
            {"shape": "step", "start_s": 0.1, "change_deg": 5.0},
            {"shape": "ramp", "start_s": 0.1, "duration_s": 0.1, "rate_dps": 5.0},
            {"shape": "doublet", "start_s": 0.1, "width_s": 0.1, "amplitude_deg": 5.0},
        ],
        "gamma_deg": 3.0,
    },
    "tuning": {"I_star": 5.0, "gain_max": 50.0, "state_scaling": [1.0, 1.0, 1.0, 1.0]},
    "sensors": {"chi_bias_deg": 1.0, "chi_noise_sd_deg": 0.1, "noise_time_constant_s": 0.5},
    "envelope": {
        "V_a_mps": [20.0, 30.0],
        "gamma_deg": [-10.0, 20.0],
        "phi_deg": [-20.0, 20.0],
        "n_z": [0.8, 1.2],
    },
    "expect": [
        {
            "plant": "kinematic",
            "gains": "paper",
            "at_most": {"chi": {"peak_deg": 30.0, "within": [[0.0, 90.0], [4.0, 6.0]]}},
        }
    ],
    "plant": [
        {"kind": "kinematic"},
        {
            "kind": "point_mass_lag",
            "roll_lag_rad_s": 6.0,
            "roll_damping": 0.8,
            "n_z_lag_rad_s": 9.0,
        },
    ],
}
OWN = """
class Own:
    def __init__(self, setup, k=1.0):
        self.dt, self.signals = setup.dt, {}

    def start(self, condition):
        pass

    def step(self, measured, reference, t):
        return 0.0, 1.0
"""
HEAVY = shipped("heavy_and_aft")["plant"][1]
AIRBORNE = {
    **shipped("gust_in_turn"),
    "wind": {"level": [{"h_m": 0.0, "speed_mps": 3.0, "from_deg": 90.0, "down_mps": 0.1}]},
    "turbulence": {"severity": 3, "wind_20ft_mps": 5.0},
    "plant": [{**HEAVY, "throttle_max": 0.9}],
}
CAMPAIGN = {
    **shipped("campaigns/aerosonde_dispersed"),
    "scenario": "level_turn",
    "runs": 8,
    "gains": ["paper", {"name": "mine", **GAINS}],
    "overrides": {"flight": {"duration_s": 12.0}},
}
AIRCRAFT = tomllib.loads((SHIPPED_AIRCRAFT / "aerosonde" / "aircraft.toml").read_text())
IDENTIFIED = json.loads((SHIPPED_AIRCRAFT / "aerosonde" / "identified.json").read_text())


PLACES = [[8.49, 47.39, 500.0], [8.53, 47.39, 500.0], [8.53, 47.42, 500.0], [8.49, 47.42, 500.0]]
AREA = [place[:2] for place in [*PLACES, PLACES[0]]]
CORNERS = [[lat, lon] for lon, lat in AREA[:-1]]
SHAPES = ("LineString", PLACES, {}), ("Polygon", [AREA], {"min_up_m": -50.0, "max_up_m": 400.0})
MAP = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": stated, "geometry": {"type": shape, "coordinates": at}}
        for shape, at, stated in SHAPES
    ],
}
KML = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'.format(
    "".join(
        f"<Placemark><{shape}><altitudeMode>absolute</altitudeMode>{before}<coordinates>"
        f"{' '.join(','.join(map(str, place)) for place in at)}</coordinates>{after}</{shape}>"
        "</Placemark>"
        for shape, at, before, after in (
            ("LineString", PLACES, "", ""),
            ("Polygon", AREA, "<outerBoundaryIs><LinearRing>", "</LinearRing></outerBoundaryIs>"),
        )
    )
)
LINES = "QGC WPL 110\n" + "\n".join(
    f"{number} 0 {frame} {command} {turns} 0 {radius} 0 {lat} {lon} {up} 1"
    for number, (frame, command, turns, radius, lat, lon, up) in enumerate(
        [(0, 16, 0, 0, *HOME), (3, 16, 0, 0, 47.4, 8.5, 60), (3, 16, 0, 0, 47.41, 8.5, 60),
         (3, 18, 2, -180, 47.41, 8.52, 90), (0, 16, 0, 0, 47.4, 8.52, 570)]
    )
)  # fmt: skip
PARAMETERS = """# Version: 4.5.7
NAVL1_PERIOD 14.0
NAVL1_DAMPING 0.75
LIM_ROLL_CD 5500
TECS_TIME_CONST 5.0
TRIM_ARSPD_CM 2200
RC1_MIN 1000
1 1 TECS_THR_DAMP 0.5 9
"""
# A space between values, and ~ in place of one in a label.
JSBSIM_TABLE = "Time Phi~(deg) Psi~(deg) V_{North}~(ft/s) V_{East}~(ft/s)\n" + "\n".join(
    f"{0.05 * k:.2f} {10.0 * math.sin(0.1 * k):.4f} 0.0 80.0 {5.0 * math.sin(0.1 * k):.4f}"
    for k in range(200)
)
LANDING = {
    "type": "ComplexItem",
    "complexItemType": "fwLandingPattern",
    "altitudesAreRelative": True,
    "landingApproachCoordinate": [47.41, 8.53, 60],
    "landCoordinate": [47.41, 8.55, 0],
    "loiterClockwise": True,
    "loiterRadius": 150.0,
    "useLoiterToAlt": True,
}


def mission(folder):
    """A plan with a speed, a jump, a landing, a fence and a rally point."""
    before = item(22, 15, 0, 0, None, 47.4, 8.5, 60), item(178, 0, 24.0, -1, 0, frame=2)
    jump = item(177, 3, 1, frame=2)
    circle = {"inclusion": False, "circle": {"center": [47.43, 8.5], "radius": 300.0}}
    fence = {"polygons": [{"inclusion": True, "polygon": CORNERS}], "circles": [circle]}
    rally = {"points": [[47.405, 8.51, 80.0]]}
    items = [{"doJumpId": i, **x} for i, x in enumerate([*before, *PATROL, jump], start=1)]
    path = plan_file(
        folder / "x.plan", *items, LANDING, cruiseSpeed=25.0, geoFence=fence, rallyPoints=rally
    )
    return json.loads(path.read_text())


def bound_of(_):
    return json.loads((Path(__file__).parent / "files_of_0_3_0" / "bound.json").read_text())


def of_map(path):
    """The route and the fence of a file: both are read, or one of them is refused."""
    fence = read_fence(path)
    return read_route(path), fence.start.tolist(), fence.end.tolist(), fence.low, fence.high


CORNER_LINES = b"#corners\n47.41 8.51\n47.39 8.49\n47.39 8.53\n47.42 8.53\n47.42 8.49\n"


def comma_separated(text):
    return text.replace(" ", ",").replace("~", " ")


def with_a_law(folder):
    (folder / "own.py").write_text(OWN)
    return SCENARIO


class Kind(NamedTuple):
    """A kind of file: its name, what is in it, how that is written, what reads it and uses it."""

    file: str
    tables: Callable[[Path], dict[str, Any]]
    text: Callable[[dict[str, Any]], str]
    load: Callable[[Path], Any]
    use: Callable[[Any], Any] = lambda _: None
    files: Callable[..., Any] = files  # strategy of files that are not quite right


def flown(scenario):
    """The first tenth of a second of every flight."""
    cut = scenario.flight.model_copy(update={"duration_s": 2.5 / scenario.controller.rate_hz})
    return ft.fly(scenario.model_copy(update={"flight": cut}))


def of_aircraft(folder):
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder, dirs_exist_ok=True)
    return AIRCRAFT


def model_of_aircraft(folder):
    of_aircraft(folder)
    return (folder / "aerosonde.xml").read_text()


def in_folder(load):
    return lambda path: load(path.parent)


def every_shipped(*patterns):
    """The tables of every shipped file of these names."""
    files = [file for pattern in patterns for file in sorted(SHIPPED_SCENARIOS.glob(pattern))]
    return lambda _: [tomllib.loads(file.read_text(encoding="utf-8")) for file in files]


def certificate_of(folder):
    ft.certify("paper_as_printed", ft.PAPER_GAINS).certificate.save(folder / "c.json")
    return json.loads((folder / "c.json").read_text())


def of_aircraft_at(path):
    """An aircraft whose trims are found."""
    return ft.trim(path.parent, V_a=[25.0])


KINDS = {
    "law": Kind("x.toml", with_a_law, to_toml, ft.load_scenario, flown),
    "wind": Kind("x.toml", lambda _: AIRBORNE, to_toml, ft.load_scenario, flown),
    "scenario": Kind(
        "x.toml", every_shipped("*.toml", "studies/*.toml"), to_toml, ft.load_scenario
    ),
    "gains": Kind("x.toml", lambda _: GAINS, to_toml, ft.load_gains),
    "campaign": Kind("x.toml", lambda _: CAMPAIGN, to_toml, ft.load_campaign, ft.plan_campaign),
    "shipped campaign": Kind(
        "x.toml", every_shipped("campaigns/*.toml"), to_toml, ft.load_campaign, ft.plan_campaign
    ),
    "aircraft": Kind("aircraft.toml", of_aircraft, to_toml, of_aircraft_at),
    "model": Kind(
        "aerosonde.xml",
        model_of_aircraft,
        str,
        of_aircraft_at,
        files=lambda text, _: xml_files(text),
    ),
    "identified": Kind("x.json", lambda _: IDENTIFIED, to_json, ft.loop.load_identified),
    "mission": Kind("x.plan", mission, to_json, of_map),
    "map": Kind("x.geojson", lambda _: MAP, to_json, of_map),
    "KML": Kind("x.kml", lambda _: KML, str, of_map, files=lambda text, _: xml_files(text)),
    "waypoints": Kind(
        "x.waypoints", lambda _: LINES, str, read_route, files=lambda text, _: text_files(text)
    ),
    "bound": Kind("x.json", bound_of, to_json, ft.load, ft.verify),
    "certificate": Kind("x.json", certificate_of, to_json, ft.load, ft.verify),
    "parameters": Kind(
        "x.param",
        lambda _: PARAMETERS,
        str,
        read_parameters,
        files=lambda text, _: text_files(text),
    ),
    "JSBSim table": Kind(
        "x.csv",
        lambda _: JSBSIM_TABLE,
        comma_separated,
        ft.load_log,
        files=lambda text, _: text_files(text).map(
            lambda data: comma_separated(data.decode("latin-1")).encode("latin-1")
        ),
    ),
}


FORECAST = {
    "latitude": 47.4, "longitude": 8.52, "utc_offset_seconds": 0, "elevation": 480.0,
    "hourly_units": {
        "time": "iso8601", "wind_speed_80m": "m/s", "wind_direction_80m": "°",
        "wind_speed_120m": "km/h", "wind_direction_120m": "°", "wind_speed_80m_member01": "kn",
        "wind_direction_80m_member01": "°", "wind_speed_120m_member01": "m/s",
        "wind_direction_120m_member01": "°", "wind_speed_850hPa": "m/s",
        "wind_direction_850hPa": "°", "geopotential_height_850hPa": "m",
    },
    "hourly": {
        "time": ["2026-11-29T00:00", "2026-11-29T01:00"],
        "wind_speed_80m": [5.0, 6.0], "wind_direction_80m": [250.0, 355.0],
        "wind_speed_120m": [25.0, 30.0], "wind_direction_120m": [260.0, 5.0],
        "wind_speed_80m_member01": [9.0, 11.0], "wind_direction_80m_member01": [240.0, 250.0],
        "wind_speed_120m_member01": [8.0, 9.0], "wind_direction_120m_member01": [240.0, 250.0],
    },
}  # fmt: skip
RATES = {
    "flights": 8,
    "ending": {"kind": "parachute", "sink_mps": 5.0, "opens_s": 2.0},
    "fault": [
        {"kind": "engine", "per_hour": 1e-3, "source": "a log", "flights": 6},
        {
            "kind": "elevator_stuck",
            "per_hour": 1e-5,
            "source": "a book",
            "stuck_deg": [-5.0, 5.0],
            "detected_s": 2.0,
            "ended_s": 4.0,
        },
    ],
}
DESCRIPTION = (
    "<PropertyList><sim><aero>model</aero><flight-model>jsb</flight-model></sim><fdm><jsbsim>"
    "<x type='double'>1.5</x><y alias='/fdm/jsbsim/x'/><t include='more.xml'><z>2</z></t>"
    "<u n='3' include='more.xml'/><v type='bool'>true</v></jsbsim></fdm></PropertyList>"
)


def forecast_csv(_):
    """The forecast as the service writes it with ``format=csv``; a space between values."""
    hourly, units = FORECAST["hourly"], FORECAST["hourly_units"]
    heads = ["time", *(f"{name}~({units[name]})" for name in hourly if name != "time")]
    rows = [
        " ".join("" if x is None else str(x) for x in row)
        for row in zip(*hourly.values(), strict=True)
    ]
    about = "latitude longitude utc_offset_seconds elevation\n47.4 8.52 0 480"
    return "\n".join([about, "", " ".join(heads), *rows])


def netcdf(folder):
    """A forecast at four grid points, packed as ERA5 packs it."""
    with netcdf_file(folder / "x.nc", "w") as file:
        for name, values in {
            "time": [0, 1],
            "latitude": [47.5, 47.25],
            "longitude": [8.5, 8.75],
        }.items():
            file.createDimension(name, None if name == "time" else 2)
            file.createVariable(name, "d", (name,))[:] = values
        file.variables["time"].units = "hours since 2026-11-29 00:00"
        for name in ("u80", "v80", "u120", "v120"):
            wind = file.createVariable(name, "h", ("time", "latitude", "longitude"))
            wind.units, wind.scale_factor, wind.add_offset = "m s**-1", 0.002, 1.0
            setattr(wind, "_FillValue", np.int16(-32767))  # noqa: B010
            wind[:] = np.arange(8).reshape(2, 2, 2) * 100
    return (folder / "x.nc").read_bytes()


def spread(path):
    """The spread of a forecast, which is of numbers."""
    found = read_forecast(path)
    assert np.isfinite([*found.speed_mps, *found.from_deg]).all(), found
    return found


def described(folder):
    (folder / "model.xml").write_text("<fdm_config/>")
    (folder / "more.xml").write_text("<PropertyList><a>5</a></PropertyList>")
    return DESCRIPTION


def flights_kept(folder):
    """The file of two flights of a command that was killed."""
    plan = ft.plan_campaign(ft.load_campaign("first_campaign"), runs=2)
    kept_flights(folder / "x.jsonl", plan)
    return (folder / "x.jsonl").read_bytes()


@st.composite
def kept_files(draw, data):
    """Bytes of such a file, torn, or with other values in a row and the right hash of its line."""
    if draw(st.booleans()):
        return draw(torn(data))
    first, *others = data.decode().splitlines()
    text = json.dumps(draw(mutated(json.loads(first.partition(" ")[2]))))
    return "\n".join([f"{sha256(text.encode()).hexdigest()} {text}", *others, ""]).encode()


KINDS |= {
    "forecast": Kind("x.json", lambda _: FORECAST, to_json, spread),
    "forecast table": Kind(
        "x.csv",
        forecast_csv,
        comma_separated,
        spread,
        files=lambda text, _: text_files(text).map(
            lambda data: comma_separated(data.decode("latin-1")).encode("latin-1")
        ),
    ),
    "rates": Kind("x.toml", lambda _: RATES, to_toml, read_rates),
    "description": Kind(
        "x-set.xml", described, str, read_description, files=lambda text, _: xml_files(text)
    ),
}


def packed(_):
    """A KMZ of the route."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("doc.kml", KML)
    return sink.getvalue()


def raster(folder):
    """A terrain below the route."""
    pytest.importorskip("rasterio")
    return terrain(folder / "x.tif", compress="deflate", blockysize=8).read_bytes()


def old_file(name):
    return lambda _: (Path(__file__).parent / "files_of_0_3_0" / name).read_bytes()


@st.composite
def binary_files(draw, data):
    """Bytes of a binary file, torn at up to three places, mostly with the right seal."""
    for _ in range(draw(st.integers(1, 3))):
        data = draw(torn(data)) or b"\0"
    return sealed_again(data) if draw(st.integers(0, 3)) else data


def sealed_again(data):
    """The seal of a changed file put right, where it still has one."""
    before, mark, after = data.rpartition(sealing.MARK)
    if not mark or len(after) < sealing.DIGITS:
        return data
    return sealing.seal(before + sealing.BLANK.encode() + after[sealing.DIGITS :])


def binary(name, data, load, use=lambda _: None):
    return Kind(name, data, bytes, load, use, files=lambda made, _: binary_files(made))


def logged(write, name):
    """A log of the first seconds of a level turn, as an autopilot writes it."""

    def made(folder):
        run = ft.fly(shortened("level_turn", 4.0, gains=["paper"], expect=[])).runs[0]
        t, signals = sampled_log(run, dropouts=False)
        return write(
            folder / name, t[:100], {key: x[:100] for key, x in signals.items()}
        ).read_bytes()

    return made


def recorded(folder):
    """A recording of one short flight."""
    turn = shortened("level_turn", 4.0, gains=["paper"], expect=[])
    ft.record(ft.fly(turn), folder, name="x")
    return (folder / "x.rrd").read_bytes()


def monitored(folder):
    """A monitor of three logs."""
    t = np.arange(500) / 25.0

    def log(k):
        phi, p = 0.5 * np.sin(0.7 * t + k), 0.35 * np.cos(0.7 * t + k)
        r = 0.5 * np.sin(phi) + 0.1 * p + 0.01 * np.cos(40.0 * t + k)
        table = {"t_s": t, "phi_rad": phi, "p": p, "r": r, "v_north": 20.0, "v_east": 0.0 * t}
        pd.DataFrame(table).to_csv(folder / f"{k}.csv", index=False)
        return ft.load_log(folder / f"{k}.csv")

    ft.monitor(*map(log, range(3))).save(folder / "x.npz")
    return (folder / "x.npz").read_bytes()


BINARY = {
    "KMZ": binary("x.kmz", packed, of_map),
    "terrain": binary("x.tif", raster, read_terrain),
    "old run": binary("x.parquet", old_file("run.parquet"), ft.load),
    "tube": binary("x.npz", old_file("tube.npz"), ft.load),
    "band": binary("x.npz", old_file("band.npz"), ft.load),
    "table of a log": binary(
        "x.csv", lambda _: comma_separated(JSBSIM_TABLE).encode(), ft.load_log
    ),
    "ULog": binary("x.ulg", logged(write_ulog, "x.ulg"), ft.load_log),
    "DataFlash": binary("x.bin", logged(write_dataflash, "x.bin"), ft.load_log),
    "telemetry": binary("x.tlog", logged(write_tlog, "x.tlog"), ft.load_log),
    "recording": binary("x.rrd", recorded, ft.load),
    "monitor": binary("x.npz", monitored, ft.load),
    "corners": binary("x.fen", lambda _: CORNER_LINES, read_fence),
    "NetCDF": binary("x.nc", netcdf, spread),
    "kept": Kind(
        "x.jsonl", flights_kept, bytes, kept_flights, files=lambda data, _: kept_files(data)
    ),
}
"""Kinds of files whose bytes are changed, and not their values."""

FOREIGN = "forecast", "forecast table", "rates", "description"
"""Kinds of tables that `make test` tries too: others write them, and no other test fuzzes them."""

LOGS = "table of a log", "ULog", "DataFlash", "telemetry"
"""Those that a process of its own reads, of which half as many are tried."""


def loads(load, path):
    """What a file holds; None where it is refused in one line that names file and key."""
    try:
        return load(path)
    except (ft.InputError, ft.loop.PlantError) as error:
        line = str(error)
        assert line.startswith(f"{path}: "), line
        assert "\n" not in line
        assert len(line) < LONGEST_LINE, len(line)
        assert re.search(r"`[^`]*`| must ", line), line
        return None


def fuzz(kind, folder, cases):
    path, tables = folder / kind.file, kind.tables(folder)
    if not isinstance(tables, list):
        text = kind.text(tables)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        kind.load(path)
    seen, longest, before = Counter(), 0.0, peak_bytes()

    @settings(max_examples=cases, suppress_health_check=list(HealthCheck))
    @given(kind.files(tables, kind.text))
    def read(data):
        nonlocal longest
        path.write_bytes(data)
        began = time.process_time()
        with limited(LOAD_S, LOAD_ROOM):
            found = loads(kind.load, path)
        longest = max(longest, time.process_time() - began)
        seen["refused" if found is None else "accepted"] += 1
        if found is None:
            return
        with suppress(ft.FlightTuneError), limited(USE_S, ROOM):
            kind.use(found)

    read()
    took = f"longest {longest:.2f} s, at most {(peak_bytes() - before) / 1e6:.0f} MB more"
    sys.stdout.write(f"{path.name}: {dict(seen)}, {took}\n")


@pytest.mark.filterwarnings("ignore:Generating overly large repr")
@pytest.mark.parametrize("cases", CASES)
@pytest.mark.parametrize("name", marked(KINDS, pytest.mark.counts, but=FOREIGN))
def test_a_file_is_read_or_refused_in_one_line(tmp_path, name, cases):
    fuzz(KINDS[name], tmp_path, cases)


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("cases", CASES)
@pytest.mark.parametrize("name", marked(BINARY, pytest.mark.soak, but={*BINARY} - {"ULog"}))
def test_a_binary_file_is_read_or_refused_in_one_line(tmp_path, name, cases):
    fuzz(BINARY[name], tmp_path, cases // 2 if name in LOGS else cases)
