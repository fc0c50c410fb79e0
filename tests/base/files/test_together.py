"""The files of an answer get their places together, and what else is in the folder stays."""

import json
import os
import subprocess
import sys
from pathlib import Path
from threading import Timer

import pytest
from killed import each_end, files_in
from made_up import scenario_file, shortened

import flighttune as ft
from flighttune.base.files import whole
from flighttune.base.files.table import json_tables

LONGEST_NAME = 255  # bytes, on all usual file systems

KILLED_WHILE_MOVED = """
import os, pathlib, sys
from flighttune.base.files.whole import remove_file, together, write_text
replaced, folder = pathlib.Path.replace, pathlib.Path(sys.argv[1])
def replace(path, target):
    if pathlib.Path(target) == folder / "b.json":
        os.kill(os.getpid(), 9)
    return replaced(path, target)
pathlib.Path.replace = replace
with together(folder):
    remove_file(folder / "stale.txt")
    for name in ("a.json", "b.json", "sub/c.json"):
        write_text(folder / name, '{"is": "new"}')
    write_text(folder.with_name("elsewhere") / "page.html", "new")
"""


def text_of(folder):
    """Texts of the files below a folder, without those that are staged."""
    names = [name for name in files_in(folder) if not name.startswith(".")]
    return {name: (folder / name).read_text() for name in names}


@pytest.fixture
def folder(tmp_path):
    """A folder with an old answer of two files, one that the new one lacks, and a note."""
    made = tmp_path / "answer"
    made.mkdir()
    for name in ("a.json", "b.json", "stale.txt", "notes.txt"):
        (made / name).write_text('{"is": "old"}')
    return made


def test_nothing_of_an_answer_is_there_before_all_of_it(folder):
    before = text_of(folder)

    with whole.together(folder):
        whole.write_text(folder / "a.json", "new")
        whole.remove_file(folder / "stale.txt")
        assert whole.current(folder / "a.json").read_text() == "new"
        assert text_of(folder) == before

    del before["stale.txt"]
    assert text_of(folder) == before | {"a.json": "new"}
    assert not [*folder.glob(".*")]


def test_files_of_other_folders_get_their_places_too_and_one_that_is_not_there_is_none(folder):
    elsewhere = folder.with_name("elsewhere")

    with whole.together(folder):
        whole.write_text(folder / "a.json", "new")
        whole.write_text(elsewhere / "deep" / "page.html", "new")
        whole.remove_file(folder / "not there")
        page = elsewhere / "deep" / "page.html"
        assert whole.current(page).read_text() == "new"
        assert not page.exists()

    assert text_of(folder)["a.json"] == "new"
    assert text_of(elsewhere) == {"deep/page.html": "new"}
    assert [*elsewhere.glob(".*"), *(elsewhere / "deep").glob(".*"), *folder.glob(".*")] == []


def test_an_answer_is_whole_although_the_command_is_interrupted_while_its_files_are_moved(
    folder, monkeypatch
):
    moved, replace = [], Path.replace

    def interrupted(path, target):
        moved.append(target)
        if len(moved) == 4:  # two were written before, and one of them moved
            raise KeyboardInterrupt
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt), whole.together(folder):  # noqa: PT012
        whole.write_text(folder / "a.json", "new")
        whole.write_text(folder / "b.json", "new")

    assert text_of(folder) == text_of(folder) | {"a.json": "new", "b.json": "new"}
    assert not [*folder.glob(".*")]


def test_files_that_another_process_moves_are_waited_for_and_not_for_ever(folder, monkeypatch):
    moving = folder / whole.WHOLE
    (moving / whole.NEW).mkdir(parents=True)
    (moving / whole.NEW / "a.json").write_text("new")
    descriptor = os.open(moving, os.O_RDONLY)
    whole.lock(descriptor)  # as the process does that moves them
    monkeypatch.setattr(whole, "WAIT_S", 0.05)
    with pytest.raises(ft.InputError, match="another process must end its writing"):
        whole.settle(folder)
    assert (folder / "a.json").read_text() == '{"is": "old"}'

    monkeypatch.setattr(whole, "WAIT_S", 10.0)
    Timer(0.1, os.close, [descriptor]).start()
    whole.settle(folder)

    assert (folder / "a.json").read_text() == "new"
    assert not moving.exists()


