"""``flighttune compare`` as a process: answers, exit statuses and one-line reasons."""

import json

import pytest
from commands import answer, flighttune


@pytest.mark.soak
def test_a_page_shows_both_runs_and_how_many_metrics_of_each_are_better(tmp_path):
    out = tmp_path / "compared.html"

    found = answer("compare", "paper_as_printed@paper", "paper_as_printed@K1", "--out", out)

    assert (found["page"], found["recording"]) == (str(out), None)
    better = [row["better"] for row in found["metrics"]]
    (pair,) = found["pairs"]
    assert pair["better"] == {side: better.count(side) for side in ("a", "b", "same")}
    page = out.read_text(encoding="utf-8")
    for run in ("kinematic / paper", "kinematic / K1"):
        assert page.count(f'data-name="{run}"') >= 4


def test_another_manoeuvre_is_status_2_and_says_why():
    shown, err = flighttune("compare", "paper@K1", "level_turn@K1", "--json", status=2)

    found = json.loads(shown)
    assert found["comparable"] is False
    assert found["metrics"] == []
    assert found["max_distance_m"] is None
    assert "the manoeuvre must be the same" in found["reason"]
    assert found["reason"] in err
