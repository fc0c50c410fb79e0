"""Opening a recording: a window where there is a screen, else a browser on this machine only."""

import socket
import urllib.request

import pytest

from flighttune.errors import RecordingError
from flighttune.recording.rrd import write_recording
from flighttune.recording.view import DISPLAYS, has_screen, view
from flighttune.recording.viewer import ViewerProcess, free_port


@pytest.fixture
def without_screen(monkeypatch):
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("CI", "true")


@pytest.fixture(scope="module")
def recording(four_runs, tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "flight.rrd"
    write_recording(four_runs, path, page="# Page\n", title="Flight")
    return path


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