def test_an_answer_with_an_error_leaves_all_as_it_was_but_for_what_is_kept(folder):
    before = text_of(folder)

    def fails(*, keep):
        with whole.together(folder):
            if keep:  # one of these is not written
                whole.keep_on_error(folder / "a.json")
                whole.keep_on_error(folder / "c.json")
            whole.write_text(folder / "a.json", "long computed")
            whole.write_text(folder / "b.json", "new")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails(keep=False)
    assert text_of(folder) == before
    with pytest.raises(ZeroDivisionError):
        fails(keep=True)
    assert text_of(folder) == before | {"a.json": "long computed"}


def test_what_is_kept_but_could_not_be_written_removes_nothing(folder):
    before = text_of(folder)

    def fails():
        with whole.together(folder):
            whole.remove_file(folder / "stale.txt")
            whole.keep_on_error(folder / "a.json")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert text_of(folder) == before


@pytest.mark.parametrize("reader", ["json", "writer", "kind"])
def test_an_answer_whose_command_is_killed_while_its_files_are_moved_is_whole_for_all(
    folder, reader
):
    code = [sys.executable, "-c", KILLED_WHILE_MOVED, folder]
    assert subprocess.run(code, check=False).returncode == -9
    left = text_of(folder)
    assert (left["a.json"], left["b.json"]) == ('{"is": "new"}', '{"is": "old"}')

    if reader == "json":
        assert json_tables(folder / "b.json") == {"is": "new"}
    elif reader == "kind":
        with pytest.raises(ft.InputError):
            ft.load(folder / "b.json")
    else:
        whole.write_text(folder / "own.txt", "own")

    own = {"own.txt": "own"} if reader == "writer" else {}
    names = ("a.json", "b.json", "sub/c.json")
    assert text_of(folder) == dict.fromkeys(names, '{"is": "new"}') | own | {
        "notes.txt": '{"is": "old"}'
    }
    assert text_of(folder.with_name("elsewhere")) == {"page.html": "new"}


def test_a_folder_of_somebody_else_moves_no_file_out_of_it(tmp_path):
    theirs, home = tmp_path / "theirs", tmp_path / "home"
    (theirs / ".flighttune.whole/new/link").mkdir(parents=True)
    home.mkdir()
    (home / "mine").write_text("mine")
    (theirs / "link").symlink_to(home)
    for name in ("link/mine", "inside"):
        (theirs / ".flighttune.whole/new" / name).write_text("theirs")
    (theirs / ".flighttune.whole/others").write_bytes(os.fsencode(home))
    (theirs / ".flighttune.whole/old").symlink_to(home)

    whole.settle(theirs)

    assert text_of(home) == {"mine": "mine"}
    assert (theirs / "inside").read_text() == "theirs"


def test_what_cannot_be_moved_is_one_line_before_anything_is(folder):
    (folder / "c").mkdir()
    before = text_of(folder)

    def write():
        with whole.together(folder):
            whole.write_text(folder / "a.json", "new")
            whole.write_text(folder / "c", "new")

    with pytest.raises(ft.InputError, match=r"answer/c: must be writable, got is a directory"):
        write()
    assert text_of(folder) == before


def test_a_name_may_be_as_long_as_the_system_allows(tmp_path):
    path = tmp_path / ("é" * (LONGEST_NAME // 2) + "x")

    whole.write_text(path, "new")
    with whole.together():
        whole.write_text(path, "newer")

    assert path.read_text() == "newer"
    assert [*tmp_path.iterdir()] == [path]


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
