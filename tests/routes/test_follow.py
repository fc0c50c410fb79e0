"""Flights along a route, on every plant: where they are, and how they come back to it."""

import math

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from places import SHIPPED_SCENARIOS
from plans import ABILITY, Waypoint
from plans import route_of as planned

import flighttune as ft

ROUTE = {
    "wind_mps": 8.0,
    "waypoint": [
        {"north_m": 0.0, "east_m": 0.0},
        {"north_m": 600.0, "east_m": 0.0},
        {"north_m": 600.0, "east_m": 600.0, "up_m": 20.0},
        {"north_m": 0.0, "east_m": 900.0, "up_m": 20.0},
    ],
}


def scenario(plants, **tables):
    tables = {"limits": {}, **tables}
    flight = {"V_a_mps": 25.0, "duration_s": 120.0, **tables.pop("flight", {})}
    made = ft.load_scenario("paper_identified").as_dict()
    for key in ("reference", "expect", "verifies", "source"):
        del made[key]
    made |= {"gains": ["tuned_identified"], "flight": flight, "plant": plants}
    return ft.scenario_from(made | {"route": ROUTE} | {k: v for k, v in tables.items() if v})


@pytest.mark.parametrize("phi_deg", [(-20.0, 40.0), (-40.0, 20.0)])
def test_a_route_is_banked_by_no_more_than_the_smaller_side_of_the_limits_allows(phi_deg):
    limits = {"phi_deg": phi_deg, "phi_rate_dps": 40.0}
    path = ft.route(scenario([{"kind": "point_mass"}], limits=limits)).reference.path

    # The tightest turn takes four fifths of the bank at 25 m/s with 8 m/s of wind from behind.
    tightest = 9.81 * math.tan(math.radians(0.8 * 20.0)) / 33.0**2
    assert np.abs(path.curvature).max() == pytest.approx(tightest, rel=1e-3)


def test_a_route_that_climbs_takes_the_time_of_its_path_through_the_air():
    """A turn behind 800 m over ground at over 15 % comes later than behind 800 m on the level."""
    climb = [(0.0, 0.0, 0.0), (800.0, 0.0, 120.0), (800.0, 800.0, 120.0)]
    keys = "north_m", "east_m", "up_m"
    tables = {"waypoint": [dict(zip(keys, x, strict=True)) for x in climb]}
    reference = ft.route(scenario([{"kind": "point_mass"}], route=tables)).reference

    path = reference.path
    lengths = np.hypot(np.diff(path.s), np.diff(path.up))
    times = np.append(0.0, np.cumsum(lengths)) / 25.0
    turning = int(np.argmax(path.course > math.pi / 4.0))
    course, _ = reference.sampled(times[[turning]])

    assert times[turning] > 1.01 * path.s[turning] / 25.0
    assert course == pytest.approx(path.course[turning], abs=2e-3)


LAW = [{"kind": "kinematic"}]


