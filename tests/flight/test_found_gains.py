"""Where nobody states gains, the first that tuning finds fly; without any, no flight begins."""

import json
import re
import shutil
from pathlib import Path

import pytest
from plans import plan_file, waypoint

import flighttune as ft

ADOPTED = Path(__file__).parents[1] / "adopted"

# An airliner that rolls at 6 deg/s at most, within 3 s: tuning finds no gains with feedback.
SLOW = {
    "order": 2, "natural_frequency_rad_s": 0.535157, "damping": 1.02222, "lag_s": None,
    "delay_s": 0.0669283, "bandwidth_rad_s": 0.333888,
}  # fmt: skip

BOX = [(47.395, 8.55), (47.527, 8.55), (47.527, 8.718), (47.395, 8.718)]


@pytest.fixture
def slow_roller(tmp_path):
    folder = shutil.copytree(ADOPTED / "737", tmp_path / "slow")
    file = folder / "identified.json"
    tables = json.loads(file.read_text())
    for condition in tables["conditions"]:
        condition["channels"]["phi"] |= SLOW
        del condition["model"]
    file.write_text(json.dumps(tables))
    file = folder / "aircraft.toml"
    file.write_text(re.sub(r"phi_rate_dps = [\d.]+", "phi_rate_dps = 6.0", file.read_text()))
    return folder


@pytest.mark.soak
def test_a_slow_roller_flies_a_mission_with_the_next_gains_and_says_so(slow_roller, tmp_path):
    points = (waypoint(*point, 80) for point in BOX)
    file = plan_file(tmp_path / "box.plan", *points, home=(47.3945, 8.5495, 430))

    plan = ft.flights(file, aircraft=str(slow_roller)).plan()

    (gains,) = plan.gain_sets.values()
    assert [*plan.gain_sets] == ["exact:tuned_identified"]
    assert gains is not None
    assert any("tuned_fed_back" in note for note in plan.scenario.route.notes)
