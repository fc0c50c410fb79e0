"""Plans: who flies what, every draw on demand, and back from JSON to the bit."""

import json
import pickle
import shutil
from dataclasses import replace
from itertools import permutations

import dispersed
import numpy as np
import pytest
from dispersed import tables_of
from hypothesis import given, settings
from hypothesis import strategies as st
from places import SHIPPED_AIRCRAFT, SHIPPED_SCENARIOS

import flighttune as ft
from flighttune import load_scenario
from flighttune.campaigns.planning.plan import plan_from

LEVEL_TURN = load_scenario("level_turn")
SPEED = {"key": "flight.V_a_mps", "distribution": "uniform", "lower": 24.0, "upper": 26.0}
HEIGHT = {"key": "flight.h_m", "distribution": "normal", "mean": 500.0, "sd": 20.0}
KEYS = ["flight.V_a_mps", "flight.h_m", "flight.phi_deg", "reference.chi_deg[0].rate_dps"]


def campaign_of(*disperse, nominal=LEVEL_TURN, gains=("paper",), **keys):
    return dispersed.campaign_of(nominal, *disperse, gains=list(gains), **keys)


def plan_of(*disperse, **keys):
    return ft.plan_campaign(campaign_of(*disperse, **keys))


def through_json(plan):
    return plan_from(json.loads(json.dumps(plan.as_dict())))


finite, positive = st.floats(-1e6, 1e6), st.floats(1e-6, 1e6)
anything = st.one_of(
    st.lists(values, min_size=1, max_size=3)
    for values in (st.floats(), st.integers(-9, 9), st.booleans(), st.text())
)


def of_kind(kind, **keys):
    return st.fixed_dictionaries({"distribution": st.just(kind), **keys})


distributions = st.one_of(
    of_kind("normal", mean=finite, sd=positive),
    of_kind("log_normal", median=positive, sd_log=st.floats(0.01, 2.0)),
    of_kind("uniform", lower=st.floats(-1e6, 0.0), upper=positive),
    of_kind("choice", values=anything),
    of_kind("grid", values=anything),
)


@st.composite
def campaigns(draw):
    keys = draw(st.lists(st.sampled_from(KEYS), unique=True, max_size=4))
    return campaign_of(
        *({"key": key, **draw(distributions)} for key in keys),
        design=draw(st.sampled_from(["random", "latin_hypercube", "sobol"])),
        seed=draw(st.integers(0, 2**31 - 3)),
        runs=draw(st.integers(1, 40)),
    )


@pytest.mark.soak
@settings(max_examples=8)
@given(campaign=campaigns())
def test_a_plan_comes_back_from_json_and_pickle_to_the_bit(campaign):
    plan = ft.plan_campaign(campaign)

    for again in (through_json(plan), pickle.loads(pickle.dumps(plan))):
        assert again.sha256 == plan.sha256
        assert again.as_dict() == plan.as_dict()
        assert again.differences(plan) == ()
        assert again.groups == plan.groups
        assert dict(again.gain_sets) == dict(plan.gain_sets)
        for name, column in plan.parameters().items():
            theirs = again.parameters()[name]
            assert theirs.dtype == column.dtype
            assert list(map(repr, theirs)) == list(map(repr, column))


@pytest.mark.soak
@settings(max_examples=40)
@given(campaign=campaigns(), more=st.integers(1, 40), first=st.integers(0, 40))
def test_draws_do_not_depend_on_where_one_begins_or_ends(campaign, more, first):
    plan = ft.plan_campaign(campaign)
    longer = plan.with_runs(plan.runs + more)
    first = min(first, plan.draws)
    whole = plan.parameters()

    assert whole.index.tolist() == list(range(plan.draws))
    assert plan.parameters(first).equals(whole.iloc[first:])
    if plan.extendable:
        assert longer.parameters(first, plan.draws).equals(whole.iloc[first:])


def test_a_campaign_may_have_the_name_of_a_shipped_scenario(tmp_path):
    file = tmp_path / "paper.toml"
    drawn = ", ".join(f"{key} = {json.dumps(value)}" for key, value in SPEED.items())
    file.write_text(f'title = "t"\nscenario = "paper"\nruns = 2\ndisperse = [{{ {drawn} }}]')

    assert ft.load_campaign(file).nominal.flight == load_scenario("paper").flight


def test_every_draw_is_flown_by_every_group_plant_by_plant():
    plan = plan_of(SPEED, gains=["paper", "K4"], runs=10)

    plants = "kinematic", "jsbsim:aerosonde"
    assert [group.label for group in plan.groups] == [
        f"{plant} / {gains}" for plant in plants for gains in ("paper", "K4")
    ]
    assert plan.draws == 3
    assert [plan.draw_of(run) for run in range(10)] == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]
    assert [plan.group_of(run) for run in (0, 5, 9)] == [plan.groups[i] for i in (0, 1, 1)]


