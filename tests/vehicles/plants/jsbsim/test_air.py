"""Weather on the full aircraft: wind triangle, gust formula, Dryden's strengths, standard air."""

import math

import numpy as np
import pytest
from airframes import blowing, fdm_of

import flighttune as ft

DEG = math.pi / 180.0
KNOT = 0.514444
FPS = 0.3048
SLUG_FT3 = 515.378818
STEP = 0.005
CLEAN = {"V_a": 0.02, "beta": 1e-5, "n_z": 2e-4, "theta": 2e-4, "elevator": 3e-4}
"""How far a start in wind may part from one in still air within 5 s, SI and rad.

In a turn the climb over ground, which the speed loop feeds forward, swings with the wind.
"""

GUST_ROUNDING = 1e-9
LINEAR_OVER_20_MS = 3e-4
"""A changing wind is exact every four steps and linear between, m/s."""


CLIMB_OF_A_STEP = 1e-4
"""Relative: turbulence is weaker by that where 0.1 m are climbed."""


BUMPY = blowing(turbulence={"severity": 4, "wind_20ft": 15.0})


def wind_of(flight):
    return np.stack([flight[f"wind_{axis}"] for axis in ("north", "east", "down")], axis=1)


def holding_height(h):
    """Wings level, and back to the height `h` gently."""

    def command(now):
        gamma_wanted = np.clip(0.02 * (h - now["h"]), -0.1, 0.1)
        return -0.5 * now["phi"], 1.0 + 1.5 * (gamma_wanted - now["gamma"])

    return command


@pytest.mark.parametrize(
    ("wind", "phi"),
    [((10.0, 0.0, 0.0), 0.0), ((3.0, 8.0, -2.0), 0.0), ((-4.0, 5.0, 1.0), 30.0 * DEG)],
)
def test_a_start_in_wind_is_the_trim_carried_along(fly, wind, phi):
    calm, flight = (
        fly((phi, 1.0 / math.cos(phi)), phi=phi, chi=0.5, duration=5.0, weather=weather)
        for weather in (None, blowing(wind))
    )

    for name, tolerance in CLEAN.items():
        assert flight[name][0] == pytest.approx(calm[name][0], abs=1e-5), name
        assert flight[name] == pytest.approx(calm[name], abs=tolerance), name


def test_wind_over_height_is_that_of_the_level_flown_through(fly):
    shear = (950.0, (0.0, 0.0, 0.0)), (1050.0, (10.0, -5.0, 0.0))

    climb = fly(
        (0.0, math.cos(15.0 * DEG)), gamma=15.0 * DEG, duration=6.0, dt=STEP,
        weather=blowing(shear),
    )  # fmt: skip

    share = np.clip((climb["h"] - 950.0) / 100.0, 0.0, 1.0)
    four_steps_of_climb = 0.1 * 8.0 * 4.0 * STEP
    assert climb["h"][-1] > 1030.0
    assert climb["wind_north"] == pytest.approx(10.0 * share, abs=four_steps_of_climb)
    assert climb["wind_east"] == pytest.approx(-5.0 * share, abs=four_steps_of_climb)


@pytest.mark.parametrize(
    ("axis", "peak", "direction"),
    [("right", 5.0, (-0.5, math.sqrt(0.75), 0.0)), ("ahead", -3.0, (math.sqrt(0.75), 0.5, 0.0))],
)
def test_gust_has_the_shape_of_the_standard(fly, axis, peak, direction):
    start, rise, hold = 1.0, 2.0, 0.5
    gust = {"axis": axis, "peak": peak, "start": start, "rise": rise, "hold": hold}

    flight = fly((0.0, 1.0), chi=30.0 * DEG, duration=7.0, dt=STEP, weather=blowing(gust=gust))

    into = np.clip(flight.t - start, 0.0, rise)
    out = np.clip(flight.t - start - rise - hold, 0.0, rise)
    shape = 0.5 * (1.0 - np.cos(np.pi * into / rise)) - 0.5 * (1.0 - np.cos(np.pi * out / rise))
    along = wind_of(flight) @ direction
    tilt = abs(peak) * (1.0 - math.cos(flight["theta"][0])) if axis == "ahead" else GUST_ROUNDING
    assert along == pytest.approx(peak * shape, abs=1.1 * tilt)


def test_a_gust_in_a_bank_blows_along_the_wing(fly):
    phi = 30.0 * DEG
    gust = blowing(gust={"axis": "right", "peak": 4.0, "start": 0.5, "rise": 1.0})

    turn = fly((phi, 1.0 / math.cos(phi)), phi=phi, duration=1.5, weather=gust)

    assert turn["wind_down"][-1] == pytest.approx(4.0 * math.sin(phi), rel=1e-2)


