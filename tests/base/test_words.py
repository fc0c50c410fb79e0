"""Sentences of answers, and numbers as they are written."""

import math

import pytest

from flighttune.base import endings, words
from flighttune.base.signals import SIGNAL_UNITS


@pytest.mark.parametrize(
    ("note", "said"),
    [
        ("adopted in 31 s", "Adopted in 31 s."),
        ("phi has no interval", "phi has no interval."),
        ("kinematic / paper: two of four", "kinematic / paper: two of four."),
        ("vtol: 1 of 3 flights ended early.", "vtol: 1 of 3 flights ended early."),
        ("n_z is 0 throughout", "n_z is 0 throughout."),
        ("fly one again: flighttune verify m.npz --run 21",) * 2,
        ("", ""),
    ],
)
def test_a_note_is_a_sentence_and_a_command_can_be_copied(note, said):
    assert words.sentence(note) == said


# A function, and pairs of its arguments and the text that it writes
WRITTEN = [
    (words.number, [((2.0 / 3.0,), "0.6667"), ((math.inf,), "∞"), ((-math.inf,), "−∞"),
                    ((math.nan,), "–"), ((2.0, ".1f"), "2.0")]),
    # A bound is rounded to its own side, however little is lost.
    (words.at_most, [((1.23401,), "1.235"), ((1.234,), "1.234"), ((-1.2349,), "-1.234"),
                     ((0.0999999,), "0.1"), ((0.0,), "0"), ((math.inf,), "∞"),
                     ((0.1201, 2), "0.13")]),
    (words.at_least, [((1.23499,), "1.234"), ((-1.2341,), "-1.235"), ((9999.9,), "9999"),
                      ((0.1299, 2), "0.12")]),
    (words.confidence_text, [((0.95,), "0.95"), ((0.999,), "0.999"), ((0.99987,), "0.99987"),
                             ((0.9876543,), "0.987")]),
    (words.figures, [((1234.5,), "1234"), ((999.6,), "1e+03"), ((-0.012345,), "-0.0123"),
                     ((1000.0,), "1000"), ((-2000.4,), "-2000")]),
    (words.interval, [((4.63, 4.25, 4.894), "4.63 [4.25, 4.89]"), ((math.nan, 1.0, 2.0), "–"),
                      ((4.63, -math.inf, 4.89), "4.63 [<= 4.89]"),
                      ((4.63, 4.25, math.inf), "4.63 [>= 4.25]"),
                      ((4.63, -math.inf, math.inf), "4.63 [−∞, ∞]")]),
    (words.percent, [((0.5,), "50.0"), ((0.0,), "0"), ((1.0,), "100"), ((0.001,), "0.1"),
                     ((0.0009,), "0.09"), ((0.9999,), "99.99"), ((0.00001,), "0.001"),
                     ((0.999991,), "99.999"), ((math.nan,), "–")]),
    (words.p_value, [((0.0312,), "0.031"), ((1e-4,), "0.0001"), ((9.9e-5,), "< 0.0001")]),
    (words.half_width, [((0.0,), "0"), ((9e-5,), "< 0.0001"), ((1e-4,), "0.0001"),
                        ((0.123456,), "0.1235"), ((math.nan,), "–")]),
    (words.matrix, [(([[1.0, -0.00001], [2.0, 3.14159]],), "[1.0000, 0.0000; 2.0000, 3.1416]")]),
    (words.listed, [(([],), ""), ((["a"],), "a"), ((["a", "b"], "or"), "a or b"),
                    ((["a", "b", "c"],), "a, b and c"),
                    ((["a", "b", "c", "d"], "and", 2), "a, b and 2 more"),
                    ((["a", "b"], "and", 2), "a and b")]),
    (words.rate, [((0.012345,), "0.0123"), ((99.96,), "100"), ((100.4,), "100"),
                  ((2345.6,), "2346")]),
    (words.duration, [((0.123,), "0.12 s"), ((9.96,), "10 s"), ((10.4,), "10 s"),
                      ((119.4,), "119 s"), ((120.0,), "2 min"), ((7199.0,), "120 min"),
                      ((7200.0,), "2.0 h"), ((12_240.0,), "3.4 h")]),
    (words.quoted, [(('a "b"\n c',), "\"a 'b' c\"")]),
    (words.told_apart, [((1.0, 1.0), ("1", "1")), ((1.00001, 1.00002), ("1.00001", "1.00002")),
                        ((1.5, 2.5), ("1.5", "2.5"))]),
]  # fmt: skip


@pytest.mark.parametrize(("write", "cases"), WRITTEN, ids=lambda x: getattr(x, "__name__", ""))
def test_numbers_and_names_are_written_as_documented(write, cases):
    for values, text in cases:
        assert write(*values) == text


def test_names_that_repeat_are_numbered_past_those_that_are_taken():
    assert words.distinct(["a", "b", "a", "a", "a_2"]) == ["a", "b", "a_2", "a_3", "a_2_2"]


def test_endings_are_counted_by_status_and_by_reasons_that_differ_in_numbers_alone():
    """The most frequent status comes first, then its most frequent reason, then the first run."""
    rows = [
        {"run": 4, "status": "crashed", "reason": "t = 3 s: ground at -1.5 m"},
        {"run": 0, "status": "left", "reason": "too slow"},
        {"run": 2, "status": "crashed", "reason": "t = 12 s: ground at 2e1 m"},
        {"run": 3, "status": "crashed", "reason": "a4 fell"},
        {"run": 1, "status": "crashed", "reason": "x8 fell"},
        {"run": 5, "status": "crashed", "reason": ""},
    ]

    found = endings.endings(rows)

    assert found == [
        {
            "status": "crashed", "count": 2, "run": 2,
            "reason": "t = 3 to 12 s: ground at -1.5 to 2e1 m",
        },
        {"status": "crashed", "reason": "x8 fell", "count": 1, "run": 1},
        {"status": "crashed", "reason": "a4 fell", "count": 1, "run": 3},
        {"status": "left", "reason": "too slow", "count": 1, "run": 0},
    ]  # fmt: skip
    assert endings.why_ended(rows[1:2]) == " 1 left: too slow"


def test_a_sentence_that_begins_with_a_signal_keeps_its_case():
    words_too = {"aileron", "elevator", "rudder", "throttle", "along", "thrust"}
    for signal in SIGNAL_UNITS.keys() - words_too:
        assert words.sentence(f"{signal} is unlike the course").startswith(f"{signal} ")
