"""The paper's manoeuvre explained once for all tests."""

import pytest

import flighttune as ft
from flighttune.control.gains import PAPER_GAINS
from flighttune.scenario import load_scenario, scenario_from


@pytest.fixture(scope="session")
def paper_gap():
    return ft.gap(load_scenario("paper"), PAPER_GAINS, name="paper")


@pytest.fixture(scope="session")
def windy_gap():
    tables = load_scenario("level_turn").as_dict()
    tables["wind"] = {"speed_mps": 8.0, "from_deg": 270.0}
    tables["turbulence"] = {"intensity": "moderate"}
    return ft.gap(scenario_from(tables), PAPER_GAINS, name="paper")
