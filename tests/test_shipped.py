"""What ships with the package is found by name, wherever it is installed."""

import email
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from commands import answer
from places import AIRCRAFT_NAMES, CAMPAIGN_NAMES, LISTED_NAMES, SCENARIO_NAMES

import flighttune as ft

REPOSITORY = Path(__file__).parents[1]


def test_every_aircraft_scenario_and_campaign_of_the_checkout_is_listed():
    told = answer("list")
    listed = {entry["name"] for key in ("begin_with", "scenarios") for entry in told[key]}

    assert told["aircraft"] == AIRCRAFT_NAMES
    assert listed == {*LISTED_NAMES}
    assert len(listed) <= 22
    assert told["notes"][0] == f"studies: {', '.join(sorted({*SCENARIO_NAMES} - listed))}"
    assert [entry["name"] for entry in told["campaigns"]] == CAMPAIGN_NAMES
    assert not {*CAMPAIGN_NAMES} & {*SCENARIO_NAMES}


def test_a_folder_that_is_here_is_named_as_it_must_be_written(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/aircraft.toml").touch()
    monkeypatch.chdir(tmp_path)

    with pytest.raises(ft.InputError, match=r"'mine'; .* is \./mine\.$"):
        ft.loop.JSBSimPlant("mine")


def copied_sources(folder):
    """What an archive of the repository holds."""
    ignored = shutil.ignore_patterns(
        "__pycache__", "*.egg-info", "runs", "dist", "build", ".venv", ".git", ".*_cache"
    )
    return Path(shutil.copytree(REPOSITORY, folder, ignore=ignored))


def built(source, out, *targets):
    """Files that the build backend makes of a folder."""
    pytest.importorskip("hatchling.build", reason="needs the build backend")
    command = [sys.executable, "-m", "hatchling", "build", "-d", out]
    for target in targets:
        command += ["-t", target]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    return sorted(out.iterdir())


def contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def dist(tmp_path_factory):
    """Wheel and sdist of a copy of the sources."""
    folder = tmp_path_factory.mktemp("dist")
    return built(copied_sources(folder / "source"), folder / "out", "wheel", "sdist")


@pytest.mark.soak
def test_the_sdist_builds_the_wheel_of_the_checkout(dist, tmp_path):
    wheel, sdist = dist
    with tarfile.open(sdist) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # from 3.11.4 on
        archive.extractall(tmp_path / "unpacked")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    (again,) = built(unpacked, tmp_path / "again", "wheel")

    assert contents(again) == contents(wheel)
    assert not [name for name in contents(wheel) if name.endswith((".png", ".svg", ".ipynb"))]
    for name in ("tests", "docs", "Makefile", "CHANGELOG.md", "CITATION.cff", "SECURITY.md"):
        assert (unpacked / name).exists(), name


@pytest.mark.soak
def test_the_wheel_says_what_a_package_index_shows(dist):
    wheel, _ = dist
    (text,) = (data for name, data in contents(wheel).items() if name.endswith("/METADATA"))
    said = email.message_from_bytes(text)

    assert said["License-Expression"] == "MIT AND LGPL-2.1-or-later AND Bitstream-Vera"
    assert said["Description-Content-Type"] == "text/markdown"
    assert said["Keywords"]
    assert {f"Programming Language :: Python :: 3.{minor}" for minor in (11, 12, 13, 14)} <= set(
        said.get_all("Classifier")
    )
    page = text.decode().partition("\n\n")[2]
    assert page.startswith("# flighttune\n")
    # A package index has neither the pictures nor the pages of the repository.
    assert not re.findall(r"!?\[[^]]*\]\((?!https?://)[^)]*\)", page)
