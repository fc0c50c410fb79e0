"""`flighttune open`: an address is printed soon, and Ctrl-C ends the page and what it flies."""

import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import psutil
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.soak]

COMMAND = [sys.executable, "-u", "-m", "flighttune", "open", "level_turn"]
COMMAND += ["--set", "flight.duration_s=4"]
LONGEST_S = 120.0


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """The command with its page up: process, and the line it printed."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as running:
        watchdog = threading.Timer(LONGEST_S, running.kill)
        watchdog.start()
        yield running, running.stdout.readline()
        running.kill()
        watchdog.cancel()


def test_it_prints_an_address_and_the_way_to_it_from_elsewhere(opened, tmp_path):
    _, line = opened
    url, port = re.search(
        r"Open (http://127\.0\.0\.1:(\d+)/[\w-]{32}/) in a browser", line
    ).groups()
    assert f"ssh -L {port}:127.0.0.1:{port} HOST" in line
    with urllib.request.urlopen(url, timeout=LONGEST_S) as answer:
        assert answer.status == 200
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("number", ["SIGTERM", pytest.param("SIGINT", marks=pytest.mark.counts)])
def test_a_signal_ends_the_page(opened, number):
    running, line = opened
    port = int(re.search(r":(\d+)/", line)[1])
    children = psutil.Process(running.pid).children(recursive=True)
    running.send_signal(signal.Signals[number])
    assert running.wait(LONGEST_S) == 0
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0
    assert not any(child.is_running() for child in children)


def test_a_signal_ends_the_processes_of_a_search_too(opened):
    running, line = opened
    url, port = re.search(r"Open (http://127\.0\.0\.1:(\d+)/[\w-]+/)", line).groups()
    asked = {"doing": "meet", "window": "w", "values": {}}
    headers = {"Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}
    begin = urllib.request.Request(f"{url}begin", json.dumps(asked).encode(), headers)
    with urllib.request.urlopen(begin, timeout=LONGEST_S) as answer:
        assert json.load(answer) is None
    children = []
    while not children:
        children = psutil.Process(running.pid).children(recursive=True)
        assert running.poll() is None
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    assert running.wait(LONGEST_S) == 0
    _, alive = psutil.wait_procs(children, LONGEST_S)  # one that was starting ends soon after
    assert alive == []
