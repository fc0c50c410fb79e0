"""The worst flight and rare misses: against closed forms, and on small campaigns of the law."""

import math

import numpy as np
import pyarrow as pa
import pytest
from campaigns import flown_here, write_campaign
from commands import answer, flighttune
from dispersed import KINEMATIC, SOFT, plan_of, tables_of, uniform
from scipy.stats import chi2, norm

from flighttune.campaign import worst as worst_module
from flighttune.campaign.conform import at_random
from flighttune.campaign.flying.rows import fly_runs
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.stated_set import planned
from flighttune.campaign.worst import (
    SEEDS_EVERY,
    StatedSet,
    find_worst,
    search_worst,
    subset_simulation,
    value_of,
)
from flighttune.flight.fly import fly
from flighttune.guarantee.bounds import Bounds
from flighttune.metrics import measures
from flighttune.scenario import load_scenario
from flighttune.tube.store import AboutTube, write_sealed

SAME = 1e-9
"""A flight of a batch and the same one alone differ by 1e-12."""

START = uniform("flight.chi_deg", -40.0, 40.0), uniform("flight.gamma_deg", -10.0, 10.0)
DEMAND = {"at_most": {"chi": {"peak_deg": 35.0}}}


def small_plan(**tables):
    """Three seconds of the law from random starts."""
    return plan_of(tables_of((KINEMATIC,), **{"gains": [SOFT], **tables}), *START, runs=8)


@pytest.mark.parametrize("dimension", [2, 8, 20])
def test_the_worst_of_a_plane_lies_where_its_normal_meets_the_region(dimension):
    normal = np.arange(1.0, dimension + 1.0)
    normal /= np.linalg.norm(normal)

    z, _, first = search_worst(lambda z, seeds: z @ normal, dimension, budget=2000, seed=3)

    radius = math.sqrt(chi2.ppf(0.999, dimension))
    assert np.linalg.norm(z) <= radius * (1.0 + SAME)
    assert z @ normal > 0.98 * radius
    assert first < z @ normal


def test_chance_is_that_of_the_worst_flight_so_far_and_others_are_tried():
    seen = []

    def values(z, seeds):
        seen.append((z, seeds))
        return (seeds % 1000).astype(float)

    _, seed, first = search_worst(values, 3, budget=640, seed=5)

    best = first
    assert first == max(seen[0][1] % 1000)
    for generation, (z, seeds) in enumerate(seen[1:], 1):
        if generation % SEEDS_EVERY == 0:
            assert len(set(seeds)) == len(seeds)
            assert (z == z[0]).all()
            best = max(best, *(seeds % 1000))
        else:
            assert set(seeds % 1000) == {best}
    assert seed % 1000 == best > first


@pytest.mark.parametrize("beta", [1.0, 2.5, 3.7])
def test_subset_simulation_finds_the_tail_of_a_normal_distribution(beta):
    """P(z_1 + ... + z_5 >= beta sqrt(5)) = Phi(-beta): one flight in 6, in 160, in 9000."""
    true = norm.cdf(-beta)
    estimates = [
        subset_simulation(
            lambda z, seeds: z.sum(axis=1) / math.sqrt(5.0),
            5, threshold=beta, budget=10_000, seed=seed,
        )
        for seed in range(20)
    ]  # fmt: skip

    mean = np.mean([estimate["probability"] for estimate in estimates])
    # Mean of twenty: its own scatter is the coefficient of variation (0.3 at most) over sqrt(20).
    assert mean == pytest.approx(true, rel=0.25)
    covering = sum(estimate["low"] <= true <= estimate["high"] for estimate in estimates)
    assert covering >= 15  # of intervals that hold at 95 %, fewer than 15 in 20 once in 3000 times


def test_what_is_never_reached_has_a_ceiling_only():
    miss = subset_simulation(lambda z, seeds: z[:, 0], 2, threshold=99.0, budget=1000, seed=1)

    assert miss["probability"] == 0.0
    assert 0.0 < miss["high"] < 1e-2
    assert miss["flights"] <= 1000


