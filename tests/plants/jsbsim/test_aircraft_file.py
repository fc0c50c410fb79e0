"""An ``aircraft.toml`` is read once, and again when it was written to."""

import shutil

import pytest

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.errors import InputError
from flighttune.shipped import aircraft_folder


def test_a_file_is_read_once_and_again_when_it_was_written_to(tmp_path):
    folder = shutil.copytree(aircraft_folder("aerosonde"), tmp_path / "mine")
    file = folder / "aircraft.toml"
    first = load_aircraft(folder)
    assert load_aircraft(folder) is first

    file.write_text(file.read_text().replace(first.title, first.title[::-1]))
    assert load_aircraft(folder).title == first.title[::-1] != first.title

    file.unlink()
    with pytest.raises(InputError, match=r"aircraft\.toml: .*readable"):
        load_aircraft(folder)


def test_aircraft_are_shipped_by_their_name_alone():
    with pytest.raises(InputError, match="`aircraft` must be one of"):
        aircraft_folder("../aircraft/aerosonde")
