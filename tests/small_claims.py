"""Small claims of every kind: flown or proven once in a session, and their files."""

import copy
import json
import shutil
import tempfile
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from flown_campaigns import flown_here
from forging import Opened
from geographiclib.geodesic import Geodesic

import flighttune as ft

OLD = Path(__file__).parent / "files_of_0_3_0"
PROVEN = Path(__file__).parent / "claims/tubes/proven"

TURN = """
title = "turn"
gains = ["paper", "K1"]
flight = { V_a_mps = 25.0, chi_deg = 5.0, gamma_deg = 2.0, duration_s = 0.5 }
reference = { chi_deg = 0.0, gamma_deg = 0.0 }
limits = { phi_deg = [-45.0, 45.0], phi_rate_dps = 30.0, n_z = [-2.1, 2.1], n_z_rate_per_s = 1.0 }
plant = [{ kind = "kinematic" }, { kind = "jsbsim", aircraft = "aerosonde" }]
"""
IN_WIND = """
title = "in wind"
scenario = "windy.toml"
seed = 2
runs = 24
[[disperse]]
key = "wind.speed_mps"
distribution = "uniform"
lower = 2.0
upper = 8.0
[[disperse]]
key = "wind.from_deg"
distribution = "uniform"
lower = 0.0
upper = 360.0
"""
# The least N with 0.7^N <= 0.1, and the least of which five may be outside.
ALONE, WITH_FIVE = 7, 29
RULE = {"epsilon": 0.3, "confidence": 0.9}
FEW = {**RULE, "learn": 10, "start_deg": 2.0}

# A straight route of 120 m, flown in 5 s, and a fence 2 m to each side of it.
LEG_M, BESIDE_M = 120.0, 2.0
STRAIGHT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, LEG_M)]}
STRAIGHT |= {"gains": ["paper"], "law": ["paper"]}  # which need no search
# Turning back takes less time in less wind, and a flight takes less of it at 20 Hz.
STRAIGHT |= {"route.wind_mps": 2.0, "flight.ground_m": 250.0, "controller.rate_hz": 20.0}
BOX = [[-100.0, -BESIDE_M], [-100.0, BESIDE_M], [250.0, BESIDE_M], [250.0, -BESIDE_M]]
RATES = """
flights = 8
target_per_hour = 0.9
[ending]
kind = "cut"
fall_per_height = 0.1
[[fault]]
kind = "engine"
per_hour = 1e-3
source = "a log"
flights = 6
[[fault]]
kind = "aileron_stuck"
per_hour = 1e-2
source = "a log"
flights = 6
ended_s = 0.5
"""


@cache
def folder():
    """A folder of this session, with the scenarios and rates of what is counted."""
    kept = tempfile.TemporaryDirectory(prefix="small-claims-")
    KEPT.append(kept)
    where = Path(kept.name)
    (where / "turn.toml").write_text(TURN)
    windy = TURN.replace("limits", "wind = { speed_mps = 5.0, from_deg = 0.0 }\nlimits")
    (where / "windy.toml").write_text(windy)
    (where / "in_wind.toml").write_text(IN_WIND)
    (where / "rates.toml").write_text(RATES)
    return where


KEPT = []


def around_leg(beside_m, ends_m=(-100.0, 250.0), top_m=None):
    """A fence of this half-width around the leg, as GeoJSON."""
    _, start, _ = ft.route("circuit", changes=STRAIGHT).where
    corners = [(ends_m[i], side * beside_m) for i, side in ((0, -1), (0, 1), (1, 1), (1, -1))]
    ring = [
        [line["lon2"], line["lat2"]]
        for n, e in [*corners, corners[0]]
        for line in [Geodesic.WGS84.Direct(*start, np.rad2deg(np.arctan2(e, n)), np.hypot(n, e))]
    ]
    properties = {} if top_m is None else {"max_up_m": top_m}
    shape = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "geometry": shape, "properties": properties}


def saved(claim, name):
    claim.save(folder() / name)
    return folder() / name


@cache
def band(flights=WITH_FIVE, plant="kinematic", **settings):
    """The file of a band of half a second of a turn."""
    with flown_here():
        counted = ft.band(
            folder() / "turn.toml", plant=plant, gains="paper", flights=flights, **FEW, **settings
        )
    return saved(counted, f"band-{flights}-{plant[:3]}{'-'.join(map(str, settings.values()))}.npz")


@cache
def band_in_wind(**settings):
    """The file of a band around the middle that its wind predicts."""
    with flown_here():
        counted = ft.band(
            folder() / "in_wind.toml", plant="kinematic", flights=ALONE, learn=40,
            predicted_from="wind", **RULE, **settings,
        )  # fmt: skip
    return saved(counted, "in_wind.npz")


