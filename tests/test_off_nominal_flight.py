"""A flight off the nominal with sensors that err, through everything that takes a scenario."""

import re
import tomllib
from pathlib import Path

import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.plants.sensors import MEASURED, SENSED

PAGE = (Path(__file__).parents[1] / "docs" / "off_nominal.md").read_text(encoding="utf-8")
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
AIRCRAFT = {"kind": "jsbsim", "aircraft": "aerosonde"}
PLANTS = [{"kind": "kinematic"}, AIRCRAFT | {"airframe": OFF}]


def short(plants):
    """Six seconds of the example with the paper's gains."""
    return made_up_scenario(**EXAMPLE | {"gains": ["paper"], "plant": plants, "flight": SIX})


@pytest.fixture(scope="module")
def flown():
    return ft.fly(short(PLANTS))


def test_the_table_of_the_page_is_a_plant_of_a_scenario():
    (table, *_) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)

    (plant,) = made_up_scenario(**EXAMPLE | tomllib.loads(table)).plant

    assert plant.airframe.mass_factor == 1.1
    assert plant.label == "jsbsim:aerosonde:heavy_aft"


def test_the_example_comes_to_what_it_expects():
    # The bias remains as error: the loop cannot see it.
    most, least = {"chi": {"MS_deg": 1.2}, "gamma": {"MS_deg": 0.2}}, {"chi": {"MS_deg": 0.8}}
    flown = ft.fly(
        made_up_scenario(**EXAMPLE, plant=PLANTS, expect=[{"at_most": most, "at_least": least}])
    )

    assert [run.status for run in flown.runs] == ["completed", "completed"]
    assert flown.claim.missed == ()


def errors_seen(run):
    return run.signals[[*MEASURED]].to_numpy() - run.signals[[*SENSED]].to_numpy()


def test_every_plant_and_every_aircraft_has_the_same_errors_and_its_own_flight(flown):
    kinematic, off = flown.runs
    (usual,) = ft.fly(short([AIRCRAFT])).runs

    for run in (off, usual):
        assert errors_seen(run) == pytest.approx(errors_seen(kinematic), abs=1e-12)
    throttle, usual_throttle = (run.signals["throttle"].iloc[0] for run in (off, usual))
    assert throttle * 0.9 > 1.15 * usual_throttle  # 20 % more drag, 15 % more weight, thrust 0.9


def test_the_gap_is_explained_through_the_same_sensors_on_every_rung():
    gap = ft.gap(short(PLANTS), ft.PAPER_GAINS)

    assert gap.status == "explained"
    assert gap.residual < 1e-9
    for run in gap.runs[1:]:
        assert errors_seen(run) == pytest.approx(errors_seen(gap.runs[0]), abs=1e-12)
