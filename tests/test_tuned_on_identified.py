"""Gains tuned on the identified aircraft, flown: the paper's manoeuvre and others not used."""

import re
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft

pytestmark = pytest.mark.slow

NOTHING_ASKED = 0.01
"""ITAE, rad s^2, below which a channel was not asked to move."""

AIRCRAFT = "jsbsim:aerosonde"
PAGE = (Path(__file__).parents[1] / "docs/identification.md").read_text(encoding="utf-8")
HALF_OF_THE_LAST_DIGIT = 0.0051
LIMITS = {
    "phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0, "n_z": [-2.1, 2.1], "n_z_rate_per_s": 1.0,
}  # fmt: skip

UNUSED = {
    "left": {"chi_deg": -60.0},
    "a small turn": {"chi_deg": 5.0, "gamma_deg": 2.0},
    "climb": {"gamma_deg": 15.0},
    "dive out of a climb": {"from": {"gamma_deg": 12.0, "chi_deg": 20.0}, "gamma_deg": -4.0},
    "slow": {"V_a_mps": 20.0, "chi_deg": 60.0, "from": {"gamma_deg": 20.0}},
    "fast": {"V_a_mps": 30.0, "chi_deg": -60.0, "from": {"gamma_deg": 20.0}},
}


def manoeuvre(wanted, *, robust=False, **more):
    wanted = dict(wanted)
    start = {"V_a_mps": wanted.pop("V_a_mps", 25.0), **wanted.pop("from", {})}
    return ft.scenario_from(
        {
            "title": "a manoeuvre the gains were not made for",
            "seed": 3,
            "gains": ["paper", "tuned", "tuned_identified"],
            "flight": {"duration_s": 20.0, "h_m": 1000.0, **start},
            "reference": {"chi_deg": 0.0, "gamma_deg": 0.0, **wanted},
            "limits": LIMITS,
            "controller": {"rate_hz": 50.0, "feed_forward": True, "schedule": True},
            "tuning": {"robust": robust},
            "plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}],
        }
        | more
    )


def itae(flown, gains, plant=AIRCRAFT):
    label = f"{plant} / {gains}"
    return {channel: flown.metrics.at[(label, channel), "ITAE"] for channel in ("chi", "gamma")}


@pytest.fixture(scope="module")
def paper():
    return ft.fly(ft.load_scenario("paper_identified"))


@pytest.mark.counts
def test_the_table_of_the_page_is_what_the_scenario_flies(paper):
    tables = ft.load_scenario("paper_identified").as_dict() | {"gains": ["tuned_identified"]}
    robust = ft.fly(ft.scenario_from(tables | {"tuning": {**tables["tuning"], "robust": True}}))
    rows = {
        "K* as printed": (paper, "paper"),
        "`tuned` on the kinematic law": (paper, "tuned"),
        "`tuned_identified`": (paper, "tuned_identified"),
        "`tuned_identified`, robust": (robust, "tuned_identified"),
    }
    printed = np.array([*itae(paper, "paper").values()])
    for title, (flown, gains) in rows.items():
        (cells,) = re.findall(rf"^\| {re.escape(title)} \|(.*)\|$", PAGE, re.MULTILINE)
        told = [float(number) for number in re.findall(r"[\d.]+", cells)]
        law, aircraft = (
            np.array([*itae(flown, gains, p).values()]) for p in ("kinematic", AIRCRAFT)
        )
        ratio = [] if gains == "paper" else aircraft / printed
        assert told == pytest.approx([*law, *aircraft, *ratio], abs=HALF_OF_THE_LAST_DIGIT), title


def wins(flown):
    assert all(run.status == "completed" for run in flown.runs)
    tuned = itae(flown, "tuned_identified")
    for other in ("paper", "tuned"):
        for channel, value in itae(flown, other).items():
            assert tuned[channel] < max(value, NOTHING_ASKED), f"{channel} of {other} is better"


@pytest.mark.counts
@pytest.mark.parametrize(
    ("name", "intensity"),
    [*((name, None) for name in UNUSED), ("left", "moderate"), ("climb", "light")],
)
def test_wins_on_manoeuvres_not_used_and_in_turbulence(name, intensity):
    air = {} if intensity is None else {"turbulence": {"intensity": intensity}}

    wins(ft.fly(manoeuvre(UNUSED[name], **air)))


@pytest.fixture(scope="module")
def left():
    """The turn to the left, its model the identified one, and the gains tuned on it."""
    scenario = manoeuvre(UNUSED["left"], tuning={"model": "identified"})
    return scenario, ft.tune(scenario).gains


def test_a_claim_over_an_envelope_is_refused_where_the_law_is_behind_a_lag():
    ranges = {
        "V_a_mps": [22.0, 28.0], "gamma_deg": [-9.0, 9.0], "phi_deg": [-9.0, 9.0], "n_z": [0.9, 1.1]
    }  # fmt: skip
    scenario = manoeuvre({"chi_deg": 5.0}, tuning={"lag_rad_s": [4.0, 8.0]}, envelope=ranges)

    with pytest.raises(ft.ScenarioError, match=r"`model` of \[tuning\]"):
        ft.certify(scenario, ft.PAPER_GAINS, envelope=True)
