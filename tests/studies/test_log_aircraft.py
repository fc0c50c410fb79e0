"""The aircraft of a log flies as its lags if the log confirms them, and is refused if not."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from plans import plan_file, waypoint

import flighttune as ft

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


def flown_as(aircraft, **options):
    """A comparison on a leg of the aircraft, of which nothing but two flights is asked."""
    parameters = Path("plane.params")
    parameters.write_text("# Version: 1.14.0\n1\t1\tNPFG_PERIOD\t10\t9\n")
    mission = plan_file(Path("m.plan"), waypoint(47.4, 8.5, 60), waypoint(47.402, 8.5, 60))
    more = {"flights": 1, "workers": 1, "changes": {"gains": ["paper"], "law": ["paper"]}}
    return ft.compare(mission, autopilot=parameters, aircraft=aircraft, **more, **options)


@pytest.mark.slow
def test_a_log_that_confirms_its_lag_is_an_aircraft(log):
    beside = flown_as(log(), assume={"n_z": 5.0})

    (said,) = (note for note in beside.notes if note.startswith("The lags of flight.csv are in "))
    (plant,) = beside.plan.scenario.plant
    assert plant.identified in said
    roll, lift = ft.loop.load_identified(plant.identified).conditions[0].lags
    # the commands of the table are held for a sample, of which the fit counts one half
    assert roll.whole == pytest.approx(1.0 / LAG + 0.5 / RATE, rel=0.02)
    assert lift.natural_frequency == 5.0
    assert "Roll: order 1, " in said
    assert "explains 100.0 % of the variance in 7 stretches" in said
    assert f"{roll.natural_frequency:.3g} rad/s" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "assume", "words"),
    [
        ({"size": 1.0}, {}, "flight.csv: roll commands changed by .*--assume phi=RAD_S"),
        ({"noise": 12.0}, {"n_z": 5.0}, r"must explain 90 % of roll .*, got \d\d\.\d %"),
        ({"size": 1.0}, {"n_z": 5.0, "phi": 5.0}, "must show roll or load factor, got none"),
        (None, {"n_z": 5.0}, "`assume` must be absent without the log"),
    ],
)
def test_lags_that_a_log_does_not_confirm_are_not_flown(log, made, assume, words):
    aircraft = "aerosonde" if made is None else log(**made)

    with pytest.raises(ft.InputError, match=words):
        flown_as(aircraft, assume=assume)
