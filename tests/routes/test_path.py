"""Paths through waypoints against Fresnel's integrals, circles and Dubins' words; refusals."""

import math

import numpy as np
import pytest
from plans import ABILITY, AROUND, Waypoint, plan
from scipy.special import fresnel

import flighttune as ft

DEG = math.pi / 180.0
RADIUS = 33.0**2 / (9.81 * math.tan(36.0 * DEG))
ROLLING = 33.0 * 36.0 / 24.0


def points(*places):
    return [
        Waypoint(**dict(zip(("north", "east", "up", "turns"), p, strict=False))) for p in places
    ]


def distances(path, waypoint, circles=None):
    """Distances of a path, or of the middle of some circles of it, from a waypoint."""
    apart = np.hypot(path.north - waypoint.north, path.east - waypoint.east)
    if circles is None:
        return apart
    ends = circles.start + ROLLING, circles.start + circles.length - ROLLING
    return apart[(path.s > ends[0]) & (path.s < ends[1])]


def test_a_corner_begins_where_clothoid_and_arc_say():
    """Tangent length of a right angle: Fresnel's integrals, then an arc about its centre."""
    path = plan(points((0, 0), (1000, 0), (1000, 1000)), ABILITY)
    leg, turn, _ = path.stretches

    scale = math.sqrt(math.pi * RADIUS * ROLLING)
    sine, cosine = fresnel(ROLLING / scale)
    x, y, angle = scale * cosine, scale * sine, ROLLING / (2.0 * RADIUS)
    centre = x - RADIUS * math.sin(angle), y + RADIUS * math.cos(angle)
    reach = centre[0] + centre[1] * math.tan(math.pi / 4)

    assert leg.length == pytest.approx(1000.0 - reach, abs=1e-6)
    assert turn.length == pytest.approx(RADIUS * math.pi / 2 + ROLLING, abs=1e-6)
    assert turn.radius == pytest.approx(RADIUS)
    half = np.searchsorted(path.s, turn.start + 0.5 * turn.length)
    towards = np.hypot(path.north - (1000 - reach + centre[0]), path.east - centre[1])
    assert towards[half - 20 : half + 20] == pytest.approx(RADIUS, abs=1e-3)


def test_a_path_passes_its_last_waypoint_and_circles_have_their_radius():
    route = points((0, 0), (900, 0, 20), (900, 900, 50, 2), (0, 1200, 50, -1), (-900, 500, 50))
    path = plan(route, ABILITY)
    end = round(path.length)

    assert (path.north[end], path.east[end]) == pytest.approx((-900, 500), abs=0.6)  # half a step
    assert path.up[end] == pytest.approx(50.0, abs=1e-9)
    for circles, centre in ((path.stretches[3], route[2]), (path.stretches[5], route[3])):
        assert circles.kind == "loiter"
        assert distances(path, centre, circles) == pytest.approx(RADIUS, abs=1e-3)
    assert abs(path.stretches[3].turn) >= 2 * math.tau
    assert path.stretches[5].turn <= -math.tau


def test_a_climb_of_its_own_angle_ends_before_the_waypoint():
    route = [Waypoint(north=0, east=0), Waypoint(north=2000, east=0, up=60, climb=6 * DEG)]
    path = plan(route, ABILITY)
    top = 60 / math.tan(6 * DEG)

    assert np.interp(0.5 * top, path.s, path.up) == pytest.approx(30.0, abs=1e-6)
    assert np.interp([top + 30, 2000], path.s, path.up) == pytest.approx(60.0, abs=1e-6)
    assert path.slope.max() == pytest.approx(math.tan(6 * DEG))


def test_a_small_corner_is_two_rolls_without_an_arc():
    """Curvature grows at one rate and falls at it: the turn is the area of a triangle."""
    path = plan(points((0, 0), (-900, 100), (-1800, 0)), ABILITY)
    angle, rate = 2.0 * math.atan(1.0 / 9.0), 1.0 / (RADIUS * ROLLING)

    _, turn, _ = path.stretches

    assert turn.turn == pytest.approx(angle)
    assert turn.length == pytest.approx(2.0 * math.sqrt(angle / rate))
    assert turn.radius == pytest.approx(1.0 / math.sqrt(angle * rate))


