"""Plans: what is drawn beside SciPy, who flies it, and the same to the bit wherever it is asked."""

import itertools
import math
import pickle
import shutil
from dataclasses import replace

import dispersed
import numpy as np
import pytest
from dispersed import one_of, tables_of, uniform
from hypothesis import given, settings
from hypothesis import strategies as st
from places import SHIPPED_AIRCRAFT, SHIPPED_SCENARIOS
from scipy import stats
from scipy.stats import qmc

import flighttune as ft

LEVEL_TURN = ft.load_scenario("level_turn")
SEEN = ft.scenario_from(tables_of(gains=["paper"]))
NUMBERS = ["sensors.chi_bias_deg", "sensors.gamma_bias_deg", "sensors.V_a_bias_mps"]
SPEED = uniform("flight.V_a_mps", 24.0, 26.0)
HEIGHT = {"key": "flight.h_m", "distribution": "normal", "mean": 500.0, "sd": 20.0}

# Smallest p-value that a fixed seed may have.
CHANCE = 1e-3


def plan_of(*disperse, nominal=LEVEL_TURN, gains=("paper",), **keys):
    return ft.plan_campaign(dispersed.campaign_of(nominal, *disperse, gains=[*gains], **keys))


def points(design, count, keys=NUMBERS, first=0, end=None, **more):
    """Points of a design in the unit cube."""
    cube = [uniform(key, 0.0, 1.0) for key in keys]
    plan = plan_of(*cube, nominal=SEEN, design=design, runs=count, **more)
    return plan.parameters(first, end)[keys].to_numpy()


def of(kind, **keys):
    return {"key": NUMBERS[0], "distribution": kind, **keys}


CONTINUOUS = [
    (of("normal", mean=25.0, sd=1.5), stats.norm(25.0, 1.5)),
    (of("normal", mean=1.0, sd=0.1, lower=0.9, upper=1.3), stats.truncnorm(-1, 3, 1, 0.1)),
    (of("normal", mean=0.0, sd=2.0, lower=-1.0), stats.truncnorm(-0.5, math.inf, 0.0, 2.0)),
    (of("normal", mean=0.0, sd=2.0, lower=9.0), stats.truncnorm(4.5, math.inf, 0.0, 2.0)),
    (of("normal", mean=3.0, sd=2.0, upper=1.0), stats.truncnorm(-math.inf, -1.0, 3.0, 2.0)),
    (of("normal", mean=0.0, sd=1.0, lower=0.0, upper=0.4), stats.truncnorm(0.0, 0.4)),
    (of("log_normal", median=1.1, sd_log=0.2), stats.lognorm(0.2, scale=1.1)),
    (of("uniform", lower=-3.0, upper=5.0), stats.uniform(-3.0, 8.0)),
]  # fmt: skip


@pytest.mark.parametrize(("drawn", "known"), CONTINUOUS)
def test_values_are_the_quantiles_of_scipy_at_the_points_of_the_design(drawn, known):
    plan = plan_of(drawn, nominal=SEEN, runs=300)
    u = points("random", 300, NUMBERS[:1])[:, 0]
    values = plan.parameters()[NUMBERS[0]].to_numpy()

    assert values == pytest.approx(known.ppf(u), rel=1e-12)
    assert plan.campaign.central.sensors.chi_bias_deg == pytest.approx(known.median(), rel=1e-9)
    if "lower" in drawn and drawn["distribution"] == "normal":  # its quantiles are SciPy's own
        assert (
            drawn["mean"] + drawn["sd"] * stats.truncnorm.ppf(u, *known.args[:2]) == values
        ).all()


def test_truncated_values_stay_within_their_bounds():
    narrow = of("normal", mean=0.0, sd=1.0, lower=-8.0, upper=-7.999)
    values = plan_of(narrow, nominal=SEEN, runs=2000).parameters()[NUMBERS[0]]

    assert values.between(-8.0, -7.999).all()
    assert values.nunique() > 1900


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol"])
def test_every_coordinate_is_uniform_and_independent_of_the_others(design):
    u = points(design, 2048)

    for column in u.T:
        assert stats.kstest(column, "uniform").pvalue > CHANCE
    ranks = np.asarray(stats.spearmanr(u).statistic)
    assert np.abs(ranks - np.eye(3)).max() < 0.08  # 3.5 standard errors of independent columns
    assert 0.0 < u.min() < u.max() < 1.0


