"""Every file in scenarios/ flies, and the tables that describe them keep up."""

from functools import cache
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest
from places import SCENARIO_NAMES

import flighttune as ft

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "scenarios").glob("*.py"))
LONGEST_SCRIPT = 60
LAST_DIGIT = 0.006


LONG = "circuit_a4", "circuit_c172p", "c172_cruise_turn", "feasible_a4"
"""Scenarios that take as long as ten others, and are flown on other aircraft by shorter ones."""


@cache
def flown(name):
    return ft.fly(name)


@pytest.mark.soak
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.counts] * (x in LONG)) for x in SCENARIO_NAMES]
)
def test_every_scenario_flies_and_comes_to_what_it_expects(name):
    claim, scenario = flown(name).claim, flown(name).scenario
    assert claim.missed == ()
    assert claim.verdict == ("met" if scenario.expect else "not tested")
    for run in flown(name).runs:
        assert (run.status == "completed") == (run.reason == "")
        if run.status == "completed" and scenario.route is None:
            assert run.duration == pytest.approx(scenario.flight.duration_s)
        assert np.isfinite(run.signals.to_numpy()).all()


@pytest.mark.soak
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_every_script_runs_and_is_short(script, tmp_path, monkeypatch):
    assert len(script.read_text().splitlines()) < LONGEST_SCRIPT
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(script)])

    run_path(str(script), run_name="__main__")

    assert list(tmp_path.rglob("certificate.json" if script.stem == "three_tanks" else "*.rrd"))


def test_the_page_of_scenarios_names_all_that_ship():
    text = (ROOT / "scenarios/README.md").read_text()
    for name in SCENARIO_NAMES:
        assert f"`{name}`" in text
    for script in SCRIPTS:
        assert f"`{script.name}`" in text


def cells(lines):
    """Cells of the rows of a table of Markdown."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_table_of_the_readme_is_part_of_that_of_the_first_flight():
    of_gains = {row[1]: row[5:9] for row in demo_rows() if row[0] == "jsbsim:aerosonde"}
    rows = cells((ROOT / "README.md").read_text().split("| gains |")[1].splitlines()[2:5])

    assert len(rows) == 3
    assert [row[1:] for row in rows] == [of_gains[row[0]] for row in rows]


def demo_rows():
    """Rows of the first table of docs/start.md."""
    text = (ROOT / "docs/start.md").read_text().split("<!-- demo:begin -->")[1]
    return cells(text.split("<!-- demo:end -->")[0].strip().splitlines()[2:])


@pytest.mark.soak
def test_the_table_of_the_first_flight_is_what_the_demo_shows():
    shown = demo_rows()
    runs = [(flown("paper"), run) for run in flown("paper").runs]
    # Then the laws on the aircraft.
    runs += [(flown("exact_law"), run) for run in flown("exact_law").runs[2:]]
    by_default = {"law": "exact", "gains": ["tuned_fed_back"], "expect": []}
    best = ft.fly(ft.load_scenario("exact_law", changes=by_default))
    runs.append((best, best.runs[-1]))
    assert [row[:2] for row in shown] == [
        [run.provenance.plant, run.provenance.gains_name] for _, run in runs
    ]
    for row, (demo, run) in zip(shown, runs, strict=True):
        found = demo.indicators[run.provenance.gains_name]
        assert row[2:5] == [f"{found.R_K:.4f}", f"{found.I_K:.3f}", f"{found.E_K:.3f}"]
        measured = demo.metrics.loc[run.label]
        overshoot = np.rad2deg(measured["MO_rad"])
        wanted = [measured["ITAE"], overshoot, measured["settling_s"]]
        numbers = [column[channel] for column in wanted for channel in ("chi", "gamma")]
        assert [float(cell) for cell in row[5:]] == pytest.approx(numbers, abs=LAST_DIGIT)
