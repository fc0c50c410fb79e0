"""Aircraft off the nominal and sensors that err, through everything that takes a scenario."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

NOMINAL, HEAVY = "jsbsim:aerosonde", "jsbsim:aerosonde:heavy_aft"

PAGE = (Path(__file__).parents[1] / "docs" / "off_nominal.md").read_text(encoding="utf-8")
HALF_OF_THE_LAST_DIGIT = 0.0051


@pytest.fixture(scope="module")
def tables():
    """Four seconds of the shipped scenario."""
    tables = ft.load_scenario("heavy_and_aft").as_dict() | {"gains": ["paper", "K1"], "expect": []}
    tables["flight"]["duration_s"] = 4.0
    return tables


@pytest.fixture(scope="module")
def flown(tables):
    return ft.fly(ft.scenario_from(tables))


def test_both_fly_their_own_flight_and_the_nominal_one_to_the_same_bits(tables, flown):
    alone = ft.fly(ft.scenario_from(tables | {"plant": tables["plant"][:1]})).runs
    labels = [f"{plant} / {name}" for plant in (NOMINAL, HEAVY) for name in ("paper", "K1")]

    assert [run.label for run in flown.runs] == labels
    for usual, run, heavy in zip(alone, flown.runs, flown.runs[2:], strict=False):
        assert np.array_equal(run.signals, usual.signals)
        throttle = [one.signals["throttle"].iloc[0] for one in (run, heavy)]
        assert throttle[1] > 1.05 * throttle[0]  # a climb at 45 deg, 10 % more weight


def test_expectations_are_of_the_plant_of_that_label(tables):
    limits = {"gains": "paper", "at_most": {"chi": {"ITAE": 1e-6}}}
    for label in (NOMINAL, HEAVY):
        expecting = tables | {"gains": ["paper"], "expect": [limits | {"plant": label}]}
        missed = ft.fly(ft.scenario_from(expecting)).claim.missed
        assert {name.partition(" / ")[0] for name in missed} == {label}
    with pytest.raises(ft.ScenarioError, match=rf"`plant` of .* {NOMINAL}, {HEAVY}, .*h"):
        ft.scenario_from(tables | {"expect": [limits | {"plant": "h"}]})


def test_names_that_letters_do_not_tell_apart_have_files_of_their_own(tables, tmp_path):
    plants = [tables["plant"][0] | {"name": name} for name in ("a*", "a_")]
    flown = ft.fly(ft.scenario_from(tables | {"plant": plants, "gains": ["paper"]}))

    files = ft.record(flown, tmp_path)

    assert len({*files.signals.values()}) == len(list(tmp_path.glob("*.parquet"))) == 2
    assert [run.label for run in ft.load(files.recording).runs] == [*files.signals]


@pytest.mark.slow
def test_the_numbers_of_the_page_are_what_the_shipped_scenario_flies():
    flown = ft.fly(ft.load_scenario("heavy_and_aft"))
    sentence = PAGE.partition("With the paper's gains")[2].partition("\n\n")[0]
    told = [float(number) for number in re.findall(r"\d+\.\d+", sentence)]

    measured = [
        flown.metrics.loc[(f"{plant} / {gains}", "gamma")]["ITAE"]
        for gains in ("paper", "tuned_identified")
        for plant in (NOMINAL, HEAVY)
    ]
    assert told == pytest.approx(measured, abs=HALF_OF_THE_LAST_DIGIT)


NOISE = {"chi_noise_sd_deg": 0.3, "gamma_noise_sd_deg": 0.2, "V_a_noise_sd_mps": 0.3}
EXAMPLE = {
    "seed": 1,
    "gains": ["tuned_identified"],
    "flight": {"duration_s": 30.0},
    "reference": {"chi_deg": 60.0, "gamma_deg": 5.0},
    "limits": {"phi_deg": [-45.0, 45.0]},
    "controller": {"feed_forward": True},
    "sensors": NOISE | {"chi_bias_deg": 1.0, "noise_time_constant_s": 0.5},
}
FACTORS = {"mass": 1.15, "ixx": 1.1, "drag": 1.2, "thrust": 0.9, "actuator_lag": 1.5}
OFF = {f"{name}_factor": factor for name, factor in FACTORS.items()} | {
    "cg_aft_m": 0.005,
    "coefficient_factors": {"Cm_alpha": 0.8, "Cl_p": 0.9},
}
SIX = {"duration_s": 6.0}
SENSED = ["chi", "gamma", "V_a"]
AIRCRAFT = {"kind": "jsbsim", "aircraft": "aerosonde"}
PLANTS = [{"kind": "kinematic"}, AIRCRAFT | {"airframe": OFF}]


def short(plants):
    """Six seconds of the example with the paper's gains."""
    return made_up_scenario(**EXAMPLE | {"gains": ["paper"], "plant": plants, "flight": SIX})


@pytest.fixture(scope="module")
def erring():
    return ft.fly(short(PLANTS))


def test_the_table_of_the_page_is_a_plant_of_a_scenario():
    (table, *_) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)

    (plant,) = made_up_scenario(**EXAMPLE | tomllib.loads(table)).plant

    assert plant.airframe.mass_factor == 1.1
    assert plant.label == "jsbsim:aerosonde:heavy_aft"


@pytest.mark.soak
def test_the_example_comes_to_what_it_expects():
    # The bias remains as error: the loop cannot see it.
    most, least = {"chi": {"MS_deg": 1.2}, "gamma": {"MS_deg": 0.2}}, {"chi": {"MS_deg": 0.8}}
    expect = [{"at_most": most, "at_least": least}]
    flown = ft.fly(made_up_scenario(**EXAMPLE, plant=PLANTS, expect=expect))

    assert [run.status for run in flown.runs] == ["completed", "completed"]
    assert flown.claim.missed == ()


def errors_seen(run):
    seen = [f"{name}_meas" for name in SENSED]
    return run.signals[seen].to_numpy() - run.signals[SENSED].to_numpy()


def test_every_plant_and_every_aircraft_has_the_same_errors_and_its_own_flight(erring):
    kinematic, off = erring.runs
    (usual,) = ft.fly(short([AIRCRAFT])).runs

    for run in (off, usual):
        assert errors_seen(run) == pytest.approx(errors_seen(kinematic), abs=1e-12)
    throttle, usual_throttle = (run.signals["throttle"].iloc[0] for run in (off, usual))
    assert throttle * 0.9 > 1.15 * usual_throttle  # 20 % more drag, 15 % more weight, thrust 0.9


@pytest.mark.slow
def test_the_gap_is_explained_through_the_same_sensors_on_every_rung():
    gap = ft.gap(short(PLANTS), ft.PAPER_GAINS)

    assert gap.status == "explained"
    assert gap.residual < 1e-9
    for run in gap.runs[1:]:
        assert errors_seen(run) == pytest.approx(errors_seen(gap.runs[0]), abs=1e-12)
