"""``flighttune report`` as a process."""

import json

import pytest
from commands import flighttune


def report(*arguments, status=0):
    """Run the command; return what it printed on stdout and on stderr."""
    return flighttune("report", *arguments, status=status)


@pytest.mark.slow
def test_a_scenario_becomes_a_page_whose_summary_is_printed(tmp_path):
    out = tmp_path / "sent" / "report.html"

    shown, err = report("paper_as_printed", "-o", out, "--json")

    found = json.loads(shown)
    assert err == ""
    assert found["report"] == str(out)
    assert found["bytes"] == out.stat().st_size
    assert len(found["summary"]) == 2
    assert {"tracking", "convergence", "certificates"} <= found["tables"].keys()
    assert out.read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("nowhere",), "nowhere: the scenario must be a file or one of"),
        (("paper", "-o", "report.pdf"), "report.pdf: --out must end in .html"),
    ],
)
def test_what_cannot_be_reported_is_status_2_with_one_line(arguments, reason):
    _, err = report(*arguments, status=2)

    assert err.startswith(f"flighttune: {reason}")
    assert err.count("\n") == 1
