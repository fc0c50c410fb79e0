"""How a process ended, on systems with signals and on Windows."""

import os

import pytest

from flighttune.processes import crash_of, joined


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (0, ""),
        (3, ""),
        (-11, "SIGSEGV"),
        (-250, "signal 250"),
        (0xC0000005, "exception 0xC0000005"),  # access violation, as Windows numbers it
    ],
)
def test_a_crash_is_named(code, said):
    assert crash_of(code) == said


@pytest.mark.parametrize(
    ("system", "line"),
    [("posix", "fly '--root=C:/My Flights'"), ("nt", 'fly "--root=C:/My Flights"')],
)
def test_a_command_line_is_quoted_for_the_shell_of_the_system(system, line, monkeypatch):
    monkeypatch.setattr(os, "name", system)

    assert joined(["fly", "--root=C:/My Flights"]) == line
