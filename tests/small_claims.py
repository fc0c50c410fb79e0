"""Small claims of every kind: flown or proven once in a session, and their files."""

import json
import tempfile
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from flown_campaigns import flown_here
from forging import Opened

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
STRAIGHT |= {"route.wind_mps": 2.0}  # turning back takes less time
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
    """A fence of this half-width around the leg, as GeoJSON: a degree of latitude is 111.2 km."""
    _, (lat, lon), _ = ft.route("circuit", changes=STRAIGHT).where
    north, east = 1.0 / 111_200.0, 1.0 / (111_300.0 * np.cos(np.deg2rad(lat)))
    corners = [(ends_m[i], side * beside_m) for i, side in ((0, -1), (0, 1), (1, 1), (1, -1))]
    ring = [[lon + east * e, lat + north * n] for n, e in [*corners, corners[0]]]
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
def stated_hours():
    """The file of the exits per flight hour of the mission as if none had left: none was flown."""
    plan = ft.flights("circuit_in_wind", changes=STRAIGHT).plan(kind="jsbsim")
    tables = {
        "format": "flighttune flight hours 2", "units": {"volume": "m"}, "confidence": 0.9,
        "rates": tomllib.loads(RATES), "plan": plan.of_group(plan.groups[0]).as_dict(),
        "volume": {"rings": [BOX], "outside": [False], "low": None, "high": None},
        "fence": around_leg(BESIDE_M), "later": [],
        "terms": [stated_term(8), stated_term(6, 0), stated_term(6, 1, 0.5)],
    }  # fmt: skip
    return Opened(tables, {}, "", b"").write(folder() / "stated-per-hour.json")


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
