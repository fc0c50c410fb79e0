"""What is asked of the machine: its cores, its screen, and how its processes end."""

import os
import signal

import pytest

from flighttune.base import errors, processors, screen


def test_cores_are_those_of_this_process_or_of_the_machine(monkeypatch):
    monkeypatch.delenv("PYTHON_CPU_COUNT", raising=False)
    assert processors.cores() == len(os.sched_getaffinity(0))
    monkeypatch.delattr(os, "sched_getaffinity")
    assert processors.cores() == os.cpu_count()
    monkeypatch.setattr(os, "cpu_count", lambda: None)  # where nobody knows
    assert processors.cores() == 1


@pytest.mark.parametrize(
    ("system", "display", "has"),
    [
        ("darwin", None, True),
        ("win32", None, True),
        ("linux", None, False),
        ("linux", "DISPLAY", True),
        ("linux", "WAYLAND_DISPLAY", True),
        ("linux", "WAYLAND_SOCKET", True),
    ],
)
def test_a_window_needs_a_display_but_on_macos_and_windows(monkeypatch, system, display, has):
    for name in screen.DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    if display is not None:
        monkeypatch.setenv(display, ":0")
    monkeypatch.setattr("sys.platform", system)

    assert screen.has_screen() is has


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (0, "exit status 0"),
        (3, "exit status 3"),
        (-signal.SIGKILL, "SIGKILL"),
        (-(signal.SIGRTMIN + 1), f"signal {signal.SIGRTMIN + 1}"),
    ],
)
def test_an_end_of_a_process_is_its_exit_status_or_its_signal(code, said):
    assert errors.ending_of(code) == said
