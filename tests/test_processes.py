"""How a process ended, on systems with signals and on Windows."""

import pytest

from flighttune.processes import crash_of


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
