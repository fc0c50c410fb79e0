"""Signals of the JSBSim plant: signs and definitions against independent computations."""

import math
import threading

import numpy as np
import pytest

import flighttune as ft
from flighttune.simulate.run import SIGNAL_UNITS

G_0 = 9.80665

DEG = math.pi / 180.0
TWO_STEPS = 0.01
ANGLE_FROM_POSITIONS = 2e-4
LOAD_FROM_POSITIONS = 5e-4


def manoeuvre(now):
    """Bank right and climb: nothing stays at zero."""
    return 25.0 * DEG, 1.2


@pytest.fixture
def turn(fly):
    return fly(manoeuvre, chi=60.0 * DEG, gamma=10.0 * DEG, duration=3.0, dt=TWO_STEPS)


def velocity_and_acceleration(flight):
    position = np.stack([flight["north"], flight["east"], flight["down"]], axis=1)
    velocity = (position[2:] - position[:-2]) / (2 * TWO_STEPS)
    acceleration = (position[2:] - 2 * position[1:-1] + position[:-2]) / TWO_STEPS**2
    return velocity, acceleration


def test_signals_begin_with_the_common_ones_and_all_have_units():
    assert ft.JSBSimPlant.signals[: len(ft.COMMON_SIGNALS)] == ft.COMMON_SIGNALS
    assert set(ft.JSBSimPlant.signals) <= set(SIGNAL_UNITS)


def test_starts_at_the_condition_in_steady_flight():
    plant = ft.JSBSimPlant()
    plant.start(ft.FlightCondition(V_a=25.0, h=800.0, chi=60.0 * DEG, gamma=20.0 * DEG))

    now = dict(zip(plant.signals, plant.observe(), strict=True))

    expected = {"chi": 60.0 * DEG, "gamma": 20.0 * DEG, "phi": 0.0, "V_a": 25.0, "h": 800.0,
                "n_z": math.cos(20.0 * DEG), "V_g": 25.0 * math.cos(20.0 * DEG), "psi": 60.0 * DEG,
                "north": 0.0, "east": 0.0, "down": 0.0, "p": 0.0, "q": 0.0, "r": 0.0,
                "beta": 0.0, "n_y": 0.0, "theta": 20.0 * DEG + now["alpha"]}  # fmt: skip
    assert {name: now[name] for name in expected} == pytest.approx(expected, abs=1e-5)


def test_chi_is_the_direction_of_travel_clockwise_from_north(turn):
    velocity, _ = velocity_and_acceleration(turn)

    course = np.arctan2(velocity[:, 1], velocity[:, 0])

    assert turn["chi"][1:-1] == pytest.approx(course, abs=ANGLE_FROM_POSITIONS)
    assert turn["chi"][-1] > turn["chi"][0], "right bank must turn clockwise"


def test_gamma_is_the_climb_angle_of_the_path_and_V_a_its_speed(turn):
    velocity, _ = velocity_and_acceleration(turn)
    assert turn["V_a"][1:-1] == pytest.approx(np.linalg.norm(velocity, axis=1), abs=1e-3)

    climb = np.arctan2(-velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1]))

    assert turn["gamma"][1:-1] == pytest.approx(climb, abs=ANGLE_FROM_POSITIONS)
    assert turn["h"] + turn["down"] == pytest.approx(1000.0, abs=1e-6)


def test_n_z_is_the_force_normal_to_the_path_over_weight(turn):
    velocity, acceleration = velocity_and_acceleration(turn)
    force = acceleration - [0.0, 0.0, G_0]
    ahead = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    normal = force - np.sum(force * ahead, axis=1, keepdims=True) * ahead
    load = np.sqrt(np.sum(normal**2, axis=1) / G_0**2 - turn["n_y"][1:-1] ** 2)

    assert turn["n_z"][1:-1] == pytest.approx(load, abs=LOAD_FROM_POSITIONS)


def test_chi_runs_on_through_south_without_a_jump(fly):
    flight = fly((30.0 * DEG, 1.15), chi=170.0 * DEG, duration=4.0)

    assert flight["chi"][-1] > 180.0 * DEG
    assert np.max(np.abs(np.diff(flight["chi"]))) < 1.0 * DEG
    assert np.max(np.abs(np.diff(flight["psi"]))) < 1.0 * DEG


def test_surface_signs(fly):
    right = fly((30.0 * DEG, 1.0), duration=0.4)
    up = fly((0.0, 1.5), duration=0.4)

    assert np.max(right["aileron"]) > 1.0 * DEG
    assert right["p"][-1] > 0.0
    assert np.min(up["elevator"]) < up["elevator"][0]
    assert up["q"][-1] > 0.0


def test_thrust_balances_weight_and_drag_in_a_climb(fly):
    mass, gamma = 11.0, 45.0 * DEG
    flight = fly((0.0, math.cos(gamma)), gamma=gamma, duration=0.1)
    alpha, dynamic_pressure = flight["alpha"][0], 0.5 * 1.1117 * 25.0**2
    C_L = 0.23 + 5.61 * alpha + 0.13 * flight["elevator"][0]
    drag = dynamic_pressure * 0.55 * (0.043 + C_L**2 / (math.pi * 0.9 * 2.8956**2 / 0.55))

    thrust = flight["thrust"][0] * math.cos(alpha)

    assert thrust == pytest.approx(mass * G_0 * math.sin(gamma) + drag, rel=2e-3)
    assert flight["throttle"][0] == pytest.approx(flight["thrust"][0] / 120.0, rel=1e-3)


def signals_of_a_turn(aircraft="aerosonde"):
    plant = ft.JSBSimPlant(aircraft)
    plant.start(ft.FlightCondition(V_a=25.0, chi=1.0, gamma=0.5))
    rows = [plant.observe()]
    for _ in range(100):
        plant.advance(0.4, 1.3, 0.02)
        rows.append(plant.observe())
    return rows


def test_flights_in_threads_equal_those_in_the_main_thread():
    flown = []
    threads = [threading.Thread(target=lambda: flown.append(signals_of_a_turn())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert flown == [signals_of_a_turn()] * 4


def test_long_and_short_samples_fly_the_same_path():
    plants = [ft.JSBSimPlant(), ft.JSBSimPlant()]
    for plant in plants:
        plant.start(ft.FlightCondition(V_a=25.0))
    plants[0].advance(0.3, 1.2, 1.015)
    for _ in range(203):
        plants[1].advance(0.3, 1.2, 0.005)

    assert plants[0].observe() == plants[1].observe()


@pytest.mark.parametrize("duration", [0.0, 0.004, 0.0125, -0.02, math.nan, math.inf])
def test_duration_must_be_whole_integration_steps(duration):
    plant = ft.JSBSimPlant()
    plant.start(ft.FlightCondition(V_a=25.0))

    with pytest.raises(ft.InputError, match=r"`duration` .* 0\.005 s"):
        plant.advance(0.0, 1.0, duration)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"seed": -1}, r"`seed` .* 2147483645"),
        ({"seed": 2**31 - 2}, r"`seed` .* 2147483645"),
        ({"steps": 0}, r"`steps` .* 1 to 20"),
        ({"steps": 21}, r"`steps` .* 1 to 20"),
    ],
)
def test_seed_and_steps_must_fit(values, message):
    with pytest.raises(ft.InputError, match=message):
        ft.JSBSimPlant(**values)


def test_must_be_started_first():
    with pytest.raises(ft.PlantError, match="must be started before"):
        ft.JSBSimPlant().observe()
    with pytest.raises(ft.PlantError, match="must be started before"):
        ft.JSBSimPlant().advance(0.0, 1.0, 0.02)