@cache
def residual(seed=1, **settings):
    """The file of residual signals of the Aerosonde in that turn."""
    with flown_here():
        counted = ft.residual(
            folder() / "turn.toml", gains="paper", flights=ALONE, seed=seed, **FEW, **settings
        )
    return saved(counted, f"residual-{seed}{'-'.join(map(str, settings))}.npz")


@cache
def monitor(seed=1):
    """The file of a monitor counted on two seconds of that turn by the Aerosonde."""
    longer = {"flight.duration_s": 2.0}
    with flown_here():
        counted = ft.monitor(
            folder() / "turn.toml", gains="paper", flights=ALONE, seed=seed, changes=longer,
            **{**FEW, "learn": 20},
        )  # fmt: skip
    return saved(counted, f"monitor-{seed}.npz")


@cache
def mission():
    """The file of the band of a mission in its fence, with its room and its hours beside it."""
    fence, band = folder() / "fence.geojson", folder() / "mission.npz"
    fence.write_text(json.dumps(around_leg(BESIDE_M)))
    with flown_here():
        ft.mission(
            "circuit_in_wind", changes=STRAIGHT, fences=[fence], turn_back=45, flights=12,
            rates=folder() / "rates.toml", out=band, **RULE,
        )  # fmt: skip
    return band


def room():
    """The file of the room to turn back of the mission."""
    return mission().with_name("mission-turn-back.npz")


def hours():
    """The file of the exits per flight hour of the mission."""
    return mission().with_name("mission-per-hour.json")


def stated_term(flights, fault=None, ended_s=None, left=0, end_s=10.0):
    """A term of a file of hours: flights of which so many left, and none was ended."""
    stayed = [-1.0] * flights
    times = {"left_s": [5.0] * left + stayed[left:], "end_s": [end_s] * flights}
    return {"fault": fault, "ended_s": ended_s, **times, "ended_at_s": stayed}


@cache
def stated_plan():
    """The plan of the flights of the mission."""
    stated = ft.flights("circuit_in_wind", changes=STRAIGHT).knowing(None)
    plan = stated.plan(kind="jsbsim")
    return plan.of_group(plan.groups[0]).as_dict()


def turning_plan():
    """The plan of flights that turn back by 45 deg from any place of the leg, every 10 m of it."""
    plan = copy.deepcopy(stated_plan())
    rate = np.rad2deg(9.81 / (25.0 + STRAIGHT["route.wind_mps"]))  # the tangent of 45 deg is 1
    there = {"chi_deg": 0.0, "gamma_deg": 0.0, "h_m": 1000.0, "V_a_mps": 25.0, "rate_dps": 0.0}
    places = [
        {"along_m": s, "north_m": s, "east_m": 0.0, **there, "back_dps": rate}
        for s in np.arange(0.0, LEG_M + 1.0, 10.0).tolist()
    ]
    turn = {"at_m": 0.0, "side": 1, "bank_deg": 45.0, "turn_deg": 180.0, "detected_s": 10.0,
            "reaction_s": 1.0, "roll_rate_dps": 30.0, "place": places}  # fmt: skip
    plan["nominal"] = {k: x for k, x in plan["nominal"].items() if k not in ("route", "expect")}
    plan["nominal"]["turn_back"] = turn
    own = plan["campaign"]
    own["title"] += ", turning back"
    own["success"] = []
    own["disperse"] += [
        {"key": "turn_back.at_m", "acts": "sets", "distribution": "uniform", "lower": 0.0,
         "upper": LEG_M},
        {"key": "turn_back.side", "acts": "sets", "distribution": "choice", "values": [-1, 1]},
    ]  # fmt: skip
    return plan


def stated_count(name, plan, learned, half, extremes, of=None, **arrays):
    """The file of a count of such extremes, shape (flights, windows, signals, 2), not flown."""
    units = {"from_route": "m", "height": "m"} if of else {"cross_track": "m", "height_err": "m"}
    tables = {
        "format": "flighttune band 2", "units": {"half": "as in signals"}, "of": of,
        "signals": units, "coefficients": np.zeros((1, *half.shape)).tolist(),
        "half": half.tolist(), "predicted_from": None, "learned": learned, **RULE, "fences": [],
        "plan": plan | {"runs": learned + len(extremes)}, "planned": None, "until_sure": False,
        "early": 0, "models": [],
    }  # fmt: skip
    arrays |= {"extremes": extremes.astype(np.float32), "wind": np.zeros((len(extremes), 0))}
    return Opened(tables, arrays, "band", b"").write(folder() / name)


