"""Every kind of page in a browser, wide, on a desk and on a phone: no text lies on another.

That of the reproduction is in studies/paper/test_reproduce.py.
"""

import re

import pytest
from browser import DESK, PHONE, SCREEN, WIDE, chromium_at_real_speed, told_at_widths, told_in_a_tab
from commands import flighttune
from log_files import heavy_cessna, sampled, write_csv
from plans import plan_file, waypoint

FEW = "--epsilon 0.5 --confidence 0.9"

# Commands that make a page, and its file.
PAGES = {
    "runs": ("fly paper --out paper", "report paper -o page.html"),
    "comparison": ("compare paper@paper paper@tuned --out page.html",),
    "gap": ("gap paper --out .", "gap.html"),
    "log": ("report log.csv -o page.html",),
    "campaign": ("campaign first_campaign --runs 8 --out flown", "report flown -o page.html"),
    "certificate": ("certify paper --out c.json", "report c.json -o page.html"),
    "bound": ("tune paper --prove b.json", "report b.json -o page.html"),
    "tube": (
        "tube level_turn --gains paper --set flight.duration_s=2.5 --out t.npz",
        "report t.npz -o page.html",
    ),
    "band": (
        f"band level_turn --start-deg 2 --plant kinematic --learn 10 {FEW} --out b.npz",
        "report b.npz -o page.html",
    ),
    "monitor": (
        f"monitor level_turn --start-deg 2 --plant kinematic --learn 20 {FEW} --out m.npz",
        "report m.npz -o page.html",
    ),
    "mission": (f"mission m.plan --turn-back 30 {FEW} --page page.html --out m.npz",),
    "beside": ("compare m.plan --with my.parm --flights 2 --out page.html",),
    "tuned": ("tune paper --page page.html",),
    "met": ("meet paper_identified --budget 4 --page page.html",),
    "adoption": ("adopt J3Cub --out adopted", "adopted/adoption.html"),
}


SEEN = "runs", "gap", "campaign", "band", "certificate", "met"
"""Kinds that CI looks at; the others have the same parts, or take long to make."""
CORNERS = (47.395, 8.49), (47.41, 8.49), (47.41, 8.52), (47.395, 8.52)
MISSION = [waypoint(*place, 300) for place in ((47.4, 8.5), (47.402, 8.5), (47.402, 8.504))]
FENCE = {"version": 2, "circles": [], "polygons": [{"inclusion": True, "polygon": CORNERS}]}

# Two texts whose places are the same, and two beside each other.
TWICE = """
<div style="position:relative"><b>one</b><i style="position:absolute;left:0px">two</i></div>
<div style="position:relative"><b>1</b><i style="position:absolute;left:200px">2</i></div>
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The text of a page of a kind, which is made once, in a folder of its own."""
    texts = {}

    def page(kind):
        if kind not in texts:
            folder = tmp_path_factory.mktemp(kind)
            plan_file(folder / "m.plan", *MISSION, geoFence=FENCE)
            (folder / "my.parm").write_text("NAVL1_PERIOD 14\nROLL_LIMIT_DEG 45\n")
            if kind == "log":
                write_csv(folder / "log.csv", *sampled(heavy_cessna(30.0)))
            *commands, last = PAGES[kind]
            file = last if last.endswith(".html") and " " not in last else "page.html"
            with pytest.MonkeyPatch.context() as patch:
                for few in ("LEARN", "LEARN_TURNS"):
                    patch.setattr(f"flighttune.claims.mission.{few}", 10)
                for command in commands if file == last else PAGES[kind]:
                    flighttune(*command.split(), cwd=folder)
            texts[kind] = (folder / file).read_text(encoding="utf-8")
        return texts[kind]

    return page


@pytest.fixture(scope="module")
def open_tab():
    with chromium_at_real_speed((4400, SCREEN)) as open_tab:
        yield open_tab


@pytest.mark.soak
@pytest.mark.parametrize(
    "kind", [pytest.param(x, marks=[pytest.mark.counts] * (x not in SEEN)) for x in PAGES]
)
def test_no_text_of_a_page_lies_on_another(open_tab, pages, kind, tmp_path):
    told = told_in_a_tab(open_tab, pages(kind), tmp_path)

    for width in (WIDE, DESK, PHONE):
        assert told[width]["overlaps"] == [], width
        assert told[width]["wide"] == [], width


@pytest.mark.soak
def test_a_text_on_another_is_seen(chromium, tmp_path):
    told = told_at_widths(chromium, TWICE, tmp_path)

    assert [told[width]["overlaps"] for width in (WIDE, DESK, PHONE)] == [[["one", "two"]]] * 3


@pytest.mark.counts
def test_the_claim_of_a_mission_is_a_list_of_sentences(pages):
    (claim,) = re.findall(r'id="claim".*?<ul class="note">(.*?)</ul>', pages("mission"), re.DOTALL)
    sentences = re.findall(r"<li>(.*?)</li>", claim)

    assert len(sentences) >= 8
    for sentence in sentences:
        assert re.match(r"[^a-z]", sentence), sentence
        assert sentence.endswith("."), sentence
        assert not re.search(r"\. [A-Z]", sentence), sentence


@pytest.mark.soak
def test_no_table_of_a_comparison_scrolls_on_a_tablet(pages, tmp_path):
    (tmp_path / "page.html").write_text(pages("comparison"), encoding="utf-8")
    with (
        chromium_at_real_speed((768, 1000)) as open_tab,
        open_tab((tmp_path / "page.html").as_uri()) as tab,
    ):
        tab.until("document.readyState === 'complete'")
        tab.run("document.querySelectorAll('details').forEach(e => { e.open = true })")
        widths = (
            "[...document.querySelectorAll('.scroll')].map(e => [e.scrollWidth, e.clientWidth])"
        )
        tables = tab.run(widths)
    assert len(tables) >= 2
    assert [whole for whole, shown in tables if whole > shown] == []


@pytest.mark.counts
def test_no_two_lines_of_a_chart_on_the_page_of_a_mission_look_alike(pages):
    for names in re.findall(r"<figcaption>(.*?)</figcaption>", pages("mission"), re.DOTALL):
        signs = re.findall(r"<svg class=\"swatch.*?</svg>", names, re.DOTALL)
        assert len({*signs}) == len(signs), names
