"""An aircraft is found beside the scenario, in ./aircraft, in the user's folder, or shipped."""

import shutil

import pytest
from places import ROOT, SHIPPED_AIRCRAFT

import flighttune as ft


def config_of(aircraft):
    """What the file of an aircraft says."""
    return ft.loop.JSBSimPlant(aircraft).config


@pytest.fixture
def places(tmp_path, monkeypatch):
    """A working directory and a folder of the user's, both empty."""
    work, own = tmp_path / "work", tmp_path / "own"
    work.mkdir()
    monkeypatch.chdir(work)
    monkeypatch.setenv("FLIGHTTUNE_AIRCRAFT", str(own))
    return work / "aircraft", own


def copied(place, name="aerosonde"):
    return shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", place / name)


def test_the_nearest_place_counts(places):
    here, own = places

    copied(own)
    assert config_of("aerosonde").folder == own / "aerosonde"

    copied(here)
    assert config_of("aerosonde").folder == here / "aerosonde"

    shutil.rmtree(here)
    shutil.rmtree(own)
    assert config_of("aerosonde").folder == SHIPPED_AIRCRAFT / "aerosonde"


def test_an_aircraft_is_found_in_the_folder_beside_the_scenario_from_anywhere(places, tmp_path):
    project = tmp_path / "project"
    copied(project / "aircraft", "mine")
    text = (ROOT / "scenarios/paper.toml").read_text().replace('"aerosonde"', '"mine"')
    (project / "turn.toml").write_text(text)

    plant = next(x for x in ft.load_scenario(project / "turn.toml").plant if x.aircraft)

    assert plant.config.folder == project / "aircraft" / "mine"


@pytest.mark.parametrize("name", ["yours", "", "..", __file__])
def test_a_name_or_file_that_is_none_is_answered_with_those_there_are(places, name):
    copied(places[0], "mine")

    with pytest.raises(ft.InputError, match="a4, aerosonde, c172p, mine, x8"):
        config_of(name)


def test_who_has_no_home_has_the_shipped_aircraft(tmp_path, monkeypatch):
    """As in a container that runs under a number nobody has."""
    monkeypatch.chdir(tmp_path)
    for name in ("HOME", "USERPROFILE", "XDG_DATA_HOME", "FLIGHTTUNE_AIRCRAFT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)

    assert config_of("aerosonde").folder == SHIPPED_AIRCRAFT / "aerosonde"


def test_a_file_is_read_once_and_again_when_it_was_written_to(tmp_path):
    folder = copied(tmp_path)
    file = folder / "aircraft.toml"
    first = config_of(folder)
    assert config_of(folder) is first

    file.write_text(file.read_text().replace(first.title, first.title[::-1]))
    assert config_of(folder).title == first.title[::-1] != first.title

    file.unlink()
    with pytest.raises(ft.InputError, match=r"aircraft\.toml: .*readable"):
        config_of(folder)
