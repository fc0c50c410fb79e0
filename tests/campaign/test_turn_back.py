"""Room to turn back: flights that turn back at any place of a route, and the volumes around it."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import answer, flighttune
from geographiclib.geodesic import Geodesic
from made_up import scenario_file
from scipy.integrate import cumulative_trapezoid
from shapely.geometry import shape

import flighttune as ft
from flighttune.campaign.turn_back import room_of, turning_back
from flighttune.planning.source import flights
from flighttune.references.maps import volumes_geojson

BANK, SPEED, G = 30.0, 25.0, 9.81

# m: the law follows a rolled-in ramp within some tenths of a degree
FLOWN = 1.5

# of the area within a width of a leg, whose round ends are polygons of 64 corners
ROUND = 0.01

FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}


@pytest.fixture(scope="module")
def turning():
    return turning_back(flights("circuit").plan(plant="kinematic"), BANK)


def flown(turning, **values):
    """One flight of the law that turns back, in still air."""
    tables = turning.scenario.as_dict()
    tables["turn_back"] |= values
    (run,) = ft.fly(ft.scenario_from(tables), gains=["paper"]).runs[:1]
    assert run.status == "completed"
    return run


@pytest.mark.parametrize("side", [-1, 1])
def test_a_flight_comes_as_far_as_its_course_says(turning, side):
    """From a straight leg: the integral of the speed along it, for a rate that rises in 1 s."""
    run = flown(turning, at_m=200.0, side=side)
    rate = np.deg2rad(turning.scenario.turn_back.rate_dps)
    t = np.linspace(0.0, 25.0, 25_001)
    rising = np.clip((t - 1.0) / 1.0, 0.0, 1.0) * rate
    course = np.clip(cumulative_trapezoid(rising, t, initial=0.0), 0.0, np.pi)
    ahead = cumulative_trapezoid(SPEED * np.cos(course), t, initial=0.0).max()

    room = room_of(run)[-1]

    # the bank is reached in the wind of the plan from behind
    fastest = SPEED + ft.route("circuit").wind
    assert rate * fastest / G == pytest.approx(np.tan(np.deg2rad(BANK)), rel=0.01)
    assert room[0] == pytest.approx(ahead, abs=FLOWN)
    assert room[1] < FLOWN
    turned = np.rad2deg(run.signals["chi"].iloc[-1] - run.signals["chi"].iloc[0])
    assert turned == pytest.approx(180.0 * side, abs=1.0)


def test_a_flight_turns_and_climbs_as_its_route_does_until_it_turns_back(turning):
    route = ft.route("circuit").reference.path
    turn = next(stretch for stretch in route.stretches if stretch.kind == "turn")
    place = round(turn.start + 0.5 * turn.length)
    run = flown(turning, at_m=float(place), side=1)
    t, chi = run.t, run.signals["chi"].to_numpy()

    before = (t > 8.0) & (t < 10.0)
    rate = np.polyfit(t[before], chi[before], 1)[0]
    assert rate == pytest.approx(route.curvature[place] * SPEED, rel=0.02)
    course = np.interp(10.0, t, chi) - route.course[place]
    assert np.rad2deg((course + np.pi) % (2.0 * np.pi) - np.pi) == pytest.approx(0.0, abs=1.0)


def test_a_circle_turns_once(turning):
    circling = turning_back(flights("circuit").plan(plant="kinematic"), f"circle:{BANK}")
    run = flown(circling, at_m=200.0)

    assert np.rad2deg(np.ptp(run.signals["chi"])) == pytest.approx(360.0, abs=1.0)


def test_draws_are_at_all_places_and_to_both_sides(turning):
    drawn = turning.parameters(0, 400)

    length = ft.route("circuit").length
    assert set(drawn["turn_back.side"]) == {-1, 1}
    counts, _ = np.histogram(drawn["turn_back.at_m"], bins=4, range=(0.0, length))
    assert counts.min() > 60


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"turn_back": "spiral:30"}, "`turn_back` must be a bank in deg, or circle:BANK"),
        ({"turn_back": 70}, "`turn_back` must be a bank of 1 to 45 deg, got 70"),
        ({"turn_back": 30, "start_deg": 2.0}, "`flight.chi_deg` must be the same in all"),
        ({"turn_back": 30, "of": "residual"}, "must be absent for turn back signals"),
        ({"turn_back": 30, "signals": ["chi_err"]}, "must be absent for turn back signals"),
    ],
)
def test_what_cannot_turn_back_is_refused_in_one_line(settings, says):
    with pytest.raises(ft.InputError, match=says) as refusal:
        ft.band("circuit", plant="kinematic", gains="paper", **FEW, **settings)
    assert "\n" not in str(refusal.value)


def test_a_scenario_over_time_has_no_place_to_turn_back_from():
    with pytest.raises(ft.InputError, match="`route` must be given"):
        ft.band("mission", turn_back=30, **FEW)


def test_the_areas_are_as_wide_as_they_say():
    changes = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)]}
    where = ft.route("circuit", changes=changes).where
    text = volumes_geojson(where, {"a": (50.0, 0.0, 9.0, "x"), "b": (250.0, 0.0, 9.0, "y")})

    areas = [feature["geometry"] for feature in json.loads(text)["features"]]
    inner, outer = map(shape, areas)
    assert outer.contains(inner)
    for area, width in zip((inner, outer), (50.0, 250.0), strict=True):
        polygon = Geodesic.WGS84.Polygon()
        for lon, lat in area.exterior.coords[:-1]:
            polygon.AddPoint(lat, lon)
        size = abs(polygon.Compute()[2])
        assert size == pytest.approx(2.0 * width * 800.0 + np.pi * width**2, rel=ROUND)


def test_the_room_of_another_route_is_refused():
    few = {"plant": "kinematic", "gains": "paper", **FEW}
    flight = {"flight.duration_s": 60.0}
    legs = [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)]
    room = ft.band("circuit", turn_back=30, changes={"route.waypoint": legs} | flight, **few)
    longer = {"route.waypoint": [*legs, {"north_m": 900.0, "east_m": 0.0}]} | flight
    corridor = ft.band("circuit", start_deg=1.0, changes=longer, **few)

    with pytest.raises(ft.InputError, match=r"along 800 m .*along 900 m"):
        room.volumes(corridor)


@pytest.mark.slow
def test_the_command_counts_the_room_and_writes_the_volumes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    circuit = ft.load_scenario("circuit")
    two_legs = {"waypoint": circuit.as_dict()["route"]["waypoint"][:3]}
    legs = scenario_file(Path("two_legs.toml"), circuit, route=two_legs, expect=[])
    few = ("--epsilon", 0.3, "--confidence", 0.9, "--flights", 7, "--workers", 1)
    told = answer(
        "band", legs, "--plant", "kinematic", "--gains", "paper", "--start-deg", 1,
        "--learn", 10, *few, "--turn-back", 30, "--page", "p.html",
    )  # fmt: skip

    room = told["turn_back"]
    ahead = ft.load_claim(told["room"]).room[0]
    assert room["room"]["ahead_m"] == pytest.approx(ahead)
    assert f"at most {ahead:.0f} m ahead" in room["sentence"]
    assert "no risk class" in " ".join(told["notes"])
    areas = json.loads(Path(told["volumes"]).read_text())["features"]
    widths = [area["properties"]["width_m"] for area in areas]
    assert widths[1] - widths[0] == pytest.approx(ahead, abs=0.2)
    assert widths[2] - widths[1] == pytest.approx(areas[1]["properties"]["max_over_ground_m"])
    assert "contingency volume" in Path("p.html").read_text()
    assert answer("verify", told["room"])["valid"]
    assert (
        "turns back, and no recorded"
        in flighttune("fly", "paper", "--claim", told["room"], status=2)[1]
    )
