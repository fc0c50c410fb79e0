"""Boxes learned and counted: the statistics of the count, and flights of small campaigns."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from campaigns import bits, flown_here, write_campaign
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
    recount,
)
from flighttune.campaign.flying.columns import table_of
from flighttune.campaign.flying.rows import fly_runs, rows_flown
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.claims.boxes import Windows
from flighttune.claims.conformance import conformance_tables, load_conformance, save_conformance
from flighttune.errors import InputError, ScenarioError
from flighttune.files.seal import BLANK, seal

GAINS = {"name": "soft", "K_P": [[0.5, 0.0], [0.0, 0.5]], "K_I": [[0.1, 0.0], [0.0, 0.1]]}
START = uniform("flight.chi_deg", -5.0, 5.0), uniform("flight.gamma_deg", 3.0, 7.0)
FEW = ConformSettings(epsilon=0.5, confidence=0.75)  # 14 flights, of which 5 may lie outside


def small_plan(runs=12, **tables):
    """One second of the Aerosonde from random starts."""
    scenario = tables_of((AEROSONDE,), **{"gains": [GAINS], **tables})
    scenario["flight"]["duration_s"] = 1.0
    return plan_of(scenario, *START, runs=runs)


@pytest.fixture(scope="module")
def found():
    with flown_here(conform_module, "planned", small_plan()) as pool:
        return conform("campaign", FEW, pool)


def made_up_rows(size_of, flown=None):
    """Rows of flights whose residuals are as large as `size_of` of each run; None: not completed.

    Their scores are those that the boxes of the count give them.
    """

    def rows(plan, runs, probes):
        (probe,) = probes.values()
        _, windows, boxes = probe.args
        shape = 2, windows.count, 4
        kept = []
        for run in runs:
            size = size_of(run)
            if size is None:
                kept.append({})
                continue
            ends = np.array([-size, size])[:, None, None] * np.ones(shape)
            kept.append({"residuals": [boxes.score(*ends)] if boxes else ends.ravel().tolist()})
        if flown is not None:
            flown.append(list(runs))
        return kept

    return rows


@pytest.mark.parametrize(("not_completed", "scale"), [(0, 9.0), (3, 12.0)])
def test_the_scale_of_the_boxes_is_an_order_statistic_of_fresh_flights(not_completed, scale):
    """Learned from one flight of size 1, counted on flights of sizes 1 to 14 in random order.

    P(Bin(14, 1/2) <= 5) = 3473 / 16384 = 0.212 and P(Bin(14, 1/2) <= 6) = 0.395: 5 flights may lie
    outside at a confidence of 0.75, and the sixth largest score is the scale.
    """
    sizes = [1.0, *np.random.default_rng(4).permutation(np.arange(1.0, 15.0)).tolist()]
    for run in range(1, 15):
        if sizes[run] <= not_completed:
            sizes[run] = None
    flown = []

    with flown_here(
        conform_module, "planned", small_plan(runs=1), made_up_rows(sizes.__getitem__, flown)
    ) as pool:
        counted = conform("campaign", FEW, pool)

    assert flown == [[0], list(range(1, 15))]
    assert counted.counted == (scale, 5)  # flights that were not completed lie outside first
    assert counted.boxes.high == pytest.approx(np.full((2, 4), scale))
    assert counted.boxes.low == pytest.approx(np.full((2, 4), -scale))
    assert "of 14 fresh flights 5 left the boxes" in counted.sentence
    assert counted.not_completed == not_completed


@pytest.mark.slow
def test_false_claims_are_as_rare_as_the_confidence_says():
    """Two hundred counts of flights whose sizes have a known distribution."""
    epsilon, confidence, counts = 0.2, 0.9, 200
    settings = ConformSettings(epsilon=epsilon, confidence=confidence)
    rng = np.random.default_rng(7)
    plan, false = small_plan(runs=1), 0

    with flown_here(
        conform_module, "planned", plan, made_up_rows(lambda _: rng.exponential())
    ) as pool:
        for _ in range(counts):
            high = conform("campaign", settings, pool).boxes.high.max()
            false += np.exp(-high) > epsilon  # probability that a new flight is larger

    # 20 are expected at most, with a standard deviation of 4.2.
    assert 5 <= false <= 33


def test_too_many_flights_that_are_not_completed_claim_nothing():
    rows = made_up_rows(lambda run: None if 1 <= run <= 6 else 1.0)

    with (
        flown_here(conform_module, "planned", small_plan(runs=1), rows) as pool,
        pytest.raises(InputError, match=r"at most 5 of 14 .* got 6"),
    ):
        conform("campaign", FEW, pool)


def residuals_kept(plan):
    """What is kept of the residuals of each flight."""
    model = conformant_model(plan.scenario, plan.groups[0].plant)
    windows = Windows.covering("time", 1.0)
    return partial(conform_module._residuals_of, model, windows, None)


def test_residuals_are_one_more_column_and_change_no_other():
    plan = small_plan(runs=3)

    rows = list(rows_flown(plan, range(3), probes={"kept": residuals_kept(plan)}))

    # The lowest and the highest of 4 residuals in 2 windows
    assert [len(row["kept"]) for row in rows] == [16] * 3
    assert bits(table_of(plan, rows)) == bits(fly_runs(plan, range(3)))


def test_a_file_comes_back_as_it_was_written(found, tmp_path):
    save_conformance(found, tmp_path / "boxes.json")

    again = load_conformance(tmp_path / "boxes.json")

    assert conformance_tables(again) == conformance_tables(found)
    assert again.boxes.low.tolist() == found.boxes.low.tolist()
    assert again.counted == found.counted


def test_a_wind_that_is_drawn_may_be_stated():
    plan = plan_campaign(load_campaign("light_turbulence"))
    (plant,) = plan.scenario.plant
    known = distribution_of(plan.campaign, plant.label)

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
        ({"format": "flighttune conformance 5"}, "`format` .*; make the file again"),
        ({"boxes": None}, "`boxes`"),
        ({"epsilon": "small"}, "`epsilon`"),
        ({"epsilon": 0.0}, "`epsilon` must be between 0 and 1"),
        ({"confidence": 1.0}, "`confidence` must be between 0 and 1"),
        ({"epsilon": 1e-4, "confidence": 0.999999}, "`flights` must be at least 138149"),
        ({"epsilon": 0.4}, "`boxes` must be at least as wide"),  # 5 flights outside are too many
        ({"not_completed": 1}, "`boxes` must be at least as wide"),
        ({"not_completed": 99}, "`not_completed` must be at most 52 of 113"),
        ({"training": 0}, "`training` must be at least 1"),
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


@pytest.mark.parametrize(("name", "end"), [("boxes", 0.99), ("learned", 1.01), ("scores", 1.01)])
def test_boxes_that_the_scores_do_not_support_are_refused(found, tmp_path, name, end):
    """Boxes that are 1 % narrower, or scores or learned boxes that are 1 % larger."""
    tables = conformance_tables(found)[name]
    if name == "scores":
        forged = [end * score for score in tables]
    else:
        low, high = (np.array(tables[side]) for side in ("low", "high"))
        centre, half = 0.5 * (low + high), 0.5 * end * (high - low)
        forged = {**tables, "low": (centre - half).tolist(), "high": (centre + half).tolist()}
    path = rewritten(found, tmp_path / "boxes.json", **{name: forged})

    with pytest.raises(ScenarioError, match=r"boxes\.json: `boxes` .* as wide"):
        load_conformance(path)


def test_a_recount_flies_other_draws_and_refutes_boxes_that_are_too_narrow(found):
    with flown_here(conform_module, "planned", small_plan()) as pool:
        again = recount("campaign", found, ConformSettings(), pool)
        # A claim that its own flights never contradict: the flights counted were of one size.
        narrow = replace(found.learned, low=found.learned.low / 1e3, high=found.learned.high / 1e3)
        forged = replace(found, learned=narrow, boxes=narrow.scaled(found.counted[0]))
        outside = recount("campaign", forged, ConformSettings(seed=5), pool)
        with pytest.raises(InputError, match=f"`seed` must not be .* got {found.seed}"):
            recount("campaign", found, ConformSettings(seed=found.seed), pool)

    # P(Bin(14, 1/2) >= 9) = 0.212 is at most 1 - 0.75, and P(Bin(14, 1/2) >= 8) = 0.395 is not.
    assert (again["flights"], again["refuting"]) == (14, 9)
    assert again["outside"] < 9
    assert outside["outside"] == 14
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


@pytest.mark.slow
def test_workers_fly_what_is_learned_and_counted(tmp_path):
    still = write_campaign(tmp_path, runs=20, law=False, wind="")
    options = ("--epsilon", 0.5, "--confidence", 0.75, "--workers", 1)

    said = answer("conform", still, *options, "--out", tmp_path / "boxes.json")
    assert "0.05 times the widest" in said["notes"][0]
    again = answer("conform", still, "--recount", tmp_path / "boxes.json", "--workers", 1)

    assert said["training"] == 10  # 20 runs are 10 draws of two gain sets
    assert said["flights"] == 14
    assert said["outside"] <= 5  # fewer where flights have equal scores
    written = load_conformance(said["out"])
    assert written.distribution.air == "calm"
    assert said["boxes"]["low"] == written.boxes.low.tolist()
    assert (again["flights"], again["refuting"]) == (14, 9)
