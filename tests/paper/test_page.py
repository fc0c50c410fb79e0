"""The page: complete, by itself, and readable in a real browser."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from flighttune.paper.claims import CLAIMS
from flighttune.paper.items import ITEMS

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
SIZE = 1200, 2600
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
VERDICT_GROUNDS = {
    "reproduced": (0xD9, 0xF2, 0xE4),
    "partly": (0xFD, 0xEC, 0xCB),
    "not reproduced": (0xFB, 0xDA, 0xDD),
    "not checkable": (0xE6, 0xE9, 0xEC),
}
"""Colours of the four verdicts on the page."""


@pytest.fixture(scope="module")
def html(reproduction):
    return reproduction[0].page.read_text(encoding="utf-8")


def test_the_page_needs_nothing_but_itself(html):
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', html)

    assert len(sources) > len(ITEMS)
    assert all(source.startswith(("data:image/svg+xml;base64,", "#")) for source in sources)
    assert "@import" not in html
    assert "url(" not in html


def test_claims_come_first_and_each_has_a_row(html):
    assert html.index('id="claims"') < html.index('id="fig3"')
    for claim in CLAIMS:
        assert f'id="claim-{claim.id}"' in html


def test_every_item_has_its_figures_on_the_page(html, reproduction):
    for one in reproduction[0].items:
        assert f'id="{one.item.name}"' in html
    figures = sum(len(one.made.figures) for one in reproduction[0].items)
    assert html.count("<img ") == figures


def browser():
    """The browser; without one the test is skipped, except on a machine that must have it."""
    if CHROMIUM is None:
        reason = "chromium is not installed (Debian: apt-get install chromium)"
        if os.environ.get("CI", "").lower() == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return CHROMIUM


def run(tmp_path, page, *options):
    done = subprocess.run(
        [browser(), *QUIET, f"--user-data-dir={tmp_path / 'profile'}", *options, page.as_uri()],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_a_browser_shows_the_claims_with_their_verdicts_in_colour(reproduction, tmp_path):
    image = pytest.importorskip("PIL.Image")
    picture = tmp_path / "page.png"

    run(
        tmp_path,
        reproduction[0].page,
        f"--window-size={SIZE[0]},{SIZE[1]}",
        f"--screenshot={picture}",
    )

    seen = np.asarray(image.open(picture).convert("RGB")).astype(int)
    assert seen.shape[:2] == SIZE[::-1]
    for verdict, colour in VERDICT_GROUNDS.items():
        near = np.abs(seen - colour).max(axis=-1) <= 2
        assert near.sum() > 500, verdict
    ink = seen.sum(axis=-1) < 300
    assert ink[:, : SIZE[0] // 2].any(axis=1).mean() > 0.2
    assert ink[:, SIZE[0] // 2 :].any(axis=1).mean() > 0.2


def test_a_browser_finds_every_figure_drawn_and_nothing_wider_than_the_page(reproduction, tmp_path):
    probe = (
        "<script>addEventListener('load', () => { document.body.dataset.broken = "
        "[...document.images].filter(i => !i.naturalWidth).length; "
        "document.body.dataset.over = document.documentElement.scrollWidth - innerWidth; "
        "document.body.dataset.tables = document.querySelectorAll('.claims tbody').length; });"
        "</script></body>"
    )
    page = tmp_path / "probed.html"
    page.write_text(reproduction[0].page.read_text("utf-8").replace("</body>", probe), "utf-8")

    dom = run(tmp_path, page, f"--window-size={SIZE[0]},{SIZE[1]}", "--dump-dom")

    found = dict(
        re.findall(r'data-(broken|over|tables)="(-?\d+)"', dom[dom.index("<body") :][:300])
    )
    assert found["broken"] == "0"
    assert int(found["over"]) <= 0
    assert int(found["tables"]) == len(CLAIMS)
