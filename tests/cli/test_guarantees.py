"""Certificates, frontiers and units of state as commands and their verbs give them."""

import pytest
from commands import answer, flighttune
from made_up_band import counted_boxes

import flighttune as ft


@pytest.mark.soak
def test_tune_and_certify_say_their_units_of_state_and_agree_in_the_same_ones():
    tables = ft.load_scenario("paper_identified").as_dict()
    tables["tuning"] = {"model": "identified", "identified": "aerosonde"}
    scenario = ft.scenario_from(tables)

    scaled = ft.tune(scenario)
    certified = ft.certify(scenario, "tuned").answer().values

    assert set(certified["scaling"]) == {1.0} != set(scaled.problem.scaling)
    assert list(certified["scaled"]["scaling"]) == list(scaled.problem.scaling)
    assert certified["scaled"]["R_K"] == pytest.approx(scaled.R_K)
    assert ft.certify("paper").answer().values["scaled"] is None
    assert scaled.answer().notes[0].startswith("units of state: scaled")
    assert ft.tune("paper").answer().notes == ["units of state: plain, as in `certify`"]


def test_verify_takes_the_workers_of_the_command_line(tmp_path):
    file = tmp_path / "certificate.json"
    ft.certify("paper", "paper").certificate.save(file)

    both = ("--workers", 1, "--scheduler", "tcp://127.0.0.1:1")
    assert "`workers` must not be given" in flighttune(*both, "verify", file, status=2)[1]
    assert answer("--workers", 1, "verify", file)["valid"]


@pytest.mark.slow
def test_flights_of_any_count_fly_again_on_the_workers_of_the_command_line(tmp_path):
    file = tmp_path / "residual.npz"
    tables = ft.load_scenario("feasible").as_dict() | {"expect": []}
    counted_boxes(ft.scenario_from(tables)).save(file)

    both = ("--workers", 1, "--scheduler", "tcp://127.0.0.1:1")
    _, told = flighttune(*both, "verify", file, "--run", 20, status=2)
    assert "`workers` must not be given" in told


def test_a_long_reason_keeps_its_beginning_and_its_end_in_one_line():
    _, whole = flighttune("fly", "paper", "--set", "=" + "x" * 500, status=2)
    _, cut = flighttune("fly", "paper", "--set", "=" + "x" * 5000, status=2)

    assert "x" * 500 in whole
    begin, end = cut.removeprefix("flighttune: ").rstrip("\n").split(" ... ")
    assert (len(begin), len(end)) == (340, 340)
    assert whole.removeprefix("flighttune: ").startswith(begin[:40])
    assert whole.rstrip("\n").endswith(end[-3:])
