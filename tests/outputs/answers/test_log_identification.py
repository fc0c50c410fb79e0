"""What is said and drawn of lags that were identified from logs."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_scenario
from made_up_tubes import tube
from scipy.integrate import cumulative_trapezoid

import flighttune as ft
from flighttune.logs.identify import ChannelOfLogs, Section
from flighttune.outputs.answers import log_identification as answers
from flighttune.vehicles.identification import file

DT = 0.05
STEP = math.radians(10.0)
SWING = 0.03  # rad/s


@pytest.fixture(scope="module")
def assumed(tmp_path_factory):
    """A model of a log of a rolling aircraft whose course also drifts for 4 s at 0.03 rad/s."""
    path = tmp_path_factory.mktemp("identified") / "flight.csv"
    t = 0.04 * np.arange(1800)
    phi = 0.02 * np.sin(t)  # too little to be identified
    turned = cumulative_trapezoid(9.81 / 20.0 * np.tan(phi), t, initial=0.0)
    chi = turned + SWING * np.clip(t - 20.0, 0.0, 4.0)
    table = {"t_s": t, "phi": phi, "phi_cmd": phi, "n_z": 1.0, "n_z_cmd": 1.0, "V_a": 20.0}
    table |= {"v_north": 20.0 * np.cos(chi), "v_east": 20.0 * np.sin(chi), "v_down": 0.0 * t}
    pd.DataFrame(table).to_csv(path, index=False)
    return ft.identify(path, assume={"phi": 5.0, "n_z": 4.0})


def section(seconds, *, begins=0.0):
    """A step of the command after 1 s, in a part of a log where nothing was measured to follow."""
    t = DT * np.arange(round(seconds / DT) + 1)
    commanded = np.where(t >= 1.0, STEP, 0.0)
    return Section(0, begins + t, DT, commanded, 0.0 * t, np.zeros_like(t))


ROLL = ChannelOfLogs(
    lag=ft.loop.InnerLag(order=1, natural_frequency=4.0), fit_percent=97.25, by_log=(96.0, 98.5),
    frequency=(3.5, 4.625), delay=(0.0, 0.0625), reason="", stretches=7,
    sections=(section(10.0), section(60.0, begins=100.0)),
)  # fmt: skip
LOAD = ROLL._replace(by_log=(), frequency=None, delay=None, reason="of 2 stretches", stretches=2)


@pytest.fixture(scope="module")
def found(assumed):
    return replace(
        assumed, channels={"phi": ROLL, "n_z": LOAD}, untold={"airspeed": "none is there"}
    )


def test_lags_are_told_with_their_intervals_and_what_the_logs_cannot_tell(found):
    said = found.answer()

    roll, load = said.tables[0].records
    assert roll == {
        "channel": "phi", "order": 1, "natural_frequency": 4.0, "delay": 0.0,
        "frequency_interval": "3.50 to 4.62", "delay_interval": "0.000 to 0.062",
        "fit_percent": 97.25, "stretches": 7, "by_log_percent": (96.0, 98.5),
    }  # fmt: skip
    assert (load["frequency_interval"], load["delay_interval"]) == ("", "")
    assert said.failure == ""
    assert said.values["untold"] == {"airspeed": "none is there"}
    told = answers.notes(found)
    assert told[:3] == [
        "airspeed: none is there",
        "phi of each log by the lag of the others: 96.0, 98.5 %",
        "n_z has no interval: of 2 stretches",
    ]
    rates = told[3].removeprefix("residual rates up to ").partition(" rad/s of chi and ")
    assert float(rates[0]) == pytest.approx(SWING, rel=1e-2)
    assert said.notes[:4] == told
    assert said.tables[1].records[0]["natural_frequency_rad_s"] == 5.0


def test_a_channel_without_a_lag_is_a_failure_with_its_remedy(found):
    said = replace(found, identified=None).answer()

    assert "none is there; assume its bandwidth, --assume airspeed=RAD_S" in said.failure
    assert said.values == {"untold": {"airspeed": "none is there"}}
    assert len(said.tables) == 1


def test_the_longest_part_is_drawn_in_degrees_from_its_own_start(found):
    """The lag answers a step by ``1 - exp(-4 t)``."""
    roll, load = answers.sheet(found).charts

    assert (roll.y, load.y) == ("phi [deg]", "n_z [1]")
    assert roll.title == "roll: 97.2 % of the variance held out"
    (t, commanded), (_, measured), (at, fitted) = roll._seen
    assert (t[0], t[-1]) == (0.0, 40.0)
    assert (commanded[-1], measured[-1]) == pytest.approx((10.0, 0.0))
    k = np.searchsorted(at, 1.3)
    assert fitted[k] == pytest.approx(10.0 * (1.0 - math.exp(-4.0 * (at[k] - 1.0))), rel=0.1)
    assert fitted[-1] == pytest.approx(10.0)
    assert load._seen[0][1][-1] == pytest.approx(STEP)
    assert [name for name, *_ in roll.legend] == ["commanded", "measured", "lag of order 1"]


def test_a_model_is_saved_with_the_figure_of_its_fits(found, tmp_path):
    saved = found.save(tmp_path / "mine.json")

    assert saved == {"model": tmp_path / "mine.json", "figure": tmp_path / "mine.svg"}
    assert "lag of order 1" in saved["figure"].read_text()
    assert file.load_identified(saved["model"]).log.assumed == ("phi", "n_z")


def test_a_tube_of_a_model_from_logs_is_of_the_rates_that_they_left(assumed, tmp_path):
    assumed.identified.save(tmp_path / "mine.json")
    plant = [{"kind": "point_mass_lag", "identified": str(tmp_path / "mine.json")}]
    scenario = made_up_scenario(
        plant=plant, flight={"duration_s": 0.2, "V_a_mps": 20.0}, controller={"rate_hz": 20.0}
    )

    said = tube(scenario, ft.PAPER_GAINS, for_ever=False).answer()

    assert said.tables[2].records[0]["high"] == pytest.approx(SWING, rel=1e-2)
    assert any(note.startswith("The disturbance is the ") for note in said.notes)
