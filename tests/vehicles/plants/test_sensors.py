"""Plants seen otherwise: through sensors that err, and by the path through the air."""

import math
from dataclasses import replace

import numpy as np
import pytest
from airframes import blowing, seen_through_air, wind_record

import flighttune as ft

DT = 0.02
LONG = 200_000
BIAS, SD = (0.02, -0.01, 1.5), (0.01, 0.004, 0.5)
FIVE_SIGMA = 5.0


@pytest.mark.parametrize("time_constant", [0.0, 0.3])
def test_mean_spread_and_memory_are_those_asked_for(time_constant):
    kept = math.exp(-DT / time_constant) if time_constant else 0.0
    independent = LONG * (1.0 - kept) / (1.0 + kept)  # of a first-order sequence

    sensors = ft.loop.Sensors(bias=BIAS, noise_sd=SD, time_constant=time_constant, seed=7)

    unit = (sensors.errors(LONG, DT) - BIAS) / SD
    tolerance = FIVE_SIGMA / math.sqrt(independent)
    assert unit.mean(axis=0) == pytest.approx(0.0, abs=tolerance)
    assert unit.var(axis=0) == pytest.approx(1.0, abs=math.sqrt(2.0) * tolerance)
    assert np.corrcoef(unit.T) == pytest.approx(np.eye(3), abs=tolerance)
    after = [np.corrcoef(x[1:], x[:-1])[0, 1] for x in unit.T]
    assert after == pytest.approx([kept] * 3, abs=tolerance)


def test_correlated_noise_is_as_strong_at_the_start_as_later():
    firsts = [
        ft.loop.Sensors(noise_sd=(1.0, 0.0, 0.0), time_constant=5.0, seed=seed).errors(2, DT)[:, 0]
        for seed in range(2000)
    ]

    tolerance = FIVE_SIGMA * math.sqrt(2.0 / 2000)
    assert np.var(firsts, axis=0) == pytest.approx(1.0, abs=tolerance)


@pytest.mark.parametrize("time_constant", [0.0, 0.3])
def test_a_seed_gives_the_same_bits_whatever_else_there_is(time_constant):
    whole = ft.loop.Sensors(bias=BIAS, noise_sd=SD, time_constant=time_constant, seed=7)
    only_gamma = replace(whole, bias=(0.0, 0.0, 0.0), noise_sd=(0.0, SD[1], 0.0))
    other = replace(whole, seed=8)

    errors = whole.errors(500, DT)

    assert np.array_equal(errors, whole.errors(500, DT))
    assert np.array_equal(errors[:100], whole.errors(100, DT))
    assert np.array_equal(errors[:, 1], BIAS[1] + only_gamma.errors(500, DT)[:, 1])
    assert not np.any(errors == other.errors(500, DT))


def test_without_noise_the_bias_is_all_there_is():
    assert np.array_equal(ft.loop.Sensors(bias=BIAS).errors(3, DT), np.array([BIAS] * 3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bias": (math.nan, 0.0, 0.0)}, "`bias` must be 3 finite numbers"),
        ({"noise_sd": (0.0, -1.0, 0.0)}, "`noise_sd` must not be negative"),
        ({"time_constant": -1.0}, "`time_constant` must not be negative, got -1"),
    ],
)
def test_what_cannot_be_used_is_refused(change, message):
    with pytest.raises(ft.InputError, match=message):
        ft.loop.Sensors(**change)


DEG = math.pi / 180.0
SAME = 1e-6


def in_a_wind_from(degrees, speed, **condition):
    towards = (-speed * math.cos(degrees * DEG), -speed * math.sin(degrees * DEG), 0.0)
    plant = seen_through_air(ft.loop.JSBSimPlant(weather=blowing(towards)))
    plant.start(ft.loop.FlightCondition(**{"V_a": 25.0} | condition))
    return plant


def now(plant):
    return dict(zip(plant.signals, plant.observe(), strict=True))


