"""Aircraft files over which JSBSim ends the process: they cost one line."""

import shutil
import subprocess

import pytest
from commands import flighttune
from places import SHIPPED_AIRCRAFT

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.files.shipped import TRUST_AIRCRAFT, aircraft_names
from flighttune.plants.jsbsim import model_files
from flighttune.plants.jsbsim.fdm import Fdm

CRASHES = (
    "<aerodynamics>",
    '<aerodynamics><function name="aero/a"><property>aero/b</property></function>'
    '<function name="aero/b"><property>aero/a</property></function>',
)
"""Two functions, each the value of the other: JSBSim calls them until its stack is full."""


@pytest.fixture(autouse=True)
def nothing_is_trusted(monkeypatch):
    monkeypatch.delenv(TRUST_AIRCRAFT)
    model_files._end_of_trial.cache_clear()


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
    config = load_aircraft(changed_aircraft("aerosonde.xml", "x", "x"))

    Fdm(config)
    Fdm(config)
    assert len(trials) == 1

    file = config.folder / "aerosonde.xml"
    file.write_text(file.read_text() + "<!-- changed -->")
    Fdm(config)
    assert len(trials) == 2


def test_shipped_aircraft_are_not_tried_and_copies_of_them_are(trials, tmp_path):
    for name in aircraft_names():
        Fdm(load_aircraft(name))
    assert not trials

    copy = tmp_path / "aircraft" / "aerosonde"
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", copy)
    Fdm(load_aircraft(copy))
    assert len(trials) == 1
