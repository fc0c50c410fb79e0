"""What the answer of a tube states: widths, disturbances, and limits that act."""

import math
from dataclasses import replace

import pytest
from made_up_tubes import tube, tube_scenario

import flighttune as ft
from flighttune.claims.tubes.enclosure import CountedProbability
from flighttune.claims.tubes.tube import TriedDisturbances
from flighttune.outputs.answers import tube as answers

D = 0.002
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def found():
    """Half a second of a flight that starts nearly on its course, under disturbed rates."""
    scenario = tube_scenario(chi_err_deg=0.3, gamma_deg=15.2, duration_s=0.4, rate_hz=12.5)
    return tube(scenario, ft.PAPER_GAINS, disturbance=D, for_ever=False)


def test_the_tables_of_a_tube_have_its_flights_in_their_units(found):
    said = found.answer("paper")

    widths, flights, disturbed, limits, gains, _ = said.tables
    assert widths.title == '"Straight on"; gains paper, the paper\'s law: bounded'
    assert widths.records == [{"error": key, **row} for key, row in found.half_widths.items()]
    (row,) = flights.records
    assert [row[x] for x in ("duration_s", "V_a_mps", "rate_hz", "within")] == [0.4, 25, 12.5, 0]
    assert row["start"] == pytest.approx({"chi": math.radians(0.3), "gamma": math.radians(15.2)})
    assert row["end"] == pytest.approx({"chi": 0.0, "gamma": math.radians(15.0)})
    assert disturbed.records == [{"channel": x, "low": -D, "high": D} for x in ("chi", "gamma")]
    roll, lift = limits.records
    assert [roll[x] for x in answers.LIMIT_KEYS] == pytest.approx([-45.0, 45.0, -30.0, 30.0])
    assert [lift[x] for x in answers.LIMIT_KEYS] == pytest.approx([-2.1, 2.1, -1.0, 1.0])
    assert (roll["held_s"], lift["held_s"]) == ("never", "never")
    assert gains.records[1]["P"] == [-0.5906, 1.9556]
    assert said.verdict == found.sentence
    assert said.failure == ""
    assert said.values["inside"] is True
    assert said.values["disturbance_rad_s"] == [[-D, -D], [D, D]]
    assert said.values["half_width_deg"] == found.half_widths
    assert said.values["limits_can_hold"] == {"phi_cmd": [], "n_z_cmd": []}
    assert found.answer().tables[0].title == '"Straight on"; the paper\'s law: bounded'


def test_limits_that_act_from_the_start_are_said_with_their_times():
    """60 deg off its course the law commands more than 45 deg of roll."""
    turning = tube(tube_scenario(duration_s=0.4, rate_hz=12.5), ft.PAPER_GAINS, for_ever=False)

    roll, _ = turning.answer().tables[3].records

    assert roll["held_s"] == ["0 to 0.4"]
    assert answers.disturbances(turning.problem)[1].tolist() == [0.0, 0.0]


def test_what_a_tube_does_not_claim_is_in_its_notes(found):
    lost = replace(found, status="unbounded", reason="it is lost from 0.2 s on")

    (note,) = found.answer().notes
    assert note.startswith("Nothing is claimed beyond the end of the scenario")
    said = lost.answer()
    assert (said.verdict, said.failure) == ("", "it is lost from 0.2 s on")
    assert said.notes == []
    assert said.values["status"] == "unbounded"


def test_a_counted_probability_is_in_the_last_note(found, monkeypatch):
    counted = CountedProbability(of="flight", at_most=0.05, confidence=0.95)
    monkeypatch.setattr(type(found), "probability", counted)

    note = found.answer().notes[-1]

    leaves = "a flight of the distribution counted leaves the tube with probability at most 0.05"
    assert note == f"{leaves}, confidence 0.95"


def test_a_search_states_the_largest_disturbance_whose_set_is_bounded(found):
    lost = replace(found, status="unbounded", reason="it is lost")
    tried = {0.001: found, 0.0042: found, 0.0043: lost, 0.01: lost}

    said = TriedDisturbances(tried=tried).answer()

    assert said.verdict == "largest disturbance for which the set is bounded: 0.0042 rad/s"
    assert (said.failure, said.values) == ("", {"largest_disturbance": 0.0042})
    rows = [(x["disturbance"], x["status"], x["reason"]) for x in said.tables[0].records]
    assert rows[1:3] == [(0.0042, "bounded", ""), (0.0043, "unbounded", "it is lost")]
    none = TriedDisturbances(tried={0.001: lost}).answer()
    assert none.verdict == ""
    assert none.failure == "for no disturbance tried the set is bounded."
    assert none.values == {"largest_disturbance": None}