def test_oscillating_wind_is_its_formula(fly):
    swing = {"cosine": (2.0, 0.0, 1.0), "cosine_omega": 0.7}
    swing |= {"sine": (0.0, 3.0, 0.0), "sine_omega": 1.1}

    flight = fly((0.0, 1.0), duration=3.0, dt=STEP, weather=blowing(oscillation=swing))

    c, s = np.cos(0.7 * flight.t), np.sin(1.1 * flight.t)
    expected = np.stack([2.0 * c, 3.0 * s, c], axis=1)
    assert wind_of(flight) == pytest.approx(expected, abs=LINEAR_OVER_20_MS)


@pytest.mark.soak
def test_turbulence_near_the_ground_takes_the_height_above_it(fly):
    # Section 3.7.3.2 of MIL-F-8785C: sigma_w is a tenth of the wind at 20 ft, L_w the height.
    ground, wind_20ft, h, seconds = 1500.0, 15.0 * KNOT, 80.0, 300.0
    turbulence = {"severity": 3, "wind_20ft": wind_20ft}

    flight = fly(
        holding_height(ground + h), h=ground + h, ground=ground, duration=seconds, dt=0.1, seed=2,
        weather=blowing(turbulence=turbulence),
    )  # fmt: skip

    assert flight.stop is None
    sigma, correlation = 0.1 * wind_20ft, h / 25.0
    three_deviations = 3.0 * sigma * math.sqrt(correlation / seconds)
    assert np.std(flight["wind_down"]) == pytest.approx(sigma, abs=three_deviations)


def test_turbulence_is_the_same_for_one_seed_and_another_for_another(fly):
    """The minimal standard generator of JSBSim has no state 0, and takes it for 1."""
    seeds = (5, 5, 6, 0, 1, 2**31 - 3)

    flights = [fly((0.0, 1.0), duration=2.0, weather=BUMPY, seed=seed) for seed in seeds]

    for name, signal in flights[0].signals.items():
        assert np.array_equal(signal, flights[1][name]), name
    assert len({flight["wind_down"].tobytes() for flight in flights}) == len(seeds) - 1


def test_turbulence_has_the_same_axes_whatever_the_start(fly):
    """Its filters know seed, airspeed and height alone: the first gust is one for every start."""
    gusts = [
        wind_of(fly((0.0, 1.0), duration=STEP, dt=STEP, weather=BUMPY, seed=5, **start))[1]
        for start in ({}, {"chi": 1.0}, {"chi": -2.5}, {"gamma": 0.7}, {"phi": -0.5, "chi": 3.0})
    ]

    assert np.linalg.norm(gusts[0][:2]) > 0.01
    for gust in gusts[1:]:
        assert gust == pytest.approx(gusts[0], rel=CLIMB_OF_A_STEP)


def test_a_flight_in_turbulence_starts_from_trim(fly):
    flight = fly((0.0, 1.0), duration=1.0, dt=STEP, weather=BUMPY)

    assert flight["n_z"][0] == pytest.approx(1.0, abs=1e-5)
    assert wind_of(flight)[0] == pytest.approx(np.zeros(3))
    assert flight["n_z"][1] == pytest.approx(1.0, abs=0.05)


def standard_density(h):
    """ICAO Doc 7488, troposphere."""
    temperature = 288.15 - 0.0065 * h
    pressure = 101325.0 * (temperature / 288.15) ** 5.25588
    return pressure / (287.05287 * temperature)


@pytest.mark.parametrize("ground", [-300.0, 0.0, 1500.0, 4000.0])
@pytest.mark.parametrize("above", [10.0, 1500.0])
def test_air_over_high_ground_is_that_of_the_standard_atmosphere(ground, above):
    fdm = fdm_of("aerosonde", ground=ground)
    fdm.writer("ic/h-sl-ft")(above / FPS)
    fdm.evaluate()

    density = fdm.reader("atmosphere/rho-slugs_ft3")() * SLUG_FT3
    assert density == pytest.approx(standard_density(ground + above), rel=1e-4)


@pytest.mark.parametrize("ground", [math.nan, 9000.0, -2000.0])
def test_ground_must_be_where_ground_is(ground):
    with pytest.raises(ft.InputError, match=r"`ground` .*-500 to 6000 m"):
        ft.loop.JSBSimPlant(ground=ground)


def test_a_flight_starts_above_the_ground():
    with pytest.raises(ft.InputError, match=r"`h` .*1200 m, .*1000 m"):
        ft.loop.JSBSimPlant(ground=1200.0).start(ft.loop.FlightCondition(V_a=25.0, h=1000.0))
