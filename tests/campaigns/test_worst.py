"""The worst flight: against closed forms, and on small campaigns of the law."""

import math
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from commands import answer, flighttune
from dispersed import KINEMATIC, SOFT, plan_of, tables_of, uniform
from flown_campaigns import flown_here, table_flown
from made_up_tubes import tube as tube_of
from made_up_tubes import tube_scenario
from scipy.stats import chi2

import flighttune as ft
from flighttune.flight.loop.run import ERRORS, Bounds
from flighttune.studies import worst as worst_module

SAME = 1e-9
"""A flight of a batch and the same one alone differ by 1e-12."""

START = uniform("flight.chi_deg", -40.0, 40.0), uniform("flight.gamma_deg", -10.0, 10.0)
DEMAND = {"at_most": {"chi": {"peak_deg": 35.0}}}


def small_plan(**tables):
    """Three seconds of the law from random starts."""
    return plan_of(tables_of((KINEMATIC,), **{"gains": [SOFT], **tables}), *START, runs=8)


@pytest.mark.soak
@pytest.mark.parametrize("dimension", [2, 8, 20])
def test_the_worst_of_a_plane_lies_where_its_normal_meets_the_region(dimension):
    normal = np.arange(1.0, dimension + 1.0)
    normal /= np.linalg.norm(normal)

    z, _, first = worst_module.search_worst(
        lambda z, seeds: z @ normal, dimension, budget=2000, seed=3
    )

    radius = math.sqrt(chi2.ppf(0.999, dimension))
    assert np.linalg.norm(z) <= radius * (1.0 + SAME)
    assert z @ normal > 0.98 * radius
    assert first < z @ normal


@pytest.mark.slow
def test_chance_is_that_of_the_worst_flight_so_far_and_others_are_tried():
    seen = []

    def values(z, seeds):
        seen.append((z, seeds))
        return (seeds % 1000).astype(float)

    _, seed, first = worst_module.search_worst(values, 3, budget=640, seed=5)

    best, place = first, seen[0][0][np.argmax(seen[0][1] % 1000)]
    assert first == max(seen[0][1] % 1000)
    for generation, (z, seeds) in enumerate(seen[1:], 1):
        if generation % worst_module.SEEDS_EVERY == 0:
            assert len(set(seeds)) == len(seeds)
            assert z.tolist() == [place.tolist()] * len(seeds)
            best = max(best, *(seeds % 1000))
        else:
            assert set(seeds % 1000) == {best}
    assert seed % 1000 == best > first


@pytest.mark.slow
def test_the_worst_flight_is_worse_than_random_ones_and_is_flown_again_as_it_was():
    plan = small_plan()
    with flown_here() as pool:
        searched = worst_module.StatedSet(plan, pool, metric="chi.peak_rad")
        worst = searched.find_worst(budget=320, seed=1)

    rows = table_flown(plan.with_runs(300)).to_pandas()
    assert worst.value > rows["chi.peak_rad"].max()
    assert worst.distance <= worst.radius * (1.0 + SAME)
    assert abs(worst.drawn["flight.chi_deg"]) <= 40.0
    (run,) = ft.fly(worst.scenario).runs
    assert run.signals["chi_err"].abs().max() == pytest.approx(worst.value, rel=SAME)


def test_the_margin_is_that_of_the_nearest_demand():
    others = {"at_least": {"flight": {"n_z_min": 2.0}}}, {"at_most": {"chi": {"ITAE": 0.0}}}
    plan = small_plan(expect=[DEMAND, *others])
    row = {
        "status": "completed", "plant": "kinematic", "gains": "soft",
        "chi.peak_rad": np.radians(70.0), "flight.n_z_min": 1.0, "chi.ITAE": 0.3,
    }  # fmt: skip

    assert worst_module.value_of(row, "margin", plan.scenario) == pytest.approx(1.0)  # 70 of 35 deg
    assert worst_module.value_of(
        {**row, "chi.ITAE": 1.5}, "margin", plan.scenario
    ) == pytest.approx(1.5)
    assert worst_module.value_of({**row, "status": "diverged"}, "chi.ITAE", plan.scenario) > 100.0
    assert worst_module.value_of(row, "chi.ITAE", plan.scenario) == 0.3


