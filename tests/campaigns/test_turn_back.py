"""Room to turn back: flights that turn back at any place of a route, and the volumes around it."""

import json

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from made_up_band import count_of
from scipy.integrate import cumulative_trapezoid
from scipy.stats import binom
from shapely import LineString, Polygon, distance, points
from shapely.affinity import translate
from shapely.geometry import shape

import flighttune as ft
from flighttune.claims import counted_flights
from flighttune.claims.turn_back import TurnBack
from flighttune.routes.volumes import Volume, VolumesMap

BANK, SPEED, G = 30.0, 25.0, 9.81
FEW = {"epsilon": 0.3, "confidence": 0.9}

# m: the law follows a rolled-in ramp within some tenths of a degree
FLOWN = 1.5

# of the area within a width of a leg, whose round ends are polygons of 64 corners
ROUND = 0.01

# m: latitudes and longitudes are written with eight digits
WRITTEN = 0.002

# m: a climb is rounded within its ends
CLIMBS = 0.3

# s and m: path angles change within seconds
ON_SLOPE, HEIGHTS = 2.5, 5.0


def plan_along(*corners, **changes):
    """Flights of the law along a route; without corners along that of the circuit."""
    keys = "north_m", "east_m", "up_m"
    legs = [dict(zip(keys, corner, strict=False)) for corner in corners]
    changes |= {"route.waypoint": legs} if legs else {}
    return ft.flights("circuit", changes=changes).plan(plant="kinematic", gains="paper")


def turned_back(plan, bank=BANK):
    """The plan of flights that turn back with this bank at any place of a route."""
    return counted_flights.turning_back(plan, bank)


@pytest.fixture(scope="module")
def turning():
    return turned_back(plan_along())


def flown(turning, **values):
    """One flight of the law that turns back, in still air, and its table."""
    tables = turning.scenario.as_dict()
    tables["turn_back"] |= values
    scenario = ft.scenario_from(tables)
    (run,) = ft.fly(scenario, gains=["paper"]).runs[:1]
    assert run.status == "completed"
    return run, scenario.turn_back


# ---------------------------------------------------------------- flights that turn back
def test_the_wind_of_a_turn_follows_from_its_bank_and_rates(turning):
    turn_back = turning.scenario.turn_back
    steeper = turn_back.model_copy(update={"bank_deg": 45.0})
    fastest = SPEED + ft.route("circuit").wind

    assert turn_back.wind(G) == pytest.approx(fastest - SPEED, abs=0.01)
    # the tangent of 45 deg is 3^0.5 times that of 30 deg
    assert steeper.wind(G) == pytest.approx(3.0**0.5 * fastest - SPEED, abs=0.01)


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


def test_a_flight_turns_as_its_route_does_until_it_turns_back_and_a_circle_turns_once(turning):
    route = ft.route("circuit").reference.path
    turn = next(stretch for stretch in route.stretches if stretch.kind == "turn")
    place = round(turn.start + 0.5 * turn.length)
    run, _ = flown(turning, at_m=float(place), side=1)
    circle, _ = flown(turned_back(plan_along(), f"circle:{BANK}"), at_m=200.0)
    t, chi = run.t, run.signals["chi"].to_numpy()

    before = (t > 8.0) & (t < 10.0)
    rate = np.polyfit(t[before], chi[before], 1)[0]
    assert rate == pytest.approx(route.curvature[place] * SPEED, rel=0.02)
    course = np.interp(10.0, t, chi) - route.course[place]
    assert np.rad2deg((course + np.pi) % (2.0 * np.pi) - np.pi) == pytest.approx(0.0, abs=1.0)
    assert np.rad2deg(np.ptp(circle.signals["chi"])) == pytest.approx(360.0, abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("at_m", "sign"), [(500.0, 1.0), (900.0, 1.0), (900.0, -1.0)])
