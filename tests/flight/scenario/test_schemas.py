"""The JSON schemas that an editor reads accept every shipped file and refuse wrong keys."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from schemas import MODELS, text_of

from flighttune.base.files.shipped import (
    SCHEMAS,
    aircraft_folders,
    campaign_files,
    is_shipped,
    scenario_files,
)
from flighttune.flight.new import new_scenario

FILES = {
    "scenario": [*scenario_files().values()],
    "campaign": [*campaign_files().values()],
    "aircraft": [x / "aircraft.toml" for x in aircraft_folders().values() if is_shipped(x)],
}


def refusals(kind, tables):
    """Where an editor would mark the tables of a file."""
    schema = json.loads((SCHEMAS / f"{kind}.json").read_text(encoding="utf-8"))
    return [
        ".".join(map(str, error.path)) for error in Draft202012Validator(schema).iter_errors(tables)
    ]


@pytest.mark.parametrize("kind", MODELS)
def test_the_shipped_schemas_are_those_of_the_models(kind):
    shipped = (SCHEMAS / f"{kind}.json").read_text(encoding="utf-8")

    assert shipped == text_of(MODELS[kind]), "run python docs/schemas.py"
    Draft202012Validator.check_schema(json.loads(shipped))


@pytest.mark.parametrize("kind", FILES)
def test_every_shipped_file_is_valid(kind):
    wrong = {
        file.name: found
        for file in FILES[kind]
        if (found := refusals(kind, tomllib.loads(file.read_text(encoding="utf-8"))))
    }

    assert FILES[kind]
    assert wrong == {}


@pytest.mark.parametrize(
    ("kind", "change", "place"),
    [
        ("scenario", {"limit": {}}, ""),
        ("scenario", {"flight": {"duration_s": 20.0, "speed": 3.0}}, "flight"),
        ("scenario", {"limits": {"phi_deg": "45"}}, "limits.phi_deg"),
        ("scenario", {"law": 3}, "law"),
        ("scenario", {"seed": -1}, "seed"),
        ("campaign", {"runs": 0}, "runs"),
        ("aircraft", {"title": 5}, "title"),
    ],
)
def test_a_wrong_key_or_value_is_marked_where_it_stands(kind, change, place):
    file = {"scenario": scenario_files()["paper"]}.get(kind, FILES[kind][0])

    assert place in refusals(kind, tomllib.loads(file.read_text(encoding="utf-8")) | change)


def test_rates_of_faults_are_checked_by_their_schema():
    fault = {"kind": "engine", "per_hour": 1e-4, "source": "the maker"}

    assert refusals("rates", {"fault": [fault]}) == []
    assert refusals("rates", {"fault": [fault | {"per_hour": 2.0}]}) == ["fault.0.per_hour"]
    assert refusals("rates", {"faults": [fault]})


def test_a_new_scenario_names_its_schema(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = new_scenario("mine").read_text(encoding="utf-8")

    key, _, place = text.partition("\n")[0].partition(" ")

    assert key == "#:schema"
    assert (tmp_path / place).read_bytes() == (SCHEMAS / "scenario.json").read_bytes()
    assert str(tmp_path) not in text
    assert str(SCHEMAS) not in text
    assert refusals("scenario", tomllib.loads(text)) == []


def test_an_editor_finds_the_schema_wherever_the_scenario_lies(tmp_path, monkeypatch):
    (tmp_path / "first").mkdir()
    monkeypatch.chdir(tmp_path / "first")
    new_scenario("mine")
    file = (tmp_path / "first").rename(tmp_path / "of two words") / "mine.toml"
    monkeypatch.chdir(tmp_path)
    text = file.read_text(encoding="utf-8")
    wrong = text.replace("n_z_rate_per_s = ", 'n_z_rate_per_s = "x" # ')
    line = wrong[: wrong.index('"x"')].count("\n") + 1

    def linted(text):
        """Status and words of Taplo, the language server of TOML files in editors."""
        file.write_text(text, encoding="utf-8")
        command = [Path(sys.executable).with_name("taplo"), "lint", "--colors", "never", file]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    status, words = linted(text)
    assert (status, "error" in words.lower()) == (0, False)
    status, words = linted(wrong)
    assert status == 1
    assert '"x" is not valid' in words
    assert f"mine.toml:{line}:" in words
