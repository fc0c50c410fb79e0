"""Opening a recording: a window where there is a screen, else a browser on this machine only."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from flighttune.errors import InputError, RecordingError
from flighttune.recording.viewer import DISPLAYS, ViewerProcess, free_port, has_screen, tied, view

pytestmark = pytest.mark.slow

LONGEST_S = 120.0
BACKGROUND = ["/bin/sh", "-c", '"$@" & wait', "sh"]


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
def test_what_cannot_be_opened_gives_one_line(recording, tmp_path):
    with pytest.raises(RecordingError, match="got none of DISPLAY"):
        view(recording, web=False)
    with pytest.raises(RecordingError, match="got no such file"):
        view(tmp_path / "none.rrd", web=True)
    with pytest.raises(RecordingError, match=r"must start, got: .*--no-such"):
        ViewerProcess(["--no-such"], port=free_port())


def listening(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def ports_printed(process):
    """Ports in the first line that `flighttune view` prints; it is killed if it prints none."""
    watchdog = threading.Timer(LONGEST_S, process.kill)
    watchdog.start()
    try:
        line = process.stdout.readline()
    finally:
        watchdog.cancel()
    return [int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", line)]


@pytest.mark.usefixtures("without_screen")
@pytest.mark.parametrize(
    ("number", "shell"), [("SIGTERM", []), ("SIGHUP", []), ("SIGINT", BACKGROUND)]
)
def test_a_command_that_is_ended_leaves_no_viewer_behind(recording, number, shell):
    # Tied, so that no viewer stays where the tests themselves are ended.
    command = tied([sys.executable, "-u", "-m", "flighttune", "view", str(recording)])
    command = tied([*shell, *command]) if shell else command
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        try:
            ports = ports_printed(running)
            before = [listening(port) for port in ports]
            (viewing,) = psutil.Process(running.pid).children() if shell else [running]
            viewing.send_signal(signal.Signals[number])
            assert running.wait(timeout=LONGEST_S) == 0
        finally:
            with suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)

    assert before == [True, True]
    assert not any(listening(port) for port in ports)


@pytest.mark.skipif(sys.platform != "linux", reason="a viewer is tied to its parent on Linux only")
@pytest.mark.usefixtures("without_screen")
def test_a_command_that_is_killed_leaves_no_viewer_behind(recording):
    command = tied([sys.executable, "-u", "-m", "flighttune", "view", str(recording)])
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        ports = ports_printed(running)
        viewers = psutil.Process(running.pid).children()
        before = [listening(port) for port in ports]
        running.kill()
    end = time.monotonic() + LONGEST_S
    while any(listening(port) for port in ports) and time.monotonic() < end:
        time.sleep(0.05)
    after = [listening(port) for port in ports]
    for viewer in viewers:
        with suppress(psutil.NoSuchProcess):
            viewer.kill()

    assert before == [True, True]
    assert after == [False, False]


@pytest.mark.usefixtures("without_screen")
def test_a_port_that_is_taken_is_refused(recording):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        taken = probe.getsockname()[1]
        for port in (taken, taken - 1):
            with pytest.raises(InputError, match=rf"`port` must be free .* got ({taken}|{port}): "):
                view(recording, port=port)


def test_the_page_is_served_at_the_port_and_its_data_at_the_next_one(recording, monkeypatch):
    started = []
    monkeypatch.setattr("flighttune.recording.viewer._check_free", lambda *ports: None)
    monkeypatch.setattr(
        "flighttune.recording.viewer.ViewerProcess",
        lambda arguments, **options: started.append((arguments, options)),
    )
    monkeypatch.setenv("DISPLAY", ":0")  # a port is for a browser also where there is a screen

    view(recording, port=9190)

    ((arguments, options),) = started
    assert arguments[:3] == ["--serve-web", "--web-viewer-port", "9190"]
    assert options["port"] == 9191
    assert options["url"].startswith("http://127.0.0.1:9190/?url=")
    assert options["url"].endswith("127.0.0.1%3A9191%2Fproxy")


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
def test_without_a_screen_a_browser_is_served_on_this_machine_only(recording):
    with view(recording) as viewer:
        assert viewer.url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(viewer.url, timeout=10.0) as answer:
            page = answer.read()
        found, port = sockets_of(viewer.pid), viewer.port

    assert b"<html" in page.lower()
    assert not listening(port)
    assert len(found) >= 2
    for local, remote in found:
        assert local in LOOPBACK
        assert remote in LOOPBACK | ANY_ADDRESS
