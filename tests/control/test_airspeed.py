"""The airspeed as third channel: model, laws, point mass, priority, identification."""

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import flighttune as ft

G = 9.81
V_0 = 25.0
START = ft.loop.FlightCondition(V_a=V_0)

# Of two ways to compute the same in doubles.
ROUNDING = 1e-12
# Of central differences with a step of 1e-6.
SLOPES = 1e-8
# rad and m/s over seconds: the point mass's own claim for its integration.
INTEGRATION = 1e-8
# m/s by which lags take the airspeed through the stop that priority keeps.
LAGS = 0.45
# m/s by which it differs from that stop some 10 time constants later.
SETTLED = 0.01


def gains_of(law):
    """Three channels by themselves, in 1/s and 1/s^2; the paper's with the gain for the weight."""
    K_P, K_I = np.diag([1.2, 1.2, 2.0]), np.diag([0.5, 0.5, 0.5])
    rates = ft.PIGains.from_lists(K_P, K_I, law="exact")
    return rates if law == "exact" else ft.loop.command_gains(rates, V_a=V_0)


def law_of(kind):
    gains = gains_of(kind)
    if kind == "exact":
        return ft.loop.ExactLaw(gains, dt=0.02)
    return ft.loop.MimoPI(gains, dt=0.02, feed_forward=True)


def point(n_x=(-0.5, 1.0), **options):
    return ft.loop.PoweredPointMass(n_x, **options)


def model_at(V_a, gamma, airspeed=True, **turn):
    return ft.loop.kinematic_model(V_a=V_a, gamma=gamma, g=G, airspeed=airspeed, **turn)


def now(plant):
    return dict(zip(plant.signals, plant.observe(), strict=True))


@pytest.mark.parametrize(("gamma", "phi"), [(0.0, 0.0), (0.26, 0.0), (-0.1, 0.3)])
def test_the_model_has_the_slopes_of_the_equations_of_motion(gamma, phi):
    """Central differences of the paper's rates and of V' = g (n_x - sin gamma), V over its trim."""
    n_z = math.cos(gamma) / math.cos(phi)

    def rates(x, u):
        V = V_0 * (1.0 + x[2])
        chi_dot = G / V * math.tan(phi + u[0])
        lift = (n_z + u[1]) * math.cos(phi + u[0]) - math.cos(gamma + x[1])
        n_x = math.sin(gamma) + u[2]
        return np.array([chi_dot, G / V * lift, G / V_0 * (n_x - math.sin(gamma + x[1]))])

    model, step, zero = model_at(V_0, gamma, phi=phi), 1e-6, np.zeros(3)
    for i, change in enumerate(step * np.eye(3)):
        # An error is reference minus actual: a state above its trim is a negative one.
        of_state = (rates(change, zero) - rates(-change, zero)) / (2.0 * step)
        of_input = (rates(zero, change) - rates(zero, -change)) / (2.0 * step)
        assert model.A[:, i] == pytest.approx(of_state, abs=SLOPES)
        assert model.B[:, i] == pytest.approx(-of_input, abs=SLOPES)


CLIMB = math.radians(15.0)


@cache
def tuned(airspeed):
    return ft.tune(
        ft.loop.TuningProblem(model=model_at(V_0, CLIMB, airspeed), I_star=5.0), starts=1
    )


@pytest.mark.slow
def test_three_channels_have_the_optimum_of_two():
    two, three = tuned(False), tuned(True)

    # The printed digits of the optimum of two channels, reached by another number of searches.
    assert three.R_K == pytest.approx(two.R_K, abs=1e-5)
    # The weight is taken out by one gain.
    assert three.gains.K_P[2, 1] == pytest.approx(-math.cos(CLIMB), abs=1e-3)


def test_gains_of_both_laws_are_the_same_loop_about_level_flight():
    exact = gains_of("exact")
    paper = ft.loop.command_gains(exact, V_a=V_0)

    back = ft.loop.rate_gains(paper, V_a=V_0)

    assert back.K == pytest.approx(exact.K, abs=ROUNDING)
    eigenvalues = np.sort_complex(np.linalg.eigvals(ft.loop.closed_loop(model_at(V_0, 0.0), paper)))
    wanted = [np.roots([1.0, exact.K_P[i, i], exact.K_I[i, i]]) for i in range(3)]
    assert np.sort_complex(np.concatenate(wanted)) == pytest.approx(eigenvalues, abs=1e-6)


