"""A nominal and an off-nominal aircraft in one scenario, through everything that names a plant."""

import re
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft
from flighttune.recording.entities import runs_to_draw

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


@pytest.fixture(scope="module")
def folder(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("named") / "both"
    ft.record(flown, folder)
    return folder


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


def test_recording_and_files_keep_them_apart_in_the_order_of_the_scenario(flown, folder):
    labels = [run.label for run in flown.runs]
    stems = [re.sub("[:]", "_", label).replace(" / ", "-") for label in labels]
    assert sorted(path.stem for path in folder.glob("*.parquet")) == sorted(stems)
    keys = [re.sub("[^A-Za-z0-9]+", "_", label) for label in labels]
    assert [member.key for member in runs_to_draw(flown.runs)] == keys
    again = ft.load(folder).runs
    assert [run.label for run in again] == labels
    assert ft.refly(again).equal


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
        factor * flown.metrics.loc[(f"{plant} / {gains}", "gamma")][name]
        for gains in ("paper", "tuned_identified")
        for name, factor in (("ITAE", 1.0), ("ST_rad", np.rad2deg(1.0)))
        for plant in (NOMINAL, HEAVY)
    ]
    # both deviations of the last gains stand there once
    assert told[-1] == pytest.approx(measured[-1], abs=HALF_OF_THE_LAST_DIGIT)
    assert told == pytest.approx(measured[:-1], abs=HALF_OF_THE_LAST_DIGIT)