@pytest.mark.slow
def test_the_worst_flight_is_worse_than_random_ones_and_is_flown_again_as_it_was():
    plan = small_plan()
    with flown_here(worst_module, "planned", plan) as pool:
        searched = StatedSet("campaign", pool, metric="chi.peak_rad")
        worst, scenario = find_worst(searched, budget=320, seed=1)

    rows = fly_runs(plan.with_runs(300), range(300)).to_pandas()
    assert worst["value"] > rows["chi.peak_rad"].max()
    assert worst["distance"] <= worst["radius"] * (1.0 + SAME)
    assert abs(worst["drawn"]["flight.chi_deg"]) <= 40.0
    (run,) = fly(scenario).runs
    assert measures(run)["chi"]["peak_rad"] == pytest.approx(worst["value"], rel=SAME)


@pytest.mark.slow
def test_probability_of_a_miss_agrees_with_counting():
    """Starts are uniform and the error is largest at the start: |chi_0| > 35 of 40 deg."""
    plan = small_plan(expect=[DEMAND])
    with flown_here(worst_module, "planned", plan):
        miss = answer("worst", "campaign", "--rare", "--budget", 2000)

    assert miss["metric"] == "margin"
    assert miss["low"] <= 5.0 / 40.0 <= miss["high"]
    rows = fly_runs(plan.with_runs(1000), range(1000)).to_pandas()
    counted = 1.0 - rows["success"].mean()
    assert miss["probability"] == pytest.approx(counted, abs=0.06)  # two sd of each


def test_the_margin_is_that_of_the_nearest_demand():
    plan = small_plan(
        expect=[
            DEMAND,
            {"at_least": {"flight": {"n_z_min": 2.0}}},
            {"at_most": {"chi": {"ITAE": 0.0}}},
        ]
    )
    row = {
        "status": "completed", "plant": "kinematic", "gains": "soft",
        "chi.peak_rad": np.radians(70.0), "flight.n_z_min": 1.0, "chi.ITAE": 0.3,
    }  # fmt: skip

    assert value_of(row, "margin", plan.scenario) == pytest.approx(1.0)  # 70 of 35 deg
    assert value_of({**row, "chi.ITAE": 1.5}, "margin", plan.scenario) == pytest.approx(1.5)
    assert value_of({**row, "status": "diverged"}, "chi.ITAE", plan.scenario) > 100.0
    assert value_of(row, "chi.ITAE", plan.scenario) == 0.3


@pytest.mark.parametrize(("completed", "worst"), [(False, 1), (True, 2)])
def test_flights_that_end_early_are_the_worst_or_left_out(completed, worst):
    columns = {
        "run": range(3),
        "status": ["completed", "diverged", "completed"],
        "chi.ITAE": [0.5, 0.1, 0.7],
    }

    def rows(plan, runs, **options):
        return pa.table(columns)

    with flown_here(worst_module, "planned", small_plan(), rows) as pool:
        searched = StatedSet("campaign", pool, metric="chi.ITAE", completed=completed)
        values = searched.values(np.zeros((3, 2)), np.arange(3))

    assert np.argmax(values) == searched.worst["run"] == worst


@pytest.mark.slow
def test_a_scenario_is_searched_over_starts_and_disturbances_of_one_plant():
    plan = planned("paper", start_deg=5.0, disturbance=0.01)

    assert {"flight.chi_deg", "disturbance.gamma_amplitude"} <= set(plan.keys)
    assert [table.label for table in plan.scenario.plant] == ["kinematic"]
    assert plan.scenario.disturbance.wave == "square"