def test_the_point_mass_flies_the_equations_of_motion():
    """SciPy's DOP853 on V' = g (n_x - sin gamma) with the exact rates of course and path angle."""
    phi, n_z, n_x, end = 0.4, 1.2, 0.15, 3.0

    def slope(_, y):
        chi, gamma, V = y[:3]
        level = V * math.cos(gamma)
        return [
            G * n_z * math.sin(phi) / level,
            G / V * (n_z * math.cos(phi) - math.cos(gamma)),
            G * (n_x - math.sin(gamma)),
            level * math.cos(chi),
            level * math.sin(chi),
            -V * math.sin(gamma),
        ]

    state = [0.1, 0.05, V_0, 0, 0, 0]
    exact = solve_ivp(slope, (0.0, end), state, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    plant = point()
    plant.start(ft.loop.FlightCondition(V_a=V_0, chi=0.1, gamma=0.05))
    plant.advance(phi, n_z, end, n_x)

    names = ("chi", "gamma", "V_a", "north", "east", "down")
    assert [now(plant)[name] for name in names] == pytest.approx(exact, abs=INTEGRATION)


@pytest.mark.slow
def test_a_lag_of_thrust_is_its_step_response():
    lag = ft.loop.InnerLag(order=2, natural_frequency=3.0, damping=0.4, delay=0.1)
    plant = point(lags=(lag, lag, lag))
    plant.start(START)
    plant.advance(0.0, 1.0, 1.1, 0.2)

    A, B = np.array([[0.0, 3.0], [-3.0, -2.4]]), np.array([0.0, 3.0])
    x = np.linalg.solve(A, (expm(A) - np.eye(2)) @ B) * 0.2
    assert now(plant)["n_x"] == pytest.approx(x[0], abs=1e-9)


WINDS = {
    "still air": (0.0, 0.0, 0.0),
    "sinking air": (0.0, 0.0, 3.0),
    "head wind": (-10.0, 0.0, 0.0),
    "tail wind": (10.0, 0.0, 0.0),
    "cross wind": (0.0, 10.0, 0.0),
}


@pytest.mark.parametrize("wind", WINDS.values(), ids=WINDS)
@pytest.mark.parametrize("kind", ["paper", "exact"])
def test_a_law_commands_the_n_x_of_its_climb_through_the_air(kind, wind):
    """Without errors n_x is the height that an airspeed gains in the moving air, per distance."""
    law, gamma = law_of(kind), 0.1
    law.start(START)
    along = wind[0] * math.cos(gamma) - wind[2] * math.sin(gamma)
    V_g = along + math.sqrt(V_0**2 - np.dot(wind, wind) + along**2)
    place = {"h": 0.0, "position": (0.0, 0.0, 0.0), "wind": wind, "n_x": (0.0, -1.0, 1.0)}
    measured = ft.loop.Measured(chi=0.0, gamma=gamma, V_a=V_0, phi=0.0, n_z=1.0, **place)

    *_, n_x = law.step(measured, ft.loop.ReferenceSample(0.0, gamma, V=V_0), 0.0)[:3]

    assert n_x == pytest.approx((V_g * math.sin(gamma) + wind[2]) / V_0, abs=ROUNDING)


@pytest.mark.soak
@pytest.mark.parametrize("wind", [WINDS["sinking air"], WINDS["cross wind"]])
def test_the_airspeed_settles_at_its_floor_in_any_wind_when_the_engine_fails(wind):
    """Level flight asked for with 6 % of the throttle: 0.95 of 25 m/s, and the glide for that."""
    north, east, down = wind
    tables = ft.load_scenario("engine_fails_in_climb").as_dict() | {"expect": [], "law": ["exact"]}
    tables["flight"] |= {"h_m": 1000.0, "duration_s": 45.0}
    tables["reference"] = {"chi_deg": 0.0, "gamma_deg": 0.0, "V_mps": V_0}
    tables["plant"][0]["throttle_max_from_s"] = 5.0
    from_deg = math.degrees(math.atan2(-east, -north))
    tables["wind"] = {"speed_mps": math.hypot(north, east), "from_deg": from_deg % 360.0}
    tables["wind"]["down_mps"] = down

    (run,) = ft.fly(ft.scenario_from(tables)).runs

    assert run.status == "completed"
    assert run.signals["V_a"].min() > 0.95 * V_0 - LAGS
    assert run.signals["V_a"].iloc[-1] == pytest.approx(0.95 * V_0, abs=SETTLED)


@pytest.mark.parametrize("kind", ["paper", "exact"])
def test_a_sample_without_an_airspeed_to_follow_is_refused(kind):
    law = law_of(kind)
    law.start(START)
    place = {"h": 0.0, "position": (0.0, 0.0, 0.0), "wind": None}
    measured = ft.loop.Measured(chi=0.0, gamma=0.0, V_a=V_0, phi=0.0, n_z=1.0, **place)

    with pytest.raises(ft.InputError, match="`gains` must be of two errors"):
        law.step(measured, ft.loop.ReferenceSample(0.0, 0.0, 0.0, 0.0), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "changes", "words"),
    [
        ("climb_beyond_power", {"reference.V_mps": 50.0}, r"`V_mps` must stay inside 15 to 45"),
        ("climb_beyond_power", {"limits.n_x": [0.1, 0.3]}, r"`n_x` must hold that of steady"),
        ("climb_beyond_power", {"gains": ["paper"]}, r"`gains` must have 3 rows"),
        ("level_turn", {"reference.V_mps": 25.0}, r"`n_x` of \[limits\] must be given"),
        ("paper", {"expect[0].at_most.V.peak_mps": 1.0}, r"`V` of \[\[expect\]\] must be absent"),
    ],
)
def test_an_airspeed_that_cannot_be_followed_is_refused_in_one_line(scenario, changes, words):
    with pytest.raises(ft.FlightTuneError, match=words) as refused:
        ft.fly(scenario, changes=changes)

    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_what_knows_two_channels_says_so():
    with pytest.raises(ft.InputError, match=r"`V_mps` .* must be absent"):
        ft.tube("climb_beyond_power")