def test_a_latin_hypercube_has_one_point_in_every_stratum_and_sobol_points_are_those_of_scipy():
    strata = (points("latin_hypercube", 50) * 50).astype(int)
    engine = qmc.Sobol(3, bits=32, rng=np.random.default_rng(np.random.SeedSequence(4)))
    known = engine.random_base2(6)[:, np.argsort(np.argsort(NUMBERS))]

    assert (np.sort(strata, axis=0) == np.arange(50)[:, None]).all()
    assert np.array_equal(points("sobol", 64, seed=4), known)
    assert np.array_equal(points("sobol", 64, first=17, end=40, seed=4), known[17:40])
    assert np.array_equal(points("sobol", 1, seed=4), known[:1])


@pytest.mark.parametrize("rank", [-0.9, -0.3, 0.5, 0.95])
def test_correlated_keys_have_the_rank_correlation_asked_for(rank):
    table = {"keys": [NUMBERS[2], NUMBERS[0]], "rank": rank}
    plain = points("sobol", 4096)
    mixed = points("sobol", 4096, correlation=[table])

    assert stats.spearmanr(mixed[:, 0], mixed[:, 2]).statistic == pytest.approx(rank, abs=0.01)
    assert np.array_equal(mixed[:, 1], plain[:, 1])
    for column in mixed.T:
        assert stats.kstest(column, "uniform").pvalue > CHANCE


def test_correlations_that_contradict_each_other_are_refused():
    pairs = zip(itertools.combinations(NUMBERS, 2), (0.9, -0.9, 0.9), strict=True)
    tables = [{"keys": [*keys], "rank": rank} for keys, rank in pairs]

    with pytest.raises(ft.FlightTuneError, match=r"`rank` .* eigenvalue -"):
        points("random", 4, correlation=tables)


def test_choices_come_as_often_as_they_weigh_and_keep_their_kind():
    weights = {0.5: 1.0, 1.5: 0.0, 2.5: 3.0, 3.5: 4.0}
    drawn = one_of(NUMBERS[0], *weights, weights=[*weights.values()])
    plan = plan_of(drawn, nominal=SEEN, runs=4000)
    counts = plan.parameters()[NUMBERS[0]].value_counts().to_dict()

    assert {*counts} == {0.5, 2.5, 3.5}
    expected = [500.0 * weights[value] for value in counts]
    assert stats.chisquare([*counts.values()], expected).pvalue > CHANCE
    assert plan.campaign.central.sensors.chi_bias_deg == 3.5  # the most likely
    for key, values, kind in (
        (NUMBERS[0], [3, 4, 6], "i"),
        (NUMBERS[0], [1, 2.5], "f"),
        ("controller.feed_forward", [True, False], "b"),
    ):
        column = plan_of(one_of(key, *values), nominal=SEEN, runs=60).parameters()[key]
        assert (column.dtype.kind, {*column}) == (kind, {*values})
    words = plan_of(one_of("controller.anti_windup", "none", "conditional"), nominal=SEEN)
    assert words.parameters()["controller.anti_windup"].dtype == "str"


def test_a_poison_is_not_what_a_choice_is_checked_at():
    poisoned = one_of("flight.V_a_mps", math.nan, 25.0, 26.0, weights=[9.0, 1.0, 2.0])

    assert plan_of(poisoned).campaign.central.flight.V_a_mps == 26.0
    with pytest.raises(ft.ScenarioError, match=r"`V_a_mps` must be a finite number, got nan"):
        plan_of(one_of("flight.V_a_mps", math.nan))


