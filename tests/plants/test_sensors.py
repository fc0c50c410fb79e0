"""Errors of sensors: their statistics, their seeds, and the plant seen through them."""

import math
from dataclasses import replace

import numpy as np
import pytest

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
