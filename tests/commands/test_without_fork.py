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
for line in sys.stdin.read().splitlines():
    sys.argv = ["flighttune", *line.split()]
    try:
        main()
    except SystemExit as ended:
        print(ended.code or 0, file=sys.stderr)
"""


WORKS = "tune paper_as_printed --out gains.json"
REFUSED = (
    "campaign first_campaign -q --workers 1 --out runs",
    "gap flight.csv --aircraft aerosonde",
)


@pytest.mark.soak
def test_what_needs_a_copy_is_refused_in_one_line_and_what_does_not_fly_works(tmp_path):
    (tmp_path / "flight.csv").write_text("t,chi\n0.0,0.0\n1.0,0.0\n")

    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], input="\n".join((WORKS, *REFUSED)),
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip

    works, *refused = done.stderr.splitlines()
    assert (tmp_path / "gains.json").exists()
    assert works == "0"
    assert refused[1::2] == ["2"] * len(REFUSED)
    for line in refused[::2]:
        assert "WSL2" in line
        assert "a crash or a hang there ends a copy of the process" in line
