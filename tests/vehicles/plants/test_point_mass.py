"""The point mass and the paper's law against flights that paper and other programs answer."""

import math
from itertools import pairwise

import numpy as np
import pytest
from airframes import wind_record
from scipy.integrate import solve_ivp

import flighttune as ft

G = 9.81
START = ft.loop.FlightCondition(V_a=25.0)
INTEGRATION = 1e-9
METRE = 1e-6
ROUNDING = 1e-12
SECOND_ORDER = ft.loop.InnerLag(order=2, natural_frequency=12.0, damping=0.6, delay=0.033)
OVERDAMPED = ft.loop.InnerLag(order=2, natural_frequency=8.0, damping=1.7, delay=0.02)
FIRST_ORDER = ft.loop.InnerLag(order=1, natural_frequency=6.0, delay=0.047)
THIRD_ORDER = ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.7, lag=0.05, delay=0.011)


def swing(t):
    """A disturbance of course and path angle, rad/s."""
    return 0.1 * math.sin(0.9 * t), 0.2 * math.cos(1.7 * t)


def along(chi, gamma):
    """Unit vector of a path."""
    level = math.cos(gamma)
    return np.array([level * math.cos(chi), level * math.sin(chi), -math.sin(gamma)])


def seen(plant):
    return dict(zip(plant.signals, plant.observe(), strict=True))


def fly(plant, condition, commands, dt):
    plant.start(condition)
    for phi_cmd, n_z_cmd in commands:
        assert plant.advance(phi_cmd, n_z_cmd, dt) is None
    return seen(plant)


def weaving(count, dt):
    """Commands that change at every sample."""
    times = dt * np.arange(count)
    return [(0.6 * math.sin(0.7 * t), 1.0 + 0.3 * math.cos(0.9 * t)) for t in times]


@pytest.mark.parametrize("phi", np.deg2rad([-60.0, 20.0, 45.0]))
def test_a_coordinated_turn_has_the_radius_of_the_textbook(phi):
    V_a, n_z = 25.0, 1.0 / math.cos(phi)
    radius = V_a**2 / (G * math.tan(abs(phi)))
    half_turn = math.pi * radius / V_a

    end = fly(ft.loop.PointMassPlant(), START, [(phi, n_z)] * 100, half_turn / 100)

    assert abs(end["chi"]) == pytest.approx(math.pi, abs=INTEGRATION)
    assert abs(end["east"]) == pytest.approx(2.0 * radius, abs=METRE)
    assert (end["north"], end["down"]) == pytest.approx((0.0, 0.0), abs=METRE)


def test_without_lift_there_is_no_turn_and_the_point_falls_as_a_stone_would():
    end = fly(ft.loop.PointMassPlant(), START, [(1.0, 0.0)] * 100, 0.01)

    # gamma' = -g cos(gamma) / V
    assert end["chi"] == 0.0
    assert math.sin(end["gamma"]) == pytest.approx(-math.tanh(G / 25.0), abs=INTEGRATION)


def test_the_papers_law_in_a_wind_of_zero_is_that_in_still_air():
    start = ft.loop.FlightCondition(V_a=25.0, chi=1.0, gamma=0.3)
    plants = [
        ft.loop.PointMassPlant(turn="paper", disturbance=swing, wind=wind)
        for wind in (None, wind_record([0.0], np.zeros((1, 3))))
    ]

    still, windy = (fly(plant, start, weaving(500, 0.02), 0.02) for plant in plants)

    assert {name: windy[name] for name in still} == pytest.approx(still, abs=INTEGRATION)
    assert plants[0].kind == "kinematic"


def test_in_steady_wind_course_and_ground_speed_close_the_wind_triangle():
    V_a, wind, heading = 25.0, 8.0, math.radians(30.0)
    plant = ft.loop.PointMassPlant(wind=wind_record([0.0], [[0.0, wind, 0.0]]))

    end = fly(plant, ft.loop.FlightCondition(V_a=V_a, chi=heading), [(0.0, 1.0)] * 10, 0.1)

    crossing = math.asin(wind * math.cos(heading) / end["V_g"])
    V_g = math.sqrt(V_a**2 + wind**2 + 2.0 * V_a * wind * math.sin(heading))
    assert end["V_g"] == pytest.approx(V_g, rel=ROUNDING)
    assert end["chi"] == pytest.approx(heading + crossing, abs=ROUNDING)
    assert math.atan2(end["east"], end["north"]) == pytest.approx(end["chi"], abs=INTEGRATION)


