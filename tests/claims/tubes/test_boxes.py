"""An aircraft's tube and the boxes that it is about: of its files, its wind and its flights."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import flighttune
from forging import changed
from made_up import scenario_file
from made_up_band import WIDE, counted_boxes
from made_up_tubes import aircraft_scenario, tube, tube_scenario

import flighttune as ft


@pytest.mark.slow
def test_in_wind_the_start_must_be_stated():
    calm = aircraft_scenario(duration_s=0.1)
    windy = ft.scenario_from(calm.as_dict() | {"wind": {"speed_mps": 3.0, "from_deg": 90.0}})
    boxes = counted_boxes(windy, half_width=10.0 * WIDE)

    assert tube(windy, ft.PAPER_GAINS, band=boxes, for_ever=False).status == "bounded"
    with pytest.raises(ft.InputError, match="`wind` must be stated"):
        tube(calm, ft.PAPER_GAINS, band=boxes)


def test_boxes_are_of_the_aircraft_that_was_counted_with_the_files_it_has():
    known = counted_boxes(aircraft_scenario(duration_s=0.1))
    other = aircraft_scenario().as_dict() | {"plant": [{"kind": "jsbsim", "aircraft": "c172p"}]}
    files = dict.fromkeys(known.flights.aircraft, "0" * 64)
    others = replace(known, flights=replace(known.flights, aircraft=files))

    words = "`aircraft` must be aerosonde with the files it was flown with, got"
    with pytest.raises(ft.InputError, match=f"{words} c172p"):
        tube(ft.scenario_from(other), ft.PAPER_GAINS, band=known)
    with pytest.raises(ft.InputError, match=f"{words} aerosonde"):
        tube(aircraft_scenario(), ft.PAPER_GAINS, band=others)


@pytest.mark.slow
def test_flights_outside_their_boxes_are_against_the_boxes_and_not_against_the_tube(tmp_path):
    scenario = aircraft_scenario(duration_s=0.3, ramp_dps=1.0)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    # The aircraft leaves boxes that are this narrow.
    counted_boxes(scenario, half_width=1e-7).save(tmp_path / "boxes.npz")
    options = "--gains", "paper", "--boxes", tmp_path / "boxes.npz"

    stdout, stderr = flighttune(
        "tube", path, *options, "--out", tmp_path / "tube.npz", "--json", status=1
    )

    found = json.loads(stdout)
    assert (found["inside"], found["flown"]["outside_boxes"]) == (True, 1)
    assert "boxes" in stderr
    assert "tube, so it is wrong" not in stderr
    assert not list(tmp_path.glob("tube.*"))


@pytest.mark.slow
def test_a_feasible_reference_in_the_file_must_be_that_of_the_scenario(tmp_path):
    tables = tube_scenario(chi_err_deg=4.0, gamma_deg=0.0, gamma_ref_deg=0.0).as_dict()
    tables["reference"]["shape"] = "feasible"
    tables["flight"]["duration_s"] = 1.0
    path = tmp_path / "tube.npz"
    found = tube(ft.scenario_from(tables), ft.PAPER_GAINS, for_ever=False)
    found.save(path)

    def with_reference(name, by):
        made = found.problem.reference + by
        return ft.load(changed(path, tmp_path / name, reference=np.asarray(made)))

    with_reference("near.npz", 1e-9)
    assert ft.verify(path).valid
    with pytest.raises(ft.InputError, match=r"far\.npz: `reference`.*1e-05"):
        with_reference("far.npz", 1e-5)
