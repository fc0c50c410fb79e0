"""Boxes learned and counted: the statistics of the count, and flights of small campaigns."""

import json
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
import pyarrow as pa
import pytest
from campaigns import flown_here, write_campaign
from commands import answer
from dispersed import AEROSONDE, TURBULENCE, WIND, plan_of, tables_of, uniform

from flighttune.campaign import conform as conform_module
from flighttune.campaign.conform import (
    ConformSettings,
    air_of,
    at_random,
    conform,
    conformant_model,
    distribution_of,
    in_air,
    own_campaign,
    recount,
)
from flighttune.campaign.flying.rows import fly_runs
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.conformance import Windows, load_conformance, save_conformance
from flighttune.conformance.boxes import ResidualSummary
from flighttune.conformance.file import conformance_tables
from flighttune.errors import InputError, ScenarioError
from flighttune.flight.fly import fly
from flighttune.seal import BLANK, seal

GAINS = {"name": "soft", "K_P": [[0.5, 0.0], [0.0, 0.5]], "K_I": [[0.1, 0.0], [0.0, 0.1]]}
START = uniform("flight.chi_deg", -5.0, 5.0), uniform("flight.gamma_deg", 3.0, 7.0)
FEW = ConformSettings(epsilon=0.5, confidence=0.75, attempts=3)


def small_plan(runs=12, **tables):
    """One second of the Aerosonde from random starts."""
    scenario = tables_of((AEROSONDE,), **{"gains": [GAINS], **tables})
    scenario["flight"]["duration_s"] = 1.0
    return plan_of(scenario, *START, runs=runs)


@pytest.fixture(scope="module")
def found():
    with flown_here(conform_module, "planned", small_plan()) as pool:
        return conform("campaign", FEW, pool)


@pytest.mark.parametrize(
    ("epsilon", "confidence", "attempts", "flights"),
    [
        (0.01, 0.999, 1, 688),
        (1e-3, 1.0 - 1e-6, 1, 13_809),
        (1e-4, 1.0 - 1e-6, 1, 138_149),
        (0.01, 0.999, 4, 826),  # attempts share the confidence
    ],
)
def test_the_flights_that_a_claim_takes(epsilon, confidence, attempts, flights):
    settings = ConformSettings(epsilon=epsilon, confidence=confidence, attempts=attempts)

    # the least M with (1 - epsilon)^M <= (1 - confidence) / attempts
    assert settings.flights == flights


@pytest.mark.slow
def test_false_claims_are_as_rare_as_the_confidence_says():
    """Flights that leave any box with a probability just above epsilon, thirty times."""
    epsilon, confidence = 0.2, 0.9
    settings = ConformSettings(epsilon=epsilon, confidence=confidence, attempts=2)
    rng = np.random.default_rng(7)
    calls = []

    def rows(plan, runs, probes):
        calls.append(runs)
        # One that leaves is ten times further out than any before, whatever was learned from those.
        size = np.where(rng.random(len(runs)) < epsilon + 0.01, 10.0 ** len(calls), 1.0)
        (windows,) = (probes["residuals"].args[0].windows.count,)
        extremes = [[-one] * (6 * windows) + [one] * (6 * windows) for one in size]
        return pa.table({"run": list(runs), "residuals": extremes})

    claims = 0
    with flown_here(conform_module, "planned", small_plan(runs=1), rows) as pool:
        for _ in range(30):
            calls.clear()
            claims += conform("campaign", settings, pool).holds

    # 30 at a probability of at most 0.1: more than 9 happen once in 2000 times.
    assert claims <= 9


def test_counted_flights_are_not_those_learned_from_and_none_is_flown_twice():
    flown = []

    def rows(plan, runs, probes):
        flown.append(list(runs))
        table = fly_runs(plan, runs, probes=probes)
        wide = [[1e3 * len(flown)] * len(one) for one in table["residuals"].to_pylist()]
        return table.set_column(table.schema.get_field_index("residuals"), "residuals", [wide])

    with flown_here(conform_module, "planned", small_plan(runs=2), rows) as pool:
        found = conform("campaign", FEW, pool)

    each = FEW.flights
    assert [len(runs) for runs in flown] == [2, each, each, each]
    assert list(chain(*flown)) == list(range(2 + 3 * each))
    ends = [2, 2 + each, 2 + 2 * each, 2 + 3 * each]
    assert [one.learned for one in found.attempts] == [(0, end) for end in ends[:-1]]
    assert [one.counted for one in found.attempts] == list(pairwise(ends))
    assert [one.outside for one in found.attempts] == [each] * 3
    assert not found.holds
    assert "nothing is claimed" in found.sentence