def test_the_scenario_of_a_draw_has_its_values_and_seed():
    chi_rate = {"key": "reference.chi_deg[0].rate_dps", "distribution": "uniform"}
    plan = plan_of(
        SPEED,
        {**HEIGHT, "acts": "adds", "mean": 0.0},
        {**chi_rate, "lower": 0.5, "upper": 1.5, "acts": "multiplies"},
        {"key": "controller.feed_forward", "distribution": "choice", "values": [True, False]},
        {"key": "controller.anti_windup", "distribution": "choice", "values": ["none"]},
    )
    for draw, row in plan.parameters().iterrows():
        scenario = plan.scenario_of(int(draw))

        assert scenario.flight.V_a_mps == row["flight.V_a_mps"]
        assert scenario.flight.h_m == LEVEL_TURN.flight.h_m + row["flight.h_m"]
        ramp = LEVEL_TURN.reference.chi_deg[0]
        assert scenario.reference.chi_deg[0].rate_dps == ramp.rate_dps * row[chi_rate["key"]]
        assert scenario.controller.feed_forward == row["controller.feed_forward"]
        assert scenario.controller.anti_windup == "none"
        assert scenario.seed == row["seed"]
        same = {"flight", "reference", "controller", "seed"}
        assert scenario.model_dump(exclude=same) == plan.scenario.model_dump(exclude=same)


def test_a_grid_is_flown_cell_by_cell_with_the_same_draws_in_each():
    plan = plan_of(
        {"key": "flight.V_a_mps", "distribution": "grid", "lower": 20.0, "upper": 30.0, "count": 3},
        HEIGHT,
        {"key": "flight.phi_deg", "distribution": "grid", "values": [-5.0, 5.0]},
        design="grid",
    )
    frame = plan.parameters()

    assert plan.cycle == 6
    assert frame["flight.V_a_mps"].tolist() == [20.0, 20.0, 25.0, 25.0, 30.0, 30.0] * 2
    assert frame["flight.phi_deg"].tolist() == [-5.0, 5.0] * 6
    for name in ("flight.h_m", "seed"):
        values = frame[name].tolist()
        assert len(set(values[:6])) == 1
        assert len(set(values)) == 2
    assert plan.parameters(4, 9).equals(frame.iloc[4:9])


@pytest.mark.slow
def test_gains_are_those_of_the_scenario_and_none_where_tuning_finds_none():
    printed = load_scenario("paper_printed_limits")
    nominal = printed.model_copy(update={"gains": ["paper", "tuned"]})
    plan = plan_of(nominal=nominal, gains=["paper", "tuned"])

    assert plan.gain_sets["paper"] == ft.PAPER_GAINS
    assert plan.gain_sets["tuned"] is None
    assert through_json(plan).gain_sets["tuned"] is None


def test_differences_name_what_was_and_what_is():
    plan = plan_of(SPEED, runs=24)
    wider = plan_of({**SPEED, "upper": 27.0}, HEIGHT, runs=30, seed=3)

    assert plan.differences(plan_of(SPEED, runs=24, title="another")) == ()
    said = plan.differences(wider)
    assert "runs: was 24, is 30" in said
    assert "seed: was 0, is 3" in said
    assert "disperse.flight.V_a_mps.upper: was 26.0, is 27.0" in said
    assert "disperse.flight.h_m.mean: was not given, is 500.0" in said
    assert len({plan.sha256, wider.sha256, plan.with_runs(25).sha256}) == 3


def test_a_plan_of_another_version_is_refused():
    with pytest.raises(ft.ScenarioError, match=r"x.json: `version` .*1.* 99"):
        plan_from({**plan_of(SPEED).as_dict(), "version": 99}, "x.json")


@pytest.mark.parametrize("runs", [0, -3])
def test_a_plan_of_no_flights_is_refused(runs):
    with pytest.raises(ft.InputError, match=f"`runs` .* {runs}"):
        ft.plan_campaign(campaign_of(SPEED), runs=runs)
    with pytest.raises(ft.InputError, match=f"`runs` .* {runs}"):
        plan_of(SPEED).with_runs(runs)