def test_a_start_on_its_reference_has_nothing_to_settle_and_is_not_the_worst():
    """A start at 0.09 deg is nearer than the smallest change, 0.1 deg; 4.8 s are 0.2 over 4 s."""
    bounds = {"at_most": {"chi": {"settling_s": 4.0, "peak_deg": 35.0}}}
    plan = small_plan(expect=[bounds])
    row = {"status": "completed", "plant": "kinematic", "gains": "soft"}
    near, far = (
        {
            **row,
            "chi.settling_s": settled,
            "chi.peak_rad": np.radians(start),
            "chi.settling_band_rad": 0.05 * np.radians(start),
        }
        for start, settled in ((0.09, None), (30.0, 4.8))
    )

    def values(row):
        return [worst_module.value_of(row, x, plan.scenario) for x in ("margin", "chi.settling_s")]

    assert values(near) == [pytest.approx(0.09 / 35.0 - 1.0), -worst_module.FAILED]
    assert values(far) == [pytest.approx(0.2), 4.8]
    assert values({**far, "chi.settling_s": None}) == [worst_module.FAILED] * 2
    # a time that there is counts, however near the start
    assert values({**near, "chi.settling_s": 4.8}) == [pytest.approx(0.2), 4.8]
    alone = small_plan(expect=[{"at_most": {"chi": {"settling_s": 4.0}}}]).scenario
    assert worst_module.value_of(near, "margin", alone) == -worst_module.FAILED
    nothing = small_plan().scenario
    assert worst_module.value_of(far, "margin", nothing) == worst_module.FAILED
    del near["chi.settling_band_rad"]  # a row of a scenario without a bound on the settling time
    assert values(near)[1] == -worst_module.FAILED


def test_a_flight_without_the_value_of_another_measure_is_the_worst():
    row = {"status": "completed", "plant": "kinematic", "gains": "soft", "chi.PT_s": None}
    row |= {"chi.peak_rad": 0.0}

    value = worst_module.value_of(row, "chi.PT_s", small_plan().scenario)

    assert value == worst_module.FAILED


@pytest.mark.parametrize(("completed", "worst"), [(False, 1), (True, 2)])
def test_flights_that_end_early_are_the_worst_or_left_out(completed, worst):
    ends = [("completed", 0.5), ("diverged", 0.1), ("completed", 0.7)]

    def rows(plan, runs, **options):
        return [{"run": run, "status": x, "chi.ITAE": y} for run, (x, y) in enumerate(ends)]

    with flown_here(rows) as pool:
        searched = worst_module.StatedSet(
            small_plan(), pool, metric="chi.ITAE", completed=completed
        )
        values = searched.values(np.zeros((3, 2)), np.arange(3))

    assert np.argmax(values) == searched.worst["run"] == worst


def test_nearness_is_that_to_the_widest_place_until_a_flight_leaves_the_narrowest():
    (run,) = ft.fly(small_plan().scenario_of(2)).runs
    t = run.signals.index.to_numpy()
    middle = run.signals[["chi_err", "gamma_err"]].to_numpy()
    width = np.where(t < 1.0, 0.01, 0.1)[:, None]

    def tube(beside):
        return Bounds(t=t, low=middle + beside - width, high=middle + beside + width)

    near = tube(0.009)
    assert near.share(run.signals) == pytest.approx(0.09)
    assert near.reach(run.signals) == pytest.approx([0.09, 0.09])
    assert near.ratios(run.signals) == pytest.approx(dict.fromkeys(("chi", "gamma"), 1.0 / 0.09))
    assert tube(0.02).share(run.signals) == pytest.approx(2.0)


