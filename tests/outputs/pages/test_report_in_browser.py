"""The page as a browser shows it: on a desk, on a phone, on paper."""

import html
import json
import re

import numpy as np
import pytest
from browser import (
    DESK,
    FLAT,
    NARROW,
    PHONE,
    POLICY,
    SCREEN,
    TABLET,
    asked_by_the_page,
    screenshot,
    told_at_widths,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def told(chromium, page, tmp_path_factory):
    """What the page says of itself, by the width it is shown at."""
    return told_at_widths(chromium, page, tmp_path_factory.mktemp("frames"))


@pytest.mark.soak
@pytest.mark.parametrize(("width", "columns"), [(DESK, 2), (TABLET, 2), (PHONE, 1), (NARROW, 1)])
def test_the_page_fits_its_width_and_cuts_no_text_off(told, width, columns):
    """Charts stand side by side down to a small tablet; on a phone tables are cards."""
    shown = told[width]
    assert shown["needs"] <= width
    assert (shown["wide"], shown["cut"], shown["columns"]) == ([], [], columns)
    assert columns == 2 or shown["sideways"] == []


@pytest.mark.soak
def test_no_request_leaves_the_machine(chromium, written, tmp_path):
    outside = "http://127.0.0.1:9/outside.png"
    (tmp_path / "outside.html").write_text(f'<img src="{outside}">', encoding="utf-8")

    assert asked_by_the_page(chromium, tmp_path / "outside.html", tmp_path / "a.json") == {outside}
    assert asked_by_the_page(chromium, written.path, tmp_path / "b.json") == set()


@pytest.mark.soak
def test_no_screen_of_the_page_is_empty(chromium, written, tmp_path):
    grey = screenshot(chromium, written.path, tmp_path / "desk.png", width=DESK, height=SCREEN)

    assert grey.shape == (SCREEN, DESK)
    for top in range(0, SCREEN, SCREEN // 2):
        assert grey[top : top + SCREEN // 2].std() > FLAT


@pytest.mark.soak
def test_the_page_prints_on_a_few_sheets(chromium, written, tmp_path):
    sheets = tmp_path / "report.pdf"
    chromium("--no-pdf-header-footer", f"--print-to-pdf={sheets}", written.path)

    data = sheets.read_bytes()
    assert data.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", data)) <= 5


POINTED = """<script>addEventListener("load", () => setTimeout(() => {
  const charts = [...document.querySelectorAll("svg.chart[data-linked]")];
  const box = charts[0].querySelector("svg.plot path.grid").getBoundingClientRect();
  charts[0].dispatchEvent(new PointerEvent("pointermove",
    {clientX: box.left + box.width / 2, clientY: box.top + 5}));
  const cursors = charts.map(c => c.querySelector(".cursor")?.getAttribute("d") ?? "");
  const tip = document.getElementById("tip").innerText;
  const run = document.querySelector("button[data-run]");
  run.click();
  const hidden = [...document.querySelectorAll("svg [data-run]")].filter(
    e => getComputedStyle(e).display === "none").map(e => e.dataset.run);
  document.title = JSON.stringify({cursors, tip, run: run.dataset.run, hidden});
}, 200));</script>"""


@pytest.mark.soak
def test_the_pointer_shows_values_in_all_charts_over_time_and_the_legend_hides_runs(
    chromium, page, flown_paper, tmp_path
):
    path = tmp_path / "pointed.html"
    path.write_text(POLICY.sub("", page) + POINTED, encoding="utf-8")

    shown = chromium("--window-size=1280,1000", "--dump-dom", path)

    title = re.search(r"<title>(.*?)</title>", shown, re.DOTALL).group(1)
    found = json.loads(html.unescape(title))
    assert len(set(found["cursors"])) == 1
    assert found["cursors"][0].startswith("M")
    at = dict(line.rsplit(" ", 1) for line in found["tip"].splitlines() if line.strip())
    t = float(at["t [s]"])
    assert t == pytest.approx(10.0, abs=0.2)
    for run in flown_paper.runs:
        course = np.degrees(np.interp(t, run.t, run.signals["chi"]))
        assert float(at[run.label]) == pytest.approx(course, abs=0.3), run.label
    assert set(found["hidden"]) == {found["run"]}
    assert len(found["hidden"]) > 5
