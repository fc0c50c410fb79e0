"""A system that cannot copy a process, as Windows: flights that need a copy are refused."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

# What Windows has not; the libraries, which know it, are imported before.
PROGRAM = """
import os, signal, sys
import filelock, rerun
for name in ("resource", "fcntl"):
    sys.modules[name] = None
del os.fork, signal.SIGHUP, signal.SIGALRM, signal.setitimer
from flighttune.cli import main
sys.argv[0] = "flighttune"
main()
"""


def run_without_fork(folder, *words):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_what_does_not_fly_works(tmp_path):
    ended = run_without_fork(tmp_path, *["tune", "paper", "--out", "gains.json"])

    assert ended.returncode == 0, ended.stderr
    assert ended.stdout
    assert not ended.stderr


@pytest.mark.parametrize(
    "command",
    ["campaign first_campaign -q --workers 1 --out runs", "gap flight.csv --aircraft aerosonde"],
)
def test_what_needs_a_copy_is_refused_in_one_line(tmp_path, command):
    (tmp_path / "flight.csv").write_text("t,chi\n0.0,0.0\n1.0,0.0\n")

    ended = run_without_fork(tmp_path, *command.split())

    assert ended.returncode == 2, ended.stderr
    (line,) = ended.stderr.splitlines()
    assert "WSL2" in line
    assert "a crash or a hang there ends a copy of the process" in line
