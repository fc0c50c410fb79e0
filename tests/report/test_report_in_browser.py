"""The page as a browser shows it: on a desk, on a phone, on paper."""

import re
from pathlib import Path

import numpy as np
import pytest
from browser import DESK, FLAT, NARROW, PHONE, SCREEN, asked_by_the_page, screenshot, told_at_widths
from PIL import Image

from flighttune.report.facts import facts_of
from flighttune.report.guarantee_panels import certificate_panels
from flighttune.report.panels import tracking

pytestmark = pytest.mark.slow

PICTURE_WIDTH = 260
SAME_PICTURE = 1.5
"""Mean difference of grey levels (of 255) between two pictures that show the same; a shift by one
pixel makes 5, a missing line 3."""


@pytest.fixture(scope="module")
def told(chromium, page, tmp_path_factory):
    """What the page says of itself, by the width it is shown at."""
    return told_at_widths(chromium, page, tmp_path_factory.mktemp("frames"))


@pytest.mark.parametrize("width", [DESK, PHONE, NARROW])
def test_the_page_fits_its_width_and_cuts_no_text_off(told, width):
    assert told[width]["needs"] <= width
    assert told[width]["wide"] == []
    assert told[width]["cut"] == []


def test_every_picture_is_shown(told, page):
    sizes = told[DESK]["images"]

    assert len(sizes) == page.count("<img ")
    assert min(sizes) > 300


def test_no_request_leaves_the_machine(chromium, written, tmp_path):
    outside = "http://127.0.0.1:9/outside.png"
    (tmp_path / "outside.html").write_text(f'<img src="{outside}">', encoding="utf-8")

    assert asked_by_the_page(chromium, tmp_path / "outside.html", tmp_path / "a.json") == {outside}
    assert asked_by_the_page(chromium, written.path, tmp_path / "b.json") == set()


def test_no_screen_of_the_page_is_empty(chromium, written, tmp_path):
    grey = screenshot(chromium, written.path, tmp_path / "desk.png", width=DESK, height=4 * SCREEN)

    assert grey.shape == (4 * SCREEN, DESK)
    for top in range(0, 4 * SCREEN, SCREEN // 2):
        assert grey[top : top + SCREEN // 2].std() > FLAT


def test_the_page_prints_on_a_few_sheets(chromium, written, tmp_path):
    sheets = tmp_path / "report.pdf"
    chromium("--no-pdf-header-footer", f"--print-to-pdf={sheets}", written.path)

    data = sheets.read_bytes()
    assert data.startswith(b"%PDF")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", data)) <= 12


def test_pictures_are_those_that_were_looked_at(chromium, printed_source, tmp_path):
    facts = facts_of(printed_source)
    pictures = {"course": tracking(facts)[0], "certificate": certificate_panels(facts)[0]}

    for name, picture in pictures.items():
        page = tmp_path / f"{name}.html"
        page.write_text(f'<body style="margin:0"><img width={PICTURE_WIDTH} src="{picture.uri}">')
        shot = tmp_path / f"{name}.png"
        shown = screenshot(chromium, page, shot, width=500, height=150)[:, :PICTURE_WIDTH]

        kept = Path(__file__).parents[1] / "reference" / "report" / f"{name}.png"
        reference = np.asarray(Image.open(kept).convert("L"), dtype=float)
        assert np.abs(shown - reference).mean() < SAME_PICTURE, f"{shot} is not {kept}"
