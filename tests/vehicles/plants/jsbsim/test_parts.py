"""A model's parts come from its folders only, and files that crash JSBSim cost one line."""

import shutil
import subprocess

import pytest
from airframes import fdm_of
from commands import flighttune
from places import AIRCRAFT_NAMES, SHIPPED_AIRCRAFT

import flighttune as ft
from flighttune.vehicles.plants.jsbsim import model_files


@pytest.fixture(autouse=True)
def nothing_is_trusted(monkeypatch):
    monkeypatch.delenv("FLIGHTTUNE_TRUST_AIRCRAFT")
    model_files._end_of_trial.cache_clear()


@pytest.fixture
def naming(changed_aircraft, tmp_path):
    def naming(name):
        """An aircraft whose main file names a part, beside a file and folders of somebody else."""
        (tmp_path / "other").mkdir()
        for file in ("settings.xml", "other/settings.xml"):
            (tmp_path / file).write_text("<settings/>")
        folder = changed_aircraft(
            "aerosonde.xml", "<metrics", f'<documentation file="{name}"/>\\g<0>'
        )
        (folder / "link.xml").symlink_to("../settings.xml")
        (folder / "Engines/up").symlink_to("../../other")
        return folder

    return naming


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["../settings", "{outside}/settings", "link", "up/settings", "up/../settings"]
)
@pytest.mark.parametrize("command", ["trim", "design", "identify", "adopt"])
def test_a_part_elsewhere_is_refused_and_nothing_of_it_is_written(naming, tmp_path, command, name):
    name = name.format(outside=tmp_path)
    folder = naming(name)
    files = set(tmp_path.rglob("*"))
    adopts = command == "adopt"
    arguments = (folder / "aerosonde.xml", "--out", tmp_path / "out") if adopts else (folder,)

    _, err = flighttune(command, *arguments, status=1 if adopts else 2)

    last = err.splitlines()[-1]
    assert f"{folder}/aerosonde.xml: " in last
    assert f'`file` must stay in the folder of the model, got "{name}"' in last
    # What adopt knows so far, with comments on what is missing; no part is copied.
    draft = {tmp_path / "out", tmp_path / "out/aircraft.toml"}
    assert set(tmp_path.rglob("*")) - (draft if adopts else set()) == files


def test_a_name_that_comes_back_into_the_folder_is_a_part(naming):
    fdm = fdm_of(naming("Engines/../Engines/direct"))

    assert {file.name for file in model_files.model_files(fdm.config)} == {
        "aerosonde.xml", "aerosonde_motor.xml", "direct.xml"
    }  # fmt: skip


def test_a_model_of_jsbsims_is_a_name_and_no_path(naming):
    folder = naming("direct")
    file = folder / "aircraft.toml"
    file.write_text(file.read_text().replace('"aerosonde.xml" ', '"../../elsewhere/x"'))

    with pytest.raises(ft.InputError, match="`model`"):
        fdm_of(folder)


CRASHES = (
    "<aerodynamics>",
    '<aerodynamics><function name="aero/a"><property>aero/b</property></function>'
    '<function name="aero/b"><property>aero/a</property></function>',
)
"""Two functions, each the value of the other: JSBSim calls them until its stack is full."""


@pytest.fixture
def trials(monkeypatch):
    """The trials of a test, which all end well."""
    seen = []

    def run(command, **_):
        seen.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(model_files.subprocess, "run", run)
    return seen


def test_a_command_ends_with_one_line_too(changed_aircraft):
    out, err = flighttune("trim", changed_aircraft("aerosonde.xml", *CRASHES), status=2)

    assert out == ""
    assert err.splitlines()[-1].endswith("ended the process that tried: SIGSEGV.")
    assert "fault of flighttune" not in err


def test_files_are_tried_once_and_again_when_they_change(trials, changed_aircraft):
    folder = changed_aircraft("aerosonde.xml", "x", "x")

    fdm_of(folder)
    fdm_of(folder)
    assert len(trials) == 1

    file = folder / "aerosonde.xml"
    file.write_text(file.read_text() + "<!-- changed -->")
    fdm_of(folder)
    assert len(trials) == 2


def test_shipped_aircraft_are_not_tried_and_copies_of_them_are(trials, tmp_path):
    for name in AIRCRAFT_NAMES:
        fdm_of(name)
    assert not trials

    copy = tmp_path / "aircraft" / "aerosonde"
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", copy)
    fdm_of(copy)
    assert len(trials) == 1
