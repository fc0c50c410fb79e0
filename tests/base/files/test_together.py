"""The files of an answer get their places together, and what else is in the folder stays."""

import json
import os
import signal
import subprocess
import sys
from unittest import mock

import pytest
from commands import flighttune
from fuzzing import in_child
from killed import each_end, files_in
from made_up import scenario_file, shortened

import flighttune as ft


def killed_while_moving(last, *words):
    """Run a command in a fork that is killed before it moves its file of this name; what ended it.

    Its unfinished file has another name.
    """

    def replace(name, *place, replaced=os.replace, **folders):
        if name == last:
            os.kill(os.getpid(), signal.SIGKILL)
        return replaced(name, *place, **folders)

    def work():
        with mock.patch.object(os, "replace", replace):
            flighttune(*words)

    return in_child(work, 60.0, 1 << 34)


@pytest.fixture
def folder(tmp_path):
    """A folder with a gains file, a folder in the place of a page, and a note."""
    made = tmp_path / "answer"
    (made / "page.html").mkdir(parents=True)
    (made / "notes.txt").write_text("mine")
    (made / "gains.json").write_text("old")
    return made


def test_what_cannot_be_moved_is_one_line_before_anything_is(folder):
    (folder / "page.svg").mkdir()
    before = files_in(folder)
    files = ("--out", folder / "gains.json", "--figure", folder / "page.svg")

    _, said = flighttune("certify", "paper", "--gains", "paper", *files, status=2)

    assert "answer/page.svg: must be writable, got is a directory" in said
    assert said.count("\n") == 1
    assert files_in(folder) == before
    assert not [*folder.glob(".*")]


def test_an_answer_replaces_its_files_alone_and_leaves_nothing_hidden(folder):
    page = folder.with_name("elsewhere") / "deep" / "loop.svg"
    unfinished, of_the_user = folder / ".flighttune-0", folder / f".mine-{'0' * 32}.json"
    for file in (unfinished, of_the_user):
        file.write_text("left")
        os.utime(file, (0.0, 0.0))  # long ago

    flighttune("certify", "paper", "--gains", "paper", "--out", folder / "c.json", "--figure", page)

    assert ft.verify(folder / "c.json").valid
    assert page.read_text(encoding="utf-8").startswith("<svg")
    assert not [*page.parent.glob(".*")]
    assert not unfinished.exists()
    assert [*folder.glob(".*")] == [of_the_user]
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / "gains.json").read_text() == "old"


@pytest.mark.parametrize("name", ["s" * 250 + ".json", "\u00e9" * 125 + ".json"])
def test_a_name_may_be_as_long_as_the_system_allows(tmp_path, name):
    ft.certify("paper", "paper").certificate.save(tmp_path / name)

    assert ft.verify(tmp_path / name).valid
    assert [*tmp_path.iterdir()] == [tmp_path / name]


@pytest.mark.slow
def test_an_answer_whose_command_is_killed_while_its_files_are_moved_is_read_once_it_is_whole(
    folder,
):
    """A command that reads refuses the file and moves none; the next that writes does."""
    certify = ["certify", "paper", "--out", folder / "c.json", "--figure", folder / "d.svg"]
    flighttune(*certify, "--gains", "paper")
    old = (folder / "d.svg").read_text("utf-8")
    assert killed_while_moving("d.svg", *certify, "--gains", "K1").endswith("ended by SIGKILL")
    assert (folder / "d.svg").read_text("utf-8") == old
    half = files_in(folder)
    for read in (ft.load, ft.report):
        with pytest.raises(ft.InputError, match="run that command again"):
            read(folder / "d.svg")
    assert files_in(folder) == half

    ft.certify("paper", "paper").certificate.save(folder / "own.json")

    assert (folder / "d.svg").read_text("utf-8") != old
    assert ft.verify(folder / "c.json").valid
    assert not [*folder.glob(".*")]


