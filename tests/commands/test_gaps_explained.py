"""Gaps of a turn: numbers of the answer of `gap` and the files that it leaves."""

from pathlib import Path

import numpy as np
import pytest
from commands import answer
from made_up import made_up_scenario, scenario_file

import flighttune as ft

AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}


@pytest.mark.soak
def test_a_gap_is_the_sum_of_its_steps_and_its_cause_the_largest(tmp_path):
    turn = made_up_scenario(
        flight={"chi_deg": 5.0, "duration_s": 2.0}, plant=[{"kind": "kinematic"}, AEROSONDE]
    )
    file = scenario_file(tmp_path / "turn.toml", turn)
    for name in ("gap.svg", "gap.html"):
        (tmp_path / name).write_text("an earlier one")

    found = answer("gap", file, "--gains", "paper", "--out", tmp_path)

    assert len(found["ladder"]) == len(found["contributions"]) + 1 == 4
    for channel in ("chi", "gamma"):
        rungs = [rung["metrics"][channel]["ITAE"] for rung in found["ladder"]]
        steps = {x["adds"]: x["metrics"][channel]["ITAE"] for x in found["contributions"]}
        assert list(steps.values()) == pytest.approx(np.diff(rungs))
        largest = max(steps, key=lambda adds: abs(steps[adds]))
        assert found["cause"][channel] == {"adds": largest, "ITAE": steps[largest]}
    assert found["figure"] == str(tmp_path / "gap.svg")
    assert found["page"] == str(tmp_path / "gap.html")
    assert Path(found["figure"]).read_text(encoding="utf-8").startswith("<svg")
    assert "<html" in Path(found["page"]).read_text(encoding="utf-8")
    kept = {ft.load(path).runs[0].provenance.plant for path in tmp_path.glob("*.parquet")}
    assert kept == {"kinematic", "point_mass", "point_mass_lag", "jsbsim:aerosonde"}
