"""Sentences of answers."""

import pytest

from flighttune.base.words import sentence


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
    assert sentence(note) == said