def test_a_climb_ends_in_the_middle_of_a_corner():
    path = plan(points((0, 0), (1000, 0, 50), (1000, 1000, 50)), ABILITY)
    leg, turn, level = path.stretches

    rise = 50.0 / (leg.length + 0.5 * turn.length)
    assert leg.gamma == pytest.approx(math.atan(rise))
    assert turn.gamma == pytest.approx(math.atan(0.5 * rise))
    assert level.gamma == 0.0
    assert np.interp(leg.length, path.s, path.up) == pytest.approx(rise * leg.length)


ROUND = points((0, 0), (700, 0), (735, 50), (700, 120), (0, 120), (-300, 100, 0, 1), (-330, 160))


@pytest.mark.parametrize(("turned", "side"), [(2.9, 1.0), (-2.0, 1.0), (0.0, -1.0)])
def test_a_route_that_is_turned_or_mirrored_has_the_same_lengths(turned, side):
    c, s = math.cos(turned), math.sin(turned)
    other = [
        x._replace(
            north=x.north * c - side * x.east * s, east=x.north * s + side * x.east * c,
            turns=side * x.turns,
        )
        for x in ROUND
    ]  # fmt: skip

    path, again = plan(ROUND, AROUND), plan(other, AROUND)

    assert len(around(path)) >= 3
    assert [x.kind for x in again.stretches] == [x.kind for x in path.stretches]
    lengths = [x.length for x in path.stretches]
    assert [x.length for x in again.stretches] == pytest.approx(lengths, abs=1e-6)
    for x in (0, 1, 2, 3, 4, 6):
        assert distances(again, other[x]).min() <= 0.5  # half a step of the table


def test_a_place_inside_of_circles_is_reached_from_them_by_a_turn_around():
    circle = Waypoint(north=1500, east=0, turns=1.0, radius=200.0)
    path = plan([*points((0, 0)), circle, *points((1500, 100), (300, 2000))], AROUND)
    (loiter,) = (x for x in path.stretches if x.kind == "loiter")

    assert [x.waypoint for x in around(path)] == [3]
    assert distances(path, circle, loiter) == pytest.approx(200.0, abs=0.05)
    assert distances(path, Waypoint(north=1500, east=100)).min() <= 0.5
    assert distances(path, Waypoint(north=300, east=2000)).min() <= 0.5


@pytest.mark.parametrize("V_a", [15.0, 25.0])
def test_a_climb_begins_over_the_two_seconds_around_its_place(V_a):
    """The slope is that of the mean height over 2 s of flight: it grows evenly."""
    path = plan(points((0, 0), (1000, 0), (2000, 0, 100)), ABILITY | {"V_a": V_a})

    at = 1000.0 + V_a * np.array([-1.1, -1.0, -0.5, 0.0, 0.5, 1.0, 1.1])
    slopes = np.interp(at, path.s, path.slope)
    assert slopes == pytest.approx(0.1 * np.array([0, 0, 0.25, 0.5, 0.75, 1, 1]), abs=2e-3)
    # half a second of climb is reached after a second, as after a step of the slope at the place
    assert np.interp(1000.0 + V_a, path.s, path.up) == pytest.approx(0.1 * V_a, abs=0.01)
    assert np.interp(1000.0, path.s, path.up) == pytest.approx(0.1 * V_a / 4.0, abs=0.03)


@pytest.mark.parametrize(
    ("route", "message"),
    [
        (points((0, 0)), "at least 2"),
        (points((0, 0), (100, 0), (100, 900)), "leg to waypoint 2"),
        (points((0, 0), (900, 0), (0, 10)), "160 deg at waypoint 2"),
        (points((0, 0), (900, 0, 300)), "height of waypoint 2"),
        (points((0, 0), (0, 0)), "waypoint 2 must"),
        (points((0, 0), (0.01, 0)), "1 m apart or more, got 0.01 m"),
        (points((0, 0, 0, 1), (900, 0)), "first waypoint"),
    ],
)
def test_what_cannot_be_flown_is_refused_by_the_number_of_its_waypoint(route, message):
    with pytest.raises(ft.InputError, match=message):
        plan(route, ABILITY)


