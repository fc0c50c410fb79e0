"""A flight off the nominal with sensors that err, through everything that takes a scenario."""

import re
from pathlib import Path

import pytest

import flighttune as ft
from flighttune.plants.sensors import MEASURED, SENSED

PAGE = (Path(__file__).parents[1] / "docs" / "off_nominal.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    (text,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    path = tmp_path_factory.mktemp("docs") / "example.toml"
    path.write_text(text, encoding="utf-8")
    return ft.load_scenario(path)


@pytest.fixture(scope="module")
def short(example):
    tables = example.as_dict() | {"gains": ["paper"], "expect": []}
    tables["flight"]["duration_s"] = 6.0
    return tables


@pytest.fixture(scope="module")
def flown(short):
    return ft.fly(ft.scenario_from(short))


def test_the_example_of_the_page_comes_to_what_it_expects(example):
    flown = ft.fly(example)

    assert [run.status for run in flown.runs] == ["completed", "completed"]
    assert flown.claim.missed == ()


def errors_seen(run):
    return run.signals[[*MEASURED]].to_numpy() - run.signals[[*SENSED]].to_numpy()


def test_every_plant_and_every_aircraft_has_the_same_errors_and_its_own_flight(short, flown):
    nominal = ft.fly(
        ft.scenario_from(short | {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}]})
    )
    kinematic, off = flown.runs
    (usual,) = nominal.runs

    for run in (off, usual):
        assert errors_seen(run) == pytest.approx(errors_seen(kinematic), abs=1e-12)
    throttle, usual_throttle = (run.signals["throttle"].iloc[0] for run in (off, usual))
    assert throttle * 0.9 > 1.15 * usual_throttle  # 20 % more drag, 15 % more weight, thrust 0.9


def test_the_gap_is_explained_through_the_same_sensors_on_every_rung(short):
    gap = ft.gap(ft.scenario_from(short), ft.PAPER_GAINS)

    assert gap.status == "explained"
    assert gap.residual < 1e-9
    for run in gap.runs[1:]:
        assert errors_seen(run) == pytest.approx(errors_seen(gap.runs[0]), abs=1e-12)
