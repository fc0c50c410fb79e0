"""Commands on a real disk that fills up: one line, soon, and nothing half-written."""

import os
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from unittest import mock

import pytest

from flighttune.cli import main
from flighttune.flight.fly import fly
from flighttune.recording.parquet import load_recording
from flighttune.recording.record import record
from flighttune.scenario import load_scenario, scenario_from
from flighttune.table_file import toml_text

pytestmark = pytest.mark.slow

DISK = 16 * 2**20
PAGE = 4096
SIZES = 10
LONGEST_S = 120.0
"""On an idle machine none takes five seconds longer than without a disk; a loaded one has time."""


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("disk")
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(folder)]
    if os.name == "nt" or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a small disk can only be made by root where mounting is allowed")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A scenario file of a second of flight, and the folder of its recording."""
    folder = tmp_path_factory.mktemp("short")
    tables = load_scenario("paper").as_dict()
    tables["flight"] = {**tables["flight"], "duration_s": 1.0}
    tables["gains"] = ["paper"]
    tables.pop("expect", None)
    file = folder / "short.toml"
    file.write_text(toml_text(tables))
    record(fly(scenario_from(tables)), folder / "flown", name="short")
    return file, folder / "flown"


def run(command, folder, short):
    """Exit status, lines on stderr and duration of a command that writes into `folder`."""
    file, flown = short
    given = command.format(out=folder, file=file, flown=flown).split()
    errors, began = StringIO(), time.monotonic()
    with (
        redirect_stdout(StringIO()),
        redirect_stderr(errors),
        mock.patch.object(sys, "argv", ["flighttune", *given]),
    ):
        try:
            main()
            status = 0
        except SystemExit as exit_:
            status = exit_.code or 0
    return status, errors.getvalue().splitlines(), time.monotonic() - began


def files_in(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


COMMANDS = {
    "fly": "fly {file} --out {out}",
    "report": "report {flown} -o {out}/report.html",
    "gap": "gap {file} --lag fitted --out {out}",
}


@pytest.mark.parametrize(
    "name", ["fly", *(pytest.param(n, marks=pytest.mark.soak) for n in ("report", "gap"))]
)
def test_a_disk_that_fills_up_is_one_line_and_leaves_what_was_there(
    name, disk, short, tmp_path, capfd
):
    status, _, alone_s = run(COMMANDS[name], tmp_path, short)
    assert status in (0, 1)  # gap: a second of flight says nothing of the certified set
    needed = sum(-(-path.stat().st_size // PAGE) for path in files_in(tmp_path))
    # Of two in one run, one may be whole before the next one fails: gap.svg, after the recording.
    for free in sorted({needed * k // SIZES for k in range(SIZES)}):
        folder = disk / f"{name}-{free}"
        ballast = disk / "ballast"
        ballast.write_bytes(b"")
        room = os.statvfs(disk)
        with ballast.open("wb") as full:
            os.posix_fallocate(full.fileno(), 0, (room.f_bavail - free) * room.f_bsize)

        status, lines, took_s = run(COMMANDS[name], folder, short)

        assert status == 2, f"{free} of {needed} pages"
        (line,) = lines
        path, reason = line.removeprefix("flighttune: ").split(": ", 1)
        assert path.startswith(str(folder))
        assert not os.path.exists(path)
        assert reason == "must be writable, got no space left on device."
        assert took_s < alone_s + LONGEST_S
        assert not [left for left in files_in(folder) if left.name.startswith(".")]
        for left in files_in(folder):
            load_recording(left)
        ballast.unlink()
    assert capfd.readouterr() == ("", "")  # no library logs