def test_a_flight_from_level_flight_is_on_the_slope_as_long_as_on_its_route(at_m, sign):
    """By hand: 300 m level, then a leg of 7 in 100."""
    corners = [(0.0, 0.0), (300.0, 0.0, 0.0), (1300.0, 0.0, 70.0 * sign)]
    plan = turned_back(plan_along(*corners, **{"flight.h_m": 1100.0}))
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
    start = ft.scenario_from(run.provenance.scenario).flight.h_m
    assert start - run.signals["down"].to_numpy()[found] == pytest.approx(h, abs=HEIGHTS)
    # the point mass has one airspeed: it needs the same room, and in the same samples
    assert rooms[1] == pytest.approx(rooms[0], abs=FLOWN)


def test_only_flights_of_a_route_with_slopes_may_begin_level():
    def start(up):
        plan = turned_back(plan_along((0.0, 0.0), (800.0, 0.0, 800.0 * up)))
        return plan.as_dict()["nominal"]["turn_back"].get("or_level")

    assert [start(0.0), start(0.02)] == [None, True]


def test_draws_are_at_all_places_and_to_both_sides(turning):
    values = turning.parameters(0, 400)

    assert set(values["turn_back.side"]) == {-1, 1}
    ends = (0.0, ft.route("circuit").length)
    counts, _ = np.histogram(values["turn_back.at_m"], bins=4, range=ends)
    assert counts.min() > 60


# Level for 400 m, then a slope of 6 deg along which the airspeed rises from 20 to 24 m/s.
PLACES = [
    {"along_m": along, "north_m": along, "east_m": 0.0, "chi_deg": 60.0, "gamma_deg": gamma,
     "h_m": h, "V_a_mps": V_a, "rate_dps": 2.0, "back_dps": 12.0}
    for along, gamma, h, V_a in ((0.0, 0.0, 100.0, 20.0), (400.0, 0.0, 130.0, 20.0),
                                 (400.0 + 1e-9, 6.0, 130.0, 20.0), (800.0, 6.0, 170.0, 24.0))
]  # fmt: skip


@pytest.mark.parametrize(
    ("wind", "seconds"),
    [
        # the integral of ds / (V + wind along), where V rises by 0.01 m/s in a metre
        ((0.0, 0.0), 100.0 * np.log(22.0 / 20.0)),
        ((3.0, 0.0), 100.0 * np.log(23.5 / 21.5)),
        ((0.0, -4.0), 100.0 * np.log((22.0 - 12.0**0.5) / (20.0 - 12.0**0.5))),
        # at a fifth of the airspeed at least
        ((-60.0, 0.0), 500.0 * np.log(22.0 / 20.0)),
    ],
)
def test_the_time_on_a_slope_is_that_over_ground(wind, seconds):
    turn = {"bank_deg": 30.0, "reaction_s": 1.5, "roll_rate_dps": 20.0, "place": PLACES}
    tables = {"title": "up", "flight": {"V_a_mps": 22.0}, "plant": [{"kind": "kinematic"}]}
    scenario = ft.scenario_from({**tables, "turn_back": {**turn, "at_m": 600.0}})

    assert scenario.turn_back.slope_m == pytest.approx(200.0, abs=1e-6)
    assert scenario.turn_back.time_on_slope(*wind) == pytest.approx(seconds, rel=1e-4)


# ---------------------------------------------------------------- what is refused
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
    plan = plan_along(**{"limits.phi_deg": [-low, high], "limits.phi_rate_dps": [-low, high]})

    assert turned_back(plan, 40.0).scenario.turn_back.roll_rate_dps == pytest.approx(45.0)
    with pytest.raises(ft.InputError, match="a bank of 1 to 45 deg, got 47"):
        turned_back(plan, 47.0)


# ---------------------------------------------------------------- volumes
def count_on(kind, plan, away, middle=0.0):
    """A count of seven flights that come this far to either side of a middle, m."""
    measured, plan = kind.measures.chosen(plan, None), plan.with_runs(17)
    return count_of(kind, plan, measured, away, np.ones(7), middle, **FEW)


