"""A process that has flown for one verb flies for the next, as a new one would."""

import multiprocessing
import tempfile
from pathlib import Path

import pandas as pd
import pytest

import flighttune as ft

LAW = """
class Mine:
    signals = {{}}

    def __init__(self, setup):
        self.dt = setup.dt

    def start(self, condition):
        pass

    def step(self, measured, reference, t):
        return {gain} * (reference.chi - measured.chi), 1.0
"""
SCENARIO = """
title = "turn"
gains = ["paper"]
flight = { V_a_mps = 25.0, duration_s = 0.5 }
reference = { chi_deg = 10.0, gamma_deg = 0.0 }
plant = [{ kind = "kinematic" }]
law = [{ name = "mine", kind = "python", module = "law.py", class = "Mine" }]
"""
CAMPAIGN = """
title = "turns"
scenario = "turn.toml"
runs = 4
disperse = [{ key = "flight.chi_deg", distribution = "uniform", lower = -5.0, upper = 5.0 }]
"""
pytestmark = pytest.mark.slow


def fly_in(folder, send=None):
    """Fly the campaign of a folder by its own law, both by paths relative to it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        out = Path(tempfile.mkdtemp(dir=folder), "out")
        ft.run_campaign("turns.toml", out=out, workers=1)
        table = pd.read_parquet(out / "runs")
    rows = table.filter(like="chi").to_csv()
    if send:
        send.send(rows)
    return rows


def test_a_law_of_the_same_path_in_another_folder_is_that_of_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("FLIGHTTUNE_RUN_CODE", "1")
    folders = []
    for gain in (0.5, 2.0, 0.5):
        folders.append(tmp_path / str(len(folders)))
        folders[-1].mkdir()
        (folders[-1] / "law.py").write_text(LAW.format(gain=gain))
        (folders[-1] / "turn.toml").write_text(SCENARIO)
        (folders[-1] / "turns.toml").write_text(CAMPAIGN)

    gentle, steep, again = map(fly_in, folders)
    receive, send = multiprocessing.Pipe(duplex=False)
    forked = multiprocessing.get_context("fork").Process(target=fly_in, args=(folders[1], send))
    forked.start()
    of_fork = receive.recv()
    forked.join()

    assert gentle == again != steep
    assert of_fork == steep
    assert fly_in(folders[1]) == steep  # the fork left the process of this one alone
