"""The page has what was asked for and what came of it, in tables that stay tables."""

import re
import tomllib

import pytest

from flighttune.recording.page import scenario_page


@pytest.fixture(scope="module")
def page(four_runs, cut_short, without_gains):
    runs = [*four_runs, cut_short, without_gains]
    return scenario_page(
        runs,
        scenario=four_runs[0].provenance.scenario,
        indicators={
            "paper": (0.45993, 4.91615, 1.67143),
            "tuned": (0.53976, 5.0, 1.23545),
            "strict": None,
        },
    )


def rows(page, heading):
    """Cells of the table below a heading, without headings and rule."""
    lines = page.split(f"## {heading}\n\n")[1].split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def test_every_run_is_named_with_its_colour_and_outcome(page):
    assert rows(page, "Runs") == [
        ["kinematic / paper", "light blue", "20.00", "completed"],
        ["jsbsim:aerosonde / paper", "blue", "20.00", "completed"],
        ["kinematic / tuned", "apricot", "20.00", "completed"],
        ["jsbsim:aerosonde / tuned", "rust", "20.00", "completed"],
        [
            "jsbsim:aerosonde / bold",
            "green",
            "7.00",
            "left envelope: alpha 16.3 deg at t = 7.00 s, must stay below 16 deg",
        ],
        [
            "jsbsim:aerosonde / strict",
            "not drawn",
            "0.00",
            "no gains: the smallest reachable I_K is 67.15",
        ],
    ]


def test_the_scenario_is_there_as_toml_that_flies_again(page, four_runs):
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)

    assert tomllib.loads(text) == four_runs[0].provenance.scenario
