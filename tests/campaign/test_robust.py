"""Gains chosen by flying them: the choice, how sure it is said to be, and the command."""

import json

import numpy as np
import pandas as pd
import pytest
from campaigns import Notes
from commands import answer, flighttune

from flighttune.campaign.choice import frontier_gains, scored, tune_robust, with_gains
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.rows import fly_runs
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.stated_set import StoppedError
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
SETTINGS = {"candidates": 5, "percentile": 90.0, "metrics": ("chi.ITAE", "gamma.MO_deg")}


def write(folder, most=50.0, more=""):
    file = folder / "law.toml"
    file.write_text(CAMPAIGN.format(most=most) + more, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return load_campaign(write(tmp_path_factory.mktemp("law")))


def tuned(campaign, **workers):
    """The answer with SETTINGS, and the gains chosen."""
    with WorkerPool(**workers) as pool:
        return tune_robust(campaign, pool, **SETTINGS)


@pytest.fixture(scope="module")
def chosen(campaign, address):
    return tuned(campaign, scheduler=address)[0]


def test_candidates_are_the_points_of_the_frontier(campaign, chosen):
    gains = list(frontier_gains(tuning_problem(campaign.nominal), 5).values())

    table = frontier(tuning_problem(campaign.nominal), points=5)
    along = [candidate["R_K"] for candidate in chosen["candidates"]]
    assert along == pytest.approx(sorted(set(table["R_K"])), rel=1e-12)
    assert chosen["candidates"][0]["I_K"] == pytest.approx(table["I_K"].min(), rel=1e-12)
    assert gains[-1].K_P[0, 0] == table["K_P[phi,chi]"].iloc[-1]
    assert gains[-1].K_I[1, 1] == table["K_I[n_z,gamma]"].iloc[-1]


def test_other_gains_fly_the_same_draws(campaign):
    other = with_gains(campaign, {"x": PAPER_GAINS, "y": PAPER_GAINS})

    mine, theirs = plan_campaign(campaign), plan_campaign(other, runs=240)

    assert theirs.parameters().equals(mine.parameters())
    assert [group.gains for group in theirs.groups] == ["x", "y"]


def test_the_choice_has_the_lowest_percentile_of_all_that_flew_everything(campaign, chosen):
    """Everything flown once more in this process, and looked at with numpy."""
    gains = frontier_gains(tuning_problem(campaign.nominal), 5)
    plan = plan_campaign(with_gains(campaign, gains), runs=120 * len(gains))
    rows = fly_runs(plan, range(plan.runs)).to_pandas()
    score = rows["chi.ITAE"] + rows["gamma.MO_rad"] / DEG
    table = rows.assign(score=score).pivot(index="draw", columns="gains", values="score")

    assert chosen["status"] == "chosen"
    assert (rows["status"] == "completed").all()
    expected = table.apply(
        lambda values: np.quantile(values, 0.9, method="inverted_cdf")
    )  # fmt: skip
    assert chosen["name"] == expected.idxmin()
    for candidate in chosen["candidates"]:
        low, high = candidate["interval"]
        assert low <= candidate["value"] == expected[candidate["name"]] <= high


def test_the_choice_says_how_sure_it_is(chosen):
    (own,), candidates = chosen["beside"], chosen["candidates"]
    (best,) = (each for each in candidates if each["name"] == chosen["name"])
    assert chosen["draws"] == best["draws"] == 120
    assert sum(each["p_best"] for each in candidates) == pytest.approx(1.0)
    assert chosen["loss"] >= 0.0
    assert (best["behind"], *best["behind_interval"]) == (0.0, 0.0, 0.0)
    assert own["name"] == "paper"
    assert np.isnan(own["p_best"])
    assert chosen["flights"] == 120 * (len(candidates) + 1)


def test_the_choice_does_not_depend_on_who_flies(campaign, chosen):
    assert repr(tuned(campaign, workers=2)[0]) == repr(chosen)


def test_a_stopped_choice_flies_no_further(campaign, address):
    observer = Notes(until=lambda progress: True)

    with pytest.raises(StoppedError):
        tuned(campaign, scheduler=address, observer=observer)


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
        ({"metrics": ("chi.nothing",)}, r"`metric`.*chi.ITAE, .* 'chi.nothing'"),
        ({"metrics": ()}, "`metric`"),
        ({"percentile": 100.0}, "`percentile`.* 100"),
        ({"least_success": 1.5}, "`min_success`.* 1.5"),
        ({"draws": 0}, "`draws`.* 0"),
        ({"plants": ("glider",)}, r"`plant` .*kinematic.* 'glider'"),
    ],
)
def test_settings_that_cannot_be_are_refused(campaign, settings, message):
    with WorkerPool() as pool, pytest.raises(InputError, match=message):
        tune_robust(campaign, pool, **settings)


def test_the_command_answers_and_writes_gains_that_other_commands_read(tmp_path, address):
    file, out = write(tmp_path), tmp_path / "gains.json"

    said = answer(
        "campaign", "tune", file, "--candidates", 3, "--draws", 40, "--scheduler", address,
        "--out", out,
    )  # fmt: skip

    assert said["status"] == "chosen"
    assert said["value"] == min(each["value"] for each in said["candidates"])
    assert [each["name"] for each in said["beside"]] == ["paper"]
    assert load_gains(out).K_P.tolist() == said["K_P"]
    assert json.loads(out.read_text()) == said


def test_the_command_says_no_where_no_gains_succeed_often_enough(tmp_path, address):
    file, out = write(tmp_path, most=0.001), tmp_path / "gains.json"

    shown, error = flighttune(
        "campaign", "tune", file, "--candidates", 2, "--draws", 20, "--scheduler", address,
        "--min-success", 0.5, "--out", out, status=1,
    )  # fmt: skip

    assert "frontier-1" in shown
    assert "must succeed on 50.0% of the draws, the best of 2 candidates succeeds on 0.0%" in error
    assert not out.exists()


def test_gains_of_the_exact_law_are_chosen_as_rates_on_the_same_draws(tmp_path, address):
    (tmp_path / "exact.toml").write_text(
        'law = "exact"\n' + scenario_files()["paper"].read_text(encoding="utf-8"), encoding="utf-8"
    )
    file = write(tmp_path)
    file.write_text(file.read_text().replace('"paper"\nseed', '"exact.toml"\nseed'))
    campaign = load_campaign(file)

    few = SETTINGS | {"candidates": 3, "draws": 40}
    with WorkerPool(scheduler=address) as pool:
        choice, gains = tune_robust(campaign, pool, **few)

    assert choice["status"] == "chosen"
    assert gains.law == "exact"
    (beside,) = choice["beside"]
    (paper,) = plan_campaign(campaign).gain_sets.values()
    assert beside["name"] == "paper"
    # In 1/s: the paper's gains times g/V, at the airspeed of the scenario.
    assert pytest.approx(paper.K_P) == PAPER_GAINS.K_P * G_PAPER / campaign.nominal.flight.V_a_mps
    rows = fly_runs(plan_campaign(with_gains(campaign, {"paper": paper})), range(40)).to_pandas()
    score = rows["chi.ITAE"] + rows["gamma.MO_rad"] / DEG
    expected = np.quantile(score, 0.9, method="inverted_cdf")
    assert beside["value"] == expected


def test_two_laws_are_refused(campaign):
    both = scenario_from(campaign.nominal.as_dict() | {"law": ["paper", "exact"]})

    with pytest.raises(InputError, match=r"`law` .* got paper, exact"):
        tuned(campaign.model_copy(update={"nominal": both}))
