"""A flight off the nominal with sensors that err, through everything that takes a scenario."""

import re
from pathlib import Path

import pytest

import flighttune as ft
from flighttune.plants.sensors import MEASURED, SENSED

PAGE = (Path(__file__).parents[1] / "docs" / "off_nominal.md").read_text(encoding="utf-8")
EXAMPLE = """
title = "A climbing turn in an aircraft heavier than its file says, with sensors that err"
seed  = 1
gains = ["tuned_identified"]

[flight]
V_a_mps    = 25.0
duration_s = 30.0
[reference]
chi_deg   = 60.0
gamma_deg = 5.0
[limits]
phi_deg = [-45.0, 45.0]
[controller]
feed_forward = true

[sensors]
chi_bias_deg          = 1.0
chi_noise_sd_deg      = 0.3
gamma_noise_sd_deg    = 0.2
V_a_noise_sd_mps      = 0.3
noise_time_constant_s = 0.5

[[plant]]
kind = "kinematic"
[[plant]]
kind     = "jsbsim"
aircraft = "aerosonde"
[plant.airframe]
mass_factor         = 1.15
cg_aft_m            = 0.005
ixx_factor          = 1.1
drag_factor         = 1.2
thrust_factor       = 0.9
actuator_lag_factor = 1.5
coefficient_factors.Cm_alpha = 0.8
coefficient_factors.Cl_p     = 0.9

[[expect]]
at_least.chi.MS_deg = 0.8            # the bias remains as error: the loop cannot see it
at_most.chi.MS_deg  = 1.2
at_most.gamma.MS_deg = 0.2
"""


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    path = tmp_path_factory.mktemp("docs") / "example.toml"
    path.write_text(EXAMPLE, encoding="utf-8")
    return ft.load_scenario(path)


@pytest.fixture(scope="module")
def short(example):
    tables = example.as_dict() | {"gains": ["paper"], "expect": []}
    tables["flight"]["duration_s"] = 6.0
    return tables


@pytest.fixture(scope="module")
def flown(short):
    return ft.fly(ft.scenario_from(short))


def test_the_table_of_the_page_is_a_plant_of_a_scenario(tmp_path):
    (table, *_) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "x.toml").write_text(EXAMPLE.partition("[[plant]]")[0] + table, encoding="utf-8")

    (plant,) = ft.load_scenario(tmp_path / "x.toml").plant

    assert plant.airframe.mass_factor == 1.1
    assert plant.label == "jsbsim:aerosonde:heavy_aft"


def test_the_example_comes_to_what_it_expects(example):
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
