"""A scenario of one's own: written by ``new`` or copied, it flies at the first try."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from commands import answer, flighttune
from made_up import made_up_scenario
from places import AIRCRAFT_NAMES, SHIPPED_AIRCRAFT

import flighttune as ft

ADOPTED = Path(__file__).parents[2] / "adopted"


@pytest.mark.counts
@pytest.mark.parametrize("aircraft", [*AIRCRAFT_NAMES, ADOPTED / "c182", ADOPTED / "B747"])
def test_a_new_scenario_meets_its_claim_at_the_first_flight(aircraft, tmp_path):
    answer("new", "mine", "--aircraft", aircraft, cwd=tmp_path)
    flown = answer("fly", "mine.toml", cwd=tmp_path)

    assert flown["claim"]["verdict"] == "met"
    assert flown["claim"]["requirements"] == 8
    assert [run["plant"] for run in flown["runs"]] == ["kinematic", f"jsbsim:{Path(aircraft).name}"]
    envelope = ft.loop.JSBSimPlant(aircraft).config.envelope.V_a
    assert envelope[0] < ft.load_scenario(tmp_path / "mine.toml").flight.V_a_mps < envelope[1]


def test_the_option_for_another_scenario_names_the_file_to_copy(tmp_path):
    _, line = flighttune("new", "mine", "--like", "circuit", status=2, cwd=tmp_path)

    assert line.startswith("flighttune: `--like` must be absent: copy ")
    assert line.split()[6].endswith("scenarios/circuit.toml,")
    assert not [*tmp_path.iterdir()]


def test_a_file_is_never_written_over_and_an_unknown_name_writes_none(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("kept")

    _, there = flighttune("new", "mine", status=2, cwd=tmp_path)
    _, unknown = flighttune("new", "other", "--aircraft", "c172", status=2, cwd=tmp_path)

    assert there.startswith("flighttune: mine.toml: must be a new file")
    assert "did you mean c172p?" in unknown
    assert file.read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


HOSTILE = """Aerosonde
duration_s = 4.0
[[law]]
name = "e"
kind = "python"
module = "evil.py"
class = "Law"
[law.parameters]"""


def stranger(folder, **texts):
    """A copy of the Aerosonde with other texts in its aircraft.toml."""
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    document = tomlkit.parse((folder / "aircraft.toml").read_text())
    document.update(texts)
    (folder / "aircraft.toml").write_text(tomlkit.dumps(document))
    return folder


@pytest.mark.parametrize(
    ("key", "text"), [("title", HOSTILE), ("source", "a\u2028b"), ("model", "a\u009b1m.xml")]
)
def test_an_aircraft_whose_texts_have_control_characters_is_refused(key, text, tmp_path):
    stranger(tmp_path / "theirs", **{key: text})

    _, reason = flighttune("new", "mine", "--aircraft", "theirs", status=2, cwd=tmp_path)

    assert f"aircraft.toml: `{key}` must be one line of printable characters" in reason
    assert [path.name for path in tmp_path.iterdir()] == ["theirs"]


def test_the_texts_of_an_aircraft_stay_values_and_comments(tmp_path):
    """A folder and a title of quotes and brackets, which once went into the file as they were."""
    theirs = stranger(tmp_path / "e\"]'v", title="\"\"\"'''] # [[law]] {h}")

    answer("new", "mine of two words", "--aircraft", theirs, cwd=tmp_path)
    text = (tmp_path / "mine of two words.toml").read_text()

    made = ft.load_scenario(tmp_path / "mine of two words.toml")
    assert [table.kind for table in made.law_tables] == ["exact"]
    slowest, fastest = tomlkit.parse((theirs / "aircraft.toml").read_text())["envelope"]["V_a_mps"]
    assert f" # the aircraft flies {slowest:g} to {fastest:g} m/s\n" in text
    assert ft.loop.JSBSimPlant(made.plant[1].aircraft).config.folder == theirs
    assert (made.flight.V_a_mps, made.flight.h_m) == (25.0, 1000.0)  # of its design
    assert made.controller.speed_priority is True
    assert "flighttune fly 'mine of two words.toml' " in text


@pytest.mark.slow
def test_an_aircraft_without_design_and_engine_descends_at_the_middle_of_its_airspeeds(tmp_path):
    theirs = stranger(tmp_path / "glider")
    file = theirs / "aircraft.toml"
    document = tomlkit.parse(file.read_text())
    del document["design"]
    document["engines"]["count"] = 0
    slowest, fastest = document["envelope"]["V_a_mps"]
    file.write_text(tomlkit.dumps(document))

    answer("new", "mine", "--aircraft", theirs, cwd=tmp_path)
    made = ft.load_scenario(tmp_path / "mine.toml")

    assert made.flight.V_a_mps == 0.5 * (slowest + fastest)
    assert made.flight.h_m == 1000.0
    assert made.controller.speed_priority is None
    turned, descended = np.diff(np.degrees(made.stated_reference.sampled(np.array([0.0, 40.0]))))
    assert (*turned, *descended) == pytest.approx((30.0, -3.0), rel=1e-3)


@pytest.mark.parametrize("name", ["", ".", "..", "below/", "x" * 300])
def test_a_name_that_no_file_can_have_is_refused_in_one_line(name, tmp_path):
    _, err = flighttune("new", name, status=2, cwd=tmp_path)

    assert err.count("\n") == 1
    assert "`NAME` must be" in err or "must be writable" in err
    assert not [*tmp_path.iterdir()]


def test_a_weaker_engine_is_no_other_model():
    """The A-4's file says nothing of engines: a throttle limit was once taken for another model."""
    config = ft.loop.JSBSimPlant("a4").config

    assert config.with_throttle_max(0.9).fingerprint == config.fingerprint


