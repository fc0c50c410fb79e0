"""Signals of the JSBSim plant: signs and definitions against independent computations."""

import math
import threading

import numpy as np
import pytest
from airframes import blowing

import flighttune as ft

DEG = math.pi / 180.0
FT, LBF, G = 0.3048, 4.4482216152605, 9.80665


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


@pytest.mark.parametrize(("name", "V_a"), [("aerosonde", 25.0), ("c172p", 50.0)])
def test_signals_are_those_of_jsbsim_in_si_and_of_its_forces(name, V_a):
    plant = ft.loop.JSBSimPlant(
        name, ground=300.0, shows_n_x=True, weather=blowing((3.0, -2.0, 0.5)), seed=1
    )
    plant.start(ft.loop.FlightCondition(V_a=V_a, h=900.0, chi=2.0, phi=0.2))
    for _ in range(20):
        plant.advance(0.5, 1.3, 0.02)

    seen = dict(zip(plant.signals, plant.observe(), strict=True))

    def read(name):
        return plant.fdm.reader(name)()

    angles = {"chi": "flight-path/psi-gt-rad", "gamma": "flight-path/gamma-rad"}
    angles |= {"alpha": "aero/alpha-rad", "beta": "aero/beta-rad", "throttle": "ft/throttle-norm"}
    angles |= {f"{name}": f"attitude/{name}-rad" for name in ("phi", "theta", "psi")}
    angles |= {name: f"velocities/{name}-rad_sec" for name in "pqr"}
    angles |= {name: f"ft/{name}-rad" for name in ("aileron", "elevator", "rudder")}
    feet = {"V_a": "velocities/vt-fps", "V_g": "velocities/vg-fps"}
    feet |= {f"wind_{name}": f"atmosphere/total-wind-{name}-fps" for name in WIND}
    feet |= {x: f"position/from-start-neu-{x[0]}-ft" for x in ("north", "east")}
    expected = {x: read(name) for x, name in angles.items()}
    expected |= {x: FT * read(name) for x, name in feet.items()}
    height = FT * read("position/h-sl-ft")
    expected |= {"h": height + 300.0, "down": 900.0 - 300.0 - height}
    x, y, z = (LBF * read(f"forces/fb{axis}-total-lbs") for axis in "xyz")
    weight = read("inertia/mass-slugs") * LBF / FT * G
    a, b = seen["alpha"], seen["beta"]
    ahead = (x * math.cos(a) + z * math.sin(a)) * math.cos(b) + y * math.sin(b)
    expected |= {"n_z": (x * math.sin(a) - z * math.cos(a)) / weight, "n_y": y / weight}
    expected |= {"n_x": ahead / weight, "thrust": LBF * read("propulsion/engine/thrust-lbs")}
    # what the inner loop sees, and as much more as the throttle has to its stops
    per_n_x, lever = read("ft/gains/speed/k_gamma"), seen["throttle"]
    low, high = plant.config.engines.throttle
    ends = [read("ft/n_x") + (stop - lever) / per_n_x for stop in (low, high)]
    expected |= dict(zip(plant.signals[-2:], ends, strict=True))
    assert seen == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert min(abs(seen[name]) for name in ("p", "q", "r", "beta", "n_y", "thrust")) > 1e-5


WIND = "north", "east", "down"


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
