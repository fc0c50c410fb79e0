"""Sentences on a search for gains that meet requirements."""

import pytest

from flighttune.outputs.answers.meeting import subject


@pytest.mark.parametrize(
    ("run", "words"),
    [("by default", "phase margin (by default)"), ("kinematic", "phase margin on kinematic")],
)
def test_a_margin_that_is_required_by_default_is_on_no_run(run, words):
    assert subject({"measure": "loop.phase_margin_deg", "run": run}) == words
