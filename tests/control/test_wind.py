"""Laws in moving air, against the wind triangle of vectors and Newton's law over ground."""

import math

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

G, DT, STILL = 9.81, 0.02, (0.0, 0.0, 0.0)
ROUNDING = 1e-9  # of two ways to compute the same in doubles
NOTHING = ft.PIGains.from_lists(np.zeros((3, 3)), np.zeros((3, 3)), law="exact")


def flights(count=200):
    """Velocities through the air and winds (m/s) whose course over ground the air can hold."""
    rng = np.random.default_rng(82)
    for _ in range(count):
        V_a, chi, gamma = rng.uniform([10.0, -3.0, -0.9], [60.0, 3.0, 0.9])
        level = V_a * math.cos(gamma)
        air = np.array([level * math.cos(chi), level * math.sin(chi), -V_a * math.sin(gamma)])
        yield float(V_a), air, rng.uniform(-0.3, 0.3, 3) * V_a


def seen(V_a, chi, gamma, wind):
    place = {"h": 0.0, "position": STILL, "wind": wind, "n_x": (0.0, -9.0, 9.0)}
    return ft.loop.Measured(chi=chi, gamma=gamma, V_a=V_a, phi=0.0, n_z=1.0, **place)


def commanded(V_a, chi, gamma, *winds, rate=0.0):
    """Roll, lift and thrust of a law without errors, on a course that turns at a rate."""
    law = ft.loop.ExactLaw(NOTHING, dt=DT, lift_floor=1e-6)
    law.start(ft.loop.FlightCondition(V_a=V_a))
    for wind in winds:
        reference = ft.loop.ReferenceSample(chi, gamma, rate, V=V_a)
        answer = law.step(seen(V_a, chi, gamma, wind), reference, 0.0)
    return answer[:3]


def test_lift_turns_the_velocity_over_ground_and_thrust_bears_the_climb_through_the_air():
    """Lift stands across the velocity through the air; thrust is its sine of climb."""
    for V_a, air, wind in flights():
        north, east, down = over_ground = air + wind
        chi, gamma = math.atan2(east, north), math.atan2(-down, math.hypot(north, east))
        V_g = float(np.linalg.norm(over_ground))
        along = float(air @ over_ground) / (V_a * V_g)

        phi, n_z, n_x = commanded(V_a, chi, gamma, tuple(wind), rate=0.02)

        turns = V_g / along * math.cos(gamma) * 0.02 / G
        assert n_z * math.sin(phi) == pytest.approx(turns, rel=ROUNDING)
        assert n_x == pytest.approx(-air[2] / V_a, abs=ROUNDING)


@pytest.mark.parametrize(
    ("gamma", "wind", "speed", "climb"),
    [
        # North at 25 m/s: over ground at 5 m/s at least, a fifth of the airspeed.
        (0.0, (-20.0, 15.0, 0.0), 5.0 * 25.0 / 20.0, 0.0),
        (math.asin(0.1), (-24.0, 0.0, 0.0), None, 0.1 * 5.0 / 25.0),
        # No heading holds the course: speed and climb are those of still air.
        (0.1, (3.0, 30.0, 1.0), 25.0, math.sin(0.1)),
        *((gamma, STILL, 25.0, math.sin(gamma)) for gamma in (-0.5, 0.1, 1.5)),
    ],
)
def test_a_path_against_a_strong_wind_or_in_none_is_flown_at_a_speed_that_can_be(
    gamma, wind, speed, climb
):
    phi, n_z, n_x = commanded(25.0, 0.0, gamma, wind, rate=0.02)

    if speed is not None:
        turns = speed * math.cos(gamma) * 0.02 / G
        assert n_z * math.sin(phi) == pytest.approx(turns, rel=ROUNDING)
    assert n_x == pytest.approx(climb, abs=ROUNDING)


def test_still_air_changes_no_bit_of_a_climb():
    assert commanded(25.0, 0.3, 0.1, STILL) == commanded(25.0, 0.3, 0.1, None)


def test_the_wind_that_thrust_knows_lags_by_five_seconds_behind_the_one_there_is():
    """Expected: the step response of a lag of first order, in air that begins to sink."""
    samples = round(5.0 / DT)

    *_, n_x = commanded(25.0, 0.0, 0.0, STILL, *[(0.0, 0.0, 2.0)] * samples)

    assert n_x == pytest.approx(2.0 * (1.0 - math.exp(-1.0)) / 25.0, rel=0.01)


WIND = {"speed_mps": 8.0, "from_deg": 70.0}


@pytest.mark.parametrize("kind", ["kinematic", "point_mass"])
def test_a_law_is_told_its_motion_over_ground_and_its_acceleration_through_the_air(kind):
    """At the first sample by the wind triangle, then by the way from sample to sample."""
    told = []

    class Listens:
        dt, signals = DT, {}

        def __init__(self, _):
            pass

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            told.append(measured)
            return 0.3, 1.1

    flown = {"flight": {"duration_s": 1.0, "chi_deg": 40.0, "gamma_deg": 5.0}, "wind": WIND}
    run = ft.fly(made_up_scenario(plant=[{"kind": kind}], **flown), laws={"own": Listens}).runs[-1]
    last = told[-len(run.signals) :]
    path = run.signals[["north", "east", "down"]].to_numpy()
    moved = np.diff(path, axis=0) / DT
    from_rad = math.radians(70.0)
    air = np.array([-8.0 * math.cos(from_rad), -8.0 * math.sin(from_rad), 0.0])

    chi, gamma = run.signals["chi"].iloc[0], run.signals["gamma"].iloc[0]
    u = np.array([math.cos(gamma) * math.cos(chi), math.cos(gamma) * math.sin(chi)])
    across = air[1] * math.cos(chi) - air[0] * math.sin(chi)
    level = 25.0 * math.cos(gamma)
    V_g = air[:2] @ u / math.cos(gamma) + math.sqrt(level**2 - across**2)
    assert last[0].V_g == pytest.approx(V_g)
    assert last[0].velocity[2] == pytest.approx(-V_g * math.tan(gamma))
    assert last[0].acceleration == 0.0
    for now, by_way in zip(last[1:], moved, strict=True):
        assert now.V_g == pytest.approx(math.hypot(*by_way[:2]))
        assert now.velocity[2] == pytest.approx(by_way[2])
        assert now.velocity[:2] == pytest.approx(
            (now.V_g * math.cos(now.chi), now.V_g * math.sin(now.chi))
        )
        assert now.wind == pytest.approx(air)
    before, now = (np.array(x.velocity) for x in last[5:7])
    through = now - air
    expected = (now - before) @ through / (DT * np.linalg.norm(through))
    assert last[6].acceleration == pytest.approx(expected)
