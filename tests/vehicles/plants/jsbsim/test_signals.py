"""A signal while JSBSim loads an aircraft ends the command as at any other time."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[3] / "interrupted.py"
NONE_SENT = 99


@pytest.mark.parametrize(
    ("name", "most"),
    [
        *(pytest.param(name, 2, marks=pytest.mark.soak) for name in ("SIGINT", "SIGTERM")),
        *(pytest.param(name, 50, marks=pytest.mark.counts) for name in ("SIGINT", "SIGTERM")),
    ],
)
def test_a_signal_while_jsbsim_calls_python_is_an_interruption(name, most):
    command = [sys.executable, PROGRAM, name, str(most), "trim", "c172p"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    if most > len(ends):
        assert os.WEXITSTATUS(ends.pop()[0]) == NONE_SENT

    assert len(ends) >= 2
    for status, err in ends:
        assert err == ""
        if name == "SIGINT":
            assert os.WEXITSTATUS(status) == 130
        else:
            assert os.WTERMSIG(status) == signal.Signals[name]