@pytest.mark.parametrize("leg", [20_000.0, 60_000.0])
def test_a_fast_aircraft_begins_and_ends_on_the_heights_and_slopes_of_its_route(leg):
    fast = ABILITY | {"V_a": 200.0, "wind": 66.0, "gamma": (-0.5, 0.5)}
    route = [Waypoint(north=0.0, east=0.0), Waypoint(north=leg, east=0.0, up=leg / 10.0)]
    path = plan([*route, Waypoint(north=2.0 * leg, east=0.0)], fast)

    end = np.searchsorted(path.s, path.length)
    assert path.up[[0, end]] == pytest.approx([0.0, 0.0], abs=0.2)  # m: a point is up to 1 m off
    assert path.slope[[0, end]] == pytest.approx([0.1, -0.1], abs=1e-9)


def test_climbs_that_change_faster_than_the_load_factor_allows_are_refused():
    fast = ABILITY | {"V_a": 200.0, "wind": 66.0, "gamma": (-0.5, 0.5)}
    heights = zip((0.0, 3000.0, 0.0, 0.0), (0.0, 9000.0, 18_000.0, 30_000.0), strict=True)

    with pytest.raises(ft.InputError, match=r"waypoint 3 must .*9000"):
        plan([Waypoint(north=north, east=0.0, up=up) for up, north in heights], fast)
    # a waypoint on a steady climb changes nothing, however near
    steady = zip((0.0, 3000.0, 3100.0, 3100.0), (0.0, 9000.0, 9300.0, 30_000.0), strict=True)
    plan([Waypoint(north=north, east=0.0, up=up) for up, north in steady], fast)


# Rolls in within 5 cm, so that turns are circles to this distance.
NIMBLE = AROUND | {"phi_rate": 130.0}
NEARLY_CIRCLES_M = 1.0


def survey(rows, spacing, length=700.0, beyond=60.0):
    """Waypoints of rows as ground stations have them: with a turn-around beyond both ends."""
    line = [-beyond, 0.0, length, length + beyond]
    return [
        Waypoint(north=north, east=row * spacing)
        for row in range(rows)
        for north in (line if row % 2 == 0 else reversed(line))
    ]


def around(path):
    return [stretch for stretch in path.stretches if stretch.kind == "turn-around"]


@pytest.mark.parametrize("spacing", [60.0, 150.0, 260.0])
def test_a_narrow_turn_around_is_the_bulb_of_three_circles(spacing):
    """R (pi + 4 phi) with cos(phi) = (R + w / 2) / 2 R: Jin and Tang (2010), eq. (3)."""
    (bulb,) = around(plan(survey(2, spacing), NIMBLE))
    phi = math.acos((RADIUS + 0.5 * spacing) / (2.0 * RADIUS))

    assert bulb.length == pytest.approx(RADIUS * (math.pi + 4.0 * phi), abs=NEARLY_CIRCLES_M)


def test_a_wide_turn_around_is_a_half_circle_with_a_straight():
    (turn,) = around(plan(survey(2, 3.0 * RADIUS), NIMBLE))

    assert turn.length == pytest.approx(RADIUS * (math.pi + 1.0), abs=NEARLY_CIRCLES_M)
    assert turn.aside == pytest.approx(RADIUS, abs=NEARLY_CIRCLES_M)


def test_eight_rows_of_60_m_are_flown_at_25_mps_through_every_waypoint():
    rows = [x._replace(north=x.north + 60.0) for x in survey(8, 60.0)]  # the first is the start
    path = plan(rows, AROUND)

    assert len(around(path)) == 7
    assert max(distances(path, x).min() for x in rows) <= 0.5  # half a step of the table
    for row, first in enumerate(rows[1::4]):  # rows themselves are straight
        inside = (path.north > 60.0) & (path.north < 760.0) & (np.abs(path.curvature) < 1e-12)
        near = inside & (np.abs(path.east - first.east) < 0.05)
        assert np.count_nonzero(near) >= 690, row


CORNERS = points((0, 0), (900, 0), (900, 700), (950, 1500), (-300, 300))


@pytest.mark.parametrize("route", [CORNERS, survey(4, 60.0)], ids=["corners", "turn-arounds"])
def test_the_roll_of_a_path_and_its_rate_are_within_the_ability(route):
    path = plan(route, AROUND)
    roll = np.arctan(path.curvature * 33.0**2 / 9.81)
    rate = np.diff(roll) * 33.0

    assert np.abs(roll).max() <= ABILITY["phi"] * (1 + 1e-9)
    # roll grows faster than its mean where it is small: tan(36 deg) / 36 deg = 1.156
    assert (
        np.abs(rate).max()
        <= ABILITY["phi_rate"] * math.tan(ABILITY["phi"]) / ABILITY["phi"] * 1.001
    )
    assert np.diff(path.course) == pytest.approx(path.curvature[:-1], abs=1e-4)


