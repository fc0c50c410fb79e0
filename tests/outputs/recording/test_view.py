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
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from fuzzing import first_or_all

import flighttune as ft

pytestmark = pytest.mark.slow

DISPLAYS = "DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"

LONGEST_S = 120.0
COMMAND = [sys.executable, "-u", "-m", "flighttune", "view"]


def pair_of_ports():
    """Two ports, one after the other, on which nothing listens."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            with suppress(OSError, OverflowError):
                second.bind(("127.0.0.1", port + 1))
                return port


def listening(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def until(condition):
    end = time.monotonic() + LONGEST_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


@contextmanager
def serving(recording):
    """`flighttune view --port` with its page up: process, port, and the line it printed."""
    port = pair_of_ports()
    command = [*COMMAND, str(recording), "--port", str(port)]
    without = {name: value for name, value in os.environ.items() if name not in DISPLAYS}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=without) as running:
        watchdog = threading.Timer(LONGEST_S, running.kill)
        watchdog.start()
        line = running.stdout.readline()
        watchdog.cancel()
        programs = psutil.Process(running.pid).children(recursive=True)
        try:
            assert until(lambda: listening(port))
            assert until(lambda: listening(port + 1))
            programs = psutil.Process(running.pid).children(recursive=True)
            yield running, port, line
        finally:
            for process in (running, *programs):
                with suppress(ProcessLookupError, psutil.NoSuchProcess):
                    process.kill()


@pytest.fixture(scope="module")
def recording(results, tmp_path_factory):
    return ft.record(results.of("met"), tmp_path_factory.mktemp("view")).recording


@pytest.fixture(scope="module")
def started():
    """Commands of this module, the last of which may still be there, and what ends them."""
    with ExitStack() as ends:
        yield [], ends


@pytest.fixture
def served(recording, started):
    """What `serving` has of a command that is there."""
    commands, ends = started
    if not commands or commands[-1][0].poll() is not None:
        commands.append(ends.enter_context(serving(recording)))
    return commands[-1]


@pytest.mark.counts
@pytest.mark.parametrize("server", first_or_all(["page", "data"]))
def test_a_port_that_is_taken_is_one_line(recording, server):
    with socket.socket() as probe:
        port = pair_of_ports()
        taken = port if server == "page" else port + 1
        probe.bind(("127.0.0.1", taken))
        probe.listen()
        done = subprocess.run(
            [*COMMAND, str(recording), "--port", str(port)],
            capture_output=True, text=True, timeout=LONGEST_S, check=False,
        )  # fmt: skip

    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(f"flighttune: port {taken} must be free")


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


@pytest.mark.soak
@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="sockets are listed on Linux only")
def test_the_page_and_its_data_are_served_on_this_machine_only(served):
    running, port, line = served
    (url,) = re.findall(r"http://\S+", line)

    with urllib.request.urlopen(url, timeout=10.0) as answer:
        page = answer.read()
    (program,) = psutil.Process(running.pid).children()
    found = sockets_of(program.pid)

    assert url.startswith(f"http://127.0.0.1:{port}/?url=")
    assert url.endswith(f"127.0.0.1%3A{port + 1}%2Fproxy")
    assert b"<html" in page.lower()
    assert len(found) >= 2
    for local, remote in found:
        assert local in LOOPBACK
        assert remote in LOOPBACK | ANY_ADDRESS


@pytest.mark.soak
@pytest.mark.parametrize("number", first_or_all(["SIGTERM", "SIGHUP", "SIGINT"]))
def test_a_command_that_is_ended_leaves_no_viewer_behind(served, number):
    running, port, _ = served

    running.send_signal(signal.Signals[number])

    assert running.wait(timeout=LONGEST_S) == 0
    assert until(lambda: not listening(port))
    assert not listening(port + 1)