REACH = np.linspace(0.5, 3.0, 12)  # of a dozen flights to either side, m
TURNED = np.linspace(50.5, 90.5, 21)  # of flights that turn back, m; half as much in height


@cache
def stated_band():
    """A band along the leg: flights reach so far to the right at 40 m, half to the left at 80 m."""
    extremes = np.zeros((12, int(LEG_M), 2, 2))
    extremes[:, 40, 0, 1], extremes[:, 80, 0, 0] = REACH, -0.5 * REACH
    extremes[:, 60, 1] = np.outer(REACH, [-0.4, 0.2])  # above and below: errors
    half = np.full((int(LEG_M), 2), [2.0, 1.0])
    numbers = np.outer(np.linspace(0.6, 1.7, 12), [1.0, 2.0, 3.0, 4.0])
    return stated_count("stated.npz", stated_plan(), 30, half, extremes, navigation=numbers,
                        by_rtk=np.outer(np.linspace(0.1, 3.0, 30), [1.0, 0.5]))  # fmt: skip


@cache
def stated_room():
    """The room of flights that turn back on that leg, which take so much of it."""
    extremes = np.zeros((21, 1, 2, 2))
    extremes[:, 0, :, 1] = np.outer(TURNED, [1.0, 0.5])
    return stated_count("stated-turn-back.npz", turning_plan(), 60, np.array([[100.0, 50.0]]),
                        extremes, "turn_back")  # fmt: skip


@cache
def stated_hours():
    """The file of the exits per flight hour of the mission as if none had left: none was flown."""
    tables = {
        "format": "flighttune flight hours 2", "units": {"volume": "m"}, "confidence": 0.9,
        "rates": tomllib.loads(RATES), "plan": stated_plan(),
        "volume": {"rings": [BOX], "outside": [False], "low": None, "high": None},
        "fence": around_leg(BESIDE_M), "later": [],
        "terms": [stated_term(8), stated_term(6, 0), stated_term(6, 1, 0.5)],
    }  # fmt: skip
    return Opened(tables, {}, "", b"").write(folder() / "stated-per-hour.json")


@cache
def stated_mission():
    """The file of that band in a folder of its own, with the room, its volumes and hours beside."""
    band = folder() / "stated" / "mission.npz"
    band.parent.mkdir()
    shutil.copy(stated_band(), band)
    shutil.copy(stated_hours(), band.with_name("mission-per-hour.json"))
    ft.mission(band).with_room(ft.load(stated_room()))
    return band


T = np.arange(600) / 25.0
NOISES = 0.02, 0.021, 0.02, 0.022, 0.06


@cache
def logs():
    """Logs of 24 s of turns, read from CSV, whose yaw rate has noise of another size in each."""
    rng, made = np.random.default_rng(5), []
    for i, size in enumerate(NOISES):
        phi, p = 0.5 * np.sin(0.7 * T + i), 0.35 * np.cos(0.7 * T + i)
        r = 0.5 * np.sin(phi) + 0.1 * p + size * rng.normal(size=len(T))
        table = {"t_s": T, "phi_rad": phi, "p": p, "r": r, "v_north": 20.0, "v_east": 0.0 * T}
        pd.DataFrame(table).to_csv(folder() / f"{i}.csv", index=False)
        made.append(ft.load_log(folder() / f"{i}.csv"))
    return made


@cache
def log_monitor(number=4):
    """The file of a monitor of the first logs."""
    return saved(ft.monitor(*logs()[:number]), f"logs-{number}.npz")


@cache
def old(name):
    """A file of 0.3.0 as it is written today."""
    return saved(ft.load(OLD / name), f"old-{name}")


def proven(name="law"):
    """The file of a tube that was proven once and is kept."""
    return PROVEN / f"{name}.npz"


# Makers of two honest files of each kind of claim, by the beginning of its format and by what a
# count is of.
KINDS = {
    "flighttune certificate": (lambda: old("certificate.json"),
                               lambda: old("certificate_sampled.json")),
    "flighttune rate bound": (lambda: old("bound.json"), lambda: old("bound.json")),
    "flighttune tube": (lambda: proven("law"), lambda: proven("lags")),
    "flighttune band": (band, lambda: band(ALONE)),
    "flighttune band of residual": (residual, lambda: residual(2)),
    "flighttune band of turn_back": (room, room),
    "flighttune band of monitor": (monitor, lambda: monitor(2)),
    "flighttune monitor": (log_monitor, lambda: log_monitor(3)),
    "flighttune flight hours": (hours, hours),
}  # fmt: skip

# Kinds that an aircraft flies for: their tests are slow.
FLOWN = {"flighttune band of turn_back", "flighttune flight hours"}