@pytest.mark.parametrize(("phi_deg", "most"), [(None, 45.0), ([-20.0, 20.0], 20.0)])
def test_a_law_beside_an_aircraft_has_its_limits_unless_others_are_stated(phi_deg, most):
    """A turn of 90 deg, whose first roll command is 156 deg without limits."""
    limits = {} if phi_deg is None else {"phi_deg": phi_deg}
    scenario = made_up_scenario(
        gains=["paper"],
        flight={"V_a_mps": 25.0, "duration_s": 3.0},
        reference={"chi_deg": 90.0, "gamma_deg": 0.0},
        limits=limits,
        plant=[{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}],
    )
    run = ft.fly(scenario).runs[0]

    assert run.status == "completed"
    assert np.rad2deg(run.signals["phi_cmd"].abs().max()) == pytest.approx(most)


@pytest.mark.slow
def test_requirements_of_options_are_those_of_the_scenario(tmp_path):
    answer("new", "mine", "--overshoot", "3", "--settle", "8", cwd=tmp_path)
    made = ft.load_scenario(tmp_path / "mine.toml")

    written = tomlkit.parse((tmp_path / "mine.toml").read_text())
    turn, climb = map(float, re.findall(r"by (\d+) deg", written["title"]))
    assert (turn, written["reference"]["chi_deg"]) == (30.0, 30.0)
    assert written["reference"]["gamma_deg"] == climb + written["flight"]["gamma_deg"]
    (expected,) = made.expect
    required = {"MO_deg": 3.0, "settling_s": 8.0}
    assert expected.at_most == {"chi": required, "gamma": required}
    metrics = ft.fly(made).metrics
    assert metrics["settling_s"].notna().all()


@pytest.mark.parametrize(
    ("name", "option", "reason"),
    [
        ("mine\n[[law]]", "--settle=8", "`NAME` must .*printable characters"),
        ("mine", "--overshoot=0", "`--overshoot` must be positive and finite, got 0"),
        ("mine", "--settle=nan", "`--settle` must be positive and finite, got nan"),
    ],
)
def test_what_cannot_be_is_one_line_and_writes_nothing(name, option, reason, tmp_path):
    _, err = flighttune("new", name, option, status=2, cwd=tmp_path)

    assert re.search(reason, err)
    assert not [*tmp_path.iterdir()]