def summary_of(plan):
    """What is kept of the residuals of each flight."""
    model = conformant_model(plan.scenario, plan.groups[0].plant)
    return ResidualSummary(model=model, windows=Windows.covering("time", 1.0))


def test_residuals_are_one_more_column_and_change_no_other():
    plan = small_plan(runs=3)
    summary = summary_of(plan)

    rows = fly_runs(
        plan,
        range(3),
        probes={"low": lambda run, start: summary.of_flight(run, start.condition)[0].ravel()},
    )

    # 2 windows of 4 residuals and 2 errors
    assert [len(one) for one in rows["low"].to_pylist()] == [12] * 3
    rest = rows.drop_columns(["wall_s", "low"])
    assert rest.equals(fly_runs(plan, range(3)).drop_columns("wall_s"))


def test_errors_of_a_window_are_those_at_its_samples_and_at_the_next():
    plan = small_plan(runs=1)
    summary = summary_of(plan)
    scenario = plan.scenario_of(0)
    (run,) = fly(scenario).runs

    low, high = summary.of_flight(run, scenario.condition)

    errors = run.signals[["chi_err", "gamma_err"]].to_numpy()
    parts = errors[:26], errors[25:]
    assert low[:, 4:] == pytest.approx(np.array([part.min(axis=0) for part in parts]))
    assert high[:, 4:] == pytest.approx(np.array([part.max(axis=0) for part in parts]))


def test_a_file_comes_back_as_it_was_written(found, tmp_path):
    save_conformance(found, tmp_path / "boxes.json")

    again = load_conformance(tmp_path / "boxes.json")

    assert conformance_tables(again) == conformance_tables(found)
    assert again.boxes.low.tolist() == found.boxes.low.tolist()


def test_a_wind_that_is_drawn_may_be_stated():
    plan = plan_campaign(load_campaign("light_turbulence"))
    (plant,) = plan.scenario.plant
    known = distribution_of(plan, plant.label)

    def difference(**wind):
        scenario = conform_module.scenario_from({**plan.scenario.as_dict(), "wind": wind})
        return known.difference(scenario, plant)

    assert known.windy
    assert difference(speed_mps=0.0, from_deg=30.0) is None
    assert "`wind.speed_mps` must be 0 to 8, got 9.0" in difference(speed_mps=9.0, from_deg=30.0)
    assert "`wind.down_mps` must be 0.0" in difference(speed_mps=3.0, from_deg=30.0, down_mps=1.0)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"flight": {"V_a_mps": 26.0}}, r"`flight.V_a_mps` must be 25.0, got 26.0"),
        ({"flight": {"chi_deg": 9.0}}, r"`flight.chi_deg` must be -5 to 5, got 9"),
        ({"limits": {"n_z_rate_per_s": 1.0}}, r"`limits.n_z_rate_per_s` must be .*, got 1"),
        ({"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, r"`wind.speed_mps` must be None, got 3.0"),
    ],
)
def test_other_flights_are_refused_by_key(found, change, key):
    plan = small_plan()
    tables = plan.scenario_of(3).as_dict()
    for name, values in change.items():
        tables[name] = {**tables.get(name, {}), **values}
    scenario = conform_module.scenario_from(tables)

    found.check(plan.scenario_of(3), scenario.plant[0], plan.gain_sets["soft"])
    with pytest.raises(InputError, match=key):
        found.check(scenario, scenario.plant[0], plan.gain_sets["soft"])


def test_other_gains_and_another_aircraft_are_refused(found):
    plan = small_plan()
    scenario, gains = plan.scenario_of(0), plan.gain_sets["soft"]

    with pytest.raises(InputError, match=r"`K_P`.*soft"):
        found.check(scenario, scenario.plant[0], replace(gains, K_P=1.01 * gains.K_P))
    other = scenario.plant[0].model_copy(update={"aircraft": "c172p"})
    with pytest.raises(InputError, match=r"`aircraft`.*aerosonde.*c172p"):
        found.check(scenario, other, gains)