@pytest.mark.slow
def test_the_command_writes_a_scenario_that_flies_to_what_it_says(tmp_path):
    drawn = ft.flights(small_plan(expect=[DEMAND]))
    with flown_here(), mock.patch.object(worst_module, "flights", return_value=drawn):
        said = answer("worst", "campaign", "--budget", 64, "--out", tmp_path / "worst.toml")

    assert said["metric"] == "margin"
    assert said["flights"] == 64
    flown = "".join(flighttune("fly", said["scenario"], "--out", tmp_path / "runs", status=1))
    assert "chi.peak_deg must be at most 35" in flown
    assert f"got {35.0 * (1.0 + said['value']):.4g}" in flown


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    """A tube of 0.3 s of the law from a box of starts, disturbed, and its file."""
    scenario = tube_scenario(chi_err_deg=15.0, gamma_deg=5.0, duration_s=0.3)
    proven = tube_of(scenario, ft.PAPER_GAINS, for_ever=False, start=0.01, disturbance=0.02)
    file = tmp_path_factory.mktemp("tube") / "proof"  # no ending: it is known by its content
    proven.save(file)
    return proven, file


@pytest.mark.slow
def test_the_flights_of_a_tube_are_searched_and_stay_inside(proven):
    tube, file = proven

    worst = ft.worst(file, budget=32, workers=1)

    flown = ft.fly(worst.scenario).within(tube).runs[0]
    assert (worst.metric, worst.contradicts) == ("tube", False)
    assert worst.answer().failure == ""
    assert tube.why_not(flown) == ""
    assert 0.5 < worst.value <= 1.0
    # the batch and a flight alone differ by rounding, and the bounds in the file by their margin
    assert tube.bounds.of(ERRORS).share(flown.signals) == pytest.approx(worst.value, abs=1e-6)
    assert abs(worst.drawn["flight.chi_deg"]) <= np.degrees(0.01)
    for channel, ratio in worst.ratio.items():  # of one of the flights of the search
        assert 1.0 - 1e-6 <= worst.ratio_of_search[channel] <= ratio + 1e-6
    assert worst.value == pytest.approx(ft.worst(tube, budget=32, workers=1).value, abs=1e-6)


@pytest.mark.slow
def test_a_flight_outside_of_a_tube_contradicts_its_proof(proven):
    tube, _ = proven
    bounds = tube.bounds
    middle, half = 0.5 * (bounds.low + bounds.high), 0.1 * bounds.half_widths
    wrong = replace(tube, bounds=replace(bounds, low=middle - half, high=middle + half))

    worst = ft.worst(wrong, budget=32, workers=1)

    assert worst.value > 1.0
    assert worst.contradicts
    assert worst.answer().status == 1
    assert "contradicts its proof" in worst.answer().failure

    other = tube_scenario(chi_err_deg=15.0, gamma_deg=5.0, duration_s=0.3)
    away = ft.worst(other, claim=tube, start_deg=5.0, gains="paper", budget=32, workers=1)
    assert away.value > 1.0  # from a start that the tube says nothing of
    assert tube.why_not(ft.fly(away.scenario).runs[0])
    assert not away.contradicts


@pytest.mark.parametrize(
    ("options", "words"),
    [({"metric": "margin"}, "must be absent for a tube"), ({"budget": 1}, "`budget` must be")],
)
def test_a_tube_has_flights_and_metric_of_its_own(proven, options, words):
    with pytest.raises(ft.InputError, match=words):
        ft.worst(proven[0], workers=1, **options)


def test_a_tube_without_bounds_has_no_worst(proven):
    open_tube = replace(proven[0], status="unbounded", reason="too wide")

    with pytest.raises(ft.InputError, match=r"must be bounded, got one that is not: too wide\."):
        ft.worst(open_tube, workers=1)


def test_a_tube_of_one_flight_has_no_worst():
    of_one = tube_of(tube_scenario(duration_s=0.1), ft.PAPER_GAINS, for_ever=False)

    with pytest.raises(ft.InputError, match="starts or a disturbance"):
        ft.worst(of_one, workers=1)


@pytest.mark.parametrize(
    ("dimension", "radius"), [(1, 3.2905), (2, math.sqrt(2.0 * math.log(1e3)))]
)
def test_the_region_has_all_but_a_thousandth_of_a_normal_distribution(dimension, radius):
    assert worst_module.region_radius(dimension) == pytest.approx(radius, rel=1e-4)


