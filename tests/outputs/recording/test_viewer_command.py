"""The command of the Rerun viewer: its ports, its address, and an end that it complains of."""

import os
import socket
import sys

import numpy as np
import pandas as pd
import pytest
from commands import flighttune

import flighttune as ft
from flighttune.outputs.recording import record

linux_alone = pytest.mark.skipif(sys.platform != "linux", reason="others always have a screen")


@pytest.fixture
def recording(tmp_path):
    """A file that begins as a recording does; the viewer finds faults in it."""
    path = tmp_path / "flight.rrd"
    path.write_bytes(b"RRF2" + b"0" * 60)
    return path


@pytest.fixture
def port(monkeypatch):
    """A port that is free with the next one, where there is no screen."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            number = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", number + 1))
            except OSError:
                continue
            return number


@pytest.fixture
def program(tmp_path, monkeypatch):
    """A program in place of the viewer, which notes how it was called."""
    script = tmp_path / "rerun"
    script.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/called\n')
    script.chmod(0o755)
    monkeypatch.setattr(record, "rerun_program", lambda: str(script))
    return tmp_path / "called"


@pytest.mark.skipif(os.name == "nt", reason="needs a shell")
def test_view_says_where_the_page_is_and_how_to_reach_it(recording, port, program):
    out, _ = flighttune("view", recording, "--port", port)

    (line,) = out.splitlines()
    assert line.startswith(f"Open http://127.0.0.1:{port}/?url=")
    tunnel = f"-L {port}:127.0.0.1:{port} -L {port + 1}:127.0.0.1:{port + 1}"
    assert f"`ssh {tunnel} HOST`" in line
    assert str(recording) in program.read_text()


@pytest.mark.skipif(os.name == "nt", reason="needs a shell")
def test_a_log_is_written_as_a_recording_before_it_is_viewed(tmp_path, port, program):
    t = 0.1 * np.arange(100)
    log, out = tmp_path / "flight.csv", tmp_path / "flight.rrd"
    still = dict.fromkeys(("east", "down", "chi", "gamma"), 0.0)
    table = {"t_s": t, "north": 20.0 * t, "phi": 0.1 * np.sin(t), "n_z": 1.0, "V_a": 20.0}
    pd.DataFrame(table | still).to_csv(log, index=False)

    said, _ = flighttune("view", log, "--out", out, "--port", port)

    assert said.startswith(f"recording: {out}\nOpen http://127.0.0.1:{port}/")
    assert out.read_bytes().startswith(b"RRF2")
    assert str(out) in program.read_text()


@linux_alone
def test_view_without_a_screen_says_that_there_is_none(recording, port, program, monkeypatch):
    monkeypatch.setattr(record, "PORT", port)

    out, _ = flighttune("view", recording)

    assert f"There is no screen here. Open http://127.0.0.1:{port}/" in out
    assert f"--web-viewer-port {port} " in program.read_text()
    monkeypatch.setenv("DISPLAY", ":0")
    assert flighttune("view", recording)[0] == ""
    assert "--port auto" in program.read_text()


def test_a_folder_without_a_recording_has_nothing_to_view(tmp_path):
    _, failure = flighttune("view", tmp_path, status=2)

    assert "the folder must hold a recording" in failure


@pytest.mark.parametrize("taken", [0, 1])
def test_a_port_that_is_taken_is_refused_by_its_number(recording, port, taken):
    with socket.socket() as other:
        other.bind(("127.0.0.1", port + taken))
        other.listen()
        with pytest.raises(ft.RecordingError, match=f"port {port + taken} must be free"):
            record.viewer(recording, port=port)


def test_a_viewer_that_fails_is_an_error_and_sends_no_statistics(recording, tmp_path, monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    told = tmp_path / "told"
    code = f"import os, pathlib; pathlib.Path({str(told)!r}).write_text(os.environ['CI'])"

    record.run_viewer(recording, [sys.executable, "-c", code])
    assert told.read_text() == "true"
    with pytest.raises(ft.RecordingError, match="got exit status 3"):
        record.run_viewer(recording, [sys.executable, "-c", "raise SystemExit(3)"])