def rewritten(found, path, **changes):
    """The file of a conformance with other keys, and the SHA-256 of what it says then."""
    tables = {**conformance_tables(found), **changes, "seal": BLANK}
    path.write_bytes(seal(json.dumps(tables, ensure_ascii=False).encode()))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "flighttune conformance 4"}, "`format`"),
        ({"boxes": None}, "`boxes`"),
        ({"epsilon": "small"}, "`epsilon`"),
        ({"epsilon": 0.0}, "`epsilon` must be between 0 and 1"),
        ({"confidence": 1.0}, "`confidence` must be between 0 and 1"),
        ({"epsilon": 1e-4, "confidence": 0.999999}, "`counted` must be at least 149134 flights"),
        ({"planned": 0}, "`attempts` must be 1 to the 0 planned"),
        # The flights counted would be those that were learned from.
        (
            {"attempts": [{"learned": [0, 12], "counted": [4, 40], "outside": 0, "widened": 1.0}]},
            "`attempts.0.counted` must be draws after",
        ),
    ],
)
def test_a_file_that_claims_more_than_was_counted_is_refused_in_one_line(
    found, tmp_path, change, message
):
    path = rewritten(found, tmp_path / "boxes.json", **change)

    with pytest.raises(ScenarioError, match=f"boxes.json: {message}") as caught:
        load_conformance(path)
    assert "\n" not in str(caught.value)


def test_a_file_with_one_digit_changed_is_refused(found, tmp_path):
    path = tmp_path / "boxes.json"
    save_conformance(found, path)
    whole = path.read_bytes()
    for place in (k for k, byte in enumerate(whole) if byte in b"3"):
        path.write_bytes(whole[:place] + b"8" + whole[place + 1 :])

        with pytest.raises(InputError, match=r"boxes\.json: "):
            load_conformance(path)


def test_another_seed_draws_other_flights_and_none_is_outside_the_boxes(found):
    with flown_here(conform_module, "planned", small_plan()) as pool:
        again = recount("campaign", found, ConformSettings(), pool)
        middle = 0.5 * (found.boxes.low + found.boxes.high)
        narrow = replace(found, boxes=replace(found.boxes, low=middle, high=middle))
        outside = recount("campaign", narrow, ConformSettings(seed=5), pool)
        with pytest.raises(InputError, match=f"`seed` must not be .* got {found.seed}"):
            recount("campaign", found, ConformSettings(seed=found.seed), pool)

    assert found.holds
    assert (again.flights, again.outside) == (FEW.flights, 0)
    assert outside.outside == FEW.flights
    with (
        flown_here(conform_module, "planned", small_plan(runs=13)) as pool,
        pytest.raises(InputError, match=r"campaign: .*another hash"),
    ):
        recount("campaign", found, ConformSettings(), pool)


def test_a_choice_of_one_value_is_not_random():
    scenario = tables_of((AEROSONDE,), gains=[GAINS])
    always = {"key": "flight.chi_deg", "distribution": "choice", "values": [3.0]}
    plan = plan_of(scenario, always, runs=4)

    with (
        flown_here(conform_module, "planned", plan) as pool,
        pytest.raises(InputError, match="`start_deg` must be given"),
    ):
        conform("campaign", FEW, pool)


def test_air_is_taken_apart():
    plan = small_plan(wind=WIND, turbulence=TURBULENCE)
    campaign = plan.campaign
    named = {**TURBULENCE, "intensity": "light"}
    named = {key: value for key, value in named.items() if key in ("intensity", "model")}
    words = small_plan(wind=WIND, turbulence=named).campaign

    assert air_of(campaign.central).startswith("severity")
    assert air_of(in_air(campaign, "calm").nominal) == "calm"
    assert air_of(in_air(campaign, "wind").nominal) == "wind"
    assert air_of(in_air(words, "severe").nominal) == "severe"
    with pytest.raises(InputError, match=r"`air`.*'stormy'"):
        in_air(campaign, "stormy")


def test_points_of_a_design_become_independent_draws():
    campaign = small_plan().campaign.model_copy(update={"design": "sobol"})

    assert at_random(campaign).design == "random"


def test_an_aircraft_flies_starts_and_references_of_its_own():
    campaign = own_campaign("c172p")

    assert campaign.design == "random"
    assert {"flight.chi_deg", "reference.chi_deg[0].rate_dps"} <= set(campaign.keys)
    assert air_of(campaign.nominal) == "calm"


@pytest.mark.slow
def test_workers_fly_what_is_learned_and_counted(tmp_path):
    still = write_campaign(tmp_path, runs=20, law=False, wind="")
    options = ("--epsilon", 0.5, "--confidence", 0.75, "--attempts", 4, "--workers", 1)

    said = answer("conform", still, *options, "--out", tmp_path / "boxes.json")

    assert said["attempts"][0]["learned"] == [0, 10]  # 20 runs are 10 draws of two gain sets
    assert said["status"] == "counted"
    written = load_conformance(said["out"])
    assert written.distribution.air == "calm"
    assert said["boxes"]["low"] == written.boxes.low.tolist()
