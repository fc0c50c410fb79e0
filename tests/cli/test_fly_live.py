"""`flighttune fly --live`: Ctrl-C and other signals keep what was flown."""

import json
import os
import re
import socket
import subprocess
import sys

import pytest

from flighttune.cli.live import pace_of
from flighttune.errors import InputError
from flighttune.flight.refly import refly
from flighttune.recording.parquet import load_recording
from flighttune.recording.viewer import tied

ENVIRONMENT_WITHOUT_SCREEN = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")


@pytest.fixture
def no_screen(monkeypatch):
    for name in ENVIRONMENT_WITHOUT_SCREEN:
        monkeypatch.delenv(name, raising=False)


def started(*arguments, program=("-m", "flighttune")):
    return subprocess.Popen(
        tied([sys.executable, *program, *map(str, arguments)]),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


SIGNALLED = """
import os, signal, sys
from flighttune.cli import main
from flighttune.recording.live import LivePlant

advance, samples, number = LivePlant.advance, [], signal.Signals[sys.argv.pop(1)]

def signalled(*arguments):
    samples.append(None)
    if len(samples) == 60:
        os.kill(os.getpid(), number)
    return advance(*arguments)

LivePlant.advance = signalled
main()
"""
"""The command line, which sends itself a signal at its 60th sample: at t = 1.18 s."""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_the_flight_keeps_it_and_leaves_no_viewer(number, tmp_path):
    arguments = ("fly", "paper", "--live", "--pace", "max", "--out", tmp_path, "--json")
    process = started(number, *arguments, program=("-c", SIGNALLED))
    out, errors = process.communicate(timeout=300)
    answer = json.loads(out)
    ports = [int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", errors)]

    assert len(ports) == 2
    for port in ports:
        with socket.socket() as probe:
            assert probe.connect_ex(("127.0.0.1", port)) != 0
    assert process.returncode == 1
    assert "interrupted: " in errors
    assert "Traceback" not in errors
    assert {run["status"] for run in answer["runs"]} == {"interrupted"}
    found = load_recording(tmp_path)
    assert found.missing == ()
    (cut,) = [run for run in found.runs if len(run.signals)]
    assert cut.reason.startswith("stopped by hand at t = ")
    assert 1.0 < cut.duration < 1.4
    assert len(list(tmp_path.glob("*.parquet"))) == len(found.runs)
    (reflown,) = [one for one in refly(found.runs) if len(one.recorded.signals)]
    assert reflown.difference is None


@pytest.mark.usefixtures("no_screen")
@pytest.mark.soak
def test_a_flight_that_nobody_stops_ends_by_itself(tmp_path):
    process = started("fly", "paper", "--live", "--pace", "max", "--out", tmp_path)
    out, errors = process.communicate(timeout=60)

    assert process.returncode == 0, errors
    assert "open http://127.0.0.1:" in out
    assert {run.status for run in load_recording(tmp_path).runs} == {"completed"}


@pytest.mark.parametrize("pace", ["0", "-1", "fast", "inf", "nan"])
def test_a_pace_that_is_none_is_refused_in_one_line(pace):
    with pytest.raises(InputError, match=r"`--pace` .*got '"):
        pace_of(pace)
