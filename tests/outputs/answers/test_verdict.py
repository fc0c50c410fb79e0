"""The JSON object of an answer agrees with its exit status."""

import json

import pytest

from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.finding import unmet


@pytest.mark.parametrize(
    ("verdict", "failure", "said"),
    [
        ("", "it is not bounded", "it is not bounded"),
        ("2 of 3", "one missed", "2 of 3"),
        ("", "", ""),
    ],
)
def test_an_answer_that_is_no_has_a_verdict(verdict, failure, said):
    assert json.loads(Answer(verdict=verdict, findings=unmet(failure)).json())["verdict"] == said
