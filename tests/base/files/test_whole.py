"""Files written whole or not at all."""

import os
import subprocess
import sys

import pytest

import flighttune as ft
from flighttune.base.files import whole as whole_file


def test_text_has_the_same_bytes_on_every_system(tmp_path):
    path = whole_file.write_text(tmp_path / "new" / "file.json", "χ\nγ²\n")

    assert path.read_bytes() == "χ\nγ²\n".encode()


def test_a_file_that_cannot_be_replaced_stays_as_it_is(tmp_path, monkeypatch):
    path = whole_file.write_text(tmp_path / "report.html", "old")

    def refused(*_):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("pathlib.Path.replace", refused)

    with pytest.raises(ft.InputError, match=r"report\.html: .*permission denied"):
        whole_file.write_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_command_left_is_removed_and_what_another_one_writes_is_not(tmp_path):
    code = (
        "import os, pathlib, sys; from flighttune.base.files.whole import whole_file\n"
        "with whole_file(pathlib.Path(sys.argv[1])) as part:\n"
        "    part.write_bytes(b'half'); os.kill(os.getpid(), 9)"
    )
    killed = subprocess.run([sys.executable, "-c", code, tmp_path / "flight.rrd"], check=False)
    (part,) = tmp_path.iterdir()
    os.utime(part, (0.0, 0.0))  # long ago
    of_the_user = tmp_path / f".mine-{'0' * 32}.json"
    of_the_user.write_text("{}")

    with whole_file.whole_file(tmp_path / "flight.rrd") as unfinished:
        unfinished.write_bytes(b"whole")
        whole_file.write_text(tmp_path / "other.json", "{}")

    assert killed.returncode == -9
    assert part.name.startswith(".")
    wanted = {"flight.rrd", "other.json", of_the_user.name}
    assert {path.name for path in tmp_path.iterdir()} == wanted
    assert (tmp_path / "flight.rrd").read_bytes() == b"whole"


@pytest.mark.slow
def test_commands_that_write_into_one_folder_do_not_disturb_each_other(tmp_path):
    code = (
        "import pathlib, sys; from flighttune.base.files.whole import write_text\n"
        "for i in range(400): write_text(pathlib.Path(sys.argv[1], f'{i}.txt'), 'x')"
    )
    command = [sys.executable, "-c", code, tmp_path]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]

    assert [process.communicate()[1] for process in both] == ["", ""]
    assert len(list(tmp_path.iterdir())) == 400


@pytest.mark.parametrize("name", ["s" * 250 + ".json", "\u00e9" * 125 + ".json"])
def test_a_name_as_long_as_names_can_be_is_written(tmp_path, name):
    assert whole_file.write_text(tmp_path / name, "x").read_text() == "x"