def test_nearness_is_that_to_the_widest_place_until_a_flight_leaves_the_narrowest():
    (run,) = fly(small_plan().scenario_of(2)).runs
    t = run.signals.index.to_numpy()
    middle = run.signals[["chi_err", "gamma_err"]].to_numpy()
    width = np.where(t < 1.0, 0.01, 0.1)[:, None]

    def tube(beside):
        return Bounds(t=t, low=middle + beside - width, high=middle + beside + width)

    assert tube(0.009).share(run) == pytest.approx(0.09)
    assert tube(0.009).reach(run) == pytest.approx([0.09, 0.09])
    assert tube(0.009).ratios(run) == pytest.approx({"chi": 1.0 / 0.09, "gamma": 1.0 / 0.09})
    assert tube(0.02).share(run) == pytest.approx(2.0)


@pytest.mark.slow
def test_the_flight_nearest_to_leaving_a_tube_is_searched(tmp_path):
    """Starts are up to 40 deg apart and the tube is 20 deg wide either side of north."""
    plan = small_plan()
    (run,) = fly(plan.scenario_of(2)).runs
    width = np.full((len(run.t), 2), np.radians(20.0))
    about = AboutTube(
        run="",
        status="bounded",
        reason="",
        model="made up",
        start_deg=0.0,
        handed_over_s=None,
        probability=None,
    )
    write_sealed(Bounds(run.t, -width, width).columns, about, tmp_path / "tube.parquet")
    with flown_here(worst_module, "planned", plan):
        said = answer(
            "worst", "campaign", "--budget", 96, "--tube", tmp_path / "tube.parquet", "--out",
            tmp_path / "worst.toml",
        )  # fmt: skip

    assert said["metric"] == "tube"
    # 20 deg of half width over the largest distance, the same number as the share's inverse
    assert min(said["ratio"].values()) == pytest.approx(1.0 / said["value"], rel=1e-6)
    assert all(said["ratio_of_search"][name] <= said["ratio"][name] for name in ("chi", "gamma"))
    assert said["family"] is None  # no disturbance was searched
    assert 1.7 < said["value"] <= 2.0 * (1.0 + SAME)  # the start itself, 40 of 20 deg


def test_the_command_writes_a_scenario_that_flies_to_what_it_says(tmp_path):
    with flown_here(worst_module, "planned", small_plan(expect=[DEMAND])):
        said = answer("worst", "campaign", "--budget", 64, "--out", tmp_path / "worst.toml")

    assert said["metric"] == "margin"
    assert said["flights"] == 64
    out, err = flighttune("fly", said["scenario"], "--out", tmp_path / "runs", status=1)
    peak = 35.0 * (1.0 + said["value"])
    assert "chi.peak_deg must be at most 35" in err + out
    assert f"got {peak:.4g}" in err + out


@pytest.mark.slow
def test_workers_fly_what_is_searched(tmp_path):
    windy = write_campaign(tmp_path, runs=20, law=False)

    said = answer(
        "worst", windy, "--budget", 64, "--metric", "chi.ITAE", "--workers", 1, "--out",
        tmp_path / "worst.toml",
    )  # fmt: skip

    assert said["flights"] == 64
    assert said["value"] > said["first"]
    (run,) = fly(load_scenario(said["scenario"])).runs
    assert measures(run)["chi"]["ITAE"] == said["value"]


@pytest.mark.soak
def test_the_search_finds_worse_than_random_flights_of_the_dispersed_aerosonde(tmp_path):
    """Turbulence, sensors, airframe and start: 320 flights searched against 320 drawn."""
    said = answer(
        "worst", "aerosonde_dispersed", "--budget", 320, "--metric", "chi.ITAE", "--completed",
        "--out", tmp_path / "worst.toml",
    )  # fmt: skip
    campaign = at_random(load_campaign("aerosonde_dispersed"))
    plan = plan_campaign(campaign, runs=640)
    drawn = fly_runs(plan, range(1, 640, 2)).to_pandas()  # odd runs are those of tuned_identified

    assert set(drawn["gains"]) == {said["gains"]}
    # One random flight in a thousand loses its course in severe turbulence: not the maximum.
    assert said["value"] > drawn["chi.ITAE"].quantile(0.99)