def test_a_crosswind_that_rises_turns_the_nose_and_not_the_path_over_ground():
    V_a, w = 25.0, 5.0
    gust = wind_record(np.array([1.0, 1.5]), np.array([[0.0, 0.0, 0.0], [0.0, w, 0.0]]))

    end = fly(ft.loop.PointMassPlant(wind=gust), START, [(0.0, 1.0)] * 20, 0.1)

    pushed_by_thrust = w - V_a * math.tanh(w / V_a)
    assert end["V_g"] * math.sin(end["chi"]) == pytest.approx(pushed_by_thrust, abs=METRE)


@pytest.mark.parametrize("w", [4.0, -4.0])
def test_air_that_begins_to_sink_or_rise_turns_the_path_through_it_alone(w):
    V_a = 25.0
    gust = wind_record(np.array([1.0, 1.01]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, w]]))

    end = fly(ft.loop.PointMassPlant(wind=gust), START, [(0.0, 1.0)] * 101, 0.01)

    pushed_by_thrust = w - V_a * math.tanh(w / V_a)
    # The lift is less than 0.02 of the weight off for 0.01 s.
    assert -end["V_g"] * math.tan(end["gamma"]) == pytest.approx(pushed_by_thrust, abs=0.0002 * G)


@pytest.mark.parametrize(
    "wind", [(5.0, 0.0, 0.0), (-5.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 3.0)]
)
def test_a_sudden_wind_changes_airspeed_and_path_but_no_velocity_over_ground(wind):
    gust = wind_record(np.array([0.0, 0.01]), np.array([[0.0, 0.0, 0.0], wind]))
    plant = ft.loop.PoweredPointMass((-0.5, 0.5), wind=gust)
    plant.start(ft.loop.FlightCondition(V_a=25.0, gamma=0.2))

    plant.advance(0.0, math.cos(0.2), 0.01, math.sin(0.2))

    end = dict(zip(plant.signals, plant.observe(), strict=True))
    over = 25.0 * np.array([math.cos(0.2), 0.0, -math.sin(0.2)])
    # Lift and thrust turn by up to 0.2 rad with the path through the air.
    turned = 0.2 * G * 0.01
    assert end["V_a"] == pytest.approx(np.linalg.norm(over - wind), abs=turned)
    assert end["gamma"] == pytest.approx(0.2, abs=turned / 25.0)
    assert end["chi"] == pytest.approx(0.0, abs=turned / 25.0)


def by_dop853(lags, wind, commands, dt):
    """The same flight with the velocity through the air as a vector and the lags as states."""
    delays = [lag.delay for lag in lags] if lags else [0.0, 0.0]
    starts = [[-math.inf, *(k * dt + delay for k in range(len(commands)))] for delay in delays]
    values = [[(0.1, 1.0)[i], *(command[i] for command in commands)] for i in range(2)]
    breaks = {k * dt for k in range(len(commands) + 1)} | set(wind.t.tolist())
    breaks |= {s for start in starts for s in start[1:] if s < len(commands) * dt}
    breaks = sorted(breaks)
    x = np.array([0.4, 0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1, 1.0, 0.0, 1.0])
    for begin, end in pairwise(breaks):
        if end - begin < 1e-12:
            continue
        middle = 0.5 * (begin + end)
        commanded = [v[np.searchsorted(s, middle) - 1] for s, v in zip(starts, values, strict=True)]
        if lags is None:
            x[5], x[8] = commanded
        w_dot = np.array(wind.piece(middle)[2])
        solved = solve_ivp(
            lambda t, x, u=commanded, w_dot=w_dot: point_with_lag(t, x, u, w_dot, wind, lags),
            (begin, end), x, method="DOP853", rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        x = solved.y[:, -1]
    return x


def point_with_lag(t, x, u, w_dot, wind, lags):
    chi, gamma, phi, n_z = x[[0, 1, 5, 8]]
    ahead = along(chi, gamma)
    right = np.array([-math.sin(chi), math.cos(chi), 0.0])
    up = np.cross(ahead, right) * -1.0
    lift = G * n_z * (math.cos(phi) * up + math.sin(phi) * right)
    acceleration = lift + np.array([0.0, 0.0, G]) - w_dot
    chi_dot = acceleration @ right / (25.0 * math.cos(gamma))
    gamma_dot = acceleration @ up / 25.0
    position = 25.0 * ahead + wind.at(t)
    roll, load = map(channel_rates, lags or (None, None), (x[5:8], x[8:]), u)
    return [chi_dot, gamma_dot, *position, *roll, *load]


def channel_rates(lag, state, command):
    """Rates of value, rate of value, and what stands before the second order."""
    if lag is None:
        return 0.0, 0.0, 0.0
    value, rate, before = state
    w = lag.natural_frequency
    if lag.order == 1:
        return w * (command - value), 0.0, 0.0
    aim = before if lag.order == 3 else command
    change = w * w * (aim - value) - 2.0 * lag.damping * w * rate
    return rate, change, (command - before) / lag.lag


@pytest.mark.parametrize(
    ("turn", "gamma", "command", "status", "reason"),
    [
        ("exact", 1.5, (0.0, 4.0), "left_envelope", "straight up or down"),
        *(
            ("paper", 0.0, (phi, 1.0), "diverged", "t = 0.00 s")
            for phi in (math.pi / 2, -1.7, math.nan)
        ),
    ],
)
def test_straight_up_and_a_roll_without_tangent_end_a_flight(turn, gamma, command, status, reason):
    plant = ft.loop.PointMassPlant(turn=turn)
    plant.start(ft.loop.FlightCondition(V_a=25.0, gamma=gamma))

    stop = [plant.advance(*command, 0.02) for _ in range(4)][-1]

    assert stop.status == status
    assert reason in stop.reason


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ft.loop.PointMassPlant(g=0.0), "`g` must be positive"),
        (lambda: wind_record([0.0, 0.0], np.zeros((2, 3))), "`t` of a wind"),
    ],
    ids=["gravity", "wind"],
)
def test_impossible_values_are_refused(made, words):
    with pytest.raises(ft.InputError, match=words):
        made()