def test_draws_are_at_the_shares_of_their_normal_scores():
    """A score of 1 exceeds 84.134 % of a normal distribution; both keys are uniform."""
    seen = []

    def rows(plan, runs, draws, **options):
        seen.extend(draws)
        return [{"run": run, "status": "completed", "chi.ITAE": 1.0} for run in runs]

    z, seeds = np.array([[0.0, 1.0], [-1.0, 0.0], [99.0, -99.0]]), np.array([5, 6, 2**40])
    with flown_here(rows) as pool:
        worst_module.StatedSet(small_plan(), pool, metric="chi.ITAE").values(z, seeds)

    drawn = [[x["flight.chi_deg"], x["flight.gamma_deg"]] for x in seen]
    assert drawn[:2] == [
        pytest.approx([0.0, 20.0 * 0.841345 - 10.0], abs=1e-4),
        pytest.approx([40.0 - 80.0 * 0.841345, 0.0], abs=1e-4),
    ]
    assert drawn[2] == pytest.approx([40.0, -10.0], abs=1e-6)
    assert [x["seed"] for x in seen[:2]] == [5, 6]


def test_the_reach_of_flights_in_a_tube_is_that_of_all_and_one_channel_can_be_maximised():
    tubes = [[0.5, 0.1, 0.9], [0.7, 0.6, 0.2], None]

    def rows(plan, runs, **options):
        ends = ({} if x is None else {"tube": x} for x in tubes)
        return [
            {"run": run, "status": "completed" if x else "diverged", **x}
            for run, x in enumerate(ends)
        ]

    plan = small_plan().with_runs(3)
    with flown_here(rows) as pool:
        stated = worst_module.StatedSet(
            plan, pool, metric="tube", probes={"tube": None}, completed=True
        )
        both, one = stated._fly(plan, [{}] * 3), stated._fly(plan, [{}] * 3, 1)

    assert both.tolist() == [0.5, 0.7, -worst_module.FAILED]
    assert one.tolist() == [0.9, 0.2, -worst_module.FAILED]
    assert stated.reach.tolist() == [0.6, 0.9]
    assert (stated.worst["run"], stated.worst["value"], stated.flights) == (1, 0.7, 6)


def test_a_block_takes_its_rarer_sign():
    signs = np.array([[1.0, -1.0], [1.0, -1.0], [-1.0, -1.0], [1.0, 1.0], [1.0, 1.0], [-1.0, 1.0],
                      [-1.0, 1.0]])  # fmt: skip

    first, second = (worst_module._other(signs, np.arange(1, 4), channel) for channel in (0, 1))

    assert first[:, 0].tolist() == [1.0, -1.0, -1.0, -1.0, 1.0, -1.0, -1.0]
    assert first[:, 1].tolist() == signs[:, 1].tolist()
    assert second[:, 1].tolist() == [-1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    # as many of both: down
    even = worst_module._other(signs, np.array([4, 5]), 0)
    assert even[4:6, 0].tolist() == [-1.0, -1.0]


def test_signs_are_deviations_of_the_start_and_switches_of_the_disturbance():
    waves = {"gamma_amplitude": 0.1, "gamma_omega_rad_s": 3.0}
    pushed = small_plan(disturbance=waves)
    stated = worst_module.StatedSet(pushed, None, sizes=(0.1, 0.2), start_deg=3.0)
    signs = np.array([[1.0, -1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])

    plan, (drawn, other) = stated._switched([signs, -signs])

    rate = plan.scenario.controller.rate_hz
    assert (drawn["flight.chi_deg"], drawn["flight.gamma_deg"]) == (3.0, -3.0)
    amplitudes = [f"disturbance.{channel}_amplitude" for channel in ("chi", "gamma")]
    assert [drawn[name] for name in amplitudes] == [-0.1, -0.2]
    assert [other[name] for name in amplitudes] == [0.1, 0.2]
    assert drawn["disturbance.chi_switch_s"] == [1.0 / rate]
    assert drawn["disturbance.gamma_switch_s"] == [3.0 / rate]
    assert plan.scenario.disturbance is None
    assert (plan.runs, [*plan.keys]) == (2, ["flight.chi_deg", "flight.gamma_deg"])
