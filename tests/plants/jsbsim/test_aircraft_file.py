"""An ``aircraft.toml`` is read once, and again when it was written to."""

import shutil

import pytest

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.errors import InputError
from flighttune.shipped import aircraft_folder


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(aircraft_folder("aerosonde"), tmp_path / "mine")


def test_a_file_that_stays_is_read_once(folder):
    assert load_aircraft(folder) is load_aircraft(folder)


def test_a_file_that_was_written_to_is_read_again(folder):
    before = load_aircraft(folder).title
    file = folder / "aircraft.toml"
    file.write_text(file.read_text().replace(before, before[::-1]))

    assert load_aircraft(folder).title == before[::-1] != before


def test_a_file_that_was_removed_is_missed(folder):
    load_aircraft(folder)
    (folder / "aircraft.toml").unlink()

    with pytest.raises(InputError, match=r"aircraft\.toml: .*readable"):
        load_aircraft(folder)


def test_aircraft_are_shipped_by_their_name_alone():
    with pytest.raises(InputError, match="`aircraft` must be one of"):
        aircraft_folder("../aircraft/aerosonde")
