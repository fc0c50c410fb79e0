"""A scenario its aircraft cannot start is refused with file, table and key."""

import pytest
from made_up import made_up_scenario, scenario_tables

import flighttune as ft
from flighttune.files.table import toml_text


def aircraft(name):
    return {"kind": "jsbsim", "aircraft": name}


OUTSIDE = [
    ("flight", {"h_m": -500.0}, r"\[flight\] `h_m` must be above the ground at 0 m, got -500 m"),
    ("flight", {"ground_m": 2e3}, r"\[flight\] `h_m` must be above the ground at 2000 m"),
    ("flight", {"phi_deg": 50.0}, r"\[flight\] `phi_deg` must lie in -45 to 45 deg .*, got 50"),
    ("flight", {"n_z": 9.0}, r"\[flight\] `n_z` must lie in .*aircraft\.toml\), got 9"),
    ("limits", {"phi_deg": [50.0, 60.0]}, r"\[limits\] `phi_deg` must overlap -45 to 45 deg"),
    ("limits", {"n_z": [20.0, 30.0]}, r"\[limits\] `n_z` must overlap"),
    ("plant", [aircraft("boeing")], r"\[plant\] `aircraft` must be one of .*, got 'boeing'"),
    ("plant", [aircraft("my/boeing")], r"\[plant\] `aircraft` must be one that can be read: "),
]


@pytest.mark.parametrize(("table", "change", "message"), OUTSIDE)
def test_what_an_aircraft_cannot_start_names_file_and_key(table, change, message, tmp_path):
    tables = scenario_tables(**{"plant": [aircraft("aerosonde")], table: change})
    path = tmp_path / "outside.toml"
    path.write_text(toml_text(tables))
    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.load_scenario(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_scenario_made_in_python_is_refused_by_its_title_when_it_is_flown():
    plants = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
    scenario = made_up_scenario(flight={"V_a_mps": 250.0}, plant=plants)

    with pytest.raises(ft.ScenarioError, match=r"^Straight on: .*`V_a_mps`.*15 to 45"):
        ft.fly(scenario)
