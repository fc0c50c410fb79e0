"""Commands on a real disk that fills up: one line, soon, and nothing half-written."""

import os
import subprocess

import pytest
from commands import flighttune
from made_up import scenario_file, shortened

import flighttune as ft

pytestmark = pytest.mark.slow

DISK = 16 * 2**20
PAGE = 4096
SIZES = 10


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("disk")
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a small disk can only be made by root where mounting is allowed")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A scenario file of a second of flight."""
    file = tmp_path_factory.mktemp("short") / "short.toml"
    return scenario_file(file, shortened("paper", 1.0, gains=["paper"]))


def files_in(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.mark.soak
def test_a_disk_that_fills_up_is_one_line_and_leaves_what_was_there(disk, short, tmp_path, capfd):
    flighttune("fly", short, "--out", tmp_path)
    needed = sum(-(-path.stat().st_size // PAGE) for path in files_in(tmp_path))
    for free in sorted({needed * k // SIZES for k in range(SIZES)}):
        folder = disk / f"fly-{free}"
        ballast = disk / "ballast"
        ballast.write_bytes(b"")
        room = os.statvfs(disk)
        with ballast.open("wb") as full:
            os.posix_fallocate(full.fileno(), 0, (room.f_bavail - free) * room.f_bsize)

        _, said = flighttune("fly", short, "--out", folder, status=2)

        (line,) = said.splitlines()
        path, reason = line.removeprefix("flighttune: ").split(": ", 1)
        assert path.startswith(str(folder))
        assert not os.path.exists(path)
        assert reason == "must be writable, got no space left on device."
        assert not [left for left in files_in(folder) if left.name.startswith(".")]
        for left in files_in(folder):
            ft.load(left)
        ballast.unlink()
    assert capfd.readouterr() == ("", "")  # no library logs