def test_a_corner_that_turns_back_is_flown_through_its_waypoint():
    path = plan([Waypoint(north=n, east=e) for n, e in ((0, 0), (900, 0), (0, 10))], AROUND)
    (back,) = around(path)

    at = np.searchsorted(path.s, [back.start, back.start + back.length])
    assert path.north[at] == pytest.approx(900.0, abs=1.0)
    assert path.east[at] == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize(
    "route",
    [
        [*points((0, 0), (900, 0)), Waypoint(north=950, east=20, turns=-1.0, radius=200.0)],
        [*points((0, 0)), Waypoint(north=1.001 * RADIUS, east=0, turns=1.0, radius=RADIUS)],
        [*points((0, 0), (900, 0)), Waypoint(north=900, east=0, turns=-1.0, radius=200.0)],
    ],
    ids=["around the place before", "beside the start", "at the place before"],
)
def test_a_circle_that_is_too_near_is_reached_by_a_turn_around(route):
    path = plan([*route, Waypoint(north=900, east=2000)], AROUND)
    (loiter,), end = (x for x in path.stretches if x.kind == "loiter"), round(path.length)

    assert around(path)
    assert distances(path, route[-1], loiter) == pytest.approx(route[-1].radius, abs=0.05)
    assert (path.north[end], path.east[end]) == pytest.approx((900, 2000), abs=0.6)


@pytest.mark.soak
def test_every_way_out_of_a_refusal_is_one():
    rows = survey(3, 420.0, beyond=120.0)
    narrow = AROUND | {"turnaround": 120.0}
    with pytest.raises(ft.InputError, match="waypoint") as refusal:
        plan(rows, narrow)

    keys = {"V_a_mps": "V_a", "turnaround_m": "turnaround", "wind_mps": "wind"}
    offered = str(refusal.value).partition("flown with")[2]
    ways = {
        key: float(offered.split(f"`{key}` of ")[1].split()[0].rstrip("."))
        for key in keys
        if f"`{key}`" in offered
    }
    assert {"V_a_mps", "turnaround_m"} <= set(ways), offered
    for key, value in ways.items():
        plan(rows, narrow | {keys[key]: value})
        # none that is much nearer to what was asked for is enough
        closer = value - 2.0 if key == "turnaround_m" else value + 0.2
        with pytest.raises(ft.InputError, match="waypoint"):
            plan(rows, narrow | {keys[key]: closer})


def test_no_airspeed_below_two_fifths_is_a_way_out():
    with pytest.raises(ft.InputError, match="waypoint") as refusal:
        plan(survey(3, 20.0, beyond=120.0), AROUND | {"wind": 0.0, "turnaround": 1.0})

    assert "`turnaround_m` of" in str(refusal.value)
    assert "`V_a_mps`" not in str(refusal.value)


def test_a_leg_to_circles_that_climb_is_as_high_as_its_begin():
    """20 m since the climb before, not 0 as at the start, nor 90 as after the circles."""
    circle = Waypoint(north=2000, east=0, up=90.0, turns=2.0, radius=200.0, spiral=True)
    ends = Waypoint(north=0, east=0), Waypoint(north=600, east=0, up=20.0)
    path = plan([*ends, circle, Waypoint(north=2000, east=1500, up=90.0)], AROUND)

    _, _, up, _ = path.at(np.array([700.0, 1500.0]))

    assert up == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize(
    ("up", "gamma", "steepest"),
    [
        (-200.0, AROUND["gamma"], 5.0),
        (-200.0, (-2.0 * DEG, 0.2), 2.0),
        (200.0, (-0.2, 3.0 * DEG), 3.0),
    ],
)
def test_circles_take_the_height_by_five_degrees_at_most_and_by_what_the_aircraft_can(
    up, gamma, steepest
):
    # 80 s are 2000 m, fewer than the height takes
    circle = Waypoint(north=1500, east=0, up=up, turns=1.0, radius=200.0, spiral=True, hold=80.0)
    ends = Waypoint(north=0, east=0), Waypoint(north=0, east=900, up=up)
    path = plan([ends[0], circle, ends[1]], AROUND | {"gamma": gamma})
    leg, circles, _ = path.stretches

    assert (leg.gamma, circles.gamma > 0.0) == (0.0, up > 0.0)
    assert abs(circles.gamma) == pytest.approx(steepest * DEG, rel=0.4)
    assert abs(circles.gamma) <= steepest * DEG
    least = 200.0 / math.tan(steepest * DEG)
    assert least <= circles.length <= least + 1.2 * math.tau * 200.0