def test_held_commands_and_disturbance_agree_with_high_accuracy_integration():
    plant = ft.loop.PointMassPlant(turn="paper", disturbance=swing)
    plant.start(ft.loop.FlightCondition(V_a=25.0, chi=1.0, gamma=0.5))
    phi, n_z = 0.4, 1.2

    for _ in range(100):
        plant.advance(phi, n_z, 0.1)

    def law(t, x):
        d_chi, d_gamma = swing(t)
        chi_dot = G * np.tan(phi) / 25.0 + d_chi
        return [chi_dot, G * (n_z * np.cos(phi) - np.cos(x[1])) / 25.0 + d_gamma]

    exact = solve_ivp(law, (0.0, 10.0), [1.0, 0.5], rtol=1e-12, atol=1e-12).y[:, -1]
    assert plant.observe()[:2] == pytest.approx(exact, abs=INTEGRATION)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"V_a": -25.0}, r"`V_a` must be positive, got -25\.0 m/s"),
        ({"gamma": 1.6}, r"`gamma` must lie inside \+-90 deg, got 91\.6"),
        ({"phi": math.pi}, r"`phi` must lie inside \+-90 deg"),
    ],
)
def test_flight_conditions_that_cannot_be_are_refused(change, message):
    with pytest.raises(ft.InputError, match=message):
        ft.loop.FlightCondition(**{"V_a": 25.0, **change})


IN_PIECES = 3e-6
"""Error of pieces of 2 ms that are flown with the output of the lags at their middle, m and rad."""


@pytest.mark.parametrize("around", [False, True])
@pytest.mark.parametrize("lags", [(OVERDAMPED, FIRST_ORDER), (THIRD_ORDER, SECOND_ORDER)])
def test_winds_and_lags_agree_with_another_integrator_for_a_moment(lags, around):
    dt, count = 0.02, 15
    wind = wind_record(
        t=np.array([0.0, 0.13, 0.3]),
        wind=np.array([[1.0, -2.0, 0.5], [3.0, 1.0, -1.0], [0, 4.0, 1]]),
    )
    commands = weaving(count, dt)
    start = ft.loop.FlightCondition(V_a=25.0, chi=0.4, gamma=0.1, phi=0.1, n_z=1.0)

    plant = ft.loop.PointMassPlant(None if around else lags, wind=wind)
    end = fly(ft.loop.LaggedPlant(plant, lags) if around else plant, start, commands, dt)

    within = IN_PIECES if around else INTEGRATION
    state = by_dop853(lags, wind, commands, dt)
    north, east, down = 25.0 * along(*state[:2]) + wind.at(count * dt)
    assert end["chi"] == pytest.approx(math.atan2(east, north), abs=within)
    assert end["gamma"] == pytest.approx(math.atan2(-down, math.hypot(north, east)), abs=within)
    places = end["north"], end["east"], end["down"]
    assert places == pytest.approx(state[2:5], abs=max(within, METRE))
    if not around:  # those of the last piece, at its middle
        assert (end["phi"], end["n_z"]) == pytest.approx((state[5], state[8]), abs=within)
    V_g = math.hypot(north, east)  # level, as JSBSim's
    assert end["V_g"] == pytest.approx(V_g, abs=max(20.0 * within, METRE))


