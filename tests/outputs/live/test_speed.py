"""How soon a picture follows a move, in time of the processor: other programs do not count."""

import statistics
import time

import pytest

import flighttune as ft
from flighttune.base.files import code
from flighttune.outputs.live import desk

pytestmark = pytest.mark.slow

TURN = {"flight.duration_s": 20.0}


def seconds_of_a_move(folder, moves=9):
    """Median time of the processor from a move of a gain to the pieces of the page, 20 s flown."""
    page = desk.Desk(ft.flights("level_turn", changes=TURN), None, folder)
    taken = []
    for number in range(moves + 3):
        began = time.process_time()
        ghosts = [{"name": "start", "values": {}}]
        values = {"gains[0].K_P[0][0]": 1.0 + 0.01 * number}
        shown = page.picture({"window": "w", "number": number, "values": values, "ghosts": ghosts})
        taken.append(time.process_time() - began)
        assert shown["charts"].count("<figure") == 6
    return statistics.median(taken[3:])


def test_a_compiled_flight_is_drawn_within_a_tenth_of_a_second(tmp_path):
    assert seconds_of_a_move(tmp_path) < 0.1


def test_a_flight_of_jsbsim_is_drawn_within_three_tenths(tmp_path, monkeypatch):
    monkeypatch.setenv(code.JSBSIM, "1")
    assert seconds_of_a_move(tmp_path) < 0.3
