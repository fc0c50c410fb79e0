"""``flighttune compare`` as a process: answers, exit statuses and one-line reasons."""

import json
import re

import pytest
from commands import flighttune

from flighttune.records.parquet import check_recording


def compare(*arguments, status=0):
    """Run the command; return what it printed on stdout and on stderr."""
    return flighttune("compare", *arguments, status=status)


@pytest.mark.slow
def test_all_runs_are_overlaid_in_one_recording(tmp_path):
    out = tmp_path / "overlay.rrd"

    compare("paper@paper", "paper@tuned", "--out", out)

    check_recording(out)


@pytest.mark.slow
def test_a_page_shows_both_runs_and_how_many_metrics_of_each_are_better(tmp_path):
    out = tmp_path / "compared.html"

    shown, _ = compare("paper_as_printed@paper", "paper_as_printed@K1", "--out", out, "--json")

    found, page = json.loads(shown), out.read_text(encoding="utf-8")
    assert (found["page"], found["recording"]) == (str(out), None)
    better = [row["better"] for row in found["metrics"]]
    (pair,) = found["pairs"]
    assert pair["better"] == {side: better.count(side) for side in ("a", "b", "same")}
    for run in ("kinematic / paper", "kinematic / K1"):
        assert page.count(f'data-name="{run}"') >= 4


def test_another_manoeuvre_is_status_2_and_says_why():
    shown, err = compare("paper@K1", "level_turn@K1", "--json", status=2)

    found = json.loads(shown)
    assert found["comparable"] is False
    assert found["metrics"] == []
    assert found["max_distance_m"] is None
    assert "the manoeuvre must be the same" in found["reason"]
    assert found["reason"] in err


@pytest.mark.slow
def test_one_gain_set_is_not_compared_with_several():
    out, err = compare("paper", "paper@tuned", status=2)

    assert out == ""
    assert err.count("\n") == 1
    assert {"paper@paper", "paper@tuned"} <= set(re.findall(r"paper@\w+", err))
