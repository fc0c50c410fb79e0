"""Opening a recording: a window where there is a screen, else a browser on this machine only."""

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from flighttune.errors import RecordingError
from flighttune.recording.viewer import DISPLAYS, ViewerProcess, free_port, has_screen, view

pytestmark = pytest.mark.slow


@pytest.fixture
def without_screen(monkeypatch):
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("CI", "true")


@pytest.mark.parametrize(
    ("environment", "platform", "screen"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({}, "darwin", True),
        ({}, "win32", True),
    ],
)
def test_a_screen_is_found_by_platform_and_environment(environment, platform, screen):
    assert has_screen(environment, platform) is screen


@pytest.mark.usefixtures("without_screen")
def test_without_a_screen_a_browser_is_served_on_this_machine(recording):
    with view(recording) as viewer:
        assert viewer.url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(viewer.url, timeout=10.0) as answer:
            page = answer.read()
        port = viewer.port

    assert b"<html" in page.lower()
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0


@pytest.mark.usefixtures("without_screen")
def test_a_window_without_a_screen_gives_one_line(recording):
    with pytest.raises(RecordingError, match="a window must have a screen, got none of DISPLAY"):
        view(recording, web=False)


def test_what_is_no_recording_is_not_opened(tmp_path):
    with pytest.raises(RecordingError, match="got no such file"):
        view(tmp_path / "none.rrd", web=True)


def test_a_viewer_that_does_not_start_says_why():
    with pytest.raises(RecordingError, match=r"the Rerun viewer must start, got: .*--no-such"):
        ViewerProcess(["--no-such"], port=free_port())


def listening(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM to catch")
@pytest.mark.usefixtures("without_screen")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("shell", [[], ["sh", "-c", '"$@" & wait', "sh"]], ids=["", "background"])
def test_a_command_that_is_ended_leaves_no_viewer_behind(recording, number, shell):
    command = [*shell, sys.executable, "-u", "-m", "flighttune", "view", str(recording)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        try:
            said = running.stdout.readline()
            ports = [int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", said)]
            before = [listening(port) for port in ports]
            (viewing,) = psutil.Process(running.pid).children() if shell else [running]
            viewing.send_signal(number)
            assert running.wait(timeout=20.0) == 0
        finally:
            with suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)

    assert before == [True, True]
    assert not any(listening(port) for port in ports)


ANY_ADDRESS = {"00000000", "0" * 32}
LOOPBACK = {"0100007F", "0" * 24 + "01000000", "0" * 16 + "FFFF00000100007F"}


def sockets_of(pid):
    """Local and remote address of every TCP and UDP socket of a process, as the kernel writes."""
    links = []
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed while it was asked
            links.append(os.readlink(file))
    own = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    found = []
    for kind in ("tcp", "tcp6", "udp", "udp6"):
        table = Path(f"/proc/{pid}/net/{kind}")
        lines = table.read_text().splitlines()[1:] if table.exists() else []
        for line in lines:
            fields = line.split()
            if fields[9] in own:
                found.append(tuple(field.partition(":")[0] for field in fields[1:3]))
    return found


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="sockets are listed on Linux only")
@pytest.mark.usefixtures("without_screen")
def test_the_viewer_talks_to_this_machine_only(recording):
    with view(recording) as viewer:
        with urllib.request.urlopen(viewer.url, timeout=10.0) as answer:
            answer.read()
        found = sockets_of(viewer.pid)

    assert len(found) >= 2
    for local, remote in found:
        assert local in LOOPBACK
        assert remote in LOOPBACK | ANY_ADDRESS
