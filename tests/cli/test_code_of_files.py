"""Commands run Python code that a file names after a word on stderr, or not at all."""

import textwrap

import pytest
from commands import answer, flighttune

import flighttune as ft

pytestmark = pytest.mark.usefixtures("own_workers")  # paths are those of the working folder

LAW = """
    import math
    from pathlib import Path

    with Path(__file__).with_name("ran").open("a") as mark:
        mark.write("x")

    class Mine:
        signals = {}

        def __init__(self, setup):
            self.dt = setup.dt

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            return reference.chi - measured.chi, math.cos(measured.gamma)
"""
SCENARIO = """
    title = "a stranger's"
    gains = ["paper"]
    flight = { V_a_mps = 25.0, duration_s = 0.5 }
    reference = { chi_deg = 10.0, gamma_deg = 0.0 }
    plant = [{ kind = "kinematic" }, { kind = "point_mass" }]
    law = [{ name = "paper", kind = "paper" },
           { name = "mine", kind = "python", module = "law.py", class = "Mine" }]
"""
CAMPAIGN = """
    title = "draws"
    scenario = "scenario.toml"
    runs = 8
    disperse = [{ key = "flight.chi_deg", distribution = "uniform", lower = -5.0, upper = 5.0 }]
"""
NOTICE = "runs the Python code of law.py"


@pytest.fixture
def folder(tmp_path):
    files = {"law.py": LAW, "scenario.toml": SCENARIO, "campaign.toml": CAMPAIGN}
    for name, text in files.items():
        (tmp_path / name).write_text(textwrap.dedent(text))
    return tmp_path


@pytest.mark.soak
@pytest.mark.parametrize(
    "command",
    [
        ("fly", "scenario.toml", "-q"),
        ("fly", "scenario.toml", "--json"),
        ("report", "scenario.toml@mine:paper"),
        ("compare", "scenario.toml@paper", "scenario.toml@mine:paper"),
        pytest.param(("campaign", "campaign.toml", "--workers", 1), marks=pytest.mark.slow),
    ],
)
def test_a_command_says_once_that_it_runs_the_code_of_a_file(folder, command):
    _, said = flighttune(*command, cwd=folder)

    assert said.splitlines().count(NOTICE) == 1
    assert said.startswith(NOTICE)
    assert (folder / "ran").exists()


def test_a_certificate_is_looked_for_after_the_word_too(folder):
    _, said = flighttune("certify", "scenario.toml", "--gains", "mine:paper", status=1, cwd=folder)

    assert said.startswith(NOTICE)


@pytest.mark.soak
@pytest.mark.parametrize(
    "command",
    [
        ("campaign", "campaign.toml", "--dry-run"),
        ("tune", "scenario.toml"),
        ("certify", "scenario.toml", "--gains", "paper"),
        ("report", "scenario.toml@paper"),
    ],
)
def test_other_commands_run_no_code_of_a_file(folder, command):
    _, said = flighttune(*command, cwd=folder)

    assert NOTICE not in said
    assert not (folder / "ran").exists()


def test_a_dry_run_says_why_it_estimates_no_time(folder):
    plan = answer("campaign", "campaign.toml", "--dry-run", cwd=folder)

    assert (plan["runs"], plan["draws"]) == (8, 2)
    assert "core_s" not in plan
    assert plan["notes"][-1].startswith("time and space are not estimated: that runs the code of")


def test_a_plan_knows_its_code_and_draws_none(folder):
    """A file named by a draw would not be in the plan's list of code."""
    plan = ft.plan_campaign(ft.load_campaign(folder / "campaign.toml"))
    assert plan.code == (str(folder / "law.py"),)

    draws = '[{ key = "law[1].module", distribution = "choice", values = ["law.py", "e.py"] }]'
    hidden = CAMPAIGN.partition("disperse")[0] + f"disperse = {draws}"
    (folder / "campaign.toml").write_text(textwrap.dedent(hidden))
    with pytest.raises(ft.ScenarioError, match=r"must not name .*code"):
        ft.load_campaign(folder / "campaign.toml")
