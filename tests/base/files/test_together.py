"""The files of an answer get their places together, and what else is in the folder stays."""

import json
import os
import subprocess
import sys
from threading import Timer

import pytest
from killed import each_end, files_in
from made_up import scenario_file, shortened

import flighttune as ft
from flighttune.base.files import whole

LONGEST_NAME = 255  # bytes, on all usual file systems

KILLED_WHILE_MOVED = """
import os, pathlib, sys
from flighttune.base.files.whole import remove_file, together, write_text
replaced, folder = os.replace, pathlib.Path(sys.argv[1])
def replace(name, *place, **folders):
    if name == "b.json":  # not its unfinished file, which has another name
        os.kill(os.getpid(), 9)
    return replaced(name, *place, **folders)
os.replace = replace
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


def left(folder, new=None, old=()):
    """What a killed command leaves in a folder: files to move, and names of files to remove."""
    made = folder / whole.WHOLE
    files = {whole.MARK: ""} | {f"{whole.NEW}/{name}": text for name, text in (new or {}).items()}
    for name, text in (files | {f"{whole.OLD}/{name}": "" for name in old}).items():
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(text)
    made.chmod(0o700)
    return made


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
    moved, replace = [], os.replace

    def interrupted(*names, **folders):
        moved.append(names)
        if len(moved) == 4:  # two were written before, and one of them moved
            raise KeyboardInterrupt
        return replace(*names, **folders)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt), whole.together(folder):  # noqa: PT012
        whole.write_text(folder / "a.json", "new")
        whole.write_text(folder / "b.json", "new")

    assert text_of(folder) == text_of(folder) | {"a.json": "new", "b.json": "new"}
    assert not [*folder.glob(".*")]


def test_files_that_another_process_moves_are_waited_for_and_not_for_ever(folder, monkeypatch):
    moving = left(folder, new={"a.json": "new"})
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


def test_an_answer_whose_command_is_killed_while_its_files_are_moved_is_read_once_it_is_whole(
    folder,
):
    """A command that reads refuses both of its files and moves none; the next that writes does."""
    code = [sys.executable, "-c", KILLED_WHILE_MOVED, folder]
    assert subprocess.run(code, check=False).returncode == -9
    half = text_of(folder)
    assert (half["a.json"], half["b.json"]) == ('{"is": "new"}', '{"is": "old"}')

    for read in (ft.load, ft.report, ft.load_gains, ft.verify):
        for path in (folder / "b.json", folder)[: 1 if read == ft.load_gains else 2]:
            with pytest.raises(ft.InputError, match="run that command again"):
                read(path)
        with pytest.raises(ft.InputError, match=r"^(?!.*run that command again)"):
            read(folder / "a.json")  # it is in its place, though no file of flighttune
    assert text_of(folder) == half

    whole.write_text(folder / "own.txt", "own")
    names = ("a.json", "b.json", "sub/c.json")
    assert text_of(folder) == dict.fromkeys(names, '{"is": "new"}') | {
        "own.txt": "own", "notes.txt": '{"is": "old"}'
    }  # fmt: skip

    elsewhere = folder.with_name("elsewhere")
    whole.write_text(elsewhere / "own.txt", "own")
    assert text_of(elsewhere) == {"page.html": "new", "own.txt": "own"}
    assert not [*folder.glob(".*"), *elsewhere.glob(".*")]


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


@pytest.mark.soak
def test_a_new_scenario_has_its_schema_wherever_its_command_is_killed(tmp_path):
    out, ours = tmp_path / "out", ("turn.toml", ".flighttune/scenario.json")

    ends = each_end(out, tmp_path / "none", ["new", out / "turn"])

    assert len(ends) > 5
    assert {tuple(name in end["settled"] for name in ours) for end in ends} == {
        (False, False), (True, True)
    }  # fmt: skip
    for end in ends:  # as it was left
        assert (ours[0] not in end["left"]) or ours[1] in end["left"], end["at"]
