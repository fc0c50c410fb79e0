"""Tables of numbers in the docs have the command or script beside them that makes them."""

import math
import re
from functools import cache

import pytest
from places import ROOT

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("README.md", "docs/*.md", "scenarios/**/README.md", "aircraft/*/README.md")
    for path in ROOT.glob(pattern)
)

# What makes numbers: a command, a script of ours, a test target, or a call from Python.
MAKER = re.compile(
    r"\bflighttune [a-z]+|\bpython ((?:docs/figures|benchmarks|scenarios)/\w+\.py)|\bmake [a-z]+|"
    r"`tests/\w+|\bft\.[a-z_.]+\("
)
CODE_OR_LINK = re.compile(r"`[^`]*`|\[[^\]]*\]\([^)]*\)")


@cache
def sections(page):
    """Parts of a page from heading to heading; the first is its head."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.split(r"(?m)^(?=##+ )", text)


def numbers_in(row):
    return re.search(r"\d", CODE_OR_LINK.sub("", row))


@pytest.mark.parametrize("page", PAGES)
def test_a_table_of_numbers_has_its_maker_in_its_section(page):
    whole = re.search(r"makes this file|page is made|like this page by", "".join(sections(page)))
    for part in sections(page):
        rows = [line for line in part.splitlines() if line.startswith("|") and numbers_in(line)]
        maker = MAKER.search(part) or whole
        assert maker or not rows, f"{page}, {part.splitlines()[0]}: what makes {rows[0]}"


def test_every_script_that_a_page_names_is_there():
    named = {
        found[1] for page in PAGES for part in sections(page) for found in MAKER.finditer(part)
    }

    missing = [script for script in named - {None} if not (ROOT / script).is_file()]
    assert len(named) > 10
    assert not missing


def test_a_count_that_supports_one_in_ten_thousand_has_as_many_flights_as_the_page_says():
    (said,) = re.findall(r"1e-4 from ([\d ]+) flights", "".join(sections("docs/which_bound.md")))

    # (1 - 1e-4)^n <= 0.05 with none outside
    assert int(said.replace(" ", "")) == math.ceil(math.log(0.05) / math.log1p(-1e-4))