@pytest.mark.soak
def test_commands_that_write_into_one_folder_do_not_disturb_each_other(tmp_path):
    code = (
        "import sys, pathlib, flighttune as ft; c = ft.certify('paper', 'paper').certificate\n"
        "for i in range(200): c.save(pathlib.Path(sys.argv[1], f'{i}.json'))"
    )
    command = [sys.executable, "-c", code, tmp_path]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]

    assert [process.communicate()[1] for process in both] == ["", ""]
    assert len(list(tmp_path.iterdir())) == 200


def check_end(end, before, ours):
    """An answer is that of before or the new one; the files of others are as they were."""
    settled = {x: sha for x, sha in end["settled"].items() if not x.startswith(".flighttune-")}
    changed = {settled.get(name) != before.get(name) for name in ours}
    assert len(changed) == 1, end
    assert {x: sha for x, sha in settled.items() if x not in ours} == {
        x: sha for x, sha in before.items() if x not in ours
    }
    if end["signal"] != "SIGKILL":
        assert not [name for name in end["left"] if ".flighttune" in name], end
    assert "Traceback" not in end["stderr"]
    return changed.pop()


ENDS = {
    "fly": (
        ["fly", "{file}", "--out", "{out}", "--set", "flight.duration_s={}"],
        ["kinematic-paper.parquet", "kinematic-K1.parquet", "short.rrd"],
        (1.0, 2.0),
    ),
    "tune": (
        [
            *("tune", "{file}", "--set", "tuning.I_star={}", "--out", "{out}/gains.json"),
            *("--page", "{out}/page.html"),
        ],
        ["gains.json", "page.html"],
        (5.0, 4.0),
    ),
    "certify": (
        [
            *("certify", "{file}", "--gains", "{}", "--out", "{out}/proof.json"),
            *("--figure", "{out}/loop.svg"),
        ],
        ["proof.json", "loop.svg"],
        ("paper", "K1"),
    ),
}
"""Command, its files, and the value that the old and the new answer have."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "signals", "every"),
    [
        ("fly", ("SIGKILL", "SIGTERM"), 14),
        pytest.param("fly", ("SIGKILL",), 1, marks=pytest.mark.counts),
        pytest.param("fly", ("SIGTERM", "SIGINT", "SIGHUP"), 1, marks=pytest.mark.counts),
        pytest.param("tune", ("SIGKILL", "SIGTERM", "SIGINT"), 1, marks=pytest.mark.counts),
        pytest.param("certify", ("SIGKILL", "SIGTERM", "SIGINT"), 1, marks=pytest.mark.counts),
    ],
)
def test_a_command_ended_at_any_operation_leaves_one_answer(tmp_path, name, signals, every):
    command, ours, values = ENDS[name]
    changes = {"plant": [{"kind": "kinematic"}], "gains": ["paper", "K1"]}
    file = scenario_file(tmp_path / "short.toml", shortened("paper", 2.0, **changes))
    before, out = tmp_path / "before", tmp_path / "out"

    def words(value, folder):
        return [word.format(value, file=file, out=folder) for word in command]

    subprocess.run([sys.executable, "-m", "flighttune", *words(values[0], before)], check=False)
    (before / "notes.txt").write_text("mine")
    old = files_in(before)
    assert {*ours} <= old.keys()

    ends = each_end(out, before, words(values[1], out), signals, every)

    kinds = [check_end(end, old, ours) for end in ends]
    assert {*kinds} == {False, True}
    assert len(ends) > (2 if every > 1 else 10), json.dumps(ends[-1])


@pytest.mark.soak
def test_a_new_scenario_has_its_schema_wherever_its_command_is_killed(tmp_path):
    out, ours = tmp_path / "out", ("turn.toml", ".flighttune/scenario.json")

    ends = each_end(out, tmp_path / "none", ["new", out / "turn"], every=3)

    assert len(ends) > 5
    assert {tuple(name in end["settled"] for name in ours) for end in ends} == {
        (False, False), (True, True)
    }  # fmt: skip
    for end in ends:  # as it was left
        assert (ours[0] not in end["left"]) or ours[1] in end["left"], end["at"]
