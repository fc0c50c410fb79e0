"""What is known of the motion of an aircraft, against motions in closed form."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import flighttune as ft
from flighttune.flight.loop.measured import Moving, measured_of
from flighttune.vehicles.plants import sensors
from flighttune.vehicles.plants.weather import WindRecord

DT = 0.02
WIND = (3.0, -2.0, 0.0)
CHI = math.radians(30.0)


def test_the_acceleration_along_the_path_through_the_air_is_that_of_its_airspeed():
    # 20 m/s and 1.5 m/s^2 along a course through the air in a wind
    moving = Moving(DT)
    ahead = math.cos(CHI), math.sin(CHI), 0.0

    def place(t):
        return tuple(
            (20.0 * t + 0.75 * t * t) * a + w * t for a, w in zip(ahead, WIND, strict=True)
        )

    for k in range(1, 5):
        t = k * DT
        V_a = 20.0 + 1.5 * t
        over = [V_a * a + w for a, w in zip(ahead, WIND, strict=True)]
        angles = math.atan2(over[1], over[0]), 0.0, V_a
        V_g, velocity, acceleration = moving(angles, place(t), WIND)

    # differences of positions are the velocity in the middle of a sample
    middle = 20.0 + 1.5 * (t - 0.5 * DT)
    over = [middle * a + w for a, w in zip(ahead, WIND, strict=True)]
    assert V_g == pytest.approx(math.hypot(over[0], over[1]), rel=1e-12)
    assert velocity == pytest.approx(over, rel=1e-3, abs=1e-12)
    assert acceleration == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(("gamma", "behind", "left"), [(0.0, 4.0, 3.0), (0.2, 0.0, 0.0)])
def test_at_the_first_sample_the_velocity_follows_from_course_airspeed_and_wind(
    gamma, behind, left
):
    """Level in a wind from behind and the left, and a climb in still air."""
    c, s = math.cos(CHI), math.sin(CHI)
    wind = behind * c - left * s, behind * s + left * c, 0.0
    V_g = behind + math.sqrt((25.0 * math.cos(gamma)) ** 2 - left**2)

    level, velocity, acceleration = Moving(DT)((CHI, gamma, 25.0), (1.0, 2.0, 3.0), wind)

    assert level == pytest.approx(V_g)
    assert velocity == pytest.approx((V_g * c, V_g * s, -V_g * math.tan(gamma)))
    assert acceleration == 0.0


def seen(error, places=(18, 8, 9), numbers=(0.5, 400.0, 0.25), begun=True):
    """Signals that a law sees, of a true row and the row before it."""
    #      chi  gamma  phi  n_z  V_a   north  east  down  h      wind
    true = [0.7, 0.1, 0.3, 1.2, 25.0, 110.0, 60.0, -5.0, 907.0, 3.0, -2.0, 0.5]
    row = [*true, *[0.0] * 6, *[0.0] * 12]
    before = [0.6, 0.1, 0.2, 1.1, 24.0, 104.0, 52.0, -4.0, 906.0, 2.0, -1.0, 0.4]
    before += [*[0.0] * 6, *[9.0] * 9, 1.0, 2.0, 4.0]
    sensors.sense(row, before, begun, error, places, numbers)
    return row[18:]


def test_sensors_alone_show_three_signals_with_their_errors():
    assert seen((0.01, -0.02, 0.5)) == pytest.approx([0.71, 0.08, 25.5, *[0.0] * 9])


def test_an_estimator_shows_each_signal_with_its_error_and_a_wind_that_lags():
    """6 and 8 m in half a second are 20 m/s over ground; each velocity has an error of its own."""
    error = [0.01, -0.02, 0.5, 0.03, 0.04, 1.5, -2.5, 7.0, 1.5, -0.5, 0.25, 0.2, -0.3, 0.6]
    V_g, chi = 20.0, 0.7
    off = [1.5, -0.5]
    north, east = V_g * math.cos(chi) + off[0], V_g * math.sin(chi) + off[1]
    up = V_g * math.tan(0.1) + 0.25

    found = seen(error)

    assert found[0] == pytest.approx(math.atan2(east, north) + 0.01)
    assert found[1] == pytest.approx(math.atan2(up, math.hypot(north, east)) - 0.02)
    assert found[2:5] == pytest.approx([25.5, 0.33, 1.24])
    assert found[5:9] == pytest.approx([111.5, 57.5, 914.0, math.hypot(north, east)])
    # a quarter of the wind now, three quarters of the estimate before, and its error
    wind = [0.75 + 0.75 + 0.2, -0.5 + 1.5 - 0.3, 0.125 + 3.0 + 0.6]
    assert found[9:] == pytest.approx(wind)


def test_an_estimator_without_height_wind_or_past_takes_those_of_the_start():
    error = [0.0] * 14
    still = seen(error, places=(18, -1, -1), begun=False)
    windy = seen(error, begun=False)

    # 400 m at the start, 5 m higher now; the airspeed along a path of 0.1 rad
    assert still[7] == 405.0
    assert still[8] == pytest.approx(25.0 * math.cos(0.1))
    assert still[9:] == [0.0] * 3
    assert windy[9:] == [3.0, -2.0, 0.5]
    assert windy[8] > still[8]  # from behind
    assert still[:7] == pytest.approx([0.7, 0.1, 25.0, 0.3, 1.2, 110.0, 60.0])


def test_errors_are_drawn_on_as_far_as_a_flight_needs_them():
    asked = []

    def draw(samples):
        asked.append(samples)
        return np.arange(float(samples))[:, None]

    errors = sensors.DrawnErrors(draw, 10, 3)

    assert len(errors.reach(2)) == 3
    assert len(errors.reach(3)) == 6
    assert len(errors.reach(9)) == 10
    assert [row for (row,) in errors] == [float(i) for i in range(10)]
    assert asked == [3, 6, 10]
    assert [row for (row,) in sensors.DrawnErrors(draw, 4, 0)] == [0.0, 1.0, 2.0, 3.0]
    assert asked[3:] == [1, 2, 4]
    assert len(sensors.DrawnErrors(draw, 4, 99).values) == 4
    assert len(sensors.DrawnErrors(draw, 10, 1).reach(7)) == 8


def given(names, now, before=None, dt=0.5):
    """Measurements of a law from a plant with these signals, after an earlier sample if any."""
    measured = measured_of(SimpleNamespace(signals=tuple(names)), 400.0, dt)
    if before:
        measured(tuple(before[name] for name in names))
    return measured(tuple(now[name] for name in names))


SEEN = {
    "chi": 0.7, "gamma": 0.1, "phi": 0.3, "n_z": 1.2, "V_a": 25.0, "north": 110.0, "east": 60.0,
    "down": -5.0, "wind_north": 3.0, "wind_east": -2.0, "wind_down": 0.5, "elevator": 0.05,
    "h": 907.0, "theta": 0.15, "n_x": 0.2, "n_x_min": -0.1, "n_x_max": 0.4,
}  # fmt: skip


def test_a_law_is_given_each_signal_that_the_plant_has_and_nothing_for_the_others():
    whole, bare = given(SEEN, SEEN), given(ft.loop.COMMON_SIGNALS, SEEN)

    common = (0.7, 0.1, 25.0, 0.3, 1.2)
    assert (whole[:5], bare[:5]) == (common, common)
    assert (whole.h, bare.h) == (907.0, 405.0)
    assert whole.position == bare.position == (110.0, 60.0, -5.0)
    assert whole.wind == (3.0, -2.0, 0.5)
    assert whole.n_x == (0.2, -0.1, 0.4)
    assert (whole.theta, whole.elevator) == (0.15, 0.05)
    assert (bare.wind, bare.n_x, bare.theta, bare.elevator) == (None,) * 4
    assert bare.V_g == pytest.approx(25.0 * math.cos(0.1))
    through_air = given([*SEEN, "chi_ground", "gamma_ground"], SEEN | dict.fromkeys(
        ("chi_ground", "gamma_ground"), 9.0
    ))  # fmt: skip
    assert through_air.wind is None
    assert through_air.V_g == bare.V_g  # as in still air
    assert given([x for x in SEEN if x != "elevator"], SEEN).theta is None


def test_a_law_is_given_the_velocity_over_ground_and_the_acceleration_through_the_air():
    """5 m/s north and 10 down, from 22 level ones, in a wind that stands: over half a second."""
    before = SEEN | {"north": 107.5, "east": 60.0, "down": -10.0, "chi": 0.0, "gamma": 0.0}
    before |= {"wind_east": 0.0}

    found = given(SEEN, SEEN | {"chi": 0.0, "wind_east": 0.0}, before)

    assert found.V_g == 5.0
    assert found.velocity == (5.0, 0.0, 10.0)
    air = np.array([5.0 - 3.0, 0.0, 10.0 - 0.5])
    change = np.array([5.0 - (25.0 + 3.0), 0.0, 10.0])
    assert found.acceleration == pytest.approx(change @ air / np.linalg.norm(air) / 0.5)


def test_a_law_with_an_estimator_is_given_what_that_sees_of_a_climb_in_wind():
    """Its position, velocity and wind are those with their errors, its acceleration too."""
    error = [0.01, -0.02, 0.5, 0.03, 0.04, 1.5, -2.5, 7.0, 0.0, 0.0, 0.25, 0.2, -0.3, 0.6, 0.35]
    errors = sensors.DrawnErrors(lambda n: np.array([error] * n), 9, 9)
    air = WindRecord.steady((3.0, -2.0, 0.0))
    plant = sensors.SensedPlant(ft.loop.PointMassPlant(wind=air), errors, 0.5, 400.0, share=0.25)
    plant.start(ft.loop.FlightCondition(V_a=25.0, chi=0.4, gamma=0.2))
    measured = measured_of(plant, 400.0, 0.5)

    def sample():
        row = dict(zip(plant.signals, plant.observe(), strict=True))
        return row, measured(tuple(row.values()))

    old, first = sample()
    plant.advance(0.0, math.cos(0.2), 0.5)
    now, found = sample()

    names = "chi_meas", "gamma_meas", "V_a_meas", "phi_meas", "n_z_meas"
    assert found[:5] == tuple(now[name] for name in names)
    assert found.h == now["h_meas"] == pytest.approx(400.0 - now["down"] + 7.0)
    assert found.position == pytest.approx(
        (now["north"] + 1.5, now["east"] - 2.5, now["down"] - 7.0)
    )
    # an estimate that moves on by a quarter a sample
    wind = np.array([3.0, -2.0, 0.0])
    off = np.array([0.2, -0.3, 0.6])
    once = wind + off
    assert first.wind == pytest.approx(once)
    assert found.wind == pytest.approx(0.25 * wind + 0.75 * once + off)
    V_g = math.hypot(now["north"] - old["north"], now["east"] - old["east"]) / 0.5
    sink = (now["down"] - old["down"]) / 0.5
    seen_at = V_g * math.cos(found.chi), V_g * math.sin(found.chi), sink - 0.25
    assert found.V_g == pytest.approx(V_g)
    assert V_g == pytest.approx(now["V_g"])
    assert found.velocity == pytest.approx(seen_at)
    # unaccelerated flight, and what the sensor errs
    assert found.acceleration == pytest.approx(0.35, abs=0.2)
