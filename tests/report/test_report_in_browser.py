"""The page as a browser shows it: on a desk, on a phone, on paper."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from flighttune.report.facts import facts_of
from flighttune.report.guarantee_panels import certificate_panels
from flighttune.report.panels import tracking

DESK, PHONE, NARROW = 1280, 390, 320
"""Widths in pixels; 390 is a phone of today, 320 the narrowest still in use."""

FLAT = 3.0
"""Standard deviation of the pixels of a screen that shows nothing."""

SCREEN = 1000
"""Height of a screen in pixels."""

PICTURE_WIDTH = 260
SAME_PICTURE = 1.5
"""Mean difference of grey levels (of 255) between two pictures that show the same; a shift by one
pixel makes 5, a missing line 3."""

BROWSER_ITSELF = "not an origin"
"""Who the log of the browser names for requests that no page made."""

POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
TELL = """<script>addEventListener("load", () => setTimeout(() => {
  const page = document.documentElement;
  const wide = [...document.querySelectorAll("body *")].filter(
    e => !e.closest(".scroll, pre, svg") && e.getBoundingClientRect().right > page.clientWidth + 1
  ).map(e => e.tagName + "." + e.className);
  const cut = [...document.querySelectorAll("h1, h2, h3, li, p, .legend span")].filter(
    e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline");
  parent.postMessage({width: page.clientWidth, needs: page.scrollWidth, wide: wide,
    cut: cut.map(e => e.textContent), images: [...document.images].map(i => i.naturalWidth)}, "*");
}, 100));</script>"""
FRAMES = """<!doctype html><meta charset="utf-8"><title>[]</title><body>{frames}<script>
const told = [];
addEventListener("message", event => {{ told.push(event.data);
  document.title = JSON.stringify(told); }});</script>"""


@pytest.fixture(scope="module")
def told(chromium, page, tmp_path_factory):
    """What the page says of itself, by the width it is shown at."""
    folder = tmp_path_factory.mktemp("frames")
    (folder / "page.html").write_text(POLICY.sub("", page) + TELL, encoding="utf-8")
    frames = "".join(
        f'<iframe src="page.html" width={width} height={SCREEN} style="border:0"></iframe>'
        for width in (DESK, PHONE, NARROW)
    )
    (folder / "frames.html").write_text(FRAMES.format(frames=frames), encoding="utf-8")
    shown = chromium("--window-size=2200,1000", "--dump-dom", folder / "frames.html")
    title = re.search(r"<title>(.*?)</title>", shown, re.DOTALL).group(1)
    return {one["width"]: one for one in json.loads(html.unescape(title))}


@pytest.mark.parametrize("width", [DESK, PHONE, NARROW])
def test_the_page_fits_its_width_and_cuts_no_text_off(told, width):
    assert told[width]["needs"] <= width
    assert told[width]["wide"] == []
    assert told[width]["cut"] == []


def test_every_picture_is_shown(told, page):
    sizes = told[DESK]["images"]

    assert len(sizes) == page.count("<img ")
    assert min(sizes) > 300


def asked_by_the_page(chromium, page, log):
    """Addresses that a page asks for outside its file; the browser itself has no origin."""
    chromium(f"--log-net-log={log}", "--dump-dom", page)
    told = json.loads(log.read_text(encoding="utf-8"))
    kind = told["constants"]["logSourceType"]["URL_REQUEST"]
    asked = [
        event["params"]
        for event in told["events"]
        if event["source"]["type"] == kind and "initiator" in event.get("params", {})
    ]
    urls = {params["url"] for params in asked if params["initiator"] != BROWSER_ITSELF}
    return {url for url in urls if not url.startswith(("file:", "data:"))}


def test_no_request_leaves_the_machine(chromium, written, tmp_path):
    outside = "http://127.0.0.1:9/outside.png"
    (tmp_path / "outside.html").write_text(f'<img src="{outside}">', encoding="utf-8")

    assert asked_by_the_page(chromium, tmp_path / "outside.html", tmp_path / "a.json") == {outside}
    assert asked_by_the_page(chromium, written.path, tmp_path / "b.json") == set()


def screenshot(chromium, page, path, *, width, height):
    chromium(f"--window-size={width},{height}", f"--screenshot={path}", page)
    return np.asarray(Image.open(path).convert("L"), dtype=float)


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
