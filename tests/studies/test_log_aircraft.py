"""The aircraft of a log flies as its lags if the log confirms them, and is refused if not."""

import numpy as np
import pandas as pd
import pytest

import flighttune as ft
from flighttune.studies.log_aircraft import aircraft_of

RATE, LAG = 25.0, 4.0  # Hz: of the log; rad/s: of the roll


@pytest.fixture
def log(tmp_path, monkeypatch):
    """Writes a table of a roll that follows its command, by the size of both and the noise, deg."""
    monkeypatch.chdir(tmp_path)

    def written(size=20.0, noise=0.0):
        t = np.arange(1000) / RATE
        command, phi = size * np.sign(np.sin(0.9 * t)), np.zeros(1000)
        for k in range(999):
            phi[k + 1] = command[k] + np.exp(-LAG / RATE) * (phi[k] - command[k])
        phi += noise * np.random.default_rng(1).standard_normal(1000)
        table = {"t_s": t, "phi_deg": phi, "phi_cmd_deg": command, "v_north": 20.0, "v_east": 0.0}
        pd.DataFrame(table).to_csv("flight.csv", index=False)
        return "flight.csv"

    return written


@pytest.mark.slow
def test_a_log_that_confirms_its_lag_is_an_aircraft(log):
    file, (said,) = aircraft_of(log(), (), {"n_z": 5.0})

    roll, lift = ft.loop.load_identified(str(file)).conditions[0].lags
    # the commands of the table are held for a sample, of which the fit counts one half
    assert roll.whole == pytest.approx(1.0 / LAG + 0.5 / RATE, rel=0.02)
    assert lift.natural_frequency == 5.0
    assert said.startswith(f"The lags of flight.csv are in {file}. Roll: order 1, ")
    assert "explains 100.0 % of the variance in 7 stretches" in said


@pytest.mark.parametrize(
    ("made", "assume", "words"),
    [
        ({"size": 1.0}, {}, "flight.csv: roll commands changed by .*--assume phi=RAD_S"),
        pytest.param(
            *({"noise": 12.0}, {"n_z": 5.0}, r"must explain 90 % of roll .*, got \d\d\.\d %"),
            marks=pytest.mark.slow,
        ),
        ({"size": 1.0}, {"n_z": 5.0, "phi": 5.0}, "must show roll or load factor, got none"),
    ],
)
def test_lags_that_a_log_does_not_confirm_are_not_flown(log, made, assume, words):
    with pytest.raises(ft.InputError, match=words):
        aircraft_of(log(**made), (), assume)


def test_what_is_no_log_is_the_aircraft_itself_and_assumes_nothing():
    assert aircraft_of(None, (), {}) == (None, [])
    assert aircraft_of("aerosonde", (), {}) == ("aerosonde", [])
    with pytest.raises(ft.InputError, match="`assume` must be absent without the log"):
        aircraft_of("aerosonde", (), {"n_z": 5.0})