@pytest.mark.slow
@pytest.mark.parametrize(
    "plant", [*LAW, {"kind": "point_mass"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
)
def test_a_flight_stays_on_its_route_in_still_air(plant):
    """Distance to the side by the plant's own position: to the leg between two waypoints."""
    (run,) = ft.fly(scenario([plant])).runs
    signals = run.signals

    assert run.status == "completed"
    assert np.abs(signals["cross_track"]).max() < 1.0
    assert np.abs(signals["height_err"]).max() < 1.0
    first = signals[signals["along"] < 400]
    assert first["cross_track"].to_numpy() == pytest.approx(first["east"].to_numpy(), abs=1e-6)
    last = signals.iloc[-1]
    assert math.hypot(last["north"], last["east"] - 900.0) < 2.0
    assert -last["down"] == pytest.approx(20.0, abs=1.0)


def test_a_flight_that_is_carried_back_has_no_places_there():
    reference = ft.route(scenario(LAW)).reference
    along = np.array([0.0, 50.0, 100.0, 90.0, 95.0, 120.0])
    signals = pd.DataFrame(
        {"north": along, "east": 2.0, "down": 3.0, "along": along, "cross_track": 2.0}
    ).assign(height_err=3.0)
    signals["down"] -= np.interp(along, reference.path.s, reference.path.up)

    assert reference.displacement(signals) == pytest.approx(
        math.hypot(10.0, reference.path.up[100] - reference.path.up[90]), abs=1e-6
    )


def test_a_route_has_its_rates_at_one_time_and_at_a_list_of_one():
    """In the middle of a turn the course changes by the airspeed over the radius."""
    reference = ft.route(scenario(LAW)).reference
    turn = next(stretch for stretch in reference.path.stretches if stretch.kind == "turn")
    t = (turn.start + 0.5 * turn.length) / 25.0

    for times in (t, [t], np.array([t])):
        chi_dot, _ = reference.rates(times)
        assert chi_dot == pytest.approx(25.0 / turn.radius, rel=1e-3)


def straight(duration_s, **start):
    """A flight of the law at 25 m/s along a route of 1000 m to the north."""
    waypoints = [{"north_m": north, "east_m": 0.0, "up_m": 0.0} for north in (0.0, 1000.0)]
    flight = {"duration_s": duration_s, **start}
    (run,) = ft.fly(scenario(LAW, flight=flight, route={"waypoint": waypoints})).runs
    return run


@pytest.mark.parametrize("left", [50.0, 1.0])
def test_a_flight_that_does_not_arrive_says_what_is_left(left):
    run = straight((1000.0 - left) / 25.0)

    assert run.status == "not_arrived"
    assert run.reason.endswith(f": {left:.0f} m of the route are left.")


def test_a_flight_arrives_at_the_end_of_its_route_and_within_the_look_ahead_of_it():
    arrived = straight(60.0)
    reference = ft.route(scenario(LAW, flight={})).reference
    length, most = reference.path.length, reference.look_ahead * reference.V_a

    assert arrived.status == "completed"
    assert arrived.signals["along"].iloc[-1] == pytest.approx(1000.0, abs=25.0 / 50.0)
    assert most == 3.0 * 25.0
    assert reference.not_arrived(1.0, (length, 0.6 * 74.9, -0.8 * 74.9)) is None
    stop = reference.not_arrived(1.0, (length, 0.6 * 75.6, -0.8 * 75.6))
    assert (stop.status, stop.reason) == (
        "not_arrived",
        "t = 1 s: the end of the route was passed 76 m from it, must be within its look-ahead of "
        "75 m.",
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reference": {"chi_deg": 0.0, "gamma_deg": 0.0}}, "`reference` or `route`"),
        ({"route": {"waypoint": ROUTE["waypoint"][:1]}}, "waypoint"),
        ({"route": {"waypoint": [{"north_m": 0.0}] * 2}}, "`north_m` and `east_m`"),
        ({"route": {"waypoint": [{"north_m": math.nan, "east_m": 0.0}] * 2}}, "north_m"),
    ],
)
def test_a_route_that_cannot_be_read_is_refused(change, message):
    with pytest.raises(ft.ScenarioError, match=message):
        scenario(LAW, **change)


def test_a_route_below_the_ground_is_refused_by_its_height(tmp_path):
    text = (SHIPPED_SCENARIOS / "circuit.toml").read_text()
    file = tmp_path / "low.toml"
    file.write_text(text.replace("up_m    = 10.0", "up_m    = -10.0"))

    assert ft.load_scenario(file, changes={"flight.ground_m": 980.0}).route is not None
    with pytest.raises(ft.ScenarioError, match=r"low.toml.*`up_m` .*995 m .*990 m"):
        ft.load_scenario(file, changes={"flight.ground_m": 995.0})


def test_a_route_that_cannot_be_flown_in_wind_is_refused_by_its_waypoint(tmp_path):
    points = [(0.0, 0.0), (99.0, 0.0), (99.0, 99.0)]
    sharp = ", ".join(f"{{north_m = {north}, east_m = {east}}}" for north, east in points)
    values = f"route.waypoint=[{sharp}]", "wind.speed_mps=8", "wind.from_deg=90"
    made = [word for x in (*values, "route.turnaround_m=0") for word in ("--set", x)]
    _, said = flighttune("fly", "circuit", *made, "--out", tmp_path, status=2)

    assert "leg to waypoint 2" in said
    assert "[wind]" not in said


def route_of(*waypoints, **more):
    return planned(waypoints, **more).reference


def measured(place, h, chi=0.0, gamma=0.0, **more):
    state = {"phi": 0.0, "n_z": 1.0, "wind": None} | more
    return ft.loop.Measured(chi, gamma, 25.0, position=(*place, 0.0), h=h, **state)


def seen_from(reference, along, *last, lead=(0.0, 0.0)):
    """What is asked at the last of samples, which follow a flight from a distance along a route."""
    follower = reference.follower(0.02, 1000.0, lead)
    for s in np.arange(0.0, along, 10.0).tolist():
        north, east, up = reference.path.beside(np.array([s]))[0].tolist()
        follower(measured((north, east), 1000.0 + up))
    return [follower(sample) for sample in last][-1]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("beside", [30.0, -30.0, 370.0])
def test_beside_a_circle_the_course_turns_with_the_nearest_point_of_it(side, beside):
    """North of the centre of a circle of 400 m, at 22 m/s over ground, 0.1 rad off its tangent."""
    circle = Waypoint(north=1500.0, east=0.0, turns=2.0 * side, radius=400.0)
    reference = route_of(Waypoint(north=0.0, east=0.0), circle)
    path = reference.path
    top = next(i for i in range(1500, len(path.s)) if path.north[i] > 1899.999)
    inside = 1.0 - side * beside / 400.0  # to the right of a clockwise circle is its inside
    north, east = 1500.0 + inside * (path.north[top] - 1500.0), inside * path.east[top]
    chi = path.course[top] + 0.1
    here = measured((north, east), 1008.0, chi=chi, gamma=0.05, V_g=22.0)

    ref, place = seen_from(reference, path.s[top] - 5.0, *[here] * 9)  # each comes nearer

    assert place[1:] == pytest.approx((beside, -8.0), abs=0.01)
    forward = 22.0 * math.cos(0.1) / max(inside, 0.2)
    across, below = beside / 66.0, -8.0 / 66.0
    assert ref.chi == pytest.approx(chi - 0.1 - math.atan(across), abs=1e-3)
    assert ref.gamma == pytest.approx(math.atan(below), abs=1e-4)
    turning = side * forward / 400.0
    assert ref.chi_dot == pytest.approx(
        turning - 22.0 * math.sin(0.1) / (66.0 * (1.0 + across**2)), abs=1e-4
    )
    assert ref.gamma_dot == pytest.approx(-22.0 * math.tan(0.05) / (66.0 * (1.0 + below**2)))
    assert ref.planned[0] == pytest.approx(math.atan(turning * 25.0 / 9.81), abs=1e-4)
    assert ref.planned[1] == pytest.approx(math.cos(ref.gamma))


@pytest.mark.parametrize("lead", [0.0, 0.6])
@pytest.mark.parametrize("wind", [None, (6.0, 0.0, 0.0)])
def test_roll_and_lift_are_planned_for_the_place_of_their_lead(lead, wind):
    """On a roll-in curvature grows evenly, and so does the slope in the 2 s about a climb."""
    corner = route_of(*(Waypoint(north=n, east=e) for n, e in ((0, 0), (1000, 0), (1000, 1000))))
    climb = route_of(
        *(Waypoint(north=n, east=0.0, up=up) for n, up in ((0, 0), (1000, 0), (2000, 100)))
    )
    leg, turn = corner.path.stretches[:2]
    rolled, begun = math.floor(leg.length) + 10.0, 1000.0 - 30.0
    places = [reference.path.beside(np.array([s]))[0] for reference, s in
              ((corner, rolled), (climb, begun))]  # fmt: skip
    course = float(np.interp(rolled, corner.path.s, corner.path.course))

    turned, climbed = (
        seen_from(
            reference,
            s,
            measured(at[:2], 1000.0 + at[2], V_g=25.0, wind=wind, phi=0.3, chi=chi),
            lead=(lead, lead),
        )[0]
        for reference, s, at, chi in zip(
            (corner, climb), (rolled, begun), places, (course, 0.0), strict=True
        )
    )

    k = (rolled + 25.0 * lead - leg.length) / (
        turn.radius * 33.0 * math.atan(33.0**2 / 9.81 / turn.radius) / ABILITY["phi_rate"]
    )
    per_g = (25.0 if wind is None else 31.0) / 9.81
    assert turned.planned[0] == pytest.approx(math.atan(k * 25.0 * per_g), rel=0.01)
    bend = 0.1 / 50.0 * (lead > 0.0)  # 5 m before the 2 s begin without a lead, and 10 m later
    lift = math.cos(climbed.gamma) + bend * 25.0 * per_g
    assert climbed.planned[1] == pytest.approx(lift / math.cos(0.3), rel=1e-3)


def test_a_place_is_told_apart_from_where_an_aircraft_takes_itself_to_be():
    follower = route_of(Waypoint(north=0, east=0), Waypoint(north=900, east=0)).follower(
        0.1, 1000.0
    )
    follower(measured((50.0, 0.0), 1000.0))

    assert follower.placed(20.0, -3.0, 1004.0) == pytest.approx((20.0, -3.0, -4.0))
    assert follower.placed(-8.0, -6.0, 999.0) == pytest.approx((0.0, -10.0, 1.0))
    ref, place = follower(measured((-4.0, 3.0), 1000.0, V_g=0.0))
    assert place == pytest.approx((0.0, 5.0, 0.0))
    assert ref.chi == pytest.approx(-math.atan(3.0 / (1.0 * 3.0)))  # 1 m/s at least
