"""How a process ended."""

import pytest

from flighttune.errors import crash_of


@pytest.mark.parametrize(
    ("code", "name"), [(0, ""), (3, ""), (-11, "SIGSEGV"), (-250, "signal 250")]
)
def test_a_crash_is_named(code, name):
    assert crash_of(code) == name