def test_a_grid_is_flown_cell_by_cell_and_each_point_of_what_is_drawn_in_all_of_them():
    grids = (
        {"key": "flight.V_a_mps", "distribution": "grid", "values": [24.0, 25.0, 26.0]},
        {"key": "flight.h_m", "distribution": "grid", "lower": 400.0, "upper": 500.0, "count": 5},
    )
    alone = plan_of(*grids, design="grid", runs=30)
    drawn = plan_of(*grids, uniform("flight.phi_deg", -1.0, 1.0), runs=90)
    cells = [*itertools.product([24.0, 25.0, 26.0], np.linspace(400.0, 500.0, 5))]

    assert alone.cycle == drawn.cycle == 15
    assert alone.campaign.central.flight.V_a_mps == 25.0
    assert alone.campaign.central.flight.h_m == 450.0
    values = drawn.parameters()
    keys = ["flight.V_a_mps", "flight.h_m"]
    assert [*map(tuple, values[keys].to_numpy())] == cells * 3
    by_point = values.groupby(np.arange(45) // 15)
    assert (by_point["flight.phi_deg"].nunique() == 1).all()
    assert (by_point["seed"].nunique() == 1).all()
    assert values["flight.phi_deg"].nunique() == values["seed"].nunique() == 3
    assert [*map(tuple, drawn.parameters(20, 33)[keys].to_numpy())] == (cells * 3)[20:33]


def test_seeds_depend_on_the_draw_alone_and_fit_a_scenario():
    plan = plan_of(SPEED, runs=2000, seed=7)
    seeds = plan.parameters()["seed"]

    assert seeds[300:400].equals(
        plan_of(SPEED, HEIGHT, seed=7, runs=900).parameters(300, 400)["seed"]
    )
    assert seeds.between(0, 2**31 - 3).all()
    assert seeds.nunique() == plan.draws == 1000
    assert not (seeds == plan.with_seed(8).parameters()["seed"]).any()
    assert plan.with_seed(None) is plan


finite, positive = st.floats(-9.0, 9.0), st.floats(0.01, 9.0)
numbers = st.lists(st.floats(-9, 9), min_size=1, max_size=3)


def of_kind(kind, **keys):
    return st.fixed_dictionaries({"distribution": st.just(kind), **keys})


distributions = st.one_of(
    of_kind("normal", mean=finite, sd=positive),
    of_kind("log_normal", median=positive, sd_log=st.floats(0.01, 0.5)),
    of_kind("uniform", lower=st.floats(-9.0, 0.0), upper=positive),
    of_kind("choice", values=numbers),
    of_kind("grid", values=numbers),
)


@st.composite
def campaigns(draw):
    keys = draw(st.lists(st.sampled_from(NUMBERS), unique=True, max_size=3))
    return dispersed.campaign_of(
        SEEN,
        *({"key": key, **draw(distributions)} for key in keys),
        design=draw(st.sampled_from(["random", "latin_hypercube", "sobol"])),
        seed=draw(st.integers(0, 2**31 - 3)),
        runs=draw(st.integers(1, 40)),
    )


@pytest.mark.slow
@settings(max_examples=12)
@given(campaign=campaigns(), more=st.integers(1, 40), first=st.integers(0, 40))
def test_draws_do_not_depend_on_where_one_begins_or_ends_or_which_process_asks(
    campaign, more, first
):
    plan = ft.plan_campaign(campaign)
    longer, first = plan.with_runs(plan.runs + more), min(first, plan.draws)
    whole, again = plan.parameters(), pickle.loads(pickle.dumps(plan))

    assert whole.index.tolist() == [*range(plan.draws)]
    assert plan.parameters(first).equals(whole.iloc[first:])
    assert plan.extendable == (campaign.design != "latin_hypercube")
    if plan.extendable:
        assert longer.parameters(first, plan.draws).equals(whole.iloc[first:])
    assert (again.sha256, again.differences(plan)) == (plan.sha256, ())
    assert again.parameters().equals(whole)


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol"])
def test_a_key_has_the_same_draws_wherever_it_stands_among_others(design):
    first, *others = (points(design, 16, [*keys]) for keys in itertools.permutations(NUMBERS))
    orders = [*itertools.permutations(range(3))][1:]

    assert all(
        np.array_equal(other, first[:, order]) for other, order in zip(others, orders, strict=True)
    )


def test_every_draw_is_flown_by_every_group_plant_by_plant_and_in_wind_aircraft_first():
    plan = plan_of(SPEED, gains=["paper", "K4"], runs=10)
    gusts = plan_of(
        SPEED, nominal=ft.scenario_from(LEVEL_TURN.as_dict() | {"wind": dispersed.WIND})
    )

    plants = "kinematic", "jsbsim:aerosonde"
    assert [group.label for group in plan.groups] == [
        f"{plant} / {gains}" for plant in plants for gains in ("paper", "K4")
    ]
    assert [x.plant for x in gusts.groups] == [*plants[::-1]]
    assert plan.draws == 3
    assert [plan.draw_of(run) for run in range(10)] == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]
    assert [plan.group_of(run) for run in (0, 5, 9)] == [plan.groups[i] for i in (0, 1, 1)]
    alone = plan.of_group(plan.groups[3])
    assert (alone.groups, [*alone.gain_sets], alone.runs) == (plan.groups[3:], ["K4"], 10)


