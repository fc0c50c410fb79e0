"""Gains chosen by flying them: the choice, how sure it is said to be, and the command."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from campaigns import Notes
from commands import answer, flighttune

from flighttune.campaign.choice import (
    RobustSettings,
    frontier_candidates,
    own_candidates,
    scored,
    tune_robust,
    with_gains,
)
from flighttune.campaign.engine.pool import worker_pool
from flighttune.campaign.flying.rows import fly_runs
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.control.gains import PAPER_GAINS
from flighttune.errors import InputError
from flighttune.flight.outer_loop import tuning_problem
from flighttune.scenario import load_gains, scenario_from
from flighttune.shipped import scenario_files
from flighttune.tuning.frontier import frontier
from flighttune.units import DEG, G_PAPER

pytestmark = pytest.mark.slow

CAMPAIGN = """
title = "The law, started otherwise"
scenario = "paper"
seed = 5
runs = 120
gains = ["paper"]
[[plant]]
kind = "kinematic"
[overrides]
flight.duration_s = 12.0
[[disperse]]
key = "flight.V_a_mps"
distribution = "uniform"
lower = 20.0
upper = 30.0
[[disperse]]
key = "flight.gamma_deg"
distribution = "uniform"
lower = 25.0
upper = 45.0
[[success]]
at_most.chi.ITAE = {most}
"""
SETTINGS = RobustSettings(candidates=5, percentile=90.0, metrics=("chi.ITAE", "gamma.MO_deg"))


def write(folder, most=50.0, more=""):
    file = folder / "law.toml"
    file.write_text(CAMPAIGN.format(most=most) + more, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return load_campaign(write(tmp_path_factory.mktemp("law")))


def tuned(campaign, settings=SETTINGS, **workers):
    with worker_pool(**workers) as pool:
        return tune_robust(campaign, settings, pool)


@pytest.fixture(scope="module")
def chosen(campaign, address):
    return tuned(campaign, scheduler=address)


def test_candidates_are_the_points_of_the_frontier(campaign):
    found = frontier_candidates(campaign.nominal, 5)

    table = frontier(tuning_problem(campaign.nominal), points=5)
    assert [one.R_K for one in found] == sorted(set(table["R_K"]))
    assert found[0].I_K == table["I_K"].min()
    assert found[-1].gains.K_P[0, 0] == table["K_P[phi,chi]"].iloc[-1]
    assert found[-1].gains.K_I[1, 1] == table["K_I[n_z,gamma]"].iloc[-1]


def test_other_gains_fly_the_same_draws(campaign):
    own = own_candidates(campaign.nominal, plan_campaign(campaign).gain_sets)
    other = with_gains(campaign, {"x": own[0].gains, "y": own[0].gains})

    mine, theirs = plan_campaign(campaign), plan_campaign(other, runs=240)

    assert theirs.parameters().equals(mine.parameters())
    assert [group.gains for group in theirs.groups] == ["x", "y"]


def test_the_choice_has_the_lowest_percentile_of_all_that_flew_everything(campaign, chosen):
    """Everything flown once more in this process, and looked at with numpy."""
    gains = {one.candidate.name: one.candidate.gains for one in chosen.candidates}
    plan = plan_campaign(with_gains(campaign, gains), runs=120 * len(gains))
    rows = fly_runs(plan, range(plan.runs)).to_pandas()
    score = rows["chi.ITAE"] + rows["gamma.MO_rad"] / DEG
    table = rows.assign(score=score).pivot(index="draw", columns="gains", values="score")

    assert chosen.status == "chosen"
    assert (rows["status"] == "completed").all()
    expected = table.apply(
        lambda values: np.quantile(values, 0.9, method="inverted_cdf")
    )  # fmt: skip
    assert chosen.best.candidate.name == expected.idxmin()
    for one in chosen.candidates:
        assert one.percentile.value == expected[one.candidate.name]
        assert one.percentile.lo <= one.percentile.value <= one.percentile.hi


def test_the_choice_says_how_sure_it_is(chosen):
    assert chosen.draws == chosen.best.success.n == 120
    assert sum(one.p_best for one in chosen.candidates) == pytest.approx(1.0)
    assert chosen.loss >= 0.0
    assert chosen.best.behind.lo == chosen.best.behind.value == chosen.best.behind.hi == 0.0
    (own,) = chosen.baselines
    assert own.candidate.name == "paper"
    assert np.isnan(own.p_best)
    assert chosen.flights == 120 * len((*chosen.candidates, *chosen.baselines))


def test_the_choice_does_not_depend_on_who_flies(campaign, chosen):
    local = tuned(campaign, workers=2)

    for one, other in zip(
        (local.best, *local.candidates, *local.baselines),
        (chosen.best, *chosen.candidates, *chosen.baselines),
        strict=True,
    ):
        assert one.candidate == other.candidate
        assert repr(dataclasses.astuple(one)[1:]) == repr(dataclasses.astuple(other)[1:])
    assert (local.loss, local.flights) == (chosen.loss, chosen.flights)


def test_a_stopped_choice_says_so(campaign, address):
    observer = Notes(until=lambda progress: True)

    found = tuned(campaign, scheduler=address, observer=observer)

    assert found.status == "interrupted"
    assert found.best is None


def test_a_draw_counts_as_on_its_worst_plant():
    rows = pd.DataFrame(
        {
            "draw": [7, 7, 7, 7, 8, 8, 8, 8],
            "plant": ["law", "law", "craft", "craft"] * 2,
            "gains": ["a", "b"] * 4,
            "status": ["completed"] * 7 + ["diverged"],
            "success": [True, True, True, False, True, True, True, False],
            "chi.ITAE": [1.0, 2.0, 3.0, 1.5, 4.0, np.nan, 2.0, 0.1],
            "chi.MO_rad": [0.0, DEG, 0.0, 0.0, 2.0 * DEG, 0.0, 0.0, 0.0],
        }
    )

    scores, success = scored(rows, ["b", "a"], ["chi.ITAE", "chi.MO_deg"])

    assert scores.tolist() == [[pytest.approx(3.0), np.inf], [3.0, pytest.approx(6.0)]]
    assert success.tolist() == [[False, False], [True, True]]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"metrics": ("chi.nothing",)}, r"`metric` must be one of chi.ITAE, .* 'chi.nothing'"),
        ({"metrics": ()}, "`metric` must be one of"),
        ({"percentile": 100.0}, "`percentile` must be between 0 and 100, got 100"),
        ({"least_success": 1.5}, "`min_success` must be 0 to 1, got 1.5"),
        ({"draws": 0}, "`draws` must be at least 1"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        RobustSettings(**settings)


def test_a_plant_must_be_one_of_the_campaign(campaign):
    with pytest.raises(InputError, match=r"`plant` .*kinematic.* 'glider'"):
        tuned(campaign, RobustSettings(plants=("glider",)))


def test_the_command_answers_and_writes_gains_that_other_commands_read(tmp_path, address):
    file, out = write(tmp_path), tmp_path / "gains.json"

    told = answer(
        "campaign", "tune", file, "--candidates", 3, "--draws", 40, "--scheduler", address,
        "--out", out,
    )  # fmt: skip

    assert told["status"] == "chosen"
    assert told["value"] == min(one["value"] for one in told["candidates"])
    assert told["interval"][0] <= told["value"]
    assert 0.0 <= told["p_best"] <= 1.0
    assert [one["name"] for one in told["beside"]] == ["paper"]
    assert load_gains(out).K_P.tolist() == told["K_P"]
    assert json.loads(out.read_text()) == told


def test_the_command_says_no_where_no_gains_succeed_often_enough(tmp_path, address):
    file, out = write(tmp_path, most=0.001), tmp_path / "gains.json"

    shown, error = flighttune(
        "campaign", "tune", file, "--candidates", 2, "--draws", 20, "--scheduler", address,
        "--min-success", 0.5, "--out", out, status=1,
    )  # fmt: skip

    assert "frontier-1" in shown
    assert "must succeed on 50.0% of the draws, the best of 2 candidates succeeds on 0.0%" in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("tune", "paper", "--out", "gains.txt"), "gains.txt: --out must end in .json"),
        (("tune", "paper", "--envelope", "--method", "convex"), "--method: must be absent"),
        (("campaign", "tune", "first_campaign", "--out", "gains.txt"), "must end in .json"),
        (("campaign", "tune", "nowhere"), "nowhere: the campaign must be a file or one of"),
    ],
)
def test_tuning_refuses_what_cannot_be(arguments, message, tmp_path):
    _, error = flighttune(*arguments, status=2, cwd=tmp_path)

    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_gains_of_the_exact_law_are_chosen_as_rates_on_the_same_draws(tmp_path, address):
    (tmp_path / "exact.toml").write_text(
        'law = "exact"\n' + scenario_files()["paper"].read_text(encoding="utf-8"), encoding="utf-8"
    )
    file = write(tmp_path)
    file.write_text(file.read_text().replace('"paper"\nseed', '"exact.toml"\nseed'))
    campaign = load_campaign(file)

    few = dataclasses.replace(SETTINGS, candidates=3, draws=40)
    found = tuned(campaign, few, scheduler=address)

    assert found.status == "chosen"
    assert found.best.candidate.gains.law == "exact"
    assert [one.candidate.name for one in found.baselines] == ["paper"]
    paper = found.baselines[0].candidate.gains
    # In 1/s: the paper's gains times g/V, at the airspeed of the scenario.
    assert pytest.approx(paper.K_P) == PAPER_GAINS.K_P * G_PAPER / campaign.nominal.flight.V_a_mps
    rows = fly_runs(plan_campaign(with_gains(campaign, {"paper": paper})), range(40)).to_pandas()
    score = rows["chi.ITAE"] + rows["gamma.MO_rad"] / DEG
    expected = np.quantile(score, 0.9, method="inverted_cdf")
    assert found.baselines[0].percentile.value == expected


def test_two_laws_are_refused(campaign):
    both = scenario_from(campaign.nominal.as_dict() | {"law": ["paper", "exact"]})

    with pytest.raises(InputError, match=r"`law` .* got paper, exact"):
        tuned(campaign.model_copy(update={"nominal": both}))
