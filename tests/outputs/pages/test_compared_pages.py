"""The page of a comparison with an autopilot, of flights that flew."""

import re

import pytest

from flighttune.outputs.pages.beside import write_beside_page


@pytest.mark.soak
def test_the_page_of_a_comparison_shows_the_draw_with_the_median_error(results, tmp_path):
    """Of two errors the median is the smaller one."""
    beside = results.of("beside")

    written = write_beside_page(beside, tmp_path / "page.html", "flighttune compare")

    shown = written.path.read_text(encoding="utf-8")
    yours = beside.rows[beside.rows["gains"] == "yours"]
    draw = yours.loc[yours["flight.cross_track_m"].idxmin(), "draw"]
    assert written.summary == tuple(beside.answer().summary)
    assert f"One flight with both, draw {draw}" in shown
    assert shown.count(f"Commands of draw {draw}") == 1
    assert {*re.findall('data-run="([^"]*)"', shown)} >= {
        f"jsbsim:aerosonde / {x}" for x in ("yours", "ours")
    }
    assert "NAVL1_PERIOD" in shown
