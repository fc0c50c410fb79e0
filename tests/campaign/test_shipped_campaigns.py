"""The campaigns that ship: their headers, and what becomes of their first flights."""

from pathlib import Path

import pytest

import flighttune as ft
from flighttune.campaign.flying.rows import fly_runs
from flighttune.files.shipped import campaign_files

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
FLOWN = 12
"""Flights of each campaign here; what all of one come to is told by its report."""


@pytest.mark.parametrize("name", campaign_files())
def test_every_campaign_says_what_it_is_for(name):
    campaign = ft.load_campaign(name)

    assert campaign.title
    assert campaign.verifies
    assert campaign.source
    assert campaign.success
    assert ft.load_campaign(ROOT / f"scenarios/campaigns/{name}.toml") == campaign


def test_the_table_of_campaigns_says_what_their_headers_say():
    text = (ROOT / "scenarios/campaigns/README.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| `")]

    assert rows == [
        f"| `{name}.toml` | {campaign.title} | {campaign.verifies} |"
        for name, campaign in ((name, ft.load_campaign(name)) for name in campaign_files())
    ]


@pytest.mark.parametrize("name", campaign_files())
def test_the_first_flights_of_every_campaign_are_flown(name):
    plan = ft.plan_campaign(ft.load_campaign(name), runs=FLOWN)
    rows = fly_runs(plan, range(FLOWN)).to_pandas()

    assert set(rows["status"]) <= {"completed", "left_envelope"}
    assert rows["status"].value_counts()["completed"] > FLOWN / 2


@pytest.mark.parametrize("name", ["kinematic_sweep", "grid_speed_gain"])
def test_runs_make_up_whole_cycles(name):
    plan = ft.plan_campaign(ft.load_campaign(name))

    assert plan.runs % (plan.cycle * len(plan.groups)) == 0


def test_the_first_campaign_comes_to_what_its_header_says():
    plan = ft.plan_campaign(ft.load_campaign("first_campaign"))
    success = fly_runs(plan, range(plan.runs)).to_pandas().groupby(["plant", "gains"])["success"]

    share = success.mean().to_dict()
    assert share.pop(("jsbsim:aerosonde", "paper")) <= 0.5
    assert set(share.values()) == {1.0}