def test_a_point_with_thrust_gains_speed_by_what_is_left_of_it_in_a_climb():
    """In air that moves faster and faster, whose change along the path is lost as airspeed."""
    wind = wind_record(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [3.0, 2.0, -1.0]]))
    lags = (FIRST_ORDER, FIRST_ORDER, ft.loop.InnerLag(order=1, natural_frequency=4.0))
    plant = ft.loop.PoweredPointMass((-0.2, 0.5), lags, wind=wind, disturbance=swing)
    plant.start(ft.loop.FlightCondition(V_a=25.0, chi=0.3, gamma=0.2, phi=0.1, n_z=1.1))
    for _ in range(10):
        # as much as its engine gives: half a weight
        assert plant.advance(0.1, 1.1, 0.1, 0.9) is None
    end = seen(plant)

    def rates(t, x):
        chi, gamma, V_a, *_ = x
        n_x = 0.5 + (math.sin(0.2) - 0.5) * math.exp(-4.0 * t)
        change = np.array([3.0, 2.0, -1.0])
        ahead, right = along(chi, gamma), np.array([-math.sin(chi), math.cos(chi), 0.0])
        up = np.cross(right, ahead)
        d_chi, d_gamma = swing(t)
        return [
            (G * 1.1 * math.sin(0.1) - change @ right) / (V_a * math.cos(gamma)) + d_chi,
            (G * (1.1 * math.cos(0.1) - math.cos(gamma)) - change @ up) / V_a + d_gamma,
            G * (n_x - math.sin(gamma)) - change @ ahead,
            *(V_a * ahead + t * change),
        ]

    x = solve_ivp(rates, (0.0, 1.0), [0.3, 0.2, 25.0, 0, 0, 0], rtol=1e-10, atol=1e-10).y[:, -1]
    assert end["V_a"] == pytest.approx(x[2], abs=METRE)
    assert (end["north"], end["east"], end["down"]) == pytest.approx(x[3:], abs=METRE)
    over = x[2] * along(x[0], x[1]) + [3.0, 2.0, -1.0]
    assert end["chi"] == pytest.approx(math.atan2(over[1], over[0]), abs=INTEGRATION)
    assert end["n_x"] == pytest.approx(0.5 + (math.sin(0.2) - 0.5) * math.exp(-4.0))
    assert plant.limits.lower[2] == -0.2
    assert plant.limits.upper[2] == 0.5


@pytest.mark.parametrize("n_x", [(0.5, 0.5), (0.5, -0.2)])
def test_a_range_of_thrust_that_does_not_rise_is_refused(n_x):
    with pytest.raises(ft.InputError, match="`n_x` must be a rising range"):
        ft.loop.PoweredPointMass(n_x)


def test_a_point_that_stops_or_loses_its_course_ends_its_flight():
    slow = ft.loop.PoweredPointMass((-0.9, 0.5))
    slow.start(ft.loop.FlightCondition(V_a=2.0))
    lost = ft.loop.PointMassPlant(turn="paper", disturbance=lambda t: (0.0, -900.0))
    lost.start(START)

    # 0.9 g for 0.12 s take 1.06 m/s
    stops = slow.advance(0.0, 1.0, 0.1, -0.9), slow.advance(0.0, 1.0, 0.02, -0.9)
    ways = lost.advance(0.1, 1.0, 1.1), lost.advance(0.1, 1.0, 0.02)

    assert stops[0] is None
    assert (stops[1].status, stops[1].reason) == (
        "left_envelope", f"airspeed {2.0 - 0.9 * G * 0.12:.3g} m/s at t = 0.12 s.",
    )  # fmt: skip
    assert ways[0] is None
    assert ways[1].status == "diverged"
    assert "at t = 1.12 s" in ways[1].reason
