"""An aircraft's tube: its conformant model under every disturbance in the boxes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from flighttune.aircraft.aircraft import files_hash
from flighttune.conformance import (
    Conformance,
    ConformantModel,
    RateBoxes,
    Windows,
    load_conformance,
    save_conformance,
)
from flighttune.conformance.file import Attempt, Distribution, conformance_tables, flown_values
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.errors import InputError
from flighttune.identify.file import load_identified
from flighttune.scenario import scenario_from
from flighttune.seal import BLANK, seal
from flighttune.table_file import toml_text
from flighttune.tube.hand_over import HandOver
from flighttune.tube.problem import tube_problem
from flighttune.tube.proof import load_tube, save_tube, verify_tube
from flighttune.tube.tube import flights_inside
from tests.commands import flighttune
from tests.tube.test_proof import arrays_of, claim_of, rewritten
from tests.tube.test_soundness import made_up, tube

WIDE = 0.05
"""Half width of the boxes, rad/s: the Aerosonde leaves over a tenth of it in gentle flight."""

ROLL, ROLL_CHANGE = 0.02, 0.002
"""Half widths, rad: its roll is off that of its model by up to 0.75 deg, 0.04 deg more a sample."""


ERROR = 0.5, 0.3
"""Half widths, rad: no error is as large."""


def flight(**changes):
    values = {"feed_forward": False, "chi_err_deg": 4.0, "gamma_deg": 0.0, "gamma_ref_deg": 0.0}
    scenario = made_up(**{**values, **changes}).as_dict()
    scenario["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    return scenario_from(scenario)


def conformance(scenario, outside=0, half_width=WIDE, roll=ROLL):
    condition = load_identified("aerosonde").nearest(scenario.flight.V_a_mps, 0.0)
    windows = Windows.covering("time", scenario.flight.duration_s)
    high = np.tile([half_width, half_width, roll, ROLL_CHANGE, *ERROR], (windows.count, 1))
    return Conformance(
        aircraft="aerosonde",
        gains_name="paper",
        gains=PAPER_GAINS,
        model=ConformantModel(
            V_a=scenario.flight.V_a_mps, g=scenario.flight.g_mps2, lags=condition.lags
        ),
        boxes=RateBoxes(windows=windows, low=-high, high=high),
        epsilon=0.01,
        confidence=0.999,
        planned=3,
        attempts=(Attempt(learned=(0, 10), counted=(10, 807), outside=outside),),
        seed=1,
        distribution=Distribution(
            title="made up",
            air="calm",
            fixed=flown_values(scenario, scenario.plant[0]),
            dispersed={},
            disperse=[],
            correlation=[],
        ),
        aircraft_sha256=files_hash("aerosonde"),
        identified_sha256="",
        campaign_sha256="",
    )


@pytest.mark.slow
@pytest.mark.parametrize("feed_forward", [False, True])
def test_the_aircraft_flies_inside_its_tube_which_is_proven_again(tmp_path, feed_forward):
    scenario = flight(feed_forward=feed_forward)

    found = tube(scenario, PAPER_GAINS, conformance=conformance(scenario))

    assert found.status == "bounded"
    assert flights_inside(found)
    assert "probability at most 0.01" in found.problem.model
    save_tube(found, tmp_path / "tube.npz")
    assert verify_tube(tmp_path / "tube.npz").valid


@pytest.fixture(scope="module")
def lost():
    """A tube whose set is lost: at the ends of its boxes the rates are those of a tight turn."""
    scenario = flight(duration_s=1.5)
    return tube(scenario, PAPER_GAINS, conformance=conformance(scenario, half_width=1.0))


@pytest.mark.slow
def test_where_the_set_is_lost_errors_are_within_those_counted(lost, tmp_path):
    assert lost.status == "bounded"
    assert 0 < lost.lost < len(lost.bounds.t) - 1
    assert lost.counted_from == lost.bounds.t[lost.lost]
    assert f"from t = {lost.counted_from:.2f} s on" in lost.reason
    assert lost.bounds.half_widths[lost.lost :, :2] == pytest.approx(
        np.tile(ERROR, (len(lost.bounds.t) - lost.lost, 1))
    )
    assert (lost.bounds.half_widths[: lost.lost, :2] <= np.array(ERROR)).all()
    assert lost.bounds.half_widths[0, 0] < 0.1 * ERROR[0]
    assert lost.can_limit[lost.lost :].all()
    assert lost.handed_over is None
    assert flights_inside(lost)
    save_tube(lost, tmp_path / "tube.npz")
    again = load_tube(tmp_path / "tube.npz")
    assert again.lost == lost.lost
    assert f"from t = {lost.counted_from:.2f} s on" in again.reason
    assert verify_tube(again).valid


def kept_after(tube):
    """A set larger than any, said to be reached after the set of the flights is lost."""
    n = tube.problem.loop.rows
    large = np.full(n, 1e3)
    bounds = np.tile([-1e3, 1e3], (4, 1))
    return HandOver(
        sample=len(tube.bounds.t) - 1, W=np.eye(n), centre=0.0 * large, size=large, samples=1,
        bounds=bounds, chosen=np.zeros(0, dtype=np.float32),
    )  # fmt: skip


def narrower(bounds):
    return replace(bounds, low=0.99 * bounds.low, high=0.99 * bounds.high)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (lambda one: {"bounds": narrower(one.bounds)}, "sample .*is not proven"),
        (
            lambda one: {"can_limit": one.can_limit & (one.bounds.t < one.bounds.t[-1])[:, None]},
            "no limit holds phi_cmd",
        ),
        (lambda one: {"lost": one.lost + 1}, "sample .*cannot be kept|end early"),
        (lambda one: {"hand_over": kept_after(one)}, "not proven to be reached"),
    ],
)
def test_more_than_was_counted_is_not_proven(lost, changes, why):
    found = verify_tube(replace(lost, **changes(lost)))

    assert not found.valid
    assert re.search(why, found.reason)


@pytest.mark.slow
def test_in_a_wind_that_is_not_stated_the_start_is_not_known():
    calm = flight(duration_s=0.3)
    windy = scenario_from(calm.as_dict() | {"wind": {"speed_mps": 3.0, "from_deg": 90.0}})
    known = conformance(windy, half_width=10.0 * WIDE)

    unknown, stated = (tube(one, PAPER_GAINS, conformance=known) for one in (calm, windy))

    assert stated.counted_from is None
    assert unknown.counted_from == 0.0
    assert "states no wind" in unknown.reason
    assert unknown.bounds.half_widths[:, :2] == pytest.approx(
        np.tile(ERROR, (len(unknown.bounds.t), 1))
    )


def test_turbulence_is_that_of_the_boxes_and_no_other():
    windy = flight(duration_s=0.3).as_dict()
    windy["wind"] = {"speed_mps": 3.0, "from_deg": 90.0}
    windy["turbulence"] = {"intensity": "light"}
    scenario = scenario_from(windy)
    known = conformance(scenario, half_width=10.0 * WIDE)

    assert tube_problem(scenario, PAPER_GAINS, conformance=known).boxes is not None
    windy["turbulence"]["intensity"] = "severe"
    with pytest.raises(InputError, match=r"`turbulence.intensity`.*'light'.*'severe'"):
        tube(scenario_from(windy), PAPER_GAINS, conformance=known)
    with pytest.raises(InputError, match=r"`wind.speed_mps`.*None.*3"):
        tube(scenario, PAPER_GAINS, conformance=conformance(flight(duration_s=0.3)))


@pytest.mark.slow
def test_starts_are_those_of_the_boxes():
    scenario = flight(duration_s=0.3)
    known = conformance(scenario)
    dispersed = {"flight.chi_deg": [2.0, 7.0], "flight.gamma_deg": [-3.0, 3.0]}
    wider = replace(known, distribution=replace(known.distribution, dispersed=dispersed))

    with pytest.raises(InputError, match=r"`start`.* 0 deg.*`flight.chi_deg`"):
        tube(scenario, PAPER_GAINS, conformance=known, start=0.01)
    assert tube(scenario, PAPER_GAINS, conformance=wider, start=0.03).status == "bounded"
    with pytest.raises(InputError, match=r"`start`.* 2 deg.*2.292 deg"):
        tube(scenario, PAPER_GAINS, conformance=wider, start=0.04)


def test_a_list_that_is_too_short_is_refused_by_name(tmp_path):
    path = tmp_path / "boxes.json"
    tables = conformance_tables(conformance(flight()))
    tables["model"]["lags"] = []
    path.write_bytes(seal(json.dumps({**tables, "seal": BLANK}).encode()))

    with pytest.raises(InputError, match=r"boxes\.json: `model\.lags\.0` must be given; "):
        load_conformance(path)


def test_what_the_boxes_say_nothing_about_is_refused():
    scenario = flight()
    known = conformance(scenario)
    other = PIGains(K_P=2.0 * PAPER_GAINS.K_P, K_I=PAPER_GAINS.K_I)

    with pytest.raises(InputError, match=r"`K_P`.*paper"):
        tube(scenario, other, conformance=known)
    with pytest.raises(InputError, match=r"`flight.chi_deg`.*4.0.*5.0"):
        tube(flight(chi_err_deg=5.0), PAPER_GAINS, conformance=known)
    with pytest.raises(InputError, match="conformance: must hold"):
        tube(scenario, PAPER_GAINS, conformance=conformance(scenario, outside=2))
    with pytest.raises(InputError, match="`disturbance` must not be given"):
        tube(scenario, PAPER_GAINS, conformance=known, disturbance=0.1)
    with pytest.raises(InputError, match="`conformance` must be given"):
        tube(scenario, PAPER_GAINS, plant="jsbsim:aerosonde")
    scheduled = scenario.as_dict()
    scheduled["controller"]["schedule"] = True
    with pytest.raises(InputError, match=r"`schedule`.*false"):
        tube(scenario_from(scheduled), PAPER_GAINS, conformance=known)
    with pytest.raises(InputError, match="of kind jsbsim"):
        tube(made_up(), PAPER_GAINS, conformance=known)


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    """The file of a tube, and that of the conformance its boxes come from."""
    scenario = flight(duration_s=0.3, feed_forward=True)
    folder = tmp_path_factory.mktemp("proof")
    boxes = conformance(scenario)
    save_conformance(boxes, folder / "boxes.json")
    save_tube(tube(scenario, PAPER_GAINS, conformance=boxes), folder / "tube.npz")
    return folder / "tube.npz", folder / "boxes.json"


UNCHECKED = "for the boxes in the file; that an aircraft keeps them is not checked here"


@pytest.mark.slow
def test_without_its_conformance_a_tube_is_proven_for_the_boxes_in_the_file_alone(proof):
    stdout, _ = flighttune("verify", proof[0])
    found, _ = flighttune("verify", proof[0], "--json")

    assert UNCHECKED in stdout
    assert not re.search("probability|confidence|797|made up.*drawn", stdout)
    found = json.loads(found)
    assert (found["valid"], found["aircraft_checked"]) == (True, False)
    assert found["claim"]["counted"] is None
    assert "probability" not in found["claim"]["model"]


@pytest.mark.slow
def test_with_its_conformance_boxes_are_rebuilt_and_what_was_counted_is_said(proof):
    stdout, _ = flighttune("verify", proof[0], "--conformance", proof[1])
    found, _ = flighttune("verify", proof[0], "--conformance", proof[1], "--json")

    assert UNCHECKED not in stdout
    assert "of 797 flights not used, none left the boxes" in stdout
    found = json.loads(found)
    assert (found["valid"], found["aircraft_checked"]) == (True, True)
    assert "at most 0.01, confidence 0.999" in found["claim"]["counted"]
    assert found["claim"]["disturbance_rad_s"] == [2 * [-WIDE], 2 * [WIDE]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "claim", "name"),
    [
        (0.1, {}, "boxes"),
        (1.0, {"start_known": False}, "start_known"),
        (1.0, {"conformance_sha256": "0" * 64}, "conformance_sha256"),
    ],
)
def test_boxes_other_than_those_counted_are_refused(proof, tmp_path, factor, claim, name):
    boxes = {"boxes": factor * arrays_of(proof[0])["boxes"]}
    path = rewritten(proof[0], boxes, tmp_path / "forged.npz", **claim)

    assert load_tube(path).problem.aircraft_checked is False
    with pytest.raises(InputError, match=rf"forged\.npz: `{name}` must"):
        load_tube(path, load_conformance(proof[1]))


@pytest.mark.slow
def test_boxes_and_an_aircraft_go_together(proof, tmp_path):
    path = rewritten(proof[0], {"boxes": None}, tmp_path / "forged.npz", conformance_sha256=None)
    with pytest.raises(InputError, match="`conformance` must be given"):
        load_tube(path)

    scenario = {**claim_of(proof[0])["scenario"], "plant": [{"kind": "kinematic"}]}
    rewritten(proof[0], {}, path, scenario=scenario, plant="kinematic")
    with pytest.raises(InputError, match=r"`boxes`.*kinematic"):
        load_tube(path)


@pytest.mark.slow
def test_of_a_tube_that_a_flight_leaves_no_file_is_written(tmp_path):
    scenario = flight(duration_s=0.6)
    path = tmp_path / "flight.toml"
    path.write_text(toml_text(scenario.as_dict()))
    # The aircraft leaves boxes that are this narrow, and so does its flight their tube.
    save_conformance(conformance(scenario, half_width=1e-7), tmp_path / "boxes.json")
    options = "--gains", "paper", "--conformance", tmp_path / "boxes.json"

    stdout, stderr = flighttune(
        "tube", path, *options, "--out", tmp_path / "tube.npz", "--json", status=1
    )
    _, said = flighttune("fly", path, "--tube", *options[2:], "--out", tmp_path / "runs", status=1)

    assert json.loads(stdout)["inside"] is False
    assert "a flight leaves the tube" in stderr
    assert not list(tmp_path.glob("tube.*"))
    assert "jsbsim:aerosonde / paper: the flight leaves its tube" in said
    assert not list((tmp_path / "runs").glob("tubes/*"))