def test_a_circle_by_time_takes_it_and_less_than_a_turn_more():
    circle = Waypoint(north=1500, east=0, turns=1.0, radius=200.0, hold=120.0)
    path = plan([Waypoint(north=0, east=0), circle, Waypoint(north=0, east=900)], AROUND)

    time = path.stretches[1].length / 25.0
    assert 120.0 <= time <= 120.0 + (math.tau * 200.0 + 60.0) / 25.0


def test_a_route_is_planned_below_90_deg_of_bank():
    tables = ft.load_scenario("circuit").as_dict() | {"plant": [{"kind": "kinematic"}]}
    tables |= {"limits": {"phi_deg": [-120.0, 120.0], "phi_rate_dps": 30.0}, "expect": []}

    with pytest.raises(ft.InputError, match=r"112\.5 deg, .* got 120"):
        ft.route(ft.scenario_from(tables))


@pytest.mark.parametrize("corner", [(402.0, 1500.0), (4000.0, 400.0)])  # 150 deg and 22 deg
def test_a_corner_that_is_rounded_far_from_its_waypoint_says_how_far(corner):
    """An arc of radius R in a corner of the angle a passes it at R (1 / cos(a / 2) - 1)."""
    waypoints = [{"north_m": x, "east_m": y} for x, y in ((0.0, 0.0), (3000.0, 0.0), corner)]
    planned = ft.route("circuit", changes={"route.waypoint": waypoints})
    (turn,) = (x for x in planned.stretches if x["kind"] == "turn")
    away = turn["radius_m"] * (1.0 / math.cos(0.5 * turn["turn"]) - 1.0)

    said = [float(note.split()[-2]) for note in planned.changed]
    assert said == ([pytest.approx(away, rel=0.02)] if away > 90.0 else [])


def test_waypoints_by_north_and_east_count_from_the_first():
    places = [{"north_m": 100.0, "east_m": -50.0}, {"north_m": 900.0, "east_m": 250.0}]
    stated = ft.load_scenario("circuit", changes={"route.waypoint": places}).route

    found = [(point.north, point.east) for point in stated.waypoints()]

    assert found == [(0.0, 0.0), (800.0, 300.0)]


def test_a_route_descends_no_steeper_than_it_states():
    """100 m down over 1000 m is 5.7 deg."""
    places = [{"north_m": n, "east_m": 0.0, "up_m": up} for n, up in ((0.0, 0.0), (1000.0, -100.0))]
    steep, shallow = (
        {"route.waypoint": places, "route.gamma_deg": [low, 10.0]} for low in (-6, -5)
    )

    assert ft.route("circuit", changes=steep).reference.path.length == pytest.approx(1000.0)
    with pytest.raises(ft.InputError, match="deg"):
        ft.route("circuit", changes=shallow)


def test_places_of_a_path_are_those_of_its_lines():
    route = [Waypoint(north=0, east=0), Waypoint(north=1000, east=0, up=50, name="gate 7")]
    path = plan(route, ABILITY)

    assert path.points(300.0).tolist() == pytest.approx([0.0, 300.0, 600.0, 900.0, 1000.0])
    assert len(path.s) == len(path.north)
    assert path.s[[0, 1, -1]].tolist() == [0.0, 1.0, len(path.north) - 1.0]
    assert path.s[-1] == pytest.approx(1000.0 + 10.0 * 33.0, abs=1.0)
    s = np.array([0.0, 250.5, 1000.0])
    assert path.beside(s, 20.0, 3.0) == pytest.approx(
        np.column_stack([s, [20.0] * 3, 0.05 * s - 3.0]), abs=1e-9
    )
    assert path.beside(s)[:, 1:] == pytest.approx(np.column_stack([0.0 * s, 0.05 * s]))
    assert path.stretch_at(999.0).words == "leg to gate 7"