def test_the_scenario_of_a_draw_has_its_values_and_seed():
    rate = uniform("reference.chi_deg[0].rate_dps", 0.5, 1.5, acts="multiplies")
    plan = plan_of(
        SPEED, {**HEIGHT, "acts": "adds", "mean": 0.0}, rate,
        one_of("controller.feed_forward", True, False),
        one_of("controller.anti_windup", "none"),
    )  # fmt: skip
    assert plan.campaign.central.reference == LEVEL_TURN.reference
    assert plan.campaign.central.flight.h_m == LEVEL_TURN.flight.h_m
    for draw, row in plan.parameters().iterrows():
        scenario = plan.scenario_of(int(draw))

        assert scenario.flight.V_a_mps == row["flight.V_a_mps"]
        assert scenario.flight.h_m == LEVEL_TURN.flight.h_m + row["flight.h_m"]
        ramp = LEVEL_TURN.reference.chi_deg[0]
        assert scenario.reference.chi_deg[0].rate_dps == ramp.rate_dps * row[rate["key"]]
        assert scenario.controller.feed_forward == row["controller.feed_forward"]
        assert scenario.controller.anti_windup == "none"
        assert scenario.seed == row["seed"] == plan.values_of(draw)["seed"]
    for draw in (-1, plan.draws):
        with pytest.raises(
            ft.InputError, match=rf"`draw` must be 0 to {plan.draws - 1}, got {draw}"
        ):
            plan.scenario_of(draw)


def test_a_difference_between_two_plans_is_said_by_its_key():
    plan = plan_of(SPEED, runs=10)
    for key, other in (
        ("seed", plan.with_seed(3)),
        ("runs", plan.with_runs(12)),
        ("disperse.flight.V_a_mps.lower", plan_of(SPEED | {"lower": 24.5}, runs=10)),
        ("disperse.flight.h_m", plan_of(SPEED, HEIGHT, runs=10)),
        ("scenario.flight.h_m", plan_of(SPEED, nominal=ft.load_scenario(
            "level_turn", changes={"flight.h_m": 400.0}), runs=10)),
        ("gains as numbers, K1", plan_of(SPEED, gains=["K1"], runs=10)),
        ("design", plan_of(SPEED, design="sobol", runs=10)),
    ):  # fmt: skip
        said = plan.differences(other)
        assert any(one.startswith(key) and ": was " in one and ", is " in one for one in said), said
        assert other.sha256 != plan.sha256
    assert plan.differences(plan_of(SPEED, runs=10, title="another", source="mine")) == ()


@pytest.mark.parametrize("runs", [0, -3])
def test_a_plan_of_no_flights_is_refused(runs):
    with pytest.raises(ft.InputError, match=f"`runs` .* {runs}"):
        ft.plan_campaign(dispersed.campaign_of(LEVEL_TURN, SPEED, gains=["paper"]), runs=runs)


@pytest.mark.slow
def test_tuned_gains_of_another_machine_are_those_there_if_they_agree_to_rounding():
    plan = plan_of(SPEED, gains=["tuned", "paper"], nominal=SEEN, runs=4)
    found = plan.gain_sets["tuned"]
    for name, by, taken in (("tuned", 1e-9, True), ("tuned", 1e-3, False), ("paper", 1e-9, False)):
        other = ft.PIGains(
            **{**plan.gain_sets[name].as_lists(), "K_P": plan.gain_sets[name].K_P * (1.0 + by)}
        )
        theirs = replace(plan, gain_sets={**plan.gain_sets, name: other})
        mine = plan.with_tuned_gains_of(theirs)
        assert (mine.gain_sets[name] == other) is taken
    assert found is not None


def test_a_group_is_chosen_by_name_and_by_default_is_the_first_with_its_tuned_gains():
    plan = plan_of(SPEED, gains=("K1", "paper"))
    first, *_ = plan.groups
    tuned = replace(plan, gain_sets={**plan.gain_sets, "tuned_identified": None})

    assert plan.chosen_group(None, None) == (first.plant, "K1")
    assert plan.chosen_group("jsbsim:aerosonde", "paper") == ("jsbsim:aerosonde", "paper")
    for of_plan, plant, gains, got in (
        (plan, "other", None, "`plant` must be one of .*, got other"),
        (plan, None, "K9", "`gains` must be one of K1, paper, got 'K9'"),
        (tuned, None, "tuned_identified", "which tuning did not find"),
        (tuned, None, None, "got .tuned_identified., which tuning did not find"),
    ):
        with pytest.raises(ft.InputError, match=got):
            of_plan.chosen_group(plant, gains)


@pytest.mark.slow
def test_gains_that_tuning_cannot_find_are_refused_before_any_flight():
    tables = tables_of(gains=["tuned"], tuning={"I_star": 1e-6})

    with pytest.raises(
        ft.FlightTuneError, match=r"`gains` must be feasible: tuning found no tuned"
    ):
        plan_of(SPEED, nominal=ft.scenario_from(tables), gains=["tuned"])


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


@pytest.mark.soak
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
