"""An aircraft's tube: its conformant model under every disturbance in the boxes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import flown_here
from dispersed import uniform
from fuzzing import first_or_all
from made_up import scenario_file

import flighttune as ft
from flighttune.campaign import band as band_module
from flighttune.tubes.enclosure import load_tube
from flighttune.tubes.tube import flights_inside
from tests.campaign.test_band import ALONE, count
from tests.commands import flighttune
from tests.made_up_band import ROLL, WIDE, counted_boxes
from tests.tubes.test_proof import arrays_of, claim_of, rewritten
from tests.tubes.test_soundness import made_up, tube


def flight(**changes):
    values = {"feed_forward": False, "chi_err_deg": 4.0, "gamma_deg": 0.0, "gamma_ref_deg": 0.0}
    scenario = made_up(**{**values, **changes}).as_dict()
    scenario["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    return ft.scenario_from(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("feed_forward", first_or_all([True, False]))
def test_the_aircraft_flies_inside_its_tube_which_is_proven_again(tmp_path, feed_forward):
    scenario = flight(feed_forward=feed_forward)

    found = tube(scenario, ft.PAPER_GAINS, band=counted_boxes(scenario))

    assert found.status == "bounded"
    assert flights_inside(found)
    assert "probability at most 0.05" in found.problem.model
    found.save(tmp_path / "tube.npz")
    assert ft.verify(tmp_path / "tube.npz").valid


@pytest.mark.slow
def test_a_set_that_is_lost_bounds_no_flight(tmp_path):
    """At the ends of its boxes the rates are those of a tight turn."""
    scenario = flight(duration_s=1.5)
    boxes = counted_boxes(scenario, half_width=1.0)
    lost = tube(scenario, ft.PAPER_GAINS, band=boxes)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    boxes.save(tmp_path / "boxes.npz")

    stdout, stderr = flighttune(
        "tube", path, "--gains", "paper", "--boxes", tmp_path / "boxes.npz", "--out",
        tmp_path / "tube.npz", status=1,
    )  # fmt: skip

    assert (lost.status, lost.probability) == ("unbounded", None)
    assert 0 < len(lost.bounds.t) < len(lost.problem.t)
    with pytest.raises(ft.InputError, match="must be bounded"):
        lost.save(tmp_path / "tube.npz")
    assert lost.reason in stderr
    assert "`flighttune band` bounds such flights" in stdout
    assert "leaves the tube with" not in stdout
    assert not (tmp_path / "tube.npz").exists()


@pytest.mark.slow
def test_in_wind_the_start_must_be_stated():
    calm = flight(duration_s=0.3)
    windy = ft.scenario_from(calm.as_dict() | {"wind": {"speed_mps": 3.0, "from_deg": 90.0}})
    boxes = counted_boxes(windy, half_width=10.0 * WIDE)

    assert tube(windy, ft.PAPER_GAINS, band=boxes).status == "bounded"
    with pytest.raises(ft.InputError, match="`wind` must be stated"):
        tube(calm, ft.PAPER_GAINS, band=boxes)


@pytest.mark.slow
def test_starts_are_those_of_the_boxes():
    scenario = flight(duration_s=0.3)
    known = counted_boxes(scenario)
    starts = uniform("flight.chi_deg", 2.0, 7.0), uniform("flight.gamma_deg", -3.0, 3.0)
    wider = counted_boxes(scenario, WIDE, ROLL, *starts)

    with pytest.raises(ft.InputError, match=r"`start`.* 0 deg.*`flight.chi_deg`"):
        tube(scenario, ft.PAPER_GAINS, band=known, start=0.01)
    assert tube(scenario, ft.PAPER_GAINS, band=wider, start=0.03).status == "bounded"
    with pytest.raises(ft.InputError, match=r"`start`.* 2 deg.*2.292 deg"):
        tube(scenario, ft.PAPER_GAINS, band=wider, start=0.04)


def test_what_the_boxes_say_nothing_about_is_refused():
    scenario = flight()
    known = counted_boxes(scenario)
    other = ft.PIGains(K_P=2.0 * ft.PAPER_GAINS.K_P, K_I=ft.PAPER_GAINS.K_I)

    with pytest.raises(ft.InputError, match=r"`K_P`.*paper"):
        tube(scenario, other, band=known)
    with pytest.raises(ft.InputError, match=r"`flight.chi_deg`.*4.0.*5.0"):
        tube(flight(chi_err_deg=5.0), ft.PAPER_GAINS, band=known)
    with pytest.raises(ft.InputError, match="`disturbance` must not be given"):
        tube(scenario, ft.PAPER_GAINS, band=known, disturbance=0.1)
    with pytest.raises(ft.InputError, match="`boxes` must be given"):
        tube(scenario, ft.PAPER_GAINS, plant="jsbsim:aerosonde")
    scheduled = scenario.as_dict()
    scheduled["controller"]["schedule"] = True
    with pytest.raises(ft.InputError, match=r"`schedule`.*false"):
        tube(ft.scenario_from(scheduled), ft.PAPER_GAINS, band=known)
    with pytest.raises(ft.InputError, match="of kind jsbsim"):
        tube(made_up(), ft.PAPER_GAINS, band=known)


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    """The file of a tube, and that of the band its boxes come from."""
    scenario = flight(duration_s=0.3, feed_forward=True)
    folder = tmp_path_factory.mktemp("proof")
    boxes = counted_boxes(scenario)
    boxes.save(folder / "boxes.npz")
    tube(scenario, ft.PAPER_GAINS, band=boxes).save(folder / "tube.npz")
    return folder / "tube.npz", folder / "boxes.npz"


UNCHECKED = "that an aircraft keeps the boxes in the file is not checked"


@pytest.mark.slow
def test_without_its_band_a_tube_is_proven_for_the_boxes_in_the_file_alone(proof):
    stdout, _ = flighttune("verify", proof[0])
    found, _ = flighttune("verify", proof[0], "--json")

    assert UNCHECKED in " ".join(stdout.split())
    assert not re.search("probability|confidence|259|made up.*drawn", stdout)
    found = json.loads(found)
    assert (found["valid"], found["claim"]["aircraft_checked"]) == (True, False)
    assert found["claim"]["counted"] is None
    assert "probability" not in found["claim"]["model"]


@pytest.mark.slow
def test_boxes_whose_flights_are_made_up_are_refused_with_the_tube(proof):
    stdout, stderr = flighttune("verify", proof[0], "--boxes", proof[1], status=1)

    assert "claimed, not proven" in stdout
    assert "flights of the band that are flown again must be equal to the bit" in stderr
    with pytest.raises(ft.InputError, match="`boxes` must be given"):
        ft.verify(ft.load(proof[1]), boxes=proof[1])


@pytest.mark.slow
def test_with_its_band_boxes_are_rebuilt_and_flown_again(tmp_path):
    scenario = flight(duration_s=0.3, feed_forward=True)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    boxes = count(path, kind=ft.residual, flights=ALONE, start_deg=1.0, gains="paper")
    found = tube(scenario, ft.PAPER_GAINS, band=boxes)
    found.save(tmp_path / "tube.npz")
    narrow = replace(boxes, extremes=np.float32(0.01) * boxes.extremes)

    with flown_here(band_module) as pool:
        verified = ft.verify(tmp_path / "tube.npz", boxes=boxes, pool=pool)
        forged = ft.verify(tube(scenario, ft.PAPER_GAINS, band=narrow), pool=pool)

    assert verified.valid
    assert verified.checks
    assert verified.claim.problem.aircraft_checked is True
    assert "All 10 flights learned from were flown again" in verified.verification.notes[0]
    assert not forged.valid


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "claim", "name"),
    [(0.1, {}, "boxes"), (1.0, {"band_sha256": "0" * 64}, "band_sha256")],
)
def test_boxes_other_than_those_counted_are_refused(proof, tmp_path, factor, claim, name):
    boxes = {"boxes": factor * arrays_of(proof[0])["boxes"]}
    path = rewritten(proof[0], boxes, tmp_path / "forged.npz", **claim)

    assert load_tube(path).problem.aircraft_checked is False
    with pytest.raises(ft.InputError, match=rf"forged\.npz: `{name}` must"):
        load_tube(path, ft.load(proof[1]))


@pytest.mark.slow
def test_boxes_and_an_aircraft_go_together(proof, tmp_path):
    path = rewritten(proof[0], {"boxes": None}, tmp_path / "forged.npz", band_sha256=None)
    with pytest.raises(ft.InputError, match="`boxes` must be given"):
        load_tube(path)

    scenario = {**claim_of(proof[0])["scenario"], "plant": [{"kind": "kinematic"}]}
    rewritten(proof[0], {}, path, scenario=scenario, plant="kinematic")
    with pytest.raises(ft.InputError, match=r"`boxes`.*kinematic"):
        load_tube(path)


@pytest.mark.slow
def test_of_a_tube_that_a_flight_leaves_no_file_is_written(tmp_path):
    scenario = flight(duration_s=0.6)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    # The aircraft leaves boxes that are this narrow, and so does its flight their tube.
    counted_boxes(scenario, half_width=1e-7).save(tmp_path / "boxes.npz")
    options = "--gains", "paper", "--boxes", tmp_path / "boxes.npz"

    stdout, stderr = flighttune(
        "tube", path, *options, "--out", tmp_path / "tube.npz", "--json", status=1
    )

    assert json.loads(stdout)["inside"] is False
    assert "a flight leaves the tube" in stderr
    assert not list(tmp_path.glob("tube.*"))