def test_stretches_of_a_path_follow_each_other_and_have_their_words():
    path = plan(points((0, 0), (900, 0), (900, 900), (0, 1200, 0, -1), (-900, 500)), ABILITY)

    words = [x.words for x in path.stretches]
    assert words == [
        *("leg to waypoint 2", "turn at waypoint 2", "leg to waypoint 3", "turn at waypoint 3"),
        *("leg to waypoint 4", "loiter at waypoint 4", "leg to waypoint 5"),
    ]
    for before, after in zip(path.stretches, path.stretches[1:], strict=False):
        assert after.start == pytest.approx(before.start + before.length)
        assert path.stretch_at(after.start) is after
        assert path.stretch_at(after.start - 1e-6) is before
        assert after.course == pytest.approx(before.course + before.turn, abs=1e-9)
    assert path.length == pytest.approx(after.start + after.length)


@pytest.mark.parametrize("radius", [100.0, 400.0])
def test_circles_that_are_too_small_are_widened_or_refused(radius):
    circle = Waypoint(north=1500, east=0, turns=1.0, radius=radius)
    route = [Waypoint(north=0, east=0), circle, Waypoint(north=1500, east=2000)]

    path = plan(route, ABILITY | {"widen": True})

    assert path.stretches[1].radius == pytest.approx(max(radius, RADIUS))
    if radius < RADIUS:
        with pytest.raises(ft.InputError, match=rf"2 must be at least {RADIUS:.0f}, got 100\."):
            plan(route, ABILITY)


@pytest.mark.parametrize(
    ("point", "most"),
    [
        ({"up": 300}, 900.0 * math.tan(10.0 * DEG)),
        ({"up": -300}, 900.0 * math.tan(8.0 * DEG)),
        ({"up": 100, "climb": 4.0 * DEG}, 900.0 * math.tan(4.0 * DEG)),
        ({"up": 100, "climb": 12.0 * DEG}, 900.0 * math.tan(10.0 * DEG)),
    ],
)
def test_a_height_out_of_reach_is_refused_with_the_one_that_is_not(point, most):
    able = ABILITY | {"gamma": (-8.0 * DEG, 10.0 * DEG)}
    said = (
        rf"waypoint 2 must differ by at most {most:.0f} m from that of waypoint 1, at .* -8\.0 to"
    )

    with pytest.raises(ft.InputError, match=said):
        plan([Waypoint(north=0, east=0), Waypoint(north=900, east=0, **point)], able)
    if "climb" not in point:
        up = math.copysign(0.999 * most, point["up"])
        plan([Waypoint(north=0, east=0), Waypoint(north=900, east=0, up=up)], able)


def test_a_leg_that_is_too_short_says_by_how_much():
    """The turn by a right angle at its end takes `reach` of the leg."""
    path = plan(points((0, 0), (1000, 0), (1000, 1000)), ABILITY)
    reach = 1000.0 - path.stretches[0].length

    with pytest.raises(ft.InputError, match=rf"waypoint 2 must be {reach - 100:.0f} m longer"):
        plan(points((0, 0), (100, 0), (100, 900)), ABILITY)


@pytest.mark.parametrize("seconds", [30.0, 30.4])
def test_a_route_must_be_flown_in_the_time_of_a_flight(seconds):
    """1000 m at 33 m/s take 30.3 s."""
    route, able = points((0, 0), (1000, 0)), ABILITY | {"duration": seconds}
    if seconds > 1000.0 / 33.0:
        assert plan(route, able).length == pytest.approx(1000.0)
        return
    with pytest.raises(ft.InputError, match=r"waypoint 2 must .* 990 m at 33 m/s .* got 1000 m"):
        plan(route, able)


@pytest.mark.parametrize("turns", [0.02, -0.02])
def test_circles_without_room_for_their_rolls_say_how_many_turns_they_must_have(turns):
    """A roll-in and a roll-out take the course half as far as a circle does over their length."""

    def route(turns):
        onward = 1500 + 3000 * math.cos(0.05), math.copysign(3000 * math.sin(0.05), turns)
        circle = Waypoint(north=1500, east=0, turns=turns, name="the circle")
        return [Waypoint(north=0, east=0), circle, Waypoint(north=onward[0], east=onward[1])]

    whole = plan(route(math.copysign(1.1, turns)), ABILITY).stretches[1].turn
    least = 1.0 + (ROLLING / RADIUS - abs(whole) % math.tau) / math.tau

    with pytest.raises(ft.InputError, match=rf"`turns` of the circle .* {least:.2f}, got {turns}"):
        plan(route(turns), ABILITY)
