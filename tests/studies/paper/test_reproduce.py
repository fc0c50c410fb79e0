"""The whole reproduction: its page, and errata that are the committed ones."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from browser import DESK, PHONE, WIDE, headless_chromium, told_at_widths
from places import ROOT

pytestmark = pytest.mark.soak

ROUNDING = 2e-3
"""Of a number in the text of the errata, relative: they are given to three digits or more."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def whole(make):
    return make()


def test_the_committed_errata_are_those_computed_now(whole):
    now = (whole.folder / "errata.md").read_text("utf-8")
    committed = (ROOT / "docs/errata.md").read_text("utf-8")

    assert NUMBER.sub("#", now) == NUMBER.sub("#", committed)
    new, old = (np.array(NUMBER.findall(text), dtype=float) for text in (now, committed))
    assert new == pytest.approx(old, rel=ROUNDING, abs=1e-9)


def test_the_page_needs_nothing_but_itself_and_has_claims_first_and_every_figure(whole, tmp_path):
    html = (whole.folder / "index.html").read_text("utf-8")

    assert all(
        x.startswith(("data:", "#")) for x in re.findall(r'(?:src|href)="([^"]{0,40})', html)
    )
    assert not re.search(r"@import|url\(", html)
    places = [html.index(f'id="{name}"') for name in ("claims", *whole.values)]
    assert places == sorted(places)
    assert all(f'id="claim-{name}"' in html for name in whole.claims)
    charts = [
        chart
        for file in whole.folder.glob("*.svg")
        for chart in ElementTree.parse(file).iter()
        if chart.get("class") == "chart"
    ]
    assert html.count('<svg class="chart"') == len(charts) > 30
    told = told_at_widths(headless_chromium(), html, tmp_path)
    for width in (WIDE, DESK, PHONE):
        assert told[width]["overlaps"] == [], width
        assert told[width]["wide"] == [], width
