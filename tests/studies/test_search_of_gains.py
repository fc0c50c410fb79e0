"""How a search ranks gains and moves through them, on excesses that are made up."""

import math
from dataclasses import replace

import numpy as np
import pytest
from dispersed import campaign_of, uniform
from flown_campaigns import flown_here
from made_up import made_up_scenario

import flighttune as ft
from flighttune.campaigns.engine.kept import KeptRows
from flighttune.flight.flown import BoundCheck
from flighttune.studies import meet, meeting

GAINS = ft.PAPER_GAINS
UNSTABLE = replace(GAINS, K_P=GAINS.K_P - 4.0 * np.eye(2))

LAW, LAG = (
    {"kind": "kinematic"},
    {"kind": "point_mass_lag", "roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 4.0},
)
BOUND = {"at_most": {"chi": {"MO_deg": 5.0}}}


def check(value=0.0, bound=1.0, sense="at_most", subject="chi", measure="MO_deg", **more):
    return BoundCheck(
        run=more.pop("run", "kinematic"), subject=subject, measure=measure, sense=sense,
        bound=bound, value=value, **more,
    )  # fmt: skip


def trial(*excess, **fields):
    """A trial with these excesses, a row for each draw."""
    rows = np.atleast_2d(np.array(excess, dtype=float))
    checks = tuple(tuple(check(1.0 + x) for x in row) for row in rows)
    return meeting.Trial(**{"gains": GAINS, "excess": rows, "checks": checks, **fields})


def search(metric="ITAE", draws=1, success=1.0, expect=(BOUND,), kept=None, **scenario):
    """A search of gains for the law, on draws of the airspeed if there are several."""
    nominal = made_up_scenario(expect=[*expect], **scenario)
    dispersed = campaign_of(nominal, uniform("flight.V_a_mps", 20.0, 30.0)) if draws > 1 else None
    flights = meet.flights_to_meet(nominal, nominal.law_tables[0], dispersed)
    return meet.Search(
        [flights], nominal.laws[0], kept, metric=metric, draws=draws, success=success
    )


def test_gains_that_meet_more_rank_first_and_the_metric_decides_among_wide_margins():
    """From best to worst: the metric below -1, excess below 0, a miss above it, and no value."""
    ranked = [
        trial([-0.3, -0.2], metric=1.0),
        trial([-0.2, -0.9], metric=3.0),
        trial([-0.2, -0.9], metric=math.inf),
        trial([-0.19, -0.9], metric=0.0),
        trial([0.0, -0.9], metric=0.0),
        trial([0.05, -0.9]),
        trial([0.1, -0.9]),
        trial([0.1, 0.5]),
        trial([meet.LOST, -0.9], metric=1.0),
        trial([meet.LOST, -0.9], metric=2.0),
    ]
    values = [search().value(x) for x in ranked]

    assert values == sorted(set(values))
    # 0.5 m / (1 + m) - 1.5, and missed draws + 0.5 e / (1 + |e|)
    assert values[0] == pytest.approx(0.25 - 1.5)
    assert values[1] == pytest.approx(0.375 - 1.5)
    assert values[2] == pytest.approx(0.5 - 1.5)
    assert values[4] == 0.0
    assert values[5] == pytest.approx(1.0 + 0.025 / 1.05)
    assert values[7] == pytest.approx(1.0 + 0.25 / 1.5)
    # without a value the metric ranks: e = 1000 + 500 m / (1 + m)
    assert values[8] == pytest.approx(1.0 + 625.0 / 1251.0, abs=1e-9)


def test_a_margin_is_maximised_further_and_on_draws_no_metric_counts():
    wide = trial([-0.5, -0.9], metric=1.0)
    half = -0.25 / 1.5

    assert search("margin").value(wide) == pytest.approx(half)
    assert search(draws=2).value(trial([-0.5], [-0.7], metric=1.0)) == pytest.approx(half)
    more = search()
    more.wanted = 0.6
    assert more.value(wide) == pytest.approx(half)


@pytest.mark.parametrize(("success", "excess"), [(1.0, 0.6), (0.75, 0.3), (0.5, -0.2)])
def test_the_excess_of_draws_is_that_which_the_required_share_does_not_exceed(success, excess):
    of_draws = trial([0.6], [-0.2], [0.3], [-0.4])

    found = search(draws=4, success=success).value(of_draws)

    assert found == pytest.approx(2.0 + 0.5 * excess / (1.0 + abs(excess)))


def test_gains_that_lose_too_much_of_R_K_miss_a_requirement():
    """R_K lacks a fifth of the least."""
    free, just, lacking = search(), search(), search()
    just.least_R_K, lacking.least_R_K = free.R_K(GAINS), 1.25 * free.R_K(GAINS)

    assert lacking.value(trial([-0.5])) == pytest.approx(1.0 + 0.5 * 0.2 / 1.2)
    assert lacking.value(trial([0.7])) == pytest.approx(2.0 + 0.5 * 0.7 / 1.7)
    assert lacking._excesses(trial([0.7])) == pytest.approx([0.7, 0.2])
    assert free._excesses(trial([0.7])).tolist() == [0.7, -meet.LOST]
    assert just.value(trial([-0.5], metric=1.0)) == pytest.approx(-1.25)


@pytest.mark.parametrize(
    ("stated", "met", "kept"), [({}, True, True), ({}, False, False), ({"R_K": 0.1}, True, False)]
)
def test_half_the_R_K_of_a_start_is_kept_that_meets_everything(stated, met, kept):
    searching = search(expect=[BOUND, {"at_least": {"loop": stated}}])

    assert searching.keep_R_K(trial([-0.1 if met else 0.1])) is kept
    assert searching.least_R_K == (0.5 * searching.R_K(GAINS) if kept else 0.0)


def searched(trials):
    """A search with these candidates; a gain set that differs stands for each."""
    searching = search()
    searching.trials |= {replace(GAINS, K_I=k * GAINS.K_I): x for k, x in enumerate(trials, 1)}
    return searching


def test_the_best_candidate_is_the_first_of_the_smallest_values():
    trials = [trial([0.2]), trial([-0.1]), trial([-0.1]), trial([0.1])]
    assert searched(trials).best() is trials[1]


@pytest.mark.parametrize(
    ("excess", "conflicting"),
    [
        # missed ones and those within 0.02 of the largest, the largest first
        ([0.5, -0.1, 0.1, 0.49], [0, 3, 2]),
        ([-0.05, -0.3, -0.06, -0.08], [0, 2]),
        # all are met by a fifth and more: of those the nearest
        ([-0.4, -0.21, -0.23], [1]),
    ],
)
def test_requirements_that_are_missed_or_just_met_conflict(excess, conflicting):
    assert search().conflicting(trial(excess)) == conflicting


def test_trade_offs_are_the_best_values_alone_and_beside_the_others():
    trials = [trial([0.4, 0.1, -0.9]), trial([-0.3, 0.5, -0.9]), trial([0.2, -0.1, -0.9]),
              trial([-0.5, -0.4, 0.3])]  # fmt: skip

    first, second = searched(trials).trade_offs(trials[0])

    # values are 1 + excess; the last trial misses the third requirement
    assert (first["alone"], first["beside"]) == (0.5, 1.2)
    assert (second["alone"], second["beside"]) == (0.6, 1.5)
    assert first["value"] == 1.4
    none = searched(trials[:1]).trade_offs(trials[0])
    assert [x["beside"] for x in none] == [None, None]


def test_the_worst_draw_is_by_what_differs_between_draws():
    of_draws = trial([0.9, -0.3, 0.1], [0.9, -0.5, 0.2], [0.9, 0.15, -0.4])

    assert (of_draws.worst_draw, of_draws.met) == (1, False)
    assert of_draws.worst.tolist() == [0.9, 0.9, 0.9]
    assert trial([0.1, 0.2], [0.1, 0.2]).worst_draw == 0
    assert (trial([0.0, -0.1], [-0.2, 0.0]).met, trial([0.0, 1e-9]).met) == (True, False)


def test_a_move_reduces_the_largest_excess_as_far_as_slopes_and_room_allow():
    """Two requirements of slopes 1 and -1 over one gain meet in the middle."""
    excess, slopes = np.array([1.0, 0.0]), np.array([[1.0], [-1.0]])

    def move(reach=2.0, room=9.0, enough=-9.0):
        return meet._least_worst(excess, slopes, enough, reach, np.array([room]))

    assert move() == pytest.approx([-0.5])
    assert move(reach=0.3) == pytest.approx([-0.3])
    up = meet._least_worst(excess[::-1], slopes, -9.0, 2.0, np.array([0.2]))
    assert up == pytest.approx([0.2])
    # no farther than is enough
    assert move(enough=0.8) == pytest.approx([-0.2])


def test_gains_are_searched_by_the_logarithms_of_those_that_are_not_zero():
    K_P, K_I = np.array([[2.0, 0.0], [-0.5, 1.0]]), np.array([[0.1, 0.0], [0.0, 0.3]])
    gains = replace(GAINS, K_P=K_P, K_I=K_I)
    largest = np.full((2, 4), 4.0)
    largest[0, 0] = 1.5
    free = meet.Free(gains, largest)

    # 2 is limited to the largest, 1.5
    assert np.exp(free.logarithms(gains)) == pytest.approx([1.5, 0.1, 0.5, 1.0, 0.3])
    assert np.exp(free.top) == pytest.approx([1.5, 4.0, 4.0, 4.0, 4.0])
    other = free.gains(np.log([1.0, 0.2, 0.7, 3.0, 0.4]))
    assert other.K_P == pytest.approx(np.array([[1.0, 0.0], [-0.7, 3.0]]))
    assert other.K_I == pytest.approx(np.array([[0.2, 0.0], [0.0, 0.4]]))


def test_starts_are_multiples_of_gains_without_those_that_are_rounding_errors():
    K_P, K_I = np.array([[2.0, 1e-5], [3e-5, 1.0]]), np.array([[0.1, -1e-5], [0.0, 0.3]])

    varied = meet._varied(replace(GAINS, K_P=K_P, K_I=K_I), (0.5, 0.1))

    # smaller than 1e-5 of the largest, 2
    assert varied.K_P == pytest.approx(np.array([[1.0, 0.0], [1.5e-5, 0.5]]))
    assert varied.K_I == pytest.approx(np.array([[0.01, 0.0], [0.0, 0.03]]))


@pytest.mark.parametrize(
    ("x", "squeezed"), [(0.0, 0.0), (1.0, 0.5), (-3.0, -0.75), (math.inf, 1.0), (-math.inf, -1.0)]
)
def test_a_squeezed_number_lies_between_minus_one_and_one(x, squeezed):
    assert meet._squeezed(x) == squeezed


@pytest.mark.parametrize(
    ("metric", "value"),
    [
        ("ITAE", 5.0),
        ("chi.MO_rad", 0.2),
        ("chi.MO_deg", math.degrees(0.2)),
        ("gamma.ITAE", 3.0),
        ("chi.settling_s", math.inf),
    ],
)
def test_the_metric_of_a_flight_is_a_column_or_the_sum_of_both_errors(metric, value):
    row = {"chi.ITAE": 2.0, "gamma.ITAE": 3.0, "chi.MO_rad": 0.2, "chi.settling_s": None}

    assert meet._metric(row, metric) == pytest.approx(value)
    assert math.isnan(meet._metric(row, "margin"))


@pytest.mark.parametrize(("draws", "whole"), [(1, 1), (32, 32)])
def test_draws_of_a_campaign_without_a_grid_are_as_many_as_asked(draws, whole):
    campaign = campaign_of(made_up_scenario(), uniform("flight.V_a_mps", 20.0, 30.0))
    assert meet.whole_cycles(campaign, draws) == whole


@pytest.mark.parametrize(("draws", "whole"), [(1, 6), (6, 6), (7, 12), (32, 36)])
def test_draws_of_a_grid_are_whole_cycles(draws, whole):
    grid = [
        {"key": key, "distribution": "grid", "values": values}
        for key, values in (("flight.V_a_mps", [20.0, 25.0, 30.0]), ("flight.phi_deg", [-5.0, 5.0]))
    ]
    campaign = campaign_of(made_up_scenario(), *grid, design="grid")
    assert meet.whole_cycles(campaign, draws) == whole


def test_only_plants_with_requirements_are_flown():
    one = made_up_scenario(plant=[LAW, LAG], expect=[BOUND | {"plant": "point_mass_lag"}])
    both = made_up_scenario(plant=[LAW, LAG], expect=[BOUND])

    assert meet._required(one) == ["point_mass_lag"]
    assert meet._required(both) == ["kinematic", "point_mass_lag"]


@pytest.mark.parametrize(
    ("air", "first"), [({}, "kinematic"), ({"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, "jsbsim")]
)
def test_in_wind_aircraft_fly_first_whose_wind_others_replay(air, first):
    aircraft = {"kind": "jsbsim", "aircraft": "aerosonde"}
    scenario = made_up_scenario(plant=[LAW, aircraft], expect=[BOUND], **air)

    required = meet._required(scenario)

    assert [x.partition(":")[0] for x in required] == sorted(
        ["kinematic", "jsbsim"], key=lambda x: x != first
    )


@pytest.mark.parametrize(
    ("stated", "left"),
    [
        ({}, {"gain_margin_dB": 6.0, "phase_margin_deg": 35.0}),
        ({"phase_margin_rad": 0.5}, {"gain_margin_dB": 6.0}),
        ({"phase_margin_deg": 20.0}, {"gain_margin_dB": 6.0}),
        ({"gain_margin_dB": 3.0, "phase_margin_deg": 20.0}, None),
    ],
)
def test_margins_are_required_where_the_scenario_states_none(stated, left):
    scenario = made_up_scenario(expect=[BOUND, {"at_least": {"loop": stated}}])

    found = meet._default_margins(scenario)

    assert [x.at_least["loop"] for x in found] == ([left] if left else [])


def test_margins_that_are_required_by_default_are_known_by_their_run():
    checks = ((check(), check(run=f"a: {meeting.BY_DEFAULT}"), check(run=meeting.BY_DEFAULT)),)
    assert trial([0.0, 0.0, 0.0], checks=checks).default.tolist() == [False, True, True]


def test_a_requirement_is_stated_with_its_margin_and_without_a_value_of_a_lost_flight():
    met, missed = check(3.0, 4.0, why="unsettled"), check(1.0, 4.0, "at_least", why="unsettled")

    assert meet.stated(met) == {
        "run": "kinematic", "measure": "chi.MO_deg", "sense": "at most", "bound": 4.0,
        "value": 3.0, "margin": 0.25, "why": "",
    }  # fmt: skip
    assert (meet.stated(missed)["margin"], meet.stated(missed)["why"]) == (-0.75, "unsettled")
    lost = meet.stated(check(3.0, 4.0, flown=False))
    assert math.isnan(lost["value"])
    assert math.isnan(lost["margin"])


def test_requirements_have_their_values_in_the_worst_draw_and_shares_of_all():
    now = trial([-0.1, -0.5], [0.2, -0.4], [-0.3, -0.6], [0.1, -0.5])
    start = trial([0.3, -0.2], [0.4, 0.5], [-0.1, 0.2], [0.1, -0.1])

    first, second = meet._requirements(now, start, [0])

    assert (first["value"], first["start"], first["active"]) == (1.2, 1.4, True)
    assert (first["share"], first["share_start"]) == (0.5, 0.25)
    assert (second["value"], second["start"], second["active"]) == (0.6, 1.5, False)
    assert (second["share"], second["share_start"]) == (1.0, 0.5)
    # an unstable start has one draw
    (alone, _) = meet._requirements(now, trial([0.3, 0.3]), [])
    assert alone["start"] == 1.3


def test_errors_at_the_end_that_grow_are_worse_from_a_hundredth_of_a_degree_on():
    scenario = made_up_scenario()
    ends = {"chi": 0.03, "gamma": 1e-5, "V": 0.2}
    start = trial([0.0], ends={"chi": 0.0299, "gamma": 1e-6, "V": 0.1})

    rows = [*meet._worse(scenario, scenario.laws[0], trial([0.0], ends=ends), start)]

    # chi grows by less than 1 %, gamma is below 0.01 deg
    assert rows == [{"measure": "V.end_error_mps", "value": 0.2, "start": 0.1}]
    grown = trial([0.0], ends={"chi": 0.031})
    (row,) = meet._worse(scenario, scenario.laws[0], grown, start)
    assert row == {"measure": "chi.end_error_rad", "value": 0.031, "start": 0.0299}
    weaker = trial([0.0], gains=replace(GAINS, K_P=0.5 * GAINS.K_P, K_I=0.5 * GAINS.K_I))
    names = [x["measure"] for x in meet._worse(scenario, scenario.laws[0], weaker, start)]
    assert "loop.R_K" in names


@pytest.mark.parametrize(
    ("own", "values", "first"),
    [
        # the nearest of those that the scenario flies, though another is nearer
        (["paper", "K1"], {"paper": 3.0, "K1": 2.0, "K3": 1.0}, ("K1", True)),
        (["K2"], {"paper": 3.0, "K1": 2.0, "K3": 1.0}, ("K3", False)),
    ],
)
def test_the_start_is_the_nearest_of_the_gains_that_are_flown(own, values, first):
    assert meet._first(made_up_scenario(gains=own), values, lambda value: value) == first


def problem(runs=1000, plants=(LAW, LAG), gains=("paper",), grid=(), **fields):
    """Requirements on the draws of a campaign."""
    nominal = made_up_scenario(plant=[*plants], expect=[BOUND], gains=[*gains])
    design = {"design": "grid"} if grid else {}
    campaign = campaign_of(nominal, *(grid or SPEEDS), runs=runs, seed=7, **design)
    usual = {"scenarios": [nominal], "law_table": nominal.law_tables[0], "dispersed": campaign}
    return meet.Problem(**{**usual, **fields})


SPEEDS = (uniform("flight.V_a_mps", 20.0, 30.0),)
SIX = [
    {"key": key, "distribution": "grid", "values": values}
    for key, values in (("flight.V_a_mps", [20.0, 25.0, 30.0]), ("flight.phi_deg", [-5.0, 5.0]))
]


@pytest.mark.parametrize(
    ("fields", "fresh"),
    [
        # of 1000 runs on two plants 500 draws, and at least 200 in whole cycles
        ({}, 500),
        ({"plants": [LAW]}, 1000),
        ({"runs": 396, "gains": ["paper", "K3"]}, 200),
        ({"runs": 804, "gains": ["paper", "K3"]}, 201),
        ({"runs": None, "grid": SIX}, 204),
        ({"dispersed": None}, 0),
    ],
)
def test_gains_are_counted_on_the_draws_of_the_campaign_and_at_least_on_200(fields, fresh):
    assert problem(**fields).fresh == fresh


def test_a_search_flies_draws_at_random_that_are_not_counted():
    searching = problem(success=0.9).search(None, "ITAE")
    alone = problem(dispersed=None).search(None, "margin")

    (campaign,) = searching.campaigns
    assert (campaign.seed, campaign.design) == (8, "random")
    assert (searching.draws, searching._success, searching.each) == (32, 0.9, 64)
    assert (alone.draws, alone._success, alone.metric, alone.each) == (1, 1.0, "margin", 2)
    plan = searching._plan(0, [GAINS, GAINS])
    assert [x.plant for x in plan.groups] == ["kinematic", "point_mass_lag"] * 2
    assert len({x.gains for x in plan.groups}) == 2
    assert plan.runs == 32 * 4


def test_a_budget_covers_the_start_and_the_count():
    """An unstable loop is not flown, and its 64 flights are in the budget all the same."""
    searching = problem().search(None, "ITAE")

    (start,) = searching.begin([UNSTABLE], 130, 66)

    assert not start.met
    with pytest.raises(ft.InputError, match="`budget` must be at least 130 flights, 64 for"):
        searching.begin([UNSTABLE], 129, 66)


def test_draws_that_are_flown_in_parts_are_those_that_are_flown_at_once():
    with flown_here() as pool:
        whole, parts = (
            search(draws=4, kept=KeptRows(None, {}, pool), flight={"duration_s": 2.0})
            for _ in range(2)
        )
        (at_once,) = whole.fly([GAINS], range(4))
        first, last = (parts.fly([GAINS], draws)[0] for draws in (range(3), range(3, 4)))

    assert first.excess.tolist() == at_once.excess[:3].tolist()
    assert last.excess.tolist() == at_once.excess.tolist()
    assert parts.flights == whole.flights == 4


def test_unstable_gains_are_not_flown_and_are_the_worse_the_faster_they_diverge():
    searching = search(draws=4)
    faster = replace(UNSTABLE, K_P=2.0 * UNSTABLE.K_P)

    slow, fast = searching.fly([UNSTABLE, faster])

    assert slow.excess.shape == fast.excess.shape == (4, len(slow.checks[0]))
    assert slow.excess.min() > meet.LOST
    assert (fast.excess > slow.excess).all()
    assert searching.flights == searching.candidates == 0