def test_the_areas_are_as_wide_as_they_say_or_wider():
    """By hand: a leg with round ends, and places at the width from it all around."""
    legs = [{"north_m": n, "east_m": 0.0} for n in (0.0, 800.0)]
    where = ft.route("circuit", changes={"route.waypoint": legs}).where
    volumes = {"a": Volume(50.0, 0.0, 9.0, "x"), "b": Volume(250.0, 0.0, 9.0, "y")}

    written = VolumesMap(where, 0.0, volumes).geojson()
    areas = [shape(x["geometry"]) for x in json.loads(written)["features"]]
    assert areas[1].contains(areas[0])
    for area, width in zip(areas, (50.0, 250.0), strict=True):
        polygon = Geodesic.WGS84.Polygon()
        for lon, lat in area.exterior.coords[:-1]:
            polygon.AddPoint(lat, lon)
        size = abs(polygon.Compute()[2])
        assert size == pytest.approx(2.0 * width * 800.0 + np.pi * width**2, rel=ROUND)
        for bearing in np.arange(0.0, 180.0):
            south = Geodesic.WGS84.Direct(*where[1], 90.0 + bearing, width - WRITTEN)
            assert area.contains(points(south["lon2"], south["lat2"]))


@pytest.mark.parametrize(
    ("away", "middle"),
    [([5.0, 2.0], (0.0, 0.0)), ([3.0, 1.5], (2.0, 0.5)), ([3.0, 1.5], (-2.0, -0.5))],
)
def test_volumes_are_over_the_ground_and_their_room_is_in_whole_metres(away, middle):
    """The start is 100 m above the ground, and the route climbs by 20 m.

    The flights come 5 m to a side and 2 m up or down, at most.
    """
    plan = plan_along((0.0, 0.0), (800.0, 0.0, 20.0), **{"flight.ground_m": 900.0})
    corridor = count_on(ft.Band, plan, away, middle)
    room = count_on(TurnBack, turned_back(plan), [271.2, 3.4])

    geography, contingency, buffer = (x[:3] for x in room.volumes(corridor).values())
    assert geography == pytest.approx((5.0, 98.0, 122.0), abs=CLIMBS)
    assert contingency == pytest.approx((277.0, 94.0, 126.0), abs=CLIMBS)
    assert buffer == pytest.approx((277.0 + 126.0, 0.0, 126.0), abs=CLIMBS)
    # The guidance of the LBA: 3 m, 3 m, 1 m, a second over ground, at 25 m/s with the route's wind
    # of 11 m/s from behind, and V^2 / (g tan(bank)).
    rows = room.terms(corridor)
    terms = {row["term"]: row["guideline"] for row in rows}
    assert [terms[f"S_{x}"] for x in ("GPS", "Pos", "K")] == [3.0, 3.0, 1.0]
    assert terms["S_RZ"] == pytest.approx(36.0)
    assert terms["S_CM"] == pytest.approx(36.0**2 / (G * np.tan(np.deg2rad(BANK))))
    # In height 1 m for a barometer, a climb at 45 deg, and the arc that ends it. The calculators
    # round sqrt(2)/2 to 0.7, and its complement to 0.3.
    assert (terms["H_baro"], terms["H_RZ"]) == (1.0, pytest.approx(36.0 * 0.7))
    arc = 36.0**2 / G * (1.0 - np.sqrt(0.5))
    assert terms["H_CM"] == pytest.approx(arc, abs=0.03 * 36.0**2 / G)
    assert terms["H_CV"] == pytest.approx(terms["H_baro"] + terms["H_RZ"] + terms["H_CM"])
    # It knows its place exactly; the sums are the sizes of the contingency volume.
    counted = [row["counted"] for row in rows]
    assert counted[:6] == [0.0, pytest.approx(5.0), None, None, 272.0, pytest.approx(277.0)]
    assert (counted[7], counted[8]) == (None, 4.0)
    assert [counted[6], counted[9]] == pytest.approx([2.0, 6.0], abs=CLIMBS)
    # a corridor that reaches the ground ends there
    high = count_on(ft.Band, plan, [5.0, 150.0])
    assert [x.low for x in room.volumes(high).values()] == [0.0, 0.0, 0.0]


