"""The paper's manoeuvre explained once for all tests."""

import pytest

import flighttune as ft


@pytest.fixture(scope="session")
def paper_gap():
    return ft.gap(ft.load_scenario("paper"), ft.PAPER_GAINS, name="paper")


@pytest.fixture(scope="session")
def windy_gap():
    tables = ft.load_scenario("level_turn").as_dict()
    tables["wind"] = {"speed_mps": 8.0, "from_deg": 270.0}
    tables["turbulence"] = {"intensity": "moderate"}
    return ft.gap(ft.scenario_from(tables), ft.PAPER_GAINS, name="paper")
