"""Room to turn back: flights that turn back at any place of a route, and the volumes around it."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pandas as pd
import pytest
from commands import answer, flighttune
from geographiclib.geodesic import Geodesic
from made_up import scenario_file, shortened
from made_up_band import count_of
from plans import item, plan_file, waypoint
from scipy.integrate import cumulative_trapezoid
from scipy.stats import binom
from shapely import LineString, Polygon, distance, points
from shapely.affinity import translate
from shapely.geometry import shape

import flighttune as ft
from flighttune.campaigns.flying.rows import fly_group
from flighttune.claims import counted_flights
from flighttune.claims.counting import drawn
from flighttune.claims.mission import MissionOdds
from flighttune.claims.turn_back import TurnBack, TurnRoom
from flighttune.flight.scenario.load import scenario_of
from flighttune.outputs.answers.band import lines
from flighttune.routes.volumes import Volume, VolumesMap

BANK, SPEED, G = 30.0, 25.0, 9.81

# m: the law follows a rolled-in ramp within some tenths of a degree
FLOWN = 1.5

# of the area within a width of a leg, whose round ends are polygons of 64 corners
ROUND = 0.01

# m/s: airspeed in turbulence
SPEEDS = 1.0

# m: latitudes and longitudes are written with eight digits
WRITTEN = 0.002

# m: a climb is rounded within its ends
CLIMBS = 0.3

# s and m: path angles change within seconds
ON_SLOPE, HEIGHTS = 2.5, 5.0

FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}


@pytest.fixture
def few_learned(monkeypatch):
    """A shape of ten flights is as wide as fresh ones make it, as one of many."""
    for name in ("LEARN", "LEARN_TURNS"):
        monkeypatch.setattr(f"flighttune.claims.mission.{name}", 10)


def turned_back(plan, bank=BANK):
    """The plan of flights that turn back with this bank at any place of a route."""
    return counted_flights.turning_back(plan, bank)


@pytest.fixture(scope="module")
def turning():
    return turned_back(ft.flights("circuit").plan(plant="kinematic", gains="paper"))


def flown(turning, **values):
    """One flight of the law that turns back, in still air, and its table."""
    tables = turning.scenario.as_dict()
    tables["turn_back"] |= values
    scenario = ft.scenario_from(tables)
    (run,) = ft.fly(scenario, gains=["paper"]).runs[:1]
    assert run.status == "completed"
    return run, scenario.turn_back


@pytest.mark.slow
def test_the_wind_of_a_turn_follows_from_its_bank_and_rates(turning):
    turn_back = turning.scenario.turn_back
    steeper = turn_back.model_copy(update={"bank_deg": 45.0})
    fastest = SPEED + ft.route("circuit").wind

    assert turn_back.wind(G) == pytest.approx(fastest - SPEED, abs=0.01)
    # the tangent of 45 deg is 3^0.5 times that of 30 deg
    assert steeper.wind(G) == pytest.approx(3.0**0.5 * fastest - SPEED, abs=0.01)


@pytest.mark.slow
def test_the_formula_of_a_route_is_that_of_its_largest_airspeed(turning):
    """The way of the reaction and the radius of the turn, 30 m/s in both."""
    turn_back = turning.scenario.turn_back
    central = SimpleNamespace(airspeeds=(20.0, 30.0, 25.0), flight=SimpleNamespace(g_mps2=G))
    room = SimpleNamespace(table=turn_back, flights=SimpleNamespace(central=central))

    radius = 30.0**2 / (G * np.tan(np.deg2rad(BANK)))
    expected = 30.0 * turn_back.reaction_s + radius
    assert TurnBack._formula.fget(room) == pytest.approx(expected)


@pytest.mark.soak
@pytest.mark.parametrize("side", [-1, pytest.param(1, marks=pytest.mark.counts)])
def test_a_flight_comes_as_far_as_its_course_says(turning, side):
    """From the first leg, to the north: the integral of the speed, for a rate that rises in 1 s."""
    run, turn_back = flown(turning, at_m=200.0, side=side)
    rate = np.deg2rad(turn_back.place[0].back_dps)
    t = np.linspace(0.0, 25.0, 25_001)
    rising = np.clip((t - 1.0) / 1.0, 0.0, 1.0) * rate
    course = np.clip(cumulative_trapezoid(rising, t, initial=0.0), 0.0, np.pi)
    north = 200.0 + cumulative_trapezoid(SPEED * np.cos(course), t, initial=0.0)
    east = side * cumulative_trapezoid(SPEED * np.sin(course), t, initial=0.0)
    path = ft.route("circuit").reference.path
    line = LineString(np.column_stack([path.north, path.east])[path.s <= path.length])
    across = distance(line, points(north, east)).max()

    room = counted_flights.room_of(run, turn_back)[-1]

    # the bank is reached in the wind of the plan from behind
    fastest = SPEED + ft.route("circuit").wind
    assert rate * fastest / G == pytest.approx(np.tan(np.deg2rad(BANK)), rel=0.01)
    assert room[0] == pytest.approx(across, abs=FLOWN)
    assert room[1] < FLOWN
    turned = np.rad2deg(run.signals["chi"].iloc[-1] - run.signals["chi"].iloc[0])
    assert turned == pytest.approx(180.0 * side, abs=1.0)


def test_a_flight_turns_and_climbs_as_its_route_does_until_it_turns_back(turning):
    route = ft.route("circuit").reference.path
    turn = next(stretch for stretch in route.stretches if stretch.kind == "turn")
    place = round(turn.start + 0.5 * turn.length)
    run, _ = flown(turning, at_m=float(place), side=1)
    t, chi = run.t, run.signals["chi"].to_numpy()

    before = (t > 8.0) & (t < 10.0)
    rate = np.polyfit(t[before], chi[before], 1)[0]
    assert rate == pytest.approx(route.curvature[place] * SPEED, rel=0.02)
    course = np.interp(10.0, t, chi) - route.course[place]
    assert np.rad2deg((course + np.pi) % (2.0 * np.pi) - np.pi) == pytest.approx(0.0, abs=1.0)


def test_a_circle_turns_once(turning):
    circling = turned_back(
        ft.flights("circuit").plan(plant="kinematic", gains="paper"), f"circle:{BANK}"
    )
    run, _ = flown(circling, at_m=200.0)

    assert np.rad2deg(np.ptp(run.signals["chi"])) == pytest.approx(360.0, abs=1.0)


@pytest.mark.parametrize(("at_m", "sign"), [(500.0, 1.0), (900.0, 1.0), (900.0, -1.0)])
def test_a_flight_from_level_flight_is_on_the_slope_as_long_as_on_its_route(at_m, sign):
    """By hand: 300 m level, then a leg of 7 in 100."""
    corners = [(0.0, 0.0), (300.0, 0.0), (1300.0, 70.0 * sign)]
    waypoints = [{"north_m": n, "east_m": 0.0, "up_m": up} for n, up in corners]
    changes = {"route.waypoint": waypoints, "flight.h_m": 1100.0}
    plan = turned_back(
        ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")
    )
    steady, run = flown(plan, at_m=at_m), flown(plan, at_m=at_m, sloped_s=(at_m - 300.0) / SPEED)
    rooms, (run, table) = [counted_flights.room_of(*steady), counted_flights.room_of(*run)], run

    found = int(np.searchsorted(run.t, table.found_s))
    gamma = np.rad2deg(run.signals["gamma"].to_numpy())
    slope = sign * np.rad2deg(np.arctan(0.07))
    assert gamma[0] == pytest.approx(0.0, abs=1e-6)
    assert gamma[found] == pytest.approx(slope, abs=0.1)
    half = np.abs(gamma[: found + 1]) > 0.5 * abs(slope)
    sloped = np.sum(half) / (len(half) - 1) * run.t[found]
    assert sloped == pytest.approx((at_m - 300.0) / SPEED, abs=ON_SLOPE)
    h = 1100.0 + 0.07 * sign * (at_m - 300.0)
    assert table.here[5] == pytest.approx(h, abs=CLIMBS)
    start = scenario_of(run).flight.h_m
    assert start - run.signals["down"].to_numpy()[found] == pytest.approx(h, abs=HEIGHTS)
    # the point mass has one airspeed: it needs the same room, and in the same samples
    assert rooms[1] == pytest.approx(rooms[0], abs=FLOWN)
    assert np.rad2deg(np.ptp(run.signals["chi"])) == pytest.approx(180.0, abs=1.0)


def test_only_flights_of_a_route_with_slopes_may_begin_level():
    def start(up):
        legs = [{"north_m": n, "east_m": 0.0, "up_m": up * n} for n in (0.0, 800.0)]
        plan = ft.flights("circuit", changes={"route.waypoint": legs}).plan(
            plant="kinematic", gains="paper"
        )
        return turned_back(plan).as_dict()["nominal"]["turn_back"].get("or_level")

    assert [start(0.0), start(0.02)] == [None, True]


@pytest.fixture(scope="module")
def steep(tmp_path_factory):
    """A leg down by 6 deg, on which the Aerosonde gets faster at a closed throttle."""
    up = np.tan(np.deg2rad(6.0)) * 900.0
    legs = [(0.0, up), (200.0, up), (1100.0, 0.0), (1300.0, 0.0)]
    north = (Geodesic.WGS84.Direct(47.4, 8.5, 0.0, s)["lat2"] for s, _ in legs)
    rows = [waypoint(lat, 8.5, 80.0 + h) for lat, (_, h) in zip(north, legs, strict=True)]
    return plan_file(tmp_path_factory.mktemp("steep") / "down.plan", *rows)


@pytest.mark.slow
def test_a_flight_without_steady_flight_comes_to_its_place_as_its_mission_does(steep):
    mission = drawn(ft.flights(steep, aircraft="aerosonde"), air="wind")
    plan = turned_back(mission)
    values = {**plan.values_of(0), "turn_back.at_m": 950.0}
    scenario = plan.dispersed(values, 0)
    back = fly_group(plan, scenario, plan.groups[0])
    begun = scenario_of(back).turn_back
    of_mission = {k: v for k, v in values.items() if not k.startswith("turn_back.")}
    whole = fly_group(
        mission, mission.dispersed(mission.values_of(0) | of_mission, 0), mission.groups[0]
    )

    assert (back.status, whole.status) == ("completed", "completed")
    slope = whole.t[whole.signals["along"].between(200.0, 950.0)]
    assert begun.sloped_s == pytest.approx(np.ptp(slope), abs=ON_SLOPE)
    around = np.abs(whole.signals["along"] - 950.0) < 2.0 * SPEED
    there = np.abs(back.t - begun.found_s) < 2.0
    V = whole.signals["V_a"][around].mean()
    assert V > SPEED + SPEEDS  # it got faster
    assert back.signals["V_a"].to_numpy()[there].mean() == pytest.approx(V, abs=SPEEDS)
    h = scenario_of(back).flight.h_m - back.signals["down"].to_numpy()[there].mean()
    assert h == pytest.approx(begun.here[5], abs=HEIGHTS)


@pytest.mark.slow
def test_flights_of_older_files_begin_in_steady_flight_and_those_that_have_one_stay_the_same(steep):
    """Files of flighttune 0.4.0 do not have the key."""
    plan = turned_back(ft.flights(steep, aircraft="aerosonde").plan(kind="jsbsim"))

    def runs(at_m):
        now = plan.dispersed({**plan.values_of(0), "turn_back.at_m": at_m}, 0)
        tables = now.as_dict()
        del tables["turn_back"]["or_level"]
        return [fly_group(plan, x, plan.groups[0]) for x in (ft.scenario_from(tables), now)]

    assert [run.status for run in runs(950.0)] == ["no_trim", "completed"]
    pd.testing.assert_frame_equal(*(run.signals for run in runs(100.0)), check_exact=True)


@pytest.mark.counts
@pytest.mark.usefixtures("few_learned")
def test_the_room_of_a_mission_with_a_steep_leg_is_claimed_of_all_its_flights(steep, tmp_path):
    few = ("--epsilon", 0.3, "--confidence", 0.9, "--flights", 9)
    out = tmp_path / "d.npz"
    told = answer(
        "mission", steep, "--aircraft", "aerosonde", "--turn-back", 30, *few, "--out", out
    )
    room = ft.load(told["room"])

    assert room.claims
    assert not room.endings
    plan = counted_flights.plan_in(room.about.plan).with_runs(int(room.draws[-1]) + 1)
    runs = (fly_group(plan, plan.scenario_of(x), plan.groups[0]) for x in room.draws.tolist())
    assert any(scenario_of(run).turn_back.sloped_s is not None for run in runs)
    condition = "or, where there is none on a slope, in level flight before it"
    assert condition in told["turn_back"]["sentence"]
    assert condition in room.summary
    assert answer("verify", told["room"])["valid"]


def test_draws_are_at_all_places_and_to_both_sides(turning):
    values = turning.parameters(0, 400)

    length = ft.route("circuit").length
    assert set(values["turn_back.side"]) == {-1, 1}
    counts, _ = np.histogram(values["turn_back.at_m"], bins=4, range=(0.0, length))
    assert counts.min() > 60


@pytest.mark.parametrize(
    ("source", "turn_back", "says"),
    [
        ("circuit", "spiral:30", "`turn_back` must be a bank in deg, or circle:BANK"),
        ("circuit", 70, "`turn_back` must be a bank of 1 to 45 deg, got 70"),
        ("mission", 30, "`route` must be given"),
    ],
)
def test_what_cannot_turn_back_is_refused_in_one_line(source, turn_back, says):
    with pytest.raises(ft.InputError, match=says) as refusal:
        ft.mission(source, turn_back=turn_back)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("low", "high"), [(45.0, 50.0), (50.0, 45.0)])
def test_the_side_that_allows_less_bank_and_roll_rate_holds(low, high):
    changes = {"limits.phi_deg": [-low, high], "limits.phi_rate_dps": [-low, high]}
    plan = ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")

    assert turned_back(plan, 40.0).scenario.turn_back.roll_rate_dps == pytest.approx(45.0)
    with pytest.raises(ft.InputError, match="a bank of 1 to 45 deg, got 47"):
        turned_back(plan, 47.0)


def test_the_areas_are_as_wide_as_they_say_or_wider():
    """By hand: a leg with round ends, and places at the width from it all around."""
    changes = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)]}
    where = ft.route("circuit", changes=changes).where
    volumes = {"a": Volume(50.0, 0.0, 9.0, "x"), "b": Volume(250.0, 0.0, 9.0, "y")}

    written = VolumesMap(where, 0.0, volumes).geojson()
    areas = [x["geometry"] for x in json.loads(written)["features"]]
    inner, outer = map(shape, areas)
    assert outer.contains(inner)
    for area, width in ((inner, 50.0), (outer, 250.0)):
        polygon = Geodesic.WGS84.Polygon()
        for lon, lat in area.exterior.coords[:-1]:
            polygon.AddPoint(lat, lon)
        size = abs(polygon.Compute()[2])
        assert size == pytest.approx(2.0 * width * 800.0 + np.pi * width**2, rel=ROUND)
        for bearing in np.arange(0.0, 180.0):
            south = Geodesic.WGS84.Direct(*where[1], 90.0 + bearing, width - WRITTEN)
            assert area.contains(points(south["lon2"], south["lat2"]))


def test_volumes_are_written_in_decimetres_and_not_smaller():
    where = ft.route("circuit").where
    written = VolumesMap(where, 0.0, {"a": Volume(50.02, 3.58, 9.01, "x")}).geojson()

    sizes = json.loads(written)["features"][0]["properties"]
    assert (sizes["width_m"], sizes["min_over_ground_m"], sizes["max_over_ground_m"]) == (
        50.1, 3.5, 9.1,
    )  # fmt: skip


def test_the_room_is_around_the_flight_geography_down_to_the_ground():
    room = TurnRoom(from_route=300.0, height=6.0)

    assert room.around(Volume(10.0, 95.0, 130.0, ""), "new") == (310.0, 89.0, 136.0, "new")
    assert room.around(Volume(10.0, 4.0, 130.0, ""), "").low == 0.0


def test_a_climb_and_a_descent_after_detection_both_take_room(turning):
    table = turning.scenario.turn_back
    t = table.detected_s + np.array([-1.0, 0.0, 1.0, 2.0])
    for sign in (1.0, -1.0):
        down = sign * np.array([50.0, 0.0, -7.0, 3.0])
        signals = pd.DataFrame({"north": 0.0, "east": 0.0, "down": down})
        room = counted_flights.room_of(SimpleNamespace(t=t, signals=signals), table)
        assert room[:, 1].tolist() == [0.0, 0.0, 7.0, 7.0]


def count_on(kind, plan, away, middle=0.0):
    """A count of seven flights that come this far to either side of a middle, m."""
    measured, plan = kind.measures.chosen(plan, None), plan.with_runs(17)
    few = {"epsilon": 0.3, "confidence": 0.9}
    return count_of(kind, plan, measured, away, np.ones(7), middle, **few)


@pytest.mark.parametrize(
    ("away", "middle"),
    [([5.0, 2.0], (0.0, 0.0)), ([3.0, 1.5], (2.0, 0.5)), ([3.0, 1.5], (-2.0, -0.5))],
)
def test_volumes_are_over_the_ground_and_their_room_is_in_whole_metres(away, middle):
    """The start is 100 m above the ground, and the route climbs by 20 m.

    The flights come 5 m to a side and 2 m up or down, at most.
    """
    waypoints = [{"north_m": n, "east_m": 0.0, "up_m": n / 40.0} for n in (0.0, 800.0)]
    changes = {"route.waypoint": waypoints, "flight.ground_m": 900.0}
    plan = ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")
    corridor = count_on(ft.Band, plan, away, middle)
    room = count_on(TurnBack, turned_back(plan), [271.2, 3.4])

    assert "at most 5 m wide to either side of the path, and 2 m high" in lines(corridor)[1]
    said = MissionOdds(band=corridor, room=room, files={}).answer()
    assert said.values["confidence"] == pytest.approx(1.0 - 0.1 - 0.1)
    assert "at a confidence of 0.8 for all that is said here" in said.summary[1]
    geography, contingency, buffer = (x[:3] for x in room.volumes(corridor).values())
    assert geography == pytest.approx((5.0, 98.0, 122.0), abs=CLIMBS)
    assert contingency == pytest.approx((277.0, 94.0, 126.0), abs=CLIMBS)
    assert buffer == pytest.approx((277.0 + 126.0, 0.0, 126.0), abs=CLIMBS)
    # The guidance of the LBA: 3 m, 3 m, 1 m, a second over ground, at 25 m/s with the route's wind
    # of 11 m/s from behind, and V^2 / (g tan(bank)).
    terms = {row["term"]: row["guideline"] for row in said.values["turn_back"]["terms"]}
    assert [terms[f"S_{x}"] for x in ("GPS", "Pos", "K")] == [3.0, 3.0, 1.0]
    assert terms["S_RZ"] == pytest.approx(36.0)
    assert terms["S_CM"] == pytest.approx(36.0**2 / (9.81 * np.tan(np.deg2rad(BANK))))
    # In height 1 m for a barometer, a climb at 45 deg, and the arc that ends it. The calculators
    # round sqrt(2)/2 to 0.7, and its complement to 0.3.
    rounded = 0.03 * 36.0**2 / 9.81
    assert (terms["H_baro"], terms["H_RZ"]) == (1.0, pytest.approx(36.0 * 0.7))
    assert terms["H_CM"] == pytest.approx(36.0**2 / 9.81 * (1.0 - np.sqrt(0.5)), abs=rounded)
    assert terms["H_CV"] == pytest.approx(terms["H_baro"] + terms["H_RZ"] + terms["H_CM"])
    counted = [row["counted"] for row in said.values["turn_back"]["terms"]]
    # It knows its place exactly; the sums are the sizes of the contingency volume.
    assert counted[:6] == [0.0, pytest.approx(5.0), None, None, 272.0, pytest.approx(277.0)]
    assert counted[6:] == [
        pytest.approx(2.0, abs=CLIMBS),
        None,
        4.0,
        pytest.approx(6.0, abs=CLIMBS),
    ]
    # a corridor that reaches the ground ends there
    high = count_on(ft.Band, plan, [5.0, 150.0])
    assert [x.low for x in room.volumes(high).values()] == [0.0, 0.0, 0.0]
    with mock.patch.object(TurnBack, "largest_dimension", 40.0):
        geography, contingency, buffer = room.volumes(corridor).values()
    assert (geography.width, geography.high - geography.low) == (60.0, 120.0)
    # as wide as the contingency volume is high, and half of the largest dimension
    assert buffer.width - contingency.width == pytest.approx(contingency.high + 20.0)


def test_a_corridor_names_the_errors_of_navigation_in_it():
    waypoints = [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)]
    flights = ft.flights("circuit", changes={"route.waypoint": waypoints}).knowing("standard")
    plan = flights.plan(plant="kinematic", gains="paper")
    corridor, room = (
        count_on(ft.Band, plan, [50.0, 20.0]), count_on(TurnBack, turned_back(plan), [90.0, 3.0])
    )  # fmt: skip
    counted = len(corridor.scores)
    # m, of each flight: errors of its place, then how far off it sees itself
    reach = np.linspace((1.0, 2.0, 0.1, 0.2), (7.0, 30.0, 0.8, 0.9), counted)

    said = lines(replace(corridor, navigation=reach))[1]

    # as many flights as inside; the corridor holds the errors with which it is flown
    beside, above, *seen = reach[counted - corridor.outside - 1].tolist()
    parts = re.findall(r"reach ([\d.]+) m", said)
    assert parts == [f"{beside:.2g}", f"{min(above, 20.0):.2g}"]
    assert f"errors of at most {seen[0]:.2g} m and {seen[1]:.2g} m" in said
    assert said.endswith("for 95 % of the time once it has joined the path.")
    assert "reach" not in lines(corridor)[1]  # a file of 0.4.0 has none
    # the width of the corridor is their sum with what is left for holding the path
    for factor, navigation in ((1.0, beside), (20.0, 50.0)):
        terms = room.terms(replace(corridor, navigation=factor * reach))
        shares = [row["counted"] for row in terms[:2]]
        assert shares == pytest.approx([navigation, 50.0 - navigation], rel=1e-5)


@pytest.mark.counts
@pytest.mark.usefixtures("few_learned")
def test_fresh_flights_keep_to_the_volume_that_is_written():
    """Flights of another seed from the edge of the flight geography, put on the route by hand."""
    corners = [(0.0, 0.0, 0.0), (400.0, 0.0, 20.0), (400.0, 450.0, 20.0)]
    waypoints = [{"north_m": n, "east_m": e, "up_m": up} for n, e, up in corners]
    changes = {"route.waypoint": waypoints, "flight.ground_m": 900.0, "flight.duration_s": 40.0}
    few = {"plant": "kinematic", "gains": "paper", "learn": 10, "workers": 1, "changes": changes}
    corridor = ft.band("circuit", start_deg=1.0, epsilon=0.1, confidence=0.9, flights=22, **few)
    room = ft.mission(corridor, turn_back=BANK, epsilon=0.1, confidence=0.9).room
    volumes, where = room.volumes(corridor), corridor.flights.route.where
    contingency = json.loads(VolumesMap(where, 0.0, volumes).geojson())["features"][1]
    assert contingency["properties"]["name"] == "contingency volume"
    (ring,) = contingency["geometry"]["coordinates"]
    lines = [Geodesic.WGS84.Inverse(*where[1], lat, lon) for lon, lat in ring]
    s, azimuth = np.array([(line["s12"], np.deg2rad(line["azi1"])) for line in lines]).T
    area = Polygon(np.column_stack([s * np.cos(azimuth), s * np.sin(azimuth)]))

    bounds = corridor.bounds(corridor.flights.edges[:-1])
    width, above = np.abs([bounds.low, bounds.high]).max(axis=(0, 1))
    high, low = 100.0 + 20.0 + above, 100.0 - above  # the start is 100 m above the ground
    assert volumes["flight geography"][:3] == pytest.approx((width, low, high), abs=CLIMBS)
    written = [contingency["properties"][f"{end}_over_ground_m"] for end in ("min", "max")]
    height = room.room.height
    assert written == pytest.approx([low - height, high + height], abs=CLIMBS)

    path, fresh, left, by_ahead = where[0], 20, 0, 0
    line = LineString(np.column_stack([path.north, path.east])[path.s <= path.length])
    plan = counted_flights.plan_in(room.about.plan)
    plan = replace(plan, campaign=plan.campaign.model_copy(update={"seed": 5}), runs=fresh)
    edge = [(width * np.cos(x), width * np.sin(x)) for x in np.arange(0.0, 2.0 * np.pi, 0.5)]
    for run in range(fresh):
        scenario = plan.scenario_of(run)
        signals = fly_group(plan, scenario, plan.groups[0]).signals.loc[10.0:]
        positions = signals[["north", "east", "down"]].to_numpy()
        north, east, down = (positions - positions[0]).T
        place = line.interpolate(scenario.turn_back.at_m)
        flown = LineString(np.column_stack([north + place.x, east + place.y]))
        inside = all(area.contains(translate(flown, *offset)) for offset in edge)
        left += not (inside and np.abs(down).max() <= height)
        chi = signals["chi"].iloc[0]
        ahead = (north * np.cos(chi) + east * np.sin(chi)).max()
        by_ahead += not line.buffer(width + ahead).contains(flown)
    assert left <= binom.ppf(0.999, fresh, 0.1)
    assert by_ahead > 0.5 * fresh  # a distance ahead is no width


@pytest.mark.soak
def test_a_flight_turns_back_at_the_airspeed_of_its_place(tmp_path):
    """Three legs at 20, 27 and 23 m/s; the wind of the plan is 9 m/s, a third of the largest."""
    speed = partial(item, 178, 0, frame=2)
    file = plan_file(
        tmp_path / "m.plan", speed(20, -1, 0, 0, 0, 0), waypoint(47.4, 8.5, 60),
        waypoint(47.406, 8.5, 80), speed(27, -1, 0, 0, 0, 0), waypoint(47.406, 8.508, 80),
        speed(23, -1, 0, 0, 0, 0), waypoint(47.4, 8.508, 60),
    )  # fmt: skip
    plan = turned_back(ft.flights(file).plan())
    route = ft.route(file).reference
    for at_m, stated in ((300.0, 20.0), (1150.0, 27.0), (1700.0, 23.0)):  # legs of some 600 m
        V = float(np.interp(at_m, route.path.s, route.V))
        assert V == pytest.approx(stated, abs=SPEEDS)
        scenario = plan.dispersed({**plan.values_of(0), "turn_back.at_m": at_m}, 0)
        run = fly_group(plan, scenario, plan.groups[0])
        back = run.t >= scenario.turn_back.detected_s
        assert run.signals["V_a"][back].iloc[:50].mean() == pytest.approx(V, abs=SPEEDS)
        rate = scenario.turn_back.here[-1]
        assert np.deg2rad(rate) * (V + 9.0) / G == pytest.approx(np.tan(np.deg2rad(BANK)), rel=0.01)
    assert "at 20 to 27 m/s" in counted_flights.distribution_of(
        plan.campaign, plan.groups[0].plant
    ).sentence("x")


def test_a_count_of_which_too_many_do_not_complete_claims_no_room_and_is_decided():
    changes = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    plan = ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")
    room = count_on(TurnBack, turned_back(plan), [271.2, 3.4])
    extremes = room.extremes.copy()
    extremes[:3] = np.float32([-np.inf, np.inf])
    ends = zip(room.draws.tolist(), ("no_trim", "ground_contact", "no_trim"), strict=False)
    endings = [{"run": run, "status": status, "reason": "t = 0 s"} for run, status in ends]

    lost = replace(room, extremes=extremes, endings=endings)

    assert (room.claims, room.decided) == (True, False)
    assert (lost.claims, lost.decided) == (False, True)
    assert "takes 272 m beyond the corridor" in room.summary
    said = "of 7 flights that turn back 3 did not complete, 2 of them without a steady flight at"
    assert said in lost.summary
    assert "1 of them ground contact" in lost.summary
    assert lost.summary.endswith("at most 0 of 7 may.")


def test_the_room_of_another_route_or_of_a_distance_ahead_is_refused(tmp_path):
    def plan(*waypoints):
        legs = [{"north_m": north, "east_m": east} for north, east in waypoints]
        changes = {"route.waypoint": legs, "flight.duration_s": 20.0}
        return ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")

    own = plan((0.0, 0.0), (300.0, 0.0))
    room = count_on(TurnBack, turned_back(own), [271.2, 3.4])
    turned = plan((0.0, 0.0), (0.0, 300.0))  # as long, to the east
    longer = plan((0.0, 0.0), (300.0, 0.0), (400.0, 0.0))
    for other, says in ((longer, r"along 300 m .*along 400 m"), (turned, "on one route")):
        with pytest.raises(ft.InputError, match=says):
            room.volumes(count_on(ft.Band, other, [5.0, 2.0]))
    with pytest.raises(ft.InputError, match="got a TurnBack"):
        room.volumes(room)
    lost = replace(room, extremes=np.full_like(room.extremes, np.inf))
    with pytest.raises(ft.InputError, match="got no claim of the room"):
        lost.volumes(count_on(ft.Band, own, [5.0, 2.0]))
    assert {*room.own_values["room"]} == {"from_route_m", "height_m", "by_formula_m"}
    assert {*lost.own_values["room"]} == {"by_formula_m"}

    old = replace(room.about, signals={"ahead": "m", "height": "m"})  # as 0.3.0 wrote it
    replace(room, about=old).save(tmp_path / "old.npz")
    with pytest.raises(ft.InputError, match=r"old.npz: .*with flighttune mission") as refusal:
        ft.load(tmp_path / "old.npz")
    assert "\n" not in str(refusal.value)


@pytest.mark.soak
@pytest.mark.usefixtures("few_learned")
def test_the_command_counts_the_room_and_writes_the_volumes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    leg = {"waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    legs = scenario_file(Path("leg.toml"), shortened("circuit", 13.0), route=leg)
    few = ("--epsilon", 0.3, "--confidence", 0.9, "--flights", 7, "--workers", 1)
    answer(
        "band", legs, "--plant", "kinematic", "--gains", "paper", "--start-deg", 1,
        "--learn", 10, *few, "--out", "b.npz",
    )  # fmt: skip
    told = answer("mission", "b.npz", "--workers=1", "--turn-back", 30, "--page", "p.html")

    # a room is not among the widths of the corridor
    assert [row["signal"] for row in told["half_widths"]] == ["cross_track", "height_err"]
    room, turned = told["turn_back"], ft.load(told["room"])
    from_route = turned.room.from_route
    assert room["room"]["from_route_m"] == from_route
    beyond = f"further than {from_route:.0f} m beyond the flight geography in any direction"
    assert beyond in room["sentence"]
    assert "no risk class" in " ".join(told["notes"])
    areas = [x["properties"] for x in json.loads(Path(told["volumes"]).read_text())["features"]]
    assert Path(told["kml"]) == Path("b.kml")
    drawn = Path("b.kml").read_text()
    assert all(f"<name>{area['name']}</name>" in drawn for area in areas)
    steps = np.diff([area["width_m"] for area in areas])
    assert steps == pytest.approx([from_route, areas[1]["max_over_ground_m"]], abs=0.2)
    assert "contingency volume" in Path("p.html").read_text()
    page = ft.report(told["room"], "room.html").path.read_text()
    assert f"{(turned.scores <= turned.scale).sum()} inside" in page
    assert "largest distance from the route" in page
    assert "A line joins" not in page
    assert answer("verify", told["room"])["valid"]
    old = {file: file.read_bytes() for file in Path().glob("b*") if file.is_file()}
    steep = ft.mission("b.npz", turn_back=45.0, out="other/c.npz", workers=1)
    assert {file: file.read_bytes() for file in old} == old
    assert steep.files["room"] == Path("other/c-turn-back.npz")
    flying = "fly", "paper_as_printed", "--set", "flight.duration_s=1", "--claim", told["room"]
    assert "got a TurnBack" in flighttune(*flying, status=2)[1]


def test_a_room_that_is_not_claimed_is_said_in_the_first_lines_with_how_its_flights_ended():
    changes = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    plan = ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")
    room = count_on(TurnBack, turned_back(plan), [271.2, 3.4])
    odds = MissionOdds(band=count_on(ft.Band, plan, [5.0, 2.0]), room=room, files={})
    extremes = odds.room.extremes.copy()
    extremes[:3] = np.float32([-np.inf, np.inf])
    draws = odds.room.draws[:3].tolist()
    endings = [{"run": x, "status": "no_trim", "reason": "t = 0 s: no steady"} for x in draws]
    lost = replace(odds.room, extremes=extremes, endings=endings)

    said = odds.with_room(lost).answer()

    assert not lost.claims
    flights = len(lost.scores)
    assert any(
        f"No room to turn back is claimed: of {flights} flights that turn back 3 did not complete"
        in line
        and "3 of them without a steady flight at their start" in line
        for line in said.summary[:4]
    )
    table = next(x for x in said.tables if x.name == "turn_back_endings")
    assert [(x["status"], x["count"]) for x in table.records] == [("no_trim", 3)]
    assert said.failure.startswith("room to turn back: nothing is claimed")
