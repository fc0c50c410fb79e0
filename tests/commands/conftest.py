"""What commands are given: every file of `shelf/`, and some that commands write, once a session."""

from pathlib import Path
from shutil import copy

import pytest

import flighttune as ft


@pytest.fixture(scope="session")
def shelf(tmp_path_factory):
    """A folder of files that commands are given; no test changes it.

    c.json is a certificate; flown has the flights of turn.toml.
    """
    folder = tmp_path_factory.mktemp("shelf")
    for file in (Path(__file__).parent / "shelf").iterdir():
        copy(file, folder)
    ft.certify("paper", "paper").certificate.save(folder / "c.json")
    ft.record(ft.fly(folder / "turn.toml"), folder / "flown")
    return folder


@pytest.fixture
def here(shelf, tmp_path, monkeypatch):
    """A folder with the files of the shelf, in which commands run."""
    for file in shelf.iterdir():
        (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    return tmp_path
