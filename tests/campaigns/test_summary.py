"""What is said of groups, on rows whose truth is known."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from made_up_campaign import made_up_plan, made_up_rows
from scipy import stats

import flighttune as ft
from flighttune.campaigns.statistics import findings, intervals
from flighttune.campaigns.statistics.findings import findings_of
from flighttune.outputs.pages.campaign_charts import rates

CRAFT = "jsbsim:aerosonde"


@pytest.fixture(scope="module")
def plan():
    return made_up_plan()


@pytest.fixture(scope="module")
def flown(plan):
    return findings_of(made_up_rows(plan), plan)


@pytest.fixture(scope="module")
def by_group(flown):
    return {group["group"]: group for group in flown.values["groups"]}


def own_rows(flown, group):
    rows = flown.rows
    return rows[(rows["plant"] == group["plant"]) & (rows["gains"] == group["gains"])]


def test_a_measure_is_that_of_completed_flights_and_keeps_its_percentiles(by_group, flown):
    """ITAE is 1.5 + 0.375 (V - 23)^2 with V uniform from 23 to 26.9 m/s."""
    group = by_group[f"{CRAFT} / paper"]
    spread = group["metrics"]["chi.ITAE"]

    assert spread["n"] == own_rows(flown, group)["status"].eq("completed").sum()
    for name, q in (("p05", 0.05), ("p50", 0.5), ("p95", 0.95)):
        low, high = spread[f"{name}_interval"]
        assert low <= 1.5 + 0.375 * (3.9 * q) ** 2 <= high


def test_statuses_and_their_reasons_are_counted(by_group):
    group = by_group[f"{CRAFT} / paper"]

    assert list(group["statuses"]) == ["completed", "diverged"]
    assert sum(group["statuses"].values()) == group["n"]
    (why,), (missed,) = group["reasons"], group["missed"]
    assert why["count"] == group["statuses"]["diverged"] > 1
    assert re.fullmatch(r"the course error passed 180 deg at t = \d\S* to \d\S* s", why["reason"])
    assert missed["reason"].startswith("chi.ITAE must be at most 4, got ")
    assert missed["count"] == group["n"] - group["successes"] - why["count"]


def test_requirements_are_counted_over_completed_flights_the_most_missed_first(flown):
    rows = flown.rows[flown.rows["status"] == "completed"]

    settling, itae = flown.values["requirements"]

    assert settling["near"] is None  # more than 5 % never settled

    assert (settling["measure"], itae["measure"]) == ("chi.settling_s", "chi.ITAE")
    assert settling["n"] == itae["n"] == len(rows)
    assert settling["missed"] == rows["chi.settling_s"].isna().sum()  # it never settled
    assert itae["missed"] == (rows["chi.ITAE"] > 4.0).sum()
    nearest = np.sort(rows["chi.ITAE"])[int(np.ceil(0.95 * len(rows))) - 1]
    assert itae["near"] == pytest.approx((nearest - 4.0) / 4.0)
    assert itae["bound"] == 4.0


def test_a_requirement_of_flights_none_of_which_completed_comes_last(plan):
    rows = made_up_rows(plan)
    lost = (rows["plant"] == CRAFT) & (rows["gains"] == "paper")
    rows.loc[lost, "status"] = "diverged"
    of_lost = {"plant": CRAFT, "gains": "paper", "at_most": {"chi": {"ITAE": 4.0}}}
    others = {"at_most": {"gamma": {"ITAE": 9.0}}}

    last = findings_of(rows, made_up_plan(of_lost, others)).values["requirements"][-1]

    assert (last["measure"], last["n"], last["near"]) == ("chi.ITAE", 0, None)


def test_a_bound_on_the_loop_counts_flights_of_gains_that_miss_it(plan):
    """R_K on the kinematic law is 0.461 1/s with `paper`, 0.592 with K3 (`flighttune certify`)."""
    bound = {"at_least": {"loop": {"R_K": 0.5}}, "at_most": {"chi": {"ITAE": 4.0}}}
    flown = findings_of(made_up_rows(plan), made_up_plan(bound))
    done = flown.rows[flown.rows["status"] == "completed"]

    loop, itae = flown.values["requirements"]

    assert (loop["measure"], itae["measure"]) == ("loop.R_K", "chi.ITAE")
    assert loop["missed"] == (done["gains"] == "paper").sum()
    assert rates(flown)[1].title == "Flights by ITAE of course"


def test_gain_sets_are_compared_on_the_same_draws(flown):
    """With `paper` every ITAE is twice that with K3, and flights that diverged are lost."""
    on_law, on_craft = intervals.paired(flown.rows, "chi.ITAE")

    law = flown.rows.set_index(["plant", "draw", "gains"])["chi.ITAE"].unstack().loc["kinematic"]
    assert (on_law["a"], on_law["b"], on_law["n"]) == ("paper", "K3", 200)
    assert on_law["win_rate"] == 0.0
    expected = stats.binomtest(0, 200).proportion_ci(method="wilson").high
    assert on_law["hi"] == pytest.approx(expected)
    ordered = np.sort(law["paper"] - law["K3"])
    assert on_law["median"] == pytest.approx(ordered[99])
    assert on_law["median_lo"] <= np.median(ordered) <= on_law["median_hi"]
    assert (on_craft["wins_b"], on_craft["only_a"]) == (200, 0)
    expected = stats.binomtest(on_craft["only_b"], on_craft["only_b"], 0.5).pvalue
    assert on_craft["p_success"] == pytest.approx(expected)


def test_values_in_clusters_count_for_less():
    """Clusters of m values with correlation r among them count as 1 + (m - 1) r times fewer."""
    rng, m, r = np.random.default_rng(4), 10, 0.5
    clusters = np.repeat(np.arange(2000), m)
    common = np.repeat(rng.normal(size=2000), m)
    values = np.sqrt(r) * common + np.sqrt(1.0 - r) * rng.normal(size=20_000)

    assert intervals.effective_size(values, clusters) == pytest.approx(20_000 / 5.5, rel=0.08)
    assert intervals.effective_size(values, np.arange(20_000)) == 20_000
    assert intervals.effective_size(np.ones(20_000), clusters) == 2000
    assert intervals.effective_size(values, np.zeros(20_000)) == 20_000


@pytest.mark.parametrize(("count", "members"), [(2, 5), (3, 2), (40, 3)])
def test_clusters_of_one_value_each_count_as_one_less(count, members):
    clusters = np.repeat(np.arange(count), members)

    assert intervals.effective_size(clusters**2, clusters) == pytest.approx(count - 1)


def test_shares_and_percentiles_of_clusters_cover():
    rng, hits, plain, of_median = np.random.default_rng(6), 0, 0, 0
    clusters = np.repeat(np.arange(60), 5)
    for _ in range(400):
        x = np.repeat(rng.normal(size=60), 5) + 0.3 * rng.normal(size=300)
        found, middle = intervals.share(x > 0.0, clusters), intervals.percentile(x, 0.5, clusters)
        lo, hi = intervals.rate_interval(np.sum(x > 0.0), 300)
        hits += found.lo <= 0.5 <= found.hi
        plain += lo <= 0.5 <= hi
        of_median += middle.lo <= 0.0 <= middle.hi

    assert hits / 400 == pytest.approx(0.95, abs=0.03)
    assert of_median / 400 > 0.93
    assert plain / 400 < 0.8


def test_rows_without_any_measure_still_tell_who_failed(plan):
    rows = made_up_rows(plan).assign(status="invalid", reason="`flight.V_a_mps` must be finite")
    rows[["chi.ITAE", "gamma.ITAE", "chi.settling_s"]] = np.nan
    rows["success"] = False

    told = findings_of(rows, plan)

    assert told.measure is None
    assert all((group["successes"], group["metrics"]) == (0, {}) for group in told.values["groups"])
    assert told.values["paired"] == told.convergence == []


def test_a_flight_that_misses_two_bounds_counts_for_both(plan):
    rows = made_up_rows(plan).head(4)
    rows["plant"], rows["gains"], rows["draw"] = "kinematic", "paper", range(4)
    rows["success"] = [False, False, True, False]
    rows["missed"] = [
        "chi.MO_deg must be at most 5, got 7 (missed by 2); gamma.ITAE must be at most 1, got 2 "
        "(missed by 1)",
        "chi.MO_deg must be at most 5, got 9 (missed by 4)",
        None,
        "chi.MO_deg must be at most 5, got nan (there is no value)",
    ]

    (group,) = findings_of(rows, plan).values["groups"]

    assert [(why["reason"], why["count"]) for why in group["missed"]] == [
        ("chi.MO_deg must be at most 5, got 7 to 9 (missed by 2 to 4)", 2),
        ("gamma.ITAE must be at most 1, got 2 (missed by 1)", 1),
        ("chi.MO_deg must be at most 5, got nan (there is no value)", 1),
    ]


def test_an_interval_at_any_time_is_of_the_first_independent_draws_alone(plan):
    rows = made_up_rows(plan)
    stopped = rows[(rows["run"] < 400) | (rows["run"] % 7 == 0)]

    told = [
        [(group["n"], group["lo"], group["hi"]) for group in found.values["groups"]]
        for some in (stopped, rows[:400])
        for found in [findings_of(some, plan).by("any-time")]
    ]

    assert told[0] == told[1]
    assert {n for n, *_ in told[0]} == {100}
    with pytest.raises(ft.InputError, match="must be with run 0"):
        findings_of(rows[1:], plan).by("any-time")
    for other in (made_up_plan(design="sobol"), made_up_plan(design="latin_hypercube")):
        with pytest.raises(ft.InputError, match="any-time must be with independent"):
            findings_of(made_up_rows(other), other).by("any-time")


def test_each_point_of_a_convergence_curve_is_what_the_first_flights_tell(flown):
    for curve, (group, rows) in zip(flown.convergence, flown.groups(), strict=True):
        assert curve["group"] == group.label
        for n, success, p95 in zip(curve["n"], curve["success"], curve["p95"], strict=True):
            first = rows.head(n)
            expected = stats.binomtest(int(first["success"].sum()), n)
            assert success.lo == pytest.approx(expected.proportion_ci(method="wilson").low)
            completed = first[first["status"] == "completed"]["chi.ITAE"]
            assert p95.value == pytest.approx(np.quantile(completed, 0.95))
            assert p95.n == len(completed)


@pytest.mark.parametrize(("met", "answer"), [(60, "yes"), (30, "no"), (54, "")])
def test_each_group_has_its_answer_about_the_share_that_is_required(plan, met, answer):
    """The evidence of 60 successes, 0.9^-60 / 2, exceeds 2 / 0.05; 54 of 60 are the share."""
    campaign = plan.campaign.model_copy(update={"until_sure": 0.9})
    required = replace(plan, campaign=campaign)
    rows = made_up_rows(plan)
    rows = rows[rows["draw"] < 60].assign(success=True)
    first = (rows["plant"] == "kinematic") & (rows["gains"] == "paper")
    rows.loc[first, "success"] = np.arange(60) < met

    found = findings.answers(rows, required)

    assert found == {**dict.fromkeys((x.label for x in plan.groups), "yes"),
                     "kinematic / paper": answer}  # fmt: skip
    assert findings.answers(rows, plan) == {}
    if not answer:
        assert findings_of(rows, required).values["sure"] == found


def test_groups_with_the_same_answer_share_a_sentence():
    answers = {"a / x": "no", "b / x": "yes", "c / x": "", "d / x": "yes"}

    assert findings.answer_words(answers, 0.975) == (
        "At least 97.5 % of the flights of b / x and d / x succeed. "
        "Fewer than 97.5 % of the flights of a / x succeed. "
        "It is not sure whether at least 97.5 % of the flights of c / x succeed."
    )
    assert findings.answer_words({}, None) == ""


def test_success_is_split_over_classes_of_the_parameter_that_decides_it(flown, plan):
    """The airspeed decides; five classes of equal size, next to each other."""
    splits = {split["group"]: split for split in flown.splits}

    # with K3 all flights succeed: nothing decides
    assert [*splits] == [x.label for x in plan.groups if x.gains == "paper"]
    rows = own_rows(flown, {"plant": CRAFT, "gains": "paper"}).sort_values("flight.V_a_mps")
    split, V = splits[f"{CRAFT} / paper"], np.sort(rows["flight.V_a_mps"].to_numpy())
    assert split["parameter"] == "flight.V_a_mps"
    of_class = V.reshape(5, 40)
    assert split["centres"] == pytest.approx(np.median(of_class, axis=1))
    assert [x.n for x in split["success"]] == [40] * 5
    succeed = rows["success"].to_numpy().reshape(5, 40).mean(axis=1)
    assert [x.value for x in split["success"]] == pytest.approx(succeed)
    between = 0.5 * (of_class[:-1, -1] + of_class[1:, 0])
    edges = [V[0], *between, V[-1]]
    assert split["labels"] == [f"{a:.4g} to {b:.4g}" for a, b in itertools.pairwise(edges)]


def test_values_of_their_own_and_categories_name_the_classes_of_a_split(plan):
    rows = made_up_rows(plan)
    rows = rows[(rows["draw"] < 60) & (rows["plant"] == CRAFT)].assign(success=True)
    late = rows["limits.n_z_rate_per_s"] == 1.2
    rows.loc[late, "success"] = False
    named = rows.assign(**{"limits.n_z_rate_per_s": np.where(late, "late", "early")})

    of_numbers, of_names = (findings_of(x, plan).splits[0] for x in (rows, named))

    assert of_numbers["labels"] == ["0.8", "1", "1.2"]
    assert of_numbers["centres"] == [0.8, 1.0, 1.2]
    assert [x.value for x in of_numbers["success"]] == [1.0, 1.0, 0.0]
    assert (of_names["labels"], of_names["centres"]) == (["early", "late"], [0.0, 1.0])


@pytest.mark.parametrize(("flights", "first", "points"), [(200, 10, 25), (8, 2, 7), (3, 1, 3)])
def test_a_convergence_curve_begins_with_ten_flights_or_a_quarter(plan, flights, first, points):
    """It has 25 points, or as many as there are whole numbers from its first to its last."""
    rows = made_up_rows(plan)
    few = findings_of(rows[rows["draw"] < flights], plan)

    for curve in few.convergence:
        assert (curve["n"][0], curve["n"][-1], len(curve["n"])) == (first, flights, points)


def test_the_worst_flights_of_a_group_are_listed_with_what_was_drawn(by_group, flown, plan):
    group = by_group[f"{CRAFT} / paper"]
    rows = own_rows(flown, group)
    done = rows[rows["status"] == "completed"].sort_values("chi.ITAE", ascending=False)

    assert [x["run"] for x in group["worst"]] == done["run"].head(5).tolist()
    assert group["worst"][0]["chi.ITAE"] == done["chi.ITAE"].max()
    assert [*group["worst"][0]["parameters"]] == [*plan.keys]
    spread = group["metrics"]["chi.ITAE"]
    assert spread["mean"] == pytest.approx(done["chi.ITAE"].mean())
    assert spread["p95"] == pytest.approx(np.quantile(done["chi.ITAE"], 0.95))
    assert group["success"] == pytest.approx(rows["success"].mean())


def test_a_requirement_that_a_value_just_keeps_is_met_and_others_are_at_least_bounds(plan):
    rows = made_up_rows(plan).assign(**{"gamma.ITAE": 0.25})
    rows = rows[rows["draw"] < 60]
    bounds = {"at_most": {"gamma": {"ITAE": 0.25}}}, {"at_least": {"gamma": {"ITAE": 0.5}}}
    flown = findings_of(rows, made_up_plan(*bounds))

    least, most = flown.values["requirements"]

    assert (most["sense"], most["missed"], most["near"]) == ("at_most", 0, 0.0)
    done = (flown.rows["status"] == "completed").sum()
    # (0.5 - 0.25) / 0.5
    assert (least["sense"], least["missed"], least["near"]) == ("at_least", done, 0.5)