def route_tables(waypoints, duration_s, throttle_max, **changes):
    """The shipped climb with a route in place of its reference, which holds the airspeed."""
    tables = ft.load_scenario("climb_beyond_power").as_dict() | {"expect": [], **changes}
    tables["route"] = {"waypoint": waypoints, "holds_airspeed": True}
    tables["flight"]["duration_s"] = duration_s
    tables["plant"][0]["throttle_max"] = throttle_max
    del tables["reference"]
    return tables


@pytest.mark.slow
def test_a_route_changes_its_airspeed_at_its_waypoints():
    """At 0.05 g, ``V^2 = V_0^2 + 2 (0.05 g) s`` from the end of a turn on, in still air."""
    along = [{"north_m": 400.0 * i, "east_m": 0.0} for i in range(4)]
    along[1]["V_mps"], along[3]["east_m"] = 22.0, 200.0
    tables = route_tables(along, 90.0, 1.0, law=["paper"])

    planned = ft.route(ft.scenario_from(tables))
    run = ft.fly(ft.scenario_from(tables)).runs[0]

    turn = next(x for x in planned.stretches if x["waypoint"] == 1 + 1)
    begins = turn["start_m"] + turn["length_m"]
    signals = run.signals
    s = signals["along"].to_numpy() - begins
    wanted = np.sqrt(np.maximum(V_0**2 - 2.0 * 0.05 * 9.81 * np.maximum(s, 0.0), 22.0**2))
    assert run.status == "completed"
    np.testing.assert_allclose(signals["V_ref"], wanted, atol=0.05)  # of points 1 m apart
    assert signals["V_err"].abs().max() < 0.3
    tables["route"]["waypoint"][1]["V_mps"] = 60.0
    with pytest.raises(ft.ScenarioError, match=r"\[\[route.waypoint\]\] `V_mps` must stay inside"):
        ft.fly(ft.scenario_from(tables))
