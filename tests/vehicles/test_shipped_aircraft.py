"""Every shipped aircraft has its trim, its compiled step, its scenario and its page."""

import re

import pytest
from airframes import changed_aerosonde
from commands import flighttune
from places import AIRCRAFT_NAMES, ROOT

import flighttune as ft

SCENARIOS = "\n".join(path.read_text("utf-8") for path in (ROOT / "scenarios").rglob("*.toml"))
DOCS = "\n".join(path.read_text("utf-8") for path in (ROOT / "docs").glob("*.md"))


@pytest.mark.slow
@pytest.mark.parametrize("name", AIRCRAFT_NAMES)
def test_a_shipped_aircraft_has_its_trim_its_scenario_and_its_page(name):
    design = ft.loop.JSBSimPlant(name).config.design

    (at,) = ft.trim(name, V_a=[design.V_a], gamma=[0.0], h=design.h).records

    assert at["reason"] == ""
    assert at["trim"]["theta_deg"] == pytest.approx(at["trim"]["alpha_deg"], abs=1e-6)
    assert 0.0 < at["trim"]["throttle"] < 1.0
    assert f'"{name}"' in SCENARIOS
    assert f"aircraft/{name}" in DOCS or f"`{name}`" in DOCS
    assert (ROOT / "aircraft" / name / "README.md").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", AIRCRAFT_NAMES)
def test_a_shipped_aircraft_is_compiled(name):
    trims = ft.trim(name, V_a=[100.0], gamma=[0.0])

    assert trims.not_compiled == ""
    assert any("compiled" in note for note in trims.answer().notes)


def test_who_flies_an_aircraft_that_is_not_compiled_is_said_with_the_reason(tmp_path):
    function = '<aerodynamics><function name="aero/noise"><random/></function>'
    folder = changed_aerosonde(
        tmp_path / "aircraft", lambda text: text.replace("<aerodynamics>", function)
    )

    trims = ft.trim(folder, V_a=[25.0], gamma=[0.0])

    assert trims.not_compiled == "the compiled step does not know <random> in a function"
    (said,) = [note for note in trims.answer().notes if "<random> in a function" in note]
    assert "JSBSim" in said


def test_a_model_that_is_refused_is_told_every_option_of_adopt(tmp_path):
    page = flighttune("adopt", "--help")[0]
    options = {*re.findall(r"^\s+(?:-\w, )?(--[\w-]+)", page, re.MULTILINE)}
    flighttune("adopt", "ball", "--out", tmp_path / "ball", status=1)
    draft = (tmp_path / "ball/aircraft.toml").read_text("utf-8")

    told = {*re.findall(r"--[\w-]+", draft)}
    assert told == options - {"--out", "--h", "--help", "--json"}
