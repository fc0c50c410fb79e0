"""The campaigns that ship: their headers, and what becomes of their first flights."""

import pytest
from dispersed import rows_of
from places import CAMPAIGN_NAMES, ROOT

import flighttune as ft

pytestmark = pytest.mark.slow

FLOWN, ON_CIRCUITS = 8, 1
"""Flights of each campaign here; what all of one come to is told by its report."""

LONG = {"circuit_in_wind_a4", "circuit_in_wind_c172p"}
"""Campaigns whose first flights alone take over 10 s."""

FLYABLE = [pytest.param(x, marks=[pytest.mark.counts] * (x in LONG)) for x in CAMPAIGN_NAMES]


@pytest.mark.soak
def test_every_campaign_says_what_it_is_for_as_the_table_of_campaigns_does():
    folder = ROOT / "scenarios/campaigns"
    rows = [x for x in (folder / "README.md").read_text().splitlines() if x.startswith("| `")]
    campaigns = {name: ft.load_campaign(name) for name in CAMPAIGN_NAMES}

    for name, x in campaigns.items():
        assert all([x.title, x.verifies, x.source, x.success]), name
        assert ft.load_campaign(folder / f"{name}.toml") == x
    assert rows == [
        f"| `{name}.toml` | {x.title} | {x.verifies} |" for name, x in campaigns.items()
    ]


@pytest.mark.counts
@pytest.mark.parametrize("name", FLYABLE)
def test_the_first_flights_of_every_campaign_are_flown(name):
    flown = ON_CIRCUITS if name.startswith("circuit") else FLOWN
    plan = ft.plan_campaign(ft.load_campaign(name), runs=flown)
    rows = rows_of(plan).to_pandas()

    assert set(rows["status"]) <= {"completed", "left_envelope"}
    assert rows["status"].value_counts()["completed"] > flown / 2


@pytest.mark.soak
def test_the_first_campaign_comes_to_what_its_header_says():
    plan = ft.plan_campaign(ft.load_campaign("first_campaign"))
    success = rows_of(plan).to_pandas().groupby(["plant", "gains"])["success"]

    share = success.mean().to_dict()
    assert share.pop(("jsbsim:aerosonde", "paper")) <= 0.5
    assert set(share.values()) == {1.0}
