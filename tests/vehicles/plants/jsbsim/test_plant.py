"""Signals of the JSBSim plant: signs and definitions against independent computations."""

import math
import threading

import numpy as np
import pytest

import flighttune as ft

DEG = math.pi / 180.0


def test_signals_begin_with_the_common_ones():
    assert ft.loop.JSBSimPlant.signals[: len(ft.loop.COMMON_SIGNALS)] == ft.loop.COMMON_SIGNALS


def test_starts_at_the_condition_in_steady_flight():
    plant = ft.loop.JSBSimPlant()
    plant.start(ft.loop.FlightCondition(V_a=25.0, h=800.0, chi=60.0 * DEG, gamma=20.0 * DEG))

    now = dict(zip(plant.signals, plant.observe(), strict=True))

    expected = {"chi": 60.0 * DEG, "gamma": 20.0 * DEG, "phi": 0.0, "V_a": 25.0, "h": 800.0,
                "n_z": math.cos(20.0 * DEG), "V_g": 25.0 * math.cos(20.0 * DEG), "psi": 60.0 * DEG,
                "north": 0.0, "east": 0.0, "down": 0.0, "p": 0.0, "q": 0.0, "r": 0.0,
                "beta": 0.0, "n_y": 0.0, "theta": 20.0 * DEG + now["alpha"]}  # fmt: skip
    assert {name: now[name] for name in expected} == pytest.approx(expected, abs=1e-5)


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


def signals_of_a_turn():
    plant = ft.loop.JSBSimPlant()
    plant.start(ft.loop.FlightCondition(V_a=25.0, chi=1.0, gamma=0.5))
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
    plants = [ft.loop.JSBSimPlant(), ft.loop.JSBSimPlant()]
    for plant in plants:
        plant.start(ft.loop.FlightCondition(V_a=25.0))
    plants[0].advance(0.3, 1.2, 1.015)
    for _ in range(203):
        plants[1].advance(0.3, 1.2, 0.005)

    assert plants[0].observe() == plants[1].observe()


@pytest.mark.parametrize("duration", [0.0, 0.004, 0.0125, -0.02, math.nan, math.inf])
def test_duration_must_be_whole_integration_steps(duration):
    plant = ft.loop.JSBSimPlant()
    plant.start(ft.loop.FlightCondition(V_a=25.0))

    with pytest.raises(ft.InputError, match=r"`duration` .* 0\.005 s"):
        plant.advance(0.0, 1.0, duration)


def test_a_slower_computer_takes_several_times_as_many_steps_in_the_same_time():
    own = ft.loop.JSBSimPlant("aerosonde").rate

    assert [ft.loop.JSBSimPlant("aerosonde", steps=n).rate for n in (1, 3)] == [own, 3.0 * own]


@pytest.mark.parametrize(
    ("name", "values", "allowed"),
    [("seed", (-1, 2**31 - 2), "0 to 2147483645"), ("steps", (0, 21), "1 to 20")],
)
def test_seed_and_steps_must_fit(name, values, allowed):
    for value in values:
        with pytest.raises(ft.InputError, match=f"`{name}` must lie in {allowed}, got {value}"):
            ft.loop.JSBSimPlant(**{name: value})


@pytest.mark.parametrize(("method", "arguments"), [("observe", ()), ("advance", (0.0, 1.0, 0.02))])
def test_must_be_started_first(method, arguments):
    with pytest.raises(ft.loop.PlantError, match="must be started before"):
        getattr(ft.loop.JSBSimPlant(), method)(*arguments)
