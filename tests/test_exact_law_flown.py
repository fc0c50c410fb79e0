"""The exact law with gains of `tune` on the identified aircraft, beside the paper's law."""

import re
from pathlib import Path

import numpy as np
import pytest
from test_tuned_on_identified import NOTHING_ASKED, UNUSED, manoeuvre

import flighttune as ft

pytestmark = pytest.mark.slow

PAGE = (Path(__file__).parents[1] / "docs/exact_law.md").read_text(encoding="utf-8")
WORST = 0.9
"""Largest ITAE over that of `tuned_identified` with the paper's law."""
HALF_OF_THE_LAST_DIGIT = 0.0051
FIVE = ("paper_identified", "level_turn", "turbulent_climb", "gust_in_turn", "crosswind_course")


def ratios(scenario):
    """ITAE of course and path angle with the exact law, over that with the paper's."""
    tables = scenario.as_dict() | {"law": ["paper", "exact"], "gains": ["tuned_identified"]}
    tables["plant"] = [plant for plant in tables["plant"] if plant["kind"] == "jsbsim"]
    tables.pop("expect", None)
    flown = ft.fly(ft.scenario_from(tables))
    assert [run.status for run in flown.runs] == ["completed", "completed"]
    paper, exact = (flown.metrics.loc[run.label]["ITAE"] for run in flown.runs)
    return (exact / paper.clip(lower=NOTHING_ASKED)).to_numpy()


@pytest.fixture(scope="module")
def five():
    return {name: ratios(ft.load_scenario(name)) for name in FIVE}


@pytest.mark.soak
def test_the_table_of_the_page_is_what_is_flown(five):
    for name, found in five.items():
        (cells,) = re.findall(rf"^\| `{name}` \|(.*)\|$", PAGE, re.MULTILINE)
        printed = [float(cell) for cell in cells.split("|")]
        assert printed == pytest.approx(found, abs=HALF_OF_THE_LAST_DIGIT), name
    (mean,) = re.findall(r"The geometric mean is ([\d.]+)\.", PAGE)
    found = np.exp(np.mean(np.log([*five.values()])))
    assert float(mean) == pytest.approx(found, abs=HALF_OF_THE_LAST_DIGIT)


@pytest.mark.counts
@pytest.mark.parametrize("name", UNUSED)
def test_better_on_manoeuvres_not_used(name):
    assert ratios(manoeuvre(UNUSED[name])).max() < 1.0


@pytest.mark.counts
@pytest.mark.parametrize("name", ["c172_cruise_turn", "jet_pull_up"])
def test_better_on_other_aircraft(name):
    assert ratios(ft.load_scenario(name)).max() < WORST
