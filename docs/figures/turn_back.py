"""Print numbers of docs/missions.md: python docs/figures/turn_back.py FOLDER FLIGHTS [ROUTE ...].

Counts the room to turn back of five routes with `flighttune mission`, unless FOLDER has its files.
Then flies so many FLIGHTS of another seed, each from a random place in the flight geography, and
judges them by the areas and heights of the written GeoJSON.
"""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from geographiclib.geodesic import Geodesic
from shapely import LineString, Polygon

from flighttune.campaigns.flying.rows import fly_group
from flighttune.claims.band import Band
from flighttune.claims.counted_file import load_counted
from flighttune.claims.counted_flights import plan_in
from flighttune.claims.turn_back import TurnBack
from flighttune.flight.scenario.load import scenario_of

SCENARIOS = Path(__file__).parents[2] / "scenarios"
MORE = ("--flights", "208")  # of the X8 more flights are lost than 93 allow
# The braking of the law, 0.5: flights were counted before the scenario stated 0.25.
BRAKING = ("--set", 'law="exact"')
CLAIM = ("--epsilon", "0.05")
EXACT = ("--navigation", "exact")  # as the page says: the room, without errors of the place
ROUTES = {
    "circuit_in_wind": ("circuit_in_wind", "--turn-back", "30"),
    "approach.plan": (str(SCENARIOS / "approach.plan"), "--turn-back", "30"),
    "survey.plan": (str(SCENARIOS / "survey.plan"), "--turn-back", "30"),
    "circuit_in_wind_c172p": ("circuit_in_wind_c172p", "--turn-back", "circle:30", *BRAKING),
    "circuit_in_wind_x8": ("circuit_in_wind_x8", "--turn-back", "30", *MORE),
}
SEED = 20_261_125
VOLUMES = "flight geography", "contingency volume", "ground risk buffer"


def flat(lon_lat, origin):
    """North and east, m, of longitudes and latitudes in deg: along geodesics from an origin."""
    lines = [Geodesic.WGS84.Inverse(*origin, lat, lon) for lon, lat, *_ in lon_lat]
    s, azimuth = np.array([(line["s12"], np.radians(line["azi1"])) for line in lines]).T
    return np.column_stack([s * np.cos(azimuth), s * np.sin(azimuth)])


def judged(name: str, folder: Path, flights: int) -> str:
    """One row of the table."""
    stem = folder / Path(name).stem
    band, file = stem.with_suffix(".npz"), folder / f"{stem.name}-turn-back.npz"
    if not file.exists():
        program = Path(sys.executable).with_name("flighttune")
        subprocess.run(
            [program, "mission", *ROUTES[name], *EXACT, *CLAIM, "--out", band, "--workers", "1"],
            check=True,
        )
    room, corridor = load_counted(file), load_counted(band)
    assert isinstance(room, TurnBack)
    assert isinstance(corridor, Band)
    route = folder / f"{stem.name}-route.geojson"
    corridor.flights.route.save(route)
    path = np.array(json.loads(route.read_text())["features"][0]["geometry"]["coordinates"])
    origin = path[0, 1], path[0, 0]
    line, ground = flat(path, origin), corridor.flights.scenario.flight.ground_m
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
    along *= corridor.flights.route.length / along[-1]
    volumes = {}
    for feature in json.loads(stem.with_suffix(".geojson").read_text())["features"]:
        rings = [flat(ring, origin) for ring in feature["geometry"]["coordinates"]]
        volumes[feature["properties"]["name"]] = Polygon(rings[0], rings[1:]), feature["properties"]
    for area, _ in volumes.values():
        shapely.prepare(area)
    width = volumes[VOLUMES[0]][1]["width_m"]
    plan = plan_in(room.about.plan)
    plan = replace(plan, campaign=plan.campaign.model_copy(update={"seed": SEED})).with_runs(
        flights
    )
    rng, left, far, lost = np.random.default_rng(SEED), dict.fromkeys(VOLUMES[1:], 0), [], 0
    for run in range(flights):
        scenario = plan.scenario_of(run)
        flown = fly_group(plan, scenario, plan.groups[0])
        if flown.status != "completed":
            lost += 1
            continue
        turn = scenario_of(flown).turn_back  # it may have begun in level flight
        assert turn is not None  # each of these flights turns back
        signals = flown.signals[["north", "east", "down"]].to_numpy()[flown.t >= turn.found_s]
        beside, bearing = width * np.sqrt(rng.random()), rng.uniform(0.0, 2.0 * np.pi)
        place = [np.interp(turn.at_m, along, x) for x in (*line.T, path[:, 2])]
        places = place + (signals - signals[0]) * (1.0, 1.0, -1.0)
        far.append(shapely.distance(LineString(line), shapely.points(places[::10, :2])).max())
        places[:, :2] += beside * np.array([np.cos(bearing), np.sin(bearing)])
        for volume in left:
            area, sizes = volumes[volume]
            over = places[:, 2] - ground
            high = over <= sizes["max_over_ground_m"]
            inside = shapely.contains_xy(area, *places[:, :2].T) & high
            left[volume] += not (inside & (over >= sizes["min_over_ground_m"])).all()
    shares = [f"{count + lost} ({100 * (count + lost) / flights:.1f} %)" for count in left.values()]
    cells = (
        f"`{name}`",
        ROUTES[name][2],
        f"{room.room.from_route:.0f} m, {room.room.height:.0f} m",
        len(room.scores),
        f"{np.median(far):.0f} m, {max(far):.0f} m",
        *shares,
    )
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    for name in sys.argv[3:] or ROUTES:
        print(judged(name, folder, int(sys.argv[2])), flush=True)
