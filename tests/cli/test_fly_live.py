"""`flighttune fly --live`: Ctrl-C keeps what was flown."""

import json
import signal
import subprocess
import sys
import time

import pytest

from flighttune.cli.live import pace_of
from flighttune.errors import InputError
from flighttune.recording.load import load_recording

ENVIRONMENT_WITHOUT_SCREEN = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")


@pytest.fixture
def no_screen(monkeypatch):
    for name in ENVIRONMENT_WITHOUT_SCREEN:
        monkeypatch.delenv(name, raising=False)


def started(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "flighttune", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.usefixtures("no_screen")
def test_ctrl_c_ends_the_flight_and_keeps_it(tmp_path):
    process = started("fly", "paper", "--live", "--pace", "5", "--out", tmp_path, "--json")
    told = process.stderr.readline()
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    answer = json.loads(out)
    by_status = [run["status"] for run in answer["runs"]]

    assert "open http://127.0.0.1:" in told
    assert process.returncode == 1
    assert "interrupted: " in errors
    assert "Traceback" not in errors
    assert "interrupted" in by_status
    found = load_recording(tmp_path)
    assert found.missing == ()
    (cut,) = [run for run in found.runs if run.status == "interrupted" and len(run.signals)]
    assert cut.reason.startswith("stopped by hand at t = ")
    assert 0.0 < cut.duration < 20.0
    flown = [run for run in found.runs if len(run.signals)]
    assert len(list(tmp_path.glob("*.parquet"))) == len(flown)
    assert (
        subprocess.run(
            [sys.executable, "-m", "flighttune", "refly", str(tmp_path)], capture_output=True
        ).returncode
        == 0
    )


@pytest.mark.slow
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
    with pytest.raises(InputError, match=r"`--pace` must be a positive number or max, got '.*'\.$"):
        pace_of(pace)
