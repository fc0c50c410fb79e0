"""A folder that lacks runs of its flight is not reported as all of it."""

import json

import pytest
from commands import flighttune
from made_up import shortened

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path):
    """The folder of a flight of three runs, one of which was removed."""
    changes = {"plant": [{"kind": "kinematic"}], "gains": ["paper", "K1", "K2"]}
    files = ft.record(ft.fly(shortened("paper", 0.5, **changes)), tmp_path / "flight")
    files.signals["kinematic / K1"].unlink()
    return tmp_path / "flight"


@pytest.mark.soak
def test_a_report_says_first_that_runs_are_missing_and_ends_with_status_2(folder, tmp_path):
    page = tmp_path / "page.html"
    sentence = "1 of 3 runs is missing"

    out, err = flighttune("report", folder, "--out", page, status=2)
    assert out.startswith(f"{sentence}: the rest is about the others.")
    assert err == f"flighttune: {folder}: {sentence}\n"

    answer = json.loads(flighttune("report", folder, "--out", page, "--json", status=2)[0])
    assert answer["missing"] == [f"{folder}: {sentence}"]
    assert answer["summary"][0].startswith(sentence)
    assert page.read_text(encoding="utf-8").index(sentence) < page.read_text().index("<table")


def test_a_flight_of_another_time_in_the_folder_is_a_note(folder, tmp_path):
    changes = {"plant": [{"kind": "kinematic"}], "gains": ["paper"], "title": "Other"}
    ft.record(ft.fly(shortened("paper", 0.4, **changes)), folder, name="other")

    out, err = flighttune("report", folder, "--out", tmp_path / "page.html", "--json")

    assert err == ""
    (line,) = json.loads(out)["missing"]
    assert line.endswith("kinematic-K2.parquet: of another flight")
