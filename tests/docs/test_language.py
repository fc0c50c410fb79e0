"""README and docs: readable numbers, whole sentences, one name for one thing."""

import re

import pytest
from places import ROOT

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("README.md", "docs/*.md", "scenarios/README.md", "aircraft/*/README.md")
    for path in ROOT.glob(pattern)
)

MAX_DIGITS = 5
DIGITS_TO_CHECK = (
    "docs/optimal.md",  # a reader compares them with formulas
    "docs/hangar.md",  # messages as they were printed
    "docs/errata.md",  # made by `flighttune reproduce`
)
DECIMAL = re.compile(r"(?<![\w./:-])-?\d+\.\d+(?:e[+-]?\d+)?(?![\w.]*\d)")
MACHINE_EXPONENT = re.compile(r"\b\d[\d.]*e-0\d\b")

WORDS = {
    r"\bodds\b": "probability",
    r"not quite (yours|that)": "varied aircraft",
    r"(law|law that is) flown by default": "default law",
    r"flown by default": "the default is",
    r"\b[Aa]ircraft that (are off|differ)\b": "varied or off-nominal aircraft",
    r"what is off\b": "off-nominal",
    r"law that is flown\b": "default law",
    r"a stranger\b": "anyone",
    r"a poor flight\b": "a lower bound on an error",
    r"\b(Not asked is|Nearest to it|Of what the|Those of|Of those)\b": "the subject first",
    r"\b(whoever|theirs|so that that|that of those)\b": "a noun",
    r"\bin gaps\b": "with gaps of",
    r"\bworked off\b": "decays",
    r"does not carry\b": "makes unstable",
}
"""Words that no reader says, and what to write."""

ARXIV = re.compile(r"\d{4}\.\d{5}")
FORMULA = re.compile(r"(?ms)\n\n(?:^ {4}\S.*?$(?=\n\S|\n\n)|^\$\$$.*?^\$\$$)(?:\n\n(?=[a-z]))?")
FENCE = re.compile(r"(?ms)^ *(```|~~~).*?^ *\1[^\n]*$")
CODE = re.compile(r"`[^`\n]*`|\$[^$\n]+\$|\]\([^)]*\)")
LATE_FRAGMENT = re.compile(r"(?m)^(?:```|~~~)\n\n(?=[a-z]+ [a-z])(.*)$")


def prose(text):
    """A page without the contents of code, formulas and link targets."""
    return CODE.sub("x", FORMULA.sub(" x.\n", FENCE.sub("", text)))


def digits(text):
    """Numbers with more digits than a reader compares, or with the exponent of a machine."""
    shown = CODE.sub("x", text)
    for found in DECIMAL.finditer(shown):
        mantissa = found[0].lower().partition("e")[0]
        if (
            not ARXIV.fullmatch(found[0])
            and len(re.sub(r"\D", "", mantissa).lstrip("0")) > MAX_DIGITS
        ):
            yield found[0]
    yield from MACHINE_EXPONENT.findall(shown)


def fragments(text):
    """Paragraphs without an end, and sentences whose subject is a block of code."""
    for paragraph in re.split(r"\n\s*\n", prose(text)):
        line = paragraph.strip()
        if line[:1].isalpha() and line[-1] not in ".:?!)”*":
            yield line
    yield from LATE_FRAGMENT.findall(text)


def words(text):
    """Words of the list, with what to write."""
    for pattern, better in WORDS.items():
        for found in re.finditer(pattern, prose(text)):
            yield found[0], better


@pytest.mark.parametrize("page", PAGES)
def test_a_page_says_it_in_whole_sentences_and_readable_numbers(page):
    text = (ROOT / page).read_text(encoding="utf-8")

    assert page in DIGITS_TO_CHECK or not [*digits(FENCE.sub("", text))]
    assert not [*fragments(text)]
    assert not [*words(text)]


@pytest.mark.parametrize(
    ("check", "sentence"),
    [
        (digits, "confidence 0.9666666667 (shared by the band and its fence)"),
        (digits, "the error is 1.096e-06 deg"),
        (digits, "from 0.576379 to 1.91281"),
        (fragments, "no claim beyond the end of the scenario: no invariant set found"),
        (fragments, "```sh\nflighttune trim c172p\n```\n\nprints the steady flights."),
        (words, "and 100 % under the law that is flown by default"),
        (words, "on hundreds of aircraft that are\nnot quite yours, in wind"),
        (words, "its corridor, the odds of leaving the fence"),
        (words, "a proof that a stranger can check, or why there is none"),
        (words, "Nearest to it, 455.2 m, it comes on the loiter at item 3."),
        (words, "Not asked is a channel with a lower bound, which a poor flight meets."),
        (words, "Of what the aircraft lacks of the commands a part is added."),
        (words, "missing: in gaps, chi: 5.8% of the time"),
    ],
)
def test_the_check_finds_what_pages_once_said(check, sentence):
    assert [*check(sentence)]