def test_in_a_crosswind_the_air_path_is_the_nose_and_the_ground_path_drifts():
    seen = now(in_a_wind_from(270.0, 5.0, chi=0.0, gamma=0.0))

    assert seen["chi"] == pytest.approx(0.0, abs=SAME)
    assert seen["chi_ground"] == pytest.approx(math.atan2(5.0, 25.0), abs=SAME)


def test_a_headwind_steepens_the_climb_over_ground_alone():
    gamma = 10.0 * DEG

    seen = now(in_a_wind_from(0.0, 10.0, gamma=gamma))

    rise, along = 25.0 * math.sin(gamma), 25.0 * math.cos(gamma) - 10.0
    assert seen["gamma"] == pytest.approx(gamma, abs=SAME)
    assert seen["gamma_ground"] == pytest.approx(math.atan2(rise, along), abs=SAME)


def test_the_course_through_the_air_is_continuous_beyond_half_a_turn():
    plant = in_a_wind_from(90.0, 8.0, chi=170.0 * DEG)

    courses = [now(plant)["chi"]]
    for _ in range(200):
        plant.advance(30.0 * DEG, 1.0 / math.cos(30.0 * DEG), 0.05)
        courses.append(now(plant)["chi"])

    assert courses[0] == pytest.approx(170.0 * DEG, abs=SAME)
    assert courses[-1] > 270.0 * DEG
    assert np.abs(np.diff(courses)).max() < 5.0 * DEG


@pytest.mark.parametrize(
    ("begin", "first"), [(0.0, 0), (0.05, 3), (0.06, 3), (0.061, 4), (0.14, 7), (0.3, 10)]
)
def test_a_late_error_is_there_from_its_time_on_and_not_before(begin, first):
    """Samples are 0.02 s apart; 0.14 / 0.02 is a little more than 7 in floats."""
    errors = ft.loop.Sensors(late=(begin, 2.0)).errors(10, 0.02)

    assert errors[:, 2].tolist() == [0.0] * first + [2.0] * (10 - first)
    assert not errors[:, :2].any()


def test_the_wind_of_a_moment_is_that_of_its_height_and_both_oscillations():
    profile = (0.0, (1.0, 2.0, 3.0)), (100.0, (3.0, 2.0, 1.0))
    swing = {"cosine": (1.0, 2.0, -1.0), "cosine_omega": 0.5}
    swing |= {"sine": (4.0, -3.0, 0.5), "sine_omega": 2.0}
    t, c, s = 1.7, math.cos(0.5 * 1.7), math.sin(2.0 * 1.7)

    both, wind = blowing(profile, oscillation=swing), blowing(profile)

    moved = np.array([c + 4.0 * s, 2.0 * c - 3.0 * s, -c + 0.5 * s])
    for h, steady in ((-9.0, (1, 2, 3)), (25.0, (1.5, 2, 2.5)), (900.0, (3, 2, 1))):
        assert wind.deterministic(t, h) == pytest.approx(steady)
        assert both.deterministic(t, h) == pytest.approx(steady + moved)


def test_a_wind_record_is_linear_between_its_samples_and_constant_beyond():
    t = np.array([1.0, 2.0, 4.0])
    wind = np.array([[0.0, 1.0, 5.0], [2.0, 1.0, 4.0], [2.0, -3.0, 0.0]])
    record = wind_record(t=t, wind=wind)

    times = np.array([-3.0, 0.9, 1.0, 1.25, 2.0, 3.5, 4.0, 99.0])
    wanted = np.array([np.interp(times, t, column) for column in wind.T]).T
    assert np.array([record.at(x) for x in times]) == pytest.approx(wanted)
    assert record.piece(2.0) == (2.0, (2.0, 1.0, 4.0), (0.0, -2.0, -2.0))
    assert record.knots(1.0, 4.0) == [2.0]
    assert record.knots(0.5, 4.5) == [1.0, 2.0, 4.0]
    for bad in (t[::-1], np.array([1.0, 1.0, 2.0])):
        with pytest.raises(ft.InputError, match="`t` of a wind record must rise"):
            wind_record(t=bad, wind=wind)
