"""Room to turn back: flights that turn back at any place of a route, and the volumes around it."""

import pytest

import flighttune as ft


@pytest.mark.parametrize(
    ("source", "turn_back", "says"),
    [
        ("circuit", "spiral:30", "`turn_back` must be a bank in deg, or circle:BANK"),
        ("circuit", 70, "`turn_back` must be a bank of 1 to 45 deg, got 70"),
        ("mission", 30, "`route` must be given"),
    ],
)
def test_what_cannot_turn_back_is_refused_in_one_line(source, turn_back, says):
    with pytest.raises(ft.InputError, match=says) as refusal:
        ft.mission(source, turn_back=turn_back)
    assert "\n" not in str(refusal.value)