@pytest.mark.soak
def test_gains_that_a_process_keeps_are_those_of_a_search_of_its_own():
    found = {I_star: ft.tune("paper", changes={"tuning.I_star": I_star}).gains for I_star in (5, 8)}

    for I_star in (5, 8, 5):
        plan = ft.flights("paper", changes={"tuning.I_star": I_star}).plan(gains="tuned")
        assert plan.gain_sets["tuned"] == found[I_star]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("as_it_is", "flat"), [(" 1.759 ", 0.8244 + 1.135), (" 1.135 ", 0.8244 + 1.759)]
)
def test_inertias_that_an_aircraft_cannot_have_are_not_drawn(tmp_path, as_it_is, flat):
    """Of a flat body the inertias about two axes add up to that about the third."""
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "flat")
    model = folder / "aerosonde.xml"
    model.write_text(model.read_text().replace(as_it_is, f" {flat} "))
    plan = SHIPPED_SCENARIOS / "approach.plan"

    own, other = (ft.flights(plan, aircraft=str(x)).campaign for x in (folder, "aerosonde"))

    assert {x.rpartition(".")[2] for x in set(other.keys) - set(own.keys)} == {
        *("ixx_factor", "iyy_factor", "izz_factor", "cg_aft_m")
    }
    assert own.title.endswith("with the aircraft's own inertias")
    assert own.correlation == []


@pytest.mark.slow
def test_gains_stay_tuned_on_the_aircraft_where_the_law_alone_flies():
    flights = ft.flights("circuit_c172p").starting(2.0)

    alone, aircraft = (flights.plan(plant=plant) for plant in ("kinematic", "jsbsim:c172p"))

    (law,), (there,) = alone.gain_sets.values(), aircraft.gain_sets.values()
    assert law.as_lists() == there.as_lists()


RAMP = {"shape": "ramp", "start_s": 0.5, "duration_s": 2.0, "rate_dps": 4.0}
STEP = {"shape": "step", "start_s": 1.0, "change_deg": 3.0}
DOUBLET = {"shape": "doublet", "start_s": 0.5, "width_s": 0.5, "amplitude_deg": 2.0}


@pytest.mark.parametrize(
    "reference",
    [
        {"chi_deg": [RAMP, STEP], "gamma_deg": [DOUBLET]},
        {"chi_deg": 25.0, "gamma_deg": [RAMP]},
        {"chi_deg": [STEP], "gamma_deg": 12.0},
        {"chi_deg": [], "gamma_deg": 12.0},
        {"chi_deg": [RAMP], "gamma_deg": [STEP], "chi_from_deg": 18.0},
        {"chi_deg": 22.0, "gamma_deg": 11.0},
        {"chi_deg": 22.0, "gamma_deg": 11.0, "shape": "feasible"},
        {"chi_deg": 22.0, "gamma_deg": 11.0, "shape": "feasible", "gamma_from_deg": 9.0},
    ],
)
def test_flights_from_drawn_starts_follow_the_reference_of_their_scenario(reference):
    scenario = ft.scenario_from(tables_of(reference=reference))
    plan = ft.flights(scenario).starting(2.0).plan(gains="paper").with_runs(6)

    flown = [plan.scenario_of(draw) for draw in range(3)]

    assert len({one.flight.chi_deg for one in (scenario, *flown)}) == 4
    assert len({one.flight.gamma_deg for one in (scenario, *flown)}) == 4
    expected, *found = (
        ft.fly(one, gains=["paper"]).runs[0].signals[["chi_ref", "gamma_ref"]]
        for one in (scenario, *flown)
    )
    assert all(np.array_equal(one, expected) for one in found)


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol"])
def test_a_key_has_the_same_draws_wherever_it_stands_among_others(design):
    tables = [{**SPEED, "key": key} for key in KEYS]
    draws = [
        plan_of(*order, design=design, runs=16).parameters(0, 8)[KEYS]
        for order in permutations(tables)
    ]

    assert all(other.equals(draws[0]) for other in draws)


def test_a_group_is_chosen_by_name_and_by_default_is_the_first_with_its_tuned_gains():
    plan = plan_of(SPEED, gains=("K1", "paper"))
    first, *_ = plan.groups
    tuned = replace(plan, gain_sets={**plan.gain_sets, "tuned_identified": None})

    assert plan.chosen_group(None, None) == (first.plant, "K1")
    assert plan.chosen_group(first.plant, "paper") == (first.plant, "paper")
    for of, plant, gains, got in (
        (plan, "other", None, "`plant` must be one of .*, got other"),
        (plan, None, "K9", "`gains` must be one of K1, paper, got 'K9'"),
        (tuned, None, "tuned_identified", "which tuning did not find"),
        (tuned, None, None, "got .tuned_identified., which tuning did not find"),
    ):
        with pytest.raises(ft.InputError, match=got):
            of.chosen_group(plant, gains)
