"""The documentation site: built without a warning, whole, and true."""

import html.parser
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest
from browser import headless_chromium
from site_reference import public_names

import flighttune as ft

pytestmark = pytest.mark.soak

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    out = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    done = subprocess.run(
        [*build, "-c", "docs", ".", str(out)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return out


class Page(html.parser.HTMLParser):
    """Anchors of a page, and what it points to."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.links = set(), []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.anchors.update(filter(None, (values.get("id"), values.get("name"))))
        self.links += [values[key] for key in ("href", "src") if values.get(key)]


def test_every_link_within_the_site_leads_somewhere(site):
    pages = {path: Page(path.read_text()) for path in site.rglob("*.html")}
    assert len(pages) > 40
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link.startswith("data:"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.exists(), f"{path.name}: {link}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].anchors, f"{path.name}: {link}"


def test_nothing_is_loaded_from_a_network(site):
    for path in site.rglob("*.html"):
        text = path.read_text()
        loaded = re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(https?:[^"]*)"', text)
        assert not loaded, path


def test_every_public_name_is_in_the_reference_and_found_by_the_search(site):
    pages = [path.read_text() for path in (site / "docs" / "api").glob("*.html")]
    anchors = set().union(*(Page(page).anchors for page in pages))
    index = (site / "searchindex.js").read_text().lower()
    for name in public_names():
        assert f"flighttune.{name}" in anchors, name
        assert name.rpartition(".")[2].lower() in index, name
    private = r"flighttune\.(?!compiled\.|gym\.|loop\.)[a-z_]+\.[\w.]+"
    assert not [path for page in pages for path in re.findall(private, page)]


@pytest.mark.counts
@pytest.mark.parametrize(
    ("words", "page", "excerpt"),
    [
        ("overshoot", "scenarios/README.html", "beyond the reference"),
        ("requirement", "scenarios/README.html", "must achieve"),
        ("own aircraft", "docs/aircraft.html", "flighttune adopt"),
        ("ft.fly", "docs/api/flights.html", "every gain set"),
        ("whole manoeuvre", "docs/tube.html", "tube"),
    ],
)
def test_the_search_puts_what_explains_a_word_first_without_a_server(site, words, page, excerpt):
    asked = f"{(site / 'search.html').as_uri()}?q={quote(words)}"

    shown = headless_chromium()("--dump-dom", asked)

    results = re.findall(r"<li.*?</li>", shown.partition('class="search"')[2], re.DOTALL)
    assert f'href="{page}' in results[0]
    assert excerpt in re.sub(r"<[^>]*>|\s+", " ", results[0]).replace("  ", " ")
    assert all('class="context"' in result for result in results[:10])


@pytest.mark.counts
@pytest.mark.parametrize("left_out", ["tube", pytest.param("nothing", marks=pytest.mark.counts)])
def test_no_key_or_column_that_is_documented_is_lost(left_out):
    """A tube takes half of the time that all commands take."""
    from figures import formats

    def entries(text):
        under, found = "", set()
        for line in text.splitlines():
            under = line if line.startswith("#") else under
            if line.startswith("| "):
                found.update((under, name) for name in re.findall(r"`[^`]+`", line))
        return found

    made = formats.pages([line for line in formats.COMMANDS if not line.startswith(left_out)])
    for file, text in zip((formats.PAGE, formats.KEYS), made, strict=True):
        lost = entries(file.read_text()) - entries(text)
        assert {under for under, _ in lost} <= {f"### flighttune {left_out} paper"}


def test_other_programs_read_our_flights_as_the_page_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ft.record(ft.fly(ft.load_scenario("paper")), "runs/paper", name="paper")
    page = (ROOT / "docs" / "reading.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "reading.md", "exec"), {})
        assert "chi_err" in capsys.readouterr().out