def test_the_room_of_another_route_is_refused():
    own = plan_along((0.0, 0.0), (300.0, 0.0))
    room = count_on(TurnBack, turned_back(own), [271.2, 3.4])
    turned = plan_along((0.0, 0.0), (0.0, 300.0))  # as long, to the east
    longer = plan_along((0.0, 0.0), (300.0, 0.0), (400.0, 0.0))

    for other, says in ((longer, r"along 300 m .*along 400 m"), (turned, "on one route")):
        with pytest.raises(ft.InputError, match=says):
            room.volumes(count_on(ft.Band, other, [5.0, 2.0]))


@pytest.mark.counts
def test_fresh_flights_keep_to_the_volume_that_is_written(tmp_path):
    """Flights of another seed from the edge of the flight geography, put on the route by hand."""
    corners = [(0.0, 0.0, 0.0), (400.0, 0.0, 20.0), (400.0, 450.0, 20.0)]
    legs = [dict(zip(("north_m", "east_m", "up_m"), x, strict=True)) for x in corners]
    changes = {"route.waypoint": legs, "flight.ground_m": 900.0, "flight.duration_s": 40.0}
    few = {"epsilon": 0.1, "confidence": 0.9}
    corridor = ft.band(
        "circuit", start_deg=1.0, plant="kinematic", gains="paper", learn=10, flights=22,
        workers=1, changes=changes, **few,
    )  # fmt: skip
    corridor.save(tmp_path / "b.npz")
    odds = ft.mission(tmp_path / "b.npz", turn_back=BANK, workers=1, **few)
    room, where = odds.room, corridor.flights.route.where
    contingency = json.loads((tmp_path / "b.geojson").read_text())["features"][1]
    assert contingency["properties"]["name"] == "contingency volume"
    (ring,) = contingency["geometry"]["coordinates"]
    lines = [Geodesic.WGS84.Inverse(*where[1], lat, lon) for lon, lat in ring]
    s, azimuth = np.array([(line["s12"], np.deg2rad(line["azi1"])) for line in lines]).T
    area = Polygon(np.column_stack([s * np.cos(azimuth), s * np.sin(azimuth)]))

    bounds = corridor.bounds(corridor.flights.edges[:-1])
    width, above = np.abs([bounds.low, bounds.high]).max(axis=(0, 1))
    high, low = 100.0 + 20.0 + above, 100.0 - above  # the start is 100 m above the ground
    height = room.room.height
    written = [contingency["properties"][f"{end}_over_ground_m"] for end in ("min", "max")]
    assert written == pytest.approx([low - height, high + height], abs=CLIMBS)

    path, fresh, left, by_ahead = where[0], 20, 0, 0
    line = LineString(np.column_stack([path.north, path.east])[path.s <= path.length])
    plan = counted_flights.plan_in(room.about.plan).with_seed(5).with_runs(fresh)
    edge = [(width * np.cos(x), width * np.sin(x)) for x in np.arange(0.0, 2.0 * np.pi, 0.5)]
    for run in range(fresh):
        scenario = plan.scenario_of(run)
        signals = ft.fly(scenario, gains=["paper"]).runs[0].signals.loc[10.0:]
        positions = signals[["north", "east", "down"]].to_numpy()
        north, east, down = (positions - positions[0]).T
        place = line.interpolate(scenario.turn_back.at_m)
        track = LineString(np.column_stack([north + place.x, east + place.y]))
        inside = all(area.contains(translate(track, *offset)) for offset in edge)
        left += not (inside and np.abs(down).max() <= height)
        chi = signals["chi"].iloc[0]
        ahead = (north * np.cos(chi) + east * np.sin(chi)).max()
        by_ahead += not line.buffer(width + ahead).contains(track)
    assert left <= binom.ppf(0.999, fresh, 0.1)
    assert by_ahead > 0.5 * fresh  # a distance ahead is no width
