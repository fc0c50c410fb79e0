"""A model's parts come from its folders only, and files that crash JSBSim cost one line."""

import pytest
from commands import flighttune

import flighttune as ft


@pytest.fixture(autouse=True)
def nothing_is_trusted(monkeypatch):
    monkeypatch.delenv("FLIGHTTUNE_TRUST_AIRCRAFT")


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
@pytest.mark.parametrize("command", ["trim", "adopt"])
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


def test_a_model_of_jsbsims_is_a_name_and_no_path(naming):
    folder = naming("direct")
    file = folder / "aircraft.toml"
    file.write_text(file.read_text().replace('"aerosonde.xml" ', '"../../elsewhere/x"'))

    with pytest.raises(ft.InputError, match="`model`"):
        ft.loop.JSBSimPlant(folder)


CRASHES = (
    "<aerodynamics>",
    '<aerodynamics><function name="aero/a"><property>aero/b</property></function>'
    '<function name="aero/b"><property>aero/a</property></function>',
)
"""Two functions, each the value of the other: JSBSim calls them until its stack is full."""


def test_a_command_ends_with_one_line_too(changed_aircraft):
    out, err = flighttune("trim", changed_aircraft("aerosonde.xml", *CRASHES), status=2)

    assert out == ""
    assert err.splitlines()[-1].endswith("ended the process that tried: SIGSEGV.")
    assert "fault of flighttune" not in err
