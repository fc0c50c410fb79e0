"""Every claim of the paper has its verdict and the numbers that decide it."""

import re
from collections import Counter
from pathlib import Path

import pytest
from commands import flighttune
from places import ROOT

pytestmark = pytest.mark.slow

COMPUTED = 2e-4
"""Relative, of numbers of an optimiser and of integrated flights."""

TABLE = Path(__file__).with_name("verdicts.txt").read_text("utf-8").splitlines()
VERDICTS = {name: row for name, *row in (line.split(" | ") for line in TABLE)}
LATER = {"converges-with-all-limits", "global-stabilisation", "overall-enhancement"}
"""Claims whose flights take seconds: with rate limits, without limits, and of an aircraft."""


def beside(name):
    """Claims that are judged together with one, by what they need."""
    if name in LATER:
        return (name,)
    kinds = [*VERDICTS].index("duffing-condition"), [*VERDICTS].index("small-region")
    groups = [
        [x for k, x in enumerate(VERDICTS) if (k >= kinds[0]) + (k >= kinds[1]) == n]
        for n in range(3)
    ]
    (group,) = (x for x in groups if name in x)
    return tuple(x for x in group if x not in LATER)


def near(words):
    try:
        return pytest.approx(float(words), rel=COMPUTED, abs=1e-6)
    except ValueError:
        return words


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.soak] * (x in LATER)) for x in VERDICTS]
)
def test_a_claim_is_judged_by_what_was_computed(make, name):
    verdict, *computed = VERDICTS[name]

    claim = make(*beside(name)).claims[name]

    assert claim["verdict"] == verdict
    if verdict == "not checkable":
        assert [*claim["computed"]] == ["missing"]
        return
    assert [*claim["computed"].values()] == [near(x) for x in computed]
    assert claim["expected"].keys() == claim["computed"].keys()
    holds = [_holds(claim["expected"][x], y) for x, y in claim["computed"].items()]
    if None not in holds:
        kind = {(True,): "reproduced", (False,): "not reproduced"}
        assert verdict == kind.get(tuple({*holds}), "partly")


def _holds(expected, computed):
    """Whether a number keeps a limit that is told as a sign and a number; None for other words."""
    found = re.fullmatch(r"([≤≥<>]) (-?[\d.e-]+)", str(expected))
    if not found or isinstance(computed, str):
        return None
    limit = float(found[2])
    if computed == pytest.approx(limit, rel=1e-3, abs=1e-6):  # what decides is no digit of these
        return None
    return computed <= limit if found[1] in "≤<" else computed >= limit


def test_the_claims_that_are_named_are_judged_alone_and_all_are_counted_in_the_readme(make):
    made = make("lemma-2", "peak-time")

    assert [*made.claims] == ["lemma-2", "peak-time"]
    assert made.answer["items"] == []
    assert made.answer["errata"] is None
    page = (made.folder / "index.html").read_text("utf-8")
    assert page.index('id="claim-peak-time"') < page.index('id="claim-lemma-2"')
    counted = Counter(verdict for verdict, *_ in VERDICTS.values())
    said = re.search(
        r"Of its (\d+) claims, (\d+) are reproduced, (\d+) partly, (\d+) are not, and (\d+) cannot",
        (ROOT / "README.md").read_text("utf-8"),
    )
    kinds = ("reproduced", "partly", "not reproduced", "not checkable")
    assert [int(x) for x in said.groups()] == [len(VERDICTS), *(counted[x] for x in kinds)]


def test_an_unknown_item_is_refused_with_those_there_are(here_alone):
    for typed, words in (("fig11", "fig1, gains, fig2"), ("lema-2", "did you mean lemma-2?")):
        out, err = flighttune("reproduce", typed, "--out", "o", status=2)
        assert out == ""
        assert words in err
        assert err.count("\n") == 1
    assert not [*here_alone.iterdir()]


@pytest.fixture
def here_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path
